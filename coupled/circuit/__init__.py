"""Circuits of several rings on one chip, coupled by light in waveguides and by heat."""

from .circuit import Circuit, Detector, LaserPort, Splitter, Waveguide, bus, crow, scissor

__all__ = [
    "Circuit", "Detector", "LaserPort", "Splitter", "Waveguide", "bus", "crow", "scissor",
]  # fmt: skip
