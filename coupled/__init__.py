"""Optics, free carriers and heat of a silicon ring together: time traces and self-pulsing."""

from .boundaries import fold_curves, hopf_curves
from .carriers import ShockleyReadHall
from .corrector import FEM, Corrector
from .cosimulate import NO_PREDICTOR, cosimulate
from .identify import Identification, identify
from .inputs import Sweep
from .lifetime import ConstantLifetime
from .maps import overlap, pulsing_map
from .newton_traces import fit_newton_per_trace
from .parameters.borghi2021 import borghi2021
from .pulsing import Pulsing, Regime, pulsing
from .pump_probe import CarrierFit, carrier_decay, fit_carrier_decay
from .resonator import RingResonator
from .simulate import simulate
from .stability import stability_map
from .states import State
from .steady import steady_states
from .tableaus import Method
from .transmission import power_for_drop, sweep, transmission
from .weight import van_vaerenbergh_q
from .window import Event

__all__ = [
    "FEM",
    "NO_PREDICTOR",
    "CarrierFit",
    "ConstantLifetime",
    "Corrector",
    "Event",
    "Identification",
    "Method",
    "Pulsing",
    "Regime",
    "RingResonator",
    "ShockleyReadHall",
    "State",
    "Sweep",
    "borghi2021",
    "carrier_decay",
    "cosimulate",
    "fit_carrier_decay",
    "fit_newton_per_trace",
    "fold_curves",
    "hopf_curves",
    "identify",
    "overlap",
    "power_for_drop",
    "pulsing",
    "pulsing_map",
    "simulate",
    "stability_map",
    "steady_states",
    "sweep",
    "transmission",
    "van_vaerenbergh_q",
]
