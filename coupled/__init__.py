"""Optics, free carriers and heat of a silicon ring together: time traces and self-pulsing."""

from .carriers.lifetime import ConstantLifetime
from .carriers.pump_probe import CarrierFit, carrier_decay, fit_carrier_decay
from .carriers.shockley_read_hall import ShockleyReadHall
from .circuit import (
    Circuit,
    Detector,
    LaserPort,
    Splitter,
    Waveguide,
    bus,
    crow,
    delay_loop,
    scissor,
)
from .cycles.continue_cycle import continue_cycle
from .cycles.cycle_folds import cycle_fold_curves
from .cycles.derivatives import cycle_derivatives
from .cycles.limit_cycle import limit_cycle
from .equilibria.bifurcation_curves import fold_curves, hopf_curves
from .equilibria.steady_states import steady_states
from .equilibria.transmission import power_for_drop, sweep, transmission
from .equilibria.van_vaerenbergh import van_vaerenbergh_q
from .explore.page import explore
from .identification.identify import Identification, identify
from .identification.newton_traces import fit_newton_per_trace
from .inputs import Sweep
from .kernel.tableaus import Method
from .loop.corrector import FEM, Corrector
from .loop.cosimulate import NO_PREDICTOR, cosimulate
from .maps.pulsing_map import overlap, pulsing_map
from .maps.stability_map import stability_map
from .noise import frequency_noise, intensity_noise
from .parameters.borghi2021 import borghi2021
from .parameters.vanvaerenbergh2012 import vanvaerenbergh2012
from .resonator import RingResonator
from .ring_from import MadeRing, ring_from
from .runs.lasers import Laser
from .runs.pulsing import Pulsing, Regime, pulsing
from .runs.simulate import simulate
from .runs.window import Event
from .states import State

__all__ = [
    "FEM", "NO_PREDICTOR", "CarrierFit", "Circuit", "ConstantLifetime", "Corrector", "Detector", "Event",
    "Identification", "Laser", "LaserPort", "MadeRing", "Method", "Pulsing", "Regime", "RingResonator",
    "ShockleyReadHall", "Splitter", "State", "Sweep", "Waveguide", "borghi2021", "bus", "carrier_decay",
    "continue_cycle", "cosimulate", "crow", "cycle_derivatives", "cycle_fold_curves",
    "delay_loop", "explore", "fit_carrier_decay", "fit_newton_per_trace", "fold_curves", "frequency_noise",
    "hopf_curves", "identify", "intensity_noise", "limit_cycle", "overlap", "power_for_drop", "pulsing", "pulsing_map",
    "ring_from", "scissor", "simulate", "stability_map", "steady_states", "sweep", "transmission", "van_vaerenbergh_q",
    "vanvaerenbergh2012",
]  # fmt: skip
