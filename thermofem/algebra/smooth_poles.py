"""Poles driven by a piecewise cubic power, in closed form.

x(t + h) = exp(-rate h) x(t) + sum_m c_m h^(m + 1) phi_m(rate h),   phi_m(y) = integral_0^1 exp(-y (1 - u)) u^m du
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..waveforms import Waveform, heating_pieces

BLOCK = 2_000_000  # numbers of one evaluation, so that many times and poles need no more than 100 MB


def phi(y: Array) -> Array:
    """phi_0 .. phi_3 of y >= 0, shape (4, *y.shape): a series downwards below 1, the recursion upwards above."""
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


def smooth_pole_responses(rate: Array, wave: Waveform, times: Array, stop: float, *, periodic: bool) -> Array:
    """Answers of poles dx/dt = -rate x + P(t) to any waveform through its piecewise cubic (`heating_pieces`).

    rate [shape (n,), 1/s]
    times [shape (m,), s]: from 0 to ``stop``.
    stop [s]: end of the pieces; the period where ``periodic``.
    Returns [shape (m, n), J]
    """
    edges, coefficients = heating_pieces(wave, 0.0, stop)
    return cubic_pole_responses(rate, edges, coefficients, times, periodic=periodic)


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
    """Part of each pole's response that the power since the edge of its piece has made, shape (pieces, poles)."""
    weights = coefficients * u[:, None] ** np.arange(1, 5)
    return np.asarray(np.einsum("km,mkn->kn", weights, phi(np.multiply.outer(u, rate))))
