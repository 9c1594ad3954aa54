"""Optics, free carriers and heat of a silicon ring together: time traces and self-pulsing."""

from .boundaries import fold_curves, hopf_curves
from .carriers import ShockleyReadHall
from .maps import overlap, pulsing_map
from .parameters.borghi2021 import borghi2021
from .pulsing import Pulsing, Regime, pulsing
from .resonator import RingResonator
from .simulate import simulate
from .stability import stability_map
from .steady import steady_states
from .tableaus import Method

__all__ = [
    "Method",
    "Pulsing",
    "Regime",
    "RingResonator",
    "ShockleyReadHall",
    "borghi2021",
    "fold_curves",
    "hopf_curves",
    "overlap",
    "pulsing",
    "pulsing_map",
    "simulate",
    "stability_map",
    "steady_states",
]
