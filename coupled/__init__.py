"""Simulation of silicon rings with light, free carriers and heat: time traces, self-pulsing and its bifurcations."""

from . import noise, ring_family  # noqa: F401 - as coupled.noise, coupled.ring_family
from .carriers import ConstantLifetime, ShockleyReadHall
from .circuit import (
    Circuit,
    Detector,
    LaserPort,
    Splitter,
    Waveguide,
    bus,
    crow,
    scissor,
)
from .cycles import cycle_folds, derivatives  # noqa: F401 - as coupled.cycles.derivatives
from .cycles.limit_cycle import continue_cycle, limit_cycle
from .equilibria.bifurcation_curves import fold_curves, hopf_curves
from .equilibria.linear_response import Linear
from .equilibria.linear_ring import linearize
from .equilibria.steady_states import steady_states
from .equilibria.transmission import transmission
from .explore import explore
from .export.export_ring import export_ring
from .identification import newton_traces  # noqa: F401 - as coupled.identification.newton_traces
from .identification.identify import identify
from .inputs import Sweep
from .loop.corrector import FEM
from .loop.cosimulate import cosimulate
from .maps.pulsing_map import pulsing_map
from .maps.stability_map import stability_map
from .parameters import borghi2021, vanvaerenbergh2012
from .resistive_heaters import Amperes, Volts
from .resonator import RingResonator
from .ring_from import ring_from
from .runs.pulsing import pulsing
from .runs.simulate import simulate
from .runs.window import Event, Laser
from .states import State
from .sweeps.fit_transmission import fit_transmission

__all__ = [
    "FEM", "Amperes", "Circuit", "ConstantLifetime", "Detector", "Event", "Laser", "LaserPort", "Linear",
    "RingResonator", "ShockleyReadHall", "Splitter", "State", "Sweep", "Volts", "Waveguide", "borghi2021", "bus",
    "continue_cycle", "cosimulate", "crow", "explore", "export_ring", "fit_transmission", "fold_curves", "hopf_curves",
    "identify", "limit_cycle", "linearize", "pulsing", "pulsing_map", "ring_from", "scissor", "simulate",
    "stability_map", "steady_states", "transmission", "vanvaerenbergh2012",
]  # fmt: skip
