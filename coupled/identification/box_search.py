"""Nonlinear least squares within bounds, for residuals with occasional discontinuities in the parameters."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import optimize

from thermofem.arrays import Array, Mask

FORWARD_STEP = 1e-3  # of a logarithm, for forward differences
STEPS = (3e-3, 1e-3, 3e-4, 1e-4)  # for central ones, of which the largest is taken about which a trace is straight
STRAIGHT, JUMP = 0.25, 0.5  # second over first difference: a trace is straight below, and has a jump above
AT_BOUND = 1e-3  # of the logarithm: a parameter this near a bound counts as on it

Residuals = Callable[[Array], "Array | None"]  # None where the parameters give no model


def at_bound(x: Array, low: Array, high: Array) -> Mask:
    """Boolean mask of the parameters ``x`` (logarithms) that lie on a bound of the search, to `AT_BOUND`."""
    return (x < low + AT_BOUND) | (x > high - AT_BOUND)


def cost(f: Residuals, x: Array) -> float:
    """Sum of the squares of the residuals at ``x``; infinity where the parameters give no model."""
    r = f(x)
    return np.inf if r is None else float(r @ r)


class End(NamedTuple):
    """Result of a search: parameters x, residuals r, Jacobian J = dr/dx, and the cost |r|^2 + the term of the prior."""

    x: Array
    r: Array
    J: Array
    cost: float


class Prior(NamedTuple):
    """Gaussian prior on the parameters x: it adds (x - centre)^T precision (x - centre) to the sum of squares."""

    centre: Array
    precision: Array


def least_squares(
    f: Residuals, x: Array, low: Array, high: Array, *, steps: int, traces: int = 0, prior: Prior | None = None
) -> End:
    """Minimise |f(x)|^2, plus the prior, within bounds from the start ``x``, with at most 2 ``steps`` evaluations.

    f: returns the residuals, shape (r,), or None where the model is not defined; it must be defined at ``x``.
    traces: number of traces with residuals of equal length, for `central_slopes`; 0 for forward differences.
    """
    first = f(x)
    assert first is not None
    size = first.size
    centre, precision = prior or Prior(x, np.zeros((x.size, x.size)))
    values, vectors = np.linalg.eigh(precision)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # of the precision

    def residuals(x: Array) -> Array:
        r = f(x)
        if r is None:
            # a large residual where the parameters give no model
            r = np.full(size, 1e3)
        return np.append(r, root @ (x - centre))

    def slopes(x: Array) -> Array:
        r = residuals(x)[:size]
        J = central_slopes(f, x, r, traces) if traces else _forward(f, x, r)
        return np.vstack([J, root])

    best = optimize.least_squares(
        residuals, np.clip(x, low + 1e-9, high - 1e-9), jac=slopes, bounds=(low, high), max_nfev=2 * steps, xtol=1e-6,
        ftol=1e-4, gtol=1e-10,
    )  # fmt: skip
    return End(best.x, best.fun[:size], best.jac[:size], 2 * float(best.cost))


def _forward(f: Residuals, x: Array, r: Array) -> Array:
    """Jacobian df/dx by forward differences, or backward where f(x + h) is not defined."""
    columns = []
    for e in FORWARD_STEP * np.eye(x.size):
        h = FORWARD_STEP
        above = f(x + e)
        if above is None:
            h = -FORWARD_STEP
            above = f(x - e)
        columns.append(np.zeros(r.size) if above is None else (above - r) / h)
    return np.array(columns).T


def central_slopes(f: Residuals, x: Array, r: Array, traces: int) -> Array:
    """Jacobian df/dx by central differences, for each trace with the largest step in which its residuals are linear.

    At a discontinuity (a trace stops pulsing) it is the one-sided slope of smaller modulus, or 0 if the signs differ.
    """
    J = np.zeros((traces, r.size // traces, x.size))
    middle = r.reshape(traces, -1)
    for k, unit in enumerate(np.eye(x.size)):
        open_traces = list(range(traces))
        straightest = np.full(traces, np.inf)
        for h in STEPS:
            above = f(x + h * unit)
            below = f(x - h * unit)
            if above is None or below is None:
                continue
            above = above.reshape(traces, -1)
            below = below.reshape(traces, -1)
            for i in [*open_traces]:
                change = float(np.linalg.norm(above[i] - below[i]))
                bent = float(np.linalg.norm(above[i] + below[i] - 2 * middle[i])) / max(change, 1e-12)
                if bent < straightest[i]:
                    straightest[i] = bent
                    J[i, :, k] = _slope(above[i], middle[i], below[i], h, jumps=bent > JUMP)
                # a change below 0.5 of all residuals of a trace is less than their noise
                if bent < STRAIGHT or change < 0.5:
                    open_traces.remove(i)
            if not open_traces:
                break
    return J.reshape(r.size, x.size)


def _slope(above: Array, middle: Array, below: Array, h: float, *, jumps: bool) -> Array:
    """Central difference of step h, or across a jump the one-sided one of smaller modulus, 0 where the signs differ."""
    if not jumps:
        return (above - below) / (2 * h)
    up = (above - middle) / h
    down = (middle - below) / h
    smaller = np.sign(up) * np.minimum(np.abs(up), np.abs(down))
    return np.where(up * down > 0, smaller, 0.0)
