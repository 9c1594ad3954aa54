"""Several rings on one chip: light along waveguides and heat between neighbours."""

from .circuit import Circuit
from .cycle import circuit_limit_cycle
from .equilibria import circuit_steady_states
from .parts import Detector, LaserPort, Splitter, Waveguide
from .ready import bus, crow, delay_loop, scissor
from .spectrum import spectrum

__all__ = [
    "Circuit", "Detector", "LaserPort", "Splitter", "Waveguide", "bus", "circuit_limit_cycle",
    "circuit_steady_states", "crow", "delay_loop", "scissor", "spectrum",
]  # fmt: skip
