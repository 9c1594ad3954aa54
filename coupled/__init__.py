"""Optics, free carriers and heat of a silicon ring together: time traces and self-pulsing."""

from .carriers import ShockleyReadHall
from .parameters.borghi2021 import borghi2021
from .pulsing import Pulsing, Regime, pulsing
from .resonator import RingResonator
from .simulate import simulate
from .tableaus import Method

__all__ = [
    "Method",
    "Pulsing",
    "Regime",
    "RingResonator",
    "ShockleyReadHall",
    "borghi2021",
    "pulsing",
    "simulate",
]
