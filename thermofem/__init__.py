"""Self-heating of silicon microring resonators: cross-section to training data."""

from . import checks, dataset, waveforms
from .checks import InputError, MissingLibraryError
from .dataset import load, save
from .geometry import Boundary, CrossSection, Interface, Layer, Part, strip_ring
from .heat import Discretization, HeatProblem, assemble, discretize
from .mesh import Mesh
from .model import Foster, StateSpace, ThermalModel
from .solve import solve, solve_periodic
from .waveforms import Chirp, Constant, Pulse, Sampled, SquareWave, Telegraph, Waveform

__version__ = "0.1.0"

__all__ = [
    "Boundary",
    "Chirp",
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
    "Telegraph",
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
