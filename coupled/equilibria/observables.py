"""What is seen of fixed points, in SI, and where the numbers of a Dataset come from."""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem.arrays import Array

from ..kernel.units import DENSITY, FJ, NS, UW
from ..resonator import RingResonator, origin
from ..thermal import Compact, attributes
from .balance import InternalRing, balance
from .spectrum import eigenvalues, kinds, leading


def observables(ring: RingResonator, at: InternalRing, U: Array, D: Array, powers: Array) -> dict[str, Any]:
    """Energy, carriers, rise, port powers and stability at fixed points (U, D; internal units), by name, in SI."""
    here = balance(U, at)
    growth, omega, growing = leading(eigenvalues(U, D, at))
    coupling, dropped = 2 * ring.bus_rate * NS, 2 * ring.drop_bus_rate * NS
    return {
        "energy": U * FJ,
        "carriers": here.N * DENSITY,
        "delta_T": here.dT,
        "drop": dropped * U * UW,
        "through": powers * np.abs(1 - coupling / (here.gamma - 1j * D)) ** 2,
        "absorbed": here.P_abs * UW,
        "growth_rate": growth / NS,
        "frequency": omega / (2 * np.pi * NS),
        "regime": kinds(omega, growing),
    }


def provenance(kind: str, ring: RingResonator, model: Compact) -> dict[str, Any]:
    """Attributes of a Dataset: its kind, the ring and the thermal network."""
    return origin(kind, ring) | attributes(model)
