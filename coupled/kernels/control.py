"""Common parts of the Rosenbrock integrations: error norm, step-size control, dense output, growing modes; compiled.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.8 (the predictive step-size
control of Gustafsson).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .compiling import inlined, inner
from .equations import Array
from .spectrum import eigenvalues

QUIET = 1e-2  # largest relative change in a step of a state that counts as at rest
DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, EVENT, STOPPED, TOO_MANY_ROWS = 0, 1, 2, 3, 4, 5  # how an integration ended
TOP = 1e300  # error of a step that ends beyond the top of an output map
GROWTH = 5.0  # largest ratio of two successive steps


@inlined
def squared_error(y: Array, out: Array, light: Array, heat: float, z: float, z_new: float, floor: Array) -> float:
    """Return the sum of the squared relative errors of field, carriers and temperature of one ring in a step.

    ``y`` and ``out`` are Re a, Im a, N before and after, ``light`` their errors, ``heat`` that of the temperature in K;
    each is relative to its size, or to ``floor`` (sqrt(fJ), 1e23/m^3, K) where that is larger. One field and one
    temperature: neither the number of poles nor a zero of Re a matters.
    """
    energy = max(y[0] * y[0] + y[1] * y[1], out[0] * out[0] + out[1] * out[1], floor[0] * floor[0])
    e0 = (light[0] * light[0] + light[1] * light[1]) / energy
    e1 = light[2] / max(abs(y[2]), abs(out[2]), floor[1])
    e2 = heat / max(abs(z), abs(z_new), floor[2])
    return e0 + e1 * e1 + e2 * e2


@inlined
def relative_change(y: Array, out: Array, z: float, z_new: float, floor: Array) -> float:
    """Return the largest relative change of field, carriers and temperature of one ring in a step."""
    d0 = math.hypot(out[0] - y[0], out[1] - y[1]) / max(math.hypot(out[0], out[1]), floor[0])
    d1 = abs(out[2] - y[2]) / max(abs(out[2]), floor[1])
    return max(d0, d1, abs(z_new - z) / max(abs(z_new), floor[2]))


@inlined
def after_rejection(h: float, error: float, size: float) -> float:
    """Return the step to try after one whose ``error`` was above 1; ``size`` is error^(1/order)."""
    return h * max(0.2, 0.9 / size) if error < math.inf else 0.2 * h


@inlined
def after_acceptance(h: float, size: float, h_before: float, size_before: float, growth: float) -> float:
    """Return the next step from the last two; ``h_before`` is 0 where there is no step before."""
    factor = 0.9 / size
    if h_before > 0.0:
        factor = min(factor, factor * h / h_before * size_before / size)
    return h * max(0.2, min(growth, factor))


@inner
def doubled(rows: Array) -> Array:
    """Return ``rows`` followed by as many that are not set."""
    out = np.empty((2 * rows.shape[0], rows.shape[1]))
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[i, j] = rows[i, j]
    return out


@inner
def tally(accepted: int, rejected: int, ended: int) -> NDArray[np.int64]:
    """Return the counts of an integration as an array."""
    out = np.empty(3, np.int64)
    out[0], out[1], out[2] = accepted, rejected, ended
    return out


@inlined
def dense_output(x: float, y0: float, y1: float, k: Array, d: Array) -> float:
    """Return one component at the fraction ``x`` of a step from its stages ``k``."""
    d1, d2, d3 = 0.0, 0.0, 0.0
    for j in range(k.size):
        d1, d2, d3 = d1 + d[0, j] * k[j], d2 + d[1, j] * k[j], d3 + d[2, j] * k[j]
    return (1.0 - x) * y0 + x * (y1 + (1.0 - x) * (d1 + x * (d2 + x * d3)))


@inner
def fastest_growth(J: Array) -> float:
    """Return the modulus of the fastest growing mode of a Jacobian, or 0 where all decay."""
    fastest = 0.0
    for value in eigenvalues(J.astype(np.complex128)):
        if value.real > 0.0:
            fastest = max(fastest, abs(value))
    return fastest
