"""Heat and light on the cross-section of a silicon microring resonator."""

from . import checks, materials, waveforms
from .campaign import Campaign, open_campaign
from .checks import InputError, MissingLibraryError
from .data import dataset
from .data.dataset import load, save
from .data.fields import write_fields
from .data.measured_trace import read_trace
from .fem import Discretization, HeatProblem, assemble, discretize
from .fem.derivatives import derivatives
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
    straight_guide,
    strip_ring,
)
from .materials import Material, Polynomial, PowerLaw, Table, silicon_film
from .mesh import Mesh
from .models import Foster, OutputMap, OutsideTrainingWarning, Quadratic, StateSpace, ThermalModel
from .optics import Light, light
from .readout import MZI, RingEdge
from .solving import solve, solve_periodic
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
    "MZI", "Boundary", "Campaign", "Chirp", "Constant", "CrossSection", "Discretization", "Foster", "Function",
    "HeatProblem", "InputError", "Interface", "Layer", "Light", "Material", "Mesh", "MissingLibraryError",
    "OutputMap", "OutsideTrainingWarning", "Part", "PiecewiseCubic", "Polynomial", "PowerLaw", "Probe", "Pulse",
    "Quadratic", "RingEdge", "Sampled", "SquareWave", "StateSpace", "Symbols", "Table", "Telegraph", "ThermalModel",
    "Waveform", "assemble", "checks", "dataset", "derivatives", "disc", "discretize", "from_gdsfactory",
    "heated_ring", "light", "load", "materials", "open_campaign", "read_trace", "rib_ring", "save", "silicon_film",
    "solve", "solve_periodic", "straight_guide", "strip_ring", "waveforms", "write_fields",
]  # fmt: skip
