"""Self-heating of silicon microring resonators: cross-section to training data."""

from typing import Any as _Any

from . import checks, dataset, model, waveforms
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
    "Boundary",
    "Campaign",
    "Chirp",
    "Constant",
    "CrossSection",
    "Discretization",
    "Foster",
    "Function",
    "HeatProblem",
    "InputError",
    "Interface",
    "Layer",
    "Material",
    "Mesh",
    "MissingLibraryError",
    "OutputMap",
    "OutsideTrainingWarning",
    "Part",
    "PiecewiseCubic",
    "Polynomial",
    "PowerLaw",
    "Probe",
    "Pulse",
    "Quadratic",
    "Sampled",
    "SquareWave",
    "StateSpace",
    "Symbols",
    "Table",
    "Telegraph",
    "ThermalModel",
    "Waveform",
    "assemble",
    "checks",
    "dataset",
    "derivatives",
    "disc",
    "discretize",
    "from_gdsfactory",
    "heated_ring",
    "load",
    "model",
    "open_campaign",
    "read_csv",
    "rib_ring",
    "save",
    "silicon_film",
    "solve",
    "solve_periodic",
    "strip_ring",
    "waveforms",
    "write_fields",
]


_RENAMED = {"Power": "PowerLaw"}  # old name -> new name; the old names go with the next release


def __getattr__(name: str) -> _Any:
    """Return a waveform that joined by its file alone, or an object by its old name, with a warning."""
    if name in _RENAMED:
        import warnings

        warnings.warn(f"thermofem.{name} is now thermofem.{_RENAMED[name]}", DeprecationWarning, stacklevel=2)
        return globals()[_RENAMED[name]]
    if name in waveforms.KINDS:
        return waveforms.KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
