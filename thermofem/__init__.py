"""Self-heating of silicon microring resonators: cross-section to training data."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from .version import __version__ as __version__

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
    from . import checks, dataset, materials, model, waveforms
    from .campaign import Campaign, open_campaign
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
    from .heat.derivatives import derivatives
    from .materials import Material, Polynomial, PowerLaw, Table, silicon_film
    from .mesh import Mesh
    from .models import Foster, OutputMap, OutsideTrainingWarning, Quadratic, StateSpace, ThermalModel
    from .solving import solve, solve_periodic
    from .tables import read_csv
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

# module -> its public names, imported at their first use: a command starts with what it needs
_HOMES = {
    ".campaign": "Campaign open_campaign",
    ".checks": "InputError MissingLibraryError",
    ".dataset": "load save",
    ".fields": "write_fields",
    ".geometry": "Boundary CrossSection Interface Layer Part Probe disc from_gdsfactory heated_ring rib_ring "
    "strip_ring",
    ".heat": "Discretization HeatProblem assemble discretize",
    ".heat.derivatives": "derivatives",
    ".materials": "Material Polynomial PowerLaw Table silicon_film",
    ".mesh": "Mesh",
    ".models": "Foster OutputMap OutsideTrainingWarning Quadratic StateSpace ThermalModel",
    ".solving": "solve solve_periodic",
    ".tables": "read_csv",
    ".waveforms": "Chirp Constant Function PiecewiseCubic Pulse Sampled SquareWave Symbols Telegraph Waveform",
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names.split()}
_RENAMED = {"Power": "PowerLaw"}  # old name -> new name; the old names go with 0.3


def __getattr__(name: str) -> _Any:
    """Import a name at its first use, find a waveform added as a file, or warn of an old name and return its object."""
    if name in _RENAMED:
        _import_module(".renamed", __name__).warn(f"thermofem.{name}", f"thermofem.{_RENAMED[name]}")
        name = _RENAMED[name]
    if name in _MODULES:
        found = globals()[name] = getattr(_import_module(_MODULES[name], __name__), name)
        return found
    if not name.startswith("_"):
        try:
            return _import_module(f".{name}", __name__)
        except ModuleNotFoundError as error:
            if error.name != f"{__name__}.{name}":
                raise
        kinds = _import_module(".waveforms", __name__).KINDS
        if name in kinds:
            return kinds[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """All public names, imported or not."""
    return sorted({*globals(), *__all__})
