"""Self-heating of silicon microring resonators: cross-section to training data."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from . import checks, dataset, materials, model, waveforms
from .checks import InputError, MissingLibraryError
from .dataset import load, save
from .fields import write_fields
from .geometry import (
    Boundary,
    CrossSection,
    Interface,
    Layer,
    Part,
    Probe,
    disc,
    from_gdsfactory,
    heated_ring,
    rib_ring,
    strip_ring,
)
from .heat import Discretization, HeatProblem, assemble, discretize
from .materials import Material, Polynomial, PowerLaw, Table, silicon_film
from .mesh import Mesh
from .models import Foster, OutputMap, OutsideTrainingWarning, Quadratic, StateSpace, ThermalModel
from .renamed import warn as _warn
from .solve import solve, solve_periodic
from .tables import read_csv
from .version import __version__ as __version__
from .waveforms import (
    Chirp,
    Constant,
    Function,
    PiecewiseCubic,
    Pulse,
    Sampled,
    SquareWave,
    Symbols,
    Telegraph,
    Waveform,
)

__all__ = [
    "Boundary", "Campaign", "Chirp", "Constant", "CrossSection", "Discretization", "Foster", "Function",
    "HeatProblem", "InputError", "Interface", "Layer", "Material", "Mesh", "MissingLibraryError", "OutputMap",
    "OutsideTrainingWarning", "Part", "PiecewiseCubic", "Polynomial", "PowerLaw", "Probe", "Pulse", "Quadratic",
    "Sampled", "SquareWave", "StateSpace", "Symbols", "Table", "Telegraph", "ThermalModel", "Waveform", "assemble",
    "checks", "dataset", "derivatives", "disc", "discretize", "from_gdsfactory", "heated_ring", "load", "materials",
    "model", "open_campaign", "read_csv", "rib_ring", "save", "silicon_film", "solve", "solve_periodic", "strip_ring",
    "waveforms", "write_fields",
]  # fmt: skip


if _TYPE_CHECKING:
    from .campaign import Campaign, open_campaign
    from .heat.derivatives import derivatives

# name -> module, imported when first used: processes of a campaign and derivatives cost time that few runs need
_LATE = {"Campaign": ".campaign", "open_campaign": ".campaign", "derivatives": ".heat.derivatives"}
_RENAMED = {"Power": "PowerLaw"}  # old name -> new name; the old names go with 0.3


def __getattr__(name: str) -> _Any:
    """Import a late name, find a waveform added as a file, or return the object of an old name with a warning."""
    if name in _LATE:
        return getattr(_import_module(_LATE[name], __name__), name)
    if name in _RENAMED:
        _warn(f"thermofem.{name}", f"thermofem.{_RENAMED[name]}")
        return globals()[_RENAMED[name]]
    if name in waveforms.KINDS:
        return waveforms.KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """All public names, imported or not."""
    return sorted({*globals(), *__all__})
