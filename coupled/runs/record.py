"""Contents of the Dataset of a run: traces in SI and provenance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from thermofem.arrays import Array

from ..inputs import pieces
from ..resonator import RingResonator, origin
from .window import Window


def provenance(ring: RingResonator, light: dict[str, Any], duration: float) -> dict[str, Any]:
    """Attributes of every run: ring and laser."""
    return {
        **origin("coupled", ring),
        **{name: value for name, value in light.items() if isinstance(value, float)},
        "duration": float(duration),
    }


def traces(ring: RingResonator, run: Window, light: dict[str, Any]) -> dict[str, Array]:
    """All time traces of a run, in SI."""
    U = np.abs(run.field) ** 2
    stop = max(float(run.reached), float(run.time.max(initial=0.0)))
    at = {
        name: np.full(run.time.size, value) if isinstance(value, float) else pieces(name, value, 0.0, stop)(run.time)
        for name, value in light.items()
    }
    traces = {
        "energy": U,
        "carriers": run.carriers,
        "delta_T": run.delta_T,
        "drop": 2 * ring.drop_bus_rate * U,
        "through": np.abs(np.sqrt(np.maximum(at["input_power"], 0)) + 1j * math.sqrt(2 * ring.bus_rate) * run.field)
        ** 2,
        "absorbed": run.absorbed,
    }
    if ring.scattering_rate > 0:
        traces["scattered"] = 2 * ring.scattering_rate * U
    return traces | {name: at[name] for name, value in light.items() if not isinstance(value, float)}
