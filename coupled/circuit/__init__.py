"""Several rings on one chip: light along waveguides and heat between neighbours."""

from .circuit import Circuit, Detector, LaserPort, Splitter, Waveguide
from .ready import bus, crow, scissor

__all__ = [
    "Circuit", "Detector", "LaserPort", "Splitter", "Waveguide", "bus", "crow", "scissor",
]  # fmt: skip
