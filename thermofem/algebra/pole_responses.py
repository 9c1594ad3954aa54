"""Poles driven by a power that is piecewise linear or piecewise cubic, in closed form.

x(t + h) = exp(-rate h) x(t) + sum_m c_m h^(m + 1) phi_m(rate h),   phi_m(y) = integral_0^1 exp(-y (1 - u)) u^m du
"""

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike
from ..piecewise import Pieces


def phi(y: Array) -> Array:
    """phi_m(y) = int_0^1 exp(-y (1 - u)) u^m du for m = 0..3 and y >= 0, shape (4, *y.shape).

    Backward recursion from a series below y = 1, forward recursion above: no cancellation in either.
    """
    small = np.minimum(y, 1.0)
    large = np.maximum(y, 1.0)
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


def cubic_pole_responses(rate: Array, power: Pieces, times: Array, *, periodic: bool = False) -> Array:
    """Responses of poles to a piecewise-cubic power, from rest at its first edge or periodic; shape (times, poles)."""
    edges = power.edges
    coefficients = power.coefficients
    at_edges = np.zeros((edges.size, rate.size))
    for block in _blocks(edges.size - 1, rate.size):
        decays, gained = _piece(rate, coefficients[block], np.diff(edges)[block])
        for k, (decay, step) in enumerate(zip(decays.T, gained.T, strict=True), start=block.start):
            at_edges[k + 1] = at_edges[k] * decay + step
    if periodic:
        at_edges += np.exp(np.multiply.outer(edges, -rate)) * (at_edges[-1] / -np.expm1(-rate * edges[-1]))
    result = np.empty((rate.size, times.size))
    for block in _blocks(times.size, rate.size):
        piece = edges[1:-1].searchsorted(times[block], side="right")
        decay, gained = _piece(rate, coefficients[piece], times[block] - edges[piece])
        decay *= at_edges.T.take(piece, axis=1)
        result[:, block] = np.add(decay, gained, out=gained)
    return result.T


def _blocks(count: int, poles: int) -> list[slice]:
    """Slices of ``count`` pieces or times, in each of which (slice, poles) arrays stay below 100,000 numbers."""
    step = 100_000 // poles + 1  # many times and poles then need no more than 100 MB
    return [slice(first, min(first + step, count)) for first in range(0, count, step)]


def _piece(rate: Array, coefficients: Array, u: Array) -> tuple[Array, Array]:
    """exp(-rate u), and the response from rest after the time u in each piece; shape (poles, pieces) each.

    Cubics take `phi`; straight lines need exp(-rate u) - 1 alone, or a series where rate u is small.
    """
    y = np.multiply.outer(rate, u)
    if coefficients[:, 2:].any():
        weights = coefficients.T * u ** np.arange(1, 5)[:, None]
        return np.exp(-y), np.einsum("mk,mnk->nk", weights, phi(y))
    constant, slope = coefficients[:, :2].T
    lost = np.expm1(-y)  # exp(-y) - 1
    gained = np.multiply.outer(-1 / rate, constant)
    gained *= lost
    if slope.any():
        series = u * u * (0.5 - y / 6 + y * y / 24 - y**3 / 120)
        ramp = (u + lost / rate[:, None]) / rate[:, None]
        gained += slope * np.where(y < 1e-3, series, ramp)
    decay = lost
    decay += 1  # in place: exp(-y)
    return decay, gained


def pole_responses(rate: Array, wave: waveforms.Waveform, times: ArrayLike, *, periodic: bool = False) -> Array:
    """Response x of poles dx/dt = -rate x + P(t) to a waveform, in closed form.

    From rest at t = 0, or in the periodic state, where x(0) = x_cold(T) / (1 - exp(-rate T)).

    rate [shape (n,), 1/s]
    times [shape (m,), s]: not negative; within one period when ``periodic``.
    Returns [shape (m, n), J]
    Raises InputError: a negative or non-finite time; a function of time that is negative or cannot be resolved.
    """
    t = checks.array("times", times)
    checks.between("times", t.min(), 0, np.inf, unit="s", hint="the power is switched on at t = 0")
    stop = wave.period if periodic and wave.period else max(float(t.max()), np.finfo(float).tiny)
    return cubic_pole_responses(rate, waveforms.heating_pieces(wave, 0.0, stop), t, periodic=periodic)
