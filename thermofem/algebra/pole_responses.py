"""Poles driven by a power that is piecewise linear or piecewise cubic, in closed form.

x(t + h) = exp(-rate h) x(t) + sum_m c_m h^(m + 1) phi_m(rate h),   phi_m(y) = integral_0^1 exp(-y (1 - u)) u^m du
"""

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike
from ..waveforms import heating_pieces

BLOCK = 2_000_000  # numbers of one evaluation, so that many times and poles need no more than 100 MB


def phi(y: Array) -> Array:
    """phi_m(y) = int_0^1 exp(-y (1 - u)) u^m du for m = 0..3 and y >= 0, shape (4, *y.shape).

    Backward recursion from a series below y = 1, forward recursion above: no cancellation in either.
    """
    small, large = np.minimum(y, 1.0), np.maximum(y, 1.0)
    out = np.empty((4, *y.shape))
    out[3] = 0.0
    for j in range(16, -1, -1):  # phi_3 = 3! sum_j (-y)^j / (j + 4)!
        out[3] = (1.0 - out[3] * small) / (j + 4)
    up = -np.expm1(-large) / large
    for m in range(2, -1, -1):
        out[m] = (1.0 - small * out[m + 1]) / (m + 1)
    for m in range(4):
        if m:
            up = (1.0 - m * up) / large
        out[m] = np.where(y < 1.0, out[m], up)
    return out


def cubic_pole_responses(
    rate: Array, edges: Array, coefficients: Array, times: Array, *, periodic: bool = False
) -> Array:
    """Responses to a power given as cubics, rows of coefficients of (t - edges[k])^j; from rest at edges[0]."""
    h = np.diff(edges)
    decay = np.exp(np.multiply.outer(h, -rate))
    at_edges = np.zeros((edges.size, rate.size))
    for first in range(0, h.size, BLOCK // rate.size + 1):
        block = slice(first, first + BLOCK // rate.size + 1)
        gained = _gained(rate, coefficients[block], h[block])
        for k, step in enumerate(gained, start=first):
            at_edges[k + 1] = at_edges[k] * decay[k] + step
    if periodic:
        at_edges += np.exp(np.multiply.outer(edges, -rate)) * (at_edges[-1] / -np.expm1(-rate * edges[-1]))
    result = np.empty((times.size, rate.size))
    for first in range(0, times.size, BLOCK // rate.size + 1):
        block = slice(first, first + BLOCK // rate.size + 1)
        piece = edges[1:-1].searchsorted(times[block], side="right")
        u = times[block] - edges[piece]
        result[block] = at_edges[piece] * np.exp(np.multiply.outer(u, -rate)) + _gained(rate, coefficients[piece], u)
    return result


def _gained(rate: Array, coefficients: Array, u: Array) -> Array:
    """sum_m c_m u^(m + 1) phi_m(rate u): response to the power since the start of each piece, shape (pieces, poles)."""
    weights = coefficients * u[:, None] ** np.arange(1, 5)
    return np.asarray(np.einsum("km,mkn->kn", weights, phi(np.multiply.outer(u, rate))))


def pole_responses(rate: Array, wave: waveforms.Waveform, times: ArrayLike, *, periodic: bool = False) -> Array:
    """Response x of poles dx/dt = -rate x + P(t) to a waveform, in closed form.

    From rest at t = 0, or in the periodic state, where x(0) = x_cold(T) / (1 - exp(-rate T)).

    rate [shape (n,), 1/s]
    times [shape (m,), s]: not negative; within one period when ``periodic``.
    Returns [shape (m, n), J]
    Raises InputError: a negative or non-finite time; a function of time that is negative or cannot be resolved.
    """
    t = checks.array("times", times)
    if t.min() < 0:
        raise checks.InputError(f"times = {t.min():g} s lies before the start at t = 0")
    stop = wave.period if periodic and wave.period else max(float(t.max()), np.finfo(float).tiny)
    if not getattr(wave, "piecewise_linear", False):
        return cubic_pole_responses(rate, *heating_pieces(wave, 0.0, stop), t, periodic=periodic)
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
