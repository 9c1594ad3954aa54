"""Measures of a closed orbit: duty cycle, swing, extinction, and the rate at which the ring settles on it.

    duty = share of the period with P_drop above min + 0.45 (max - min),       extinction = 10 log10(max/min)

Extremes are where dU/dt and d(dT)/dt vanish, which the equations tell from the states; crossings of a level are where
the collocation polynomials meet it. Both by bisection.

Source of the duty cycle: Borghi et al., Opt. Express 29, 4363 (2021), caption of Fig. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray

from ..runs.pulsing import DUTY_LEVEL
from .orbit import CycleProblem, Orbit
from .scheme import scheme

BETWEEN = 4  # points for every stage where extremes and crossings are looked for
ENERGY, HEAT = 0, 2  # columns of `orbit_mesh.look`, each with its slope behind it


class Measures(NamedTuple):
    """Numbers of an orbit, and the fractions of the period at which they are taken."""

    duty: float
    swing: float  # K
    extinction: float  # dB
    lowest: float  # of U, fJ
    highest: float
    crossings: Array  # of the level of the duty cycle
    rising: NDArray[np.bool_]
    extremes: Array  # where U is lowest and highest, where dT is
    hottest: float  # K


def measure(p: CycleProblem, orbit: Orbit) -> Measures:
    """Measure an orbit."""
    grid = np.append(_fine(orbit), 1.0)
    seen = _look(p, orbit, grid)
    ends = [_extremes(p, orbit, grid, seen, column) for column in (ENERGY, HEAT)]
    (low_at, low, high_at, high), (cold_at, cold, hot_at, hot) = ends
    level = low + DUTY_LEVEL * (high - low)
    above = seen[:, ENERGY] > level
    edges = np.flatnonzero(above[1:] != above[:-1])
    crossings = _passes(p, orbit, grid, seen, ENERGY, level)
    rising = above[edges + 1]
    if crossings.size == 0:
        duty = float(above.all())
    else:
        duty = float(np.sum(np.where(rising, -crossings, crossings)) + above[0])
    return Measures(
        duty, hot - cold, 10 * np.log10(high / low) if low > 0 else np.inf, low, high, crossings, rising,
        np.array([low_at, high_at, cold_at, hot_at]), hot,
    )  # fmt: skip


def _fine(orbit: Orbit) -> Array:
    """Fractions of the period, ``BETWEEN`` for every stage."""
    parts = np.linspace(0, 1, BETWEEN * orbit.Y.shape[1], endpoint=False)
    return np.asarray((orbit.tau[:-1, None] + np.diff(orbit.tau)[:, None] * parts).ravel())


def _look(p: CycleProblem, orbit: Orbit, at: Array) -> Array:
    from ..kernels import orbit_mesh

    return np.asarray(orbit_mesh.look(orbit.start, orbit.Y, orbit.tau, p.at, scheme(), at))


def _extremes(
    p: CycleProblem, orbit: Orbit, grid: Array, seen: Array, column: int
) -> tuple[float, float, float, float]:
    """Place and value of the minimum of a column, then of its maximum."""
    at = np.concatenate([[0.0], _passes(p, orbit, grid, seen, column + 1, 0.0)])
    values = _look(p, orbit, at)[:, column]
    low, high = int(values.argmin()), int(values.argmax())
    return float(at[low]), float(values[low]), float(at[high]), float(values[high])


def _passes(p: CycleProblem, orbit: Orbit, grid: Array, seen: Array, column: int, level: float) -> Array:
    """Where a column passes ``level``."""
    from ..kernels import orbit_mesh

    found = orbit_mesh.passes(orbit.start, orbit.Y, orbit.tau, p.at, scheme(), grid, seen, column, level)
    return np.asarray(found)
