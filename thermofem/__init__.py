"""Self-heating of silicon microring resonators: cross-section to training data."""

from . import checks, waveforms
from .model import Foster, StateSpace, ThermalModel
from .waveforms import Constant, Pulse, Sampled, SquareWave

__version__ = "0.1.0"
