"""Poles driven by a waveform, in closed form."""

from __future__ import annotations

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike
from .smooth_poles import smooth_pole_responses


def pole_responses(rate: Array, wave: waveforms.Waveform, times: ArrayLike, *, periodic: bool = False) -> Array:
    """Answers of poles dx/dt = -rate x + P(t) to a waveform, in closed form.

    From rest at t = 0, or in the periodic state, where x(0) = x_cold(T) / (1 - exp(-rate T)).

    rate [shape (n,), 1/s]
    times [shape (m,), s]: not negative; within one period when ``periodic``.
    Returns [shape (m, n), J]
    Raises InputError: a negative or non-finite time; a function of time that is negative or cannot be resolved.
    """
    checks.has("wave", wave, "breakpoints", hint="give a waveform; a function f of time is thermofem.Function(f)")
    t = checks.array("times", times)
    if t.min() < 0:
        raise checks.InputError(f"times = {t.min():g} s lies before the start at t = 0")
    stop = wave.period if periodic and wave.period else max(float(t.max()), np.finfo(float).tiny)
    if not getattr(wave, "piecewise_linear", False):
        return smooth_pole_responses(rate, wave, t, stop, periodic=periodic)
    edges, after, before = waveforms.linear_pieces(wave, 0.0, stop)
    length = edges[1:] - edges[:-1]
    slope, settled = (before - after) / length, np.divide.outer(after, rate)
    ramps = slope.any()
    # from an edge on x(u) = x(0) + (x(0) - P/rate) (exp(-rate u) - 1), and a ramp's share
    fall = np.expm1(np.multiply.outer(length, -rate))
    gained = -settled * fall
    if ramps:
        gained += slope[:, None] * _phi2(rate, length[:, None])
    at_edges = np.zeros((edges.size, rate.size))
    for k in range(after.size):
        at_edges[k + 1] = at_edges[k] * (1 + fall[k]) + gained[k]
    if periodic:
        at_edges += np.exp(np.multiply.outer(edges, -rate)) * (at_edges[-1] / -np.expm1(-rate * edges[-1]))
    start = at_edges[:-1]
    piece = edges[1:-1].searchsorted(t, side="right")
    u = t - edges.take(piece)
    result = np.expm1(np.multiply.outer(-rate, u))  # poles first: long inner loops
    result *= (start - settled).T.take(piece, axis=1)
    result += start.T.take(piece, axis=1)
    if ramps:
        result += slope.take(piece) * _phi2(rate[:, None], u)
    return result.T


def _phi2(rate: Array, u: Array) -> Array:
    """Response of one pole to a unit ramp, the integral of v exp(-rate (u - v)) for v from 0 to u.

    A series is used for small ``rate`` ``u``, where the closed form loses digits.
    """
    z = rate * u
    series = u * u * (0.5 - z / 6 + z * z / 24 - z**3 / 120)
    return np.where(z < 1e-3, series, (u + np.expm1(-z) / rate) / rate)
