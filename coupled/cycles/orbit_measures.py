"""Measures of a closed orbit: duty cycle, swing, extinction, and the integrals over the period.

    duty = share of the period with P_drop above min + 0.45 (max - min),       extinction = 10 log10(max/min)

Rows are four to each step of a precise trace. Extremes and crossings are those of cubic splines through them.

Source of the duty cycle: Borghi et al., Opt. Express 29, 4363 (2021), caption of Fig. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from thermofem.arrays import Array, NDArray

from ..runs.pulsing import DUTY_LEVEL
from .return_map import PER_STEP, Orbit

BOOLE = np.array([7, 32, 12, 32, 7]) / 90  # weights of five rows of a step, of its length


class Measures(NamedTuple):
    """Numbers of an orbit, and the times in ns at which they are taken."""

    duty: float
    swing: float  # K
    extinction: float  # dB
    lowest: float  # of U, fJ
    highest: float
    hottest: float  # K
    crossings: Array  # of the level of the duty cycle
    rising: NDArray[np.bool_]
    extremes: Array  # where U is lowest and highest, where dT is


def measure(orbit: Orbit) -> Measures:
    """Measure an orbit of one ring."""
    t, energy, dT = periodic_rows(orbit)
    U, heat = CubicSpline(t, energy), CubicSpline(t, dT)
    low_at, low, high_at, high = _extremes(U, t)
    cold_at, cold, hot_at, hot = _extremes(heat, t)
    crossings = np.asarray(U.solve(low + DUTY_LEVEL * (high - low), extrapolate=False)) if high > low else np.empty(0)
    rising = U(crossings, 1) > 0
    above = float(energy[0] > low + DUTY_LEVEL * (high - low))
    duty = float(np.where(rising, -crossings, crossings).sum()) / orbit.T + above
    return Measures(
        duty, hot - cold, 10 * np.log10(high / low) if low > 0 else np.inf, low, high, hot, crossings, rising,
        np.array([low_at, high_at, cold_at, hot_at]),
    )  # fmt: skip


def periodic_rows(orbit: Orbit) -> tuple[Array, Array, Array]:
    """Times in ns, energies in fJ and rises in K over a period, both ends included."""
    t, re, im, _, dT = orbit.trace.rows.T
    kept = np.append(True, np.diff(t) > 1e-13 * t[-1])
    return t[kept], (re**2 + im**2)[kept], dT[kept]


def _extremes(curve: CubicSpline, t: Array) -> tuple[float, float, float, float]:
    """Place and value of the minimum of a spline, then of its maximum."""
    at = np.concatenate([t[[0, -1]], curve.derivative().roots(extrapolate=False)])
    at = at[np.isfinite(at)]  # a constant has roots nan
    values = curve(at)
    low, high = int(values.argmin()), int(values.argmax())
    return float(at[low]), float(values[low]), float(at[high]), float(values[high])


def time_weights(orbit: Orbit) -> Array:
    """Weights in ns of the rows in an integral over the period, shape (rows,): Boole's rule on every step."""
    out = np.zeros(len(orbit.trace.rows))
    steps = np.concatenate([steps for _, steps in orbit.trace.parts])
    for k, weight in enumerate(BOOLE):
        out[k : k + PER_STEP * (steps.size - 1) + 1 : PER_STEP] += weight * steps
    return out
