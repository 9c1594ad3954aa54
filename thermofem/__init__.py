"""Heat and light on the cross-section of a silicon microring resonator."""

__version__ = "0.4.0"  # stored in every file, and part of the hash of every campaign result

from . import checks as checks, materials, waveforms as waveforms
from .campaign import Campaign
from .checks import InputError
from .data import (
    dataset,
    fields,  # noqa: F401 - as thermofem.data.fields
)
from .data.dataset import load, save
from .data.measured_trace import read_trace
from .fem import assemble, light
from .fem.heat_derivatives import derivatives
from .fluctuations import thermal_noise
from .function_waveform import Function
from .geometry import (
    Boundary,
    CrossSection,
    Interface,
    Layer,
    Part,
    Probe,
    Shape,
    disc,
    from_gdsfactory,
    heated_ring,
    racetrack,
    read_layout,
    rib_ring,
    straight_guide,
    strip_ring,
)
from .materials import Material
from .models import Foster, OutputMap as OutputMap, Quadratic as Quadratic, StateSpace
from .pulse_trains import Chirp, Symbols, Telegraph
from .readout import MZI, RingEdge
from .solving import solve, solve_periodic
from .waveforms import Constant, Pulse, Sampled, SquareWave

__all__ = [
    "MZI", "Boundary", "Campaign", "Chirp", "Constant", "CrossSection", "Foster", "Function", "InputError",
    "Interface", "Layer", "Material", "Part", "Probe", "Pulse", "RingEdge", "Sampled", "Shape", "SquareWave",
    "StateSpace", "Symbols", "Telegraph", "assemble", "dataset", "derivatives", "disc", "from_gdsfactory",
    "heated_ring", "light", "load", "materials", "racetrack", "read_layout", "read_trace", "rib_ring", "save", "solve",
    "solve_periodic", "straight_guide", "strip_ring", "thermal_noise",
]  # fmt: skip
