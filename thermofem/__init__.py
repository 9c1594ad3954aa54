"""Self-heating of silicon microring resonators: cross-section to training data."""

from . import checks, dataset, waveforms
from .checks import InputError, MissingLibraryError
from .dataset import load, save
from .geometry import Boundary, CrossSection, Interface, Layer, Part, strip_ring
from .heat import Discretization, HeatProblem, assemble, discretize
from .mesh import Mesh
from .model import Foster, StateSpace, ThermalModel
from .solve import solve, solve_periodic
from .waveforms import Constant, Pulse, Sampled, SquareWave, Waveform

__version__ = "0.1.0"

__all__ = [
    "Boundary",
    "Constant",
    "CrossSection",
    "Discretization",
    "Foster",
    "HeatProblem",
    "InputError",
    "Interface",
    "Layer",
    "Mesh",
    "MissingLibraryError",
    "Part",
    "Pulse",
    "Sampled",
    "SquareWave",
    "StateSpace",
    "ThermalModel",
    "Waveform",
    "assemble",
    "checks",
    "dataset",
    "discretize",
    "load",
    "save",
    "solve",
    "solve_periodic",
    "strip_ring",
    "waveforms",
]
