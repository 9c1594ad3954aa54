"""Error-controlled Rosenbrock integration that uses the structure of a ring coupled to a Foster network.

With s = 1/(gamma h), heat eliminated from (s - J) k = r leaves a 3 x 3 system, whatever the number of poles:

    k_i = (r_i + gain_i w.k_o) / (s + rate_i),        w = d(P_abs)/d(Re a, Im a, N)
    (s - J_o - G u w^T) k_o = r_o + u sum_i r_i/(s + rate_i),     G = sum_i gain_i/(s + rate_i),  u = d(optics)/d(dT)

so a step costs O(n) with a small constant, and never a dense factorization.

Sources: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.7 (methods) and Section IV.8
(the predictive step-size control of Gustafsson); coefficients in tableaus.json.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from . import equations
from .compiling import compiled, forget_if_older, inlined
from .equations import Array, Rates, dispersion, optics, optics_jacobian
from .tableaus import Tableau

DONE, TOO_MANY_STEPS, STEP_TOO_SMALL = 0, 1, 2  # how `integrate` ended

Row3 = tuple[float, float, float]


@inlined
def _inverse(m: tuple[Row3, Row3, Row3]) -> tuple[Row3, Row3, Row3]:
    """Return the inverse of a 3 x 3 matrix by cofactors; s on the diagonal keeps it well conditioned."""
    c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1]
    c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2]
    c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0]
    d = 1.0 / (m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2)
    return (
        (d * c0, d * (m[0][2] * m[2][1] - m[0][1] * m[2][2]), d * (m[0][1] * m[1][2] - m[0][2] * m[1][1])),
        (d * c1, d * (m[0][0] * m[2][2] - m[0][2] * m[2][0]), d * (m[0][2] * m[1][0] - m[0][0] * m[1][2])),
        (d * c2, d * (m[0][1] * m[2][0] - m[0][0] * m[2][1]), d * (m[0][0] * m[1][1] - m[0][1] * m[1][0])),
    )


@compiled
def step(
    y: Array, h: float, drive: float, detuning: float, rates: Rates, fcd: Array, poles: Array, method: Tableau,
    out: Array, k: Array, total: Array, damping: Array,
) -> tuple[float, float]:  # fmt: skip
    """Take one step of ``h`` ns from ``y`` to ``out``; return dT before and after.

    Fills ``k``, shape (stages, 3 + n), with the stages (the last one is the error estimate) and ``total`` with the sum
    of each over the poles; ``damping``, shape (n,), is workspace for 1/(s + rate_i).
    """
    n, stages = poles.shape[1], method.a.shape[0]
    a, c, s, per_h = method.a, method.c, 1.0 / (method.gamma * h), 1.0 / h
    start, G = 0.0, 0.0
    for i in range(n):
        start += y[3 + i]
        damping[i] = 1.0 / (s + poles[1, i])
        G += poles[0, i] * damping[i]
    shift, slope = dispersion(y[2], fcd)
    J = optics_jacobian(y[0], y[1], y[2], start, shift, slope, detuning, rates)
    u0, u1, w = J[0][3], J[1][3], J[3]
    m = _inverse(
        (
            (s - J[0][0] - G * u0 * w[0], -J[0][1] - G * u0 * w[1], -J[0][2] - G * u0 * w[2]),
            (-J[1][0] - G * u1 * w[0], s - J[1][1] - G * u1 * w[1], -J[1][2] - G * u1 * w[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
    )
    f0, f1, f2, heat = optics(y[0], y[1], y[2], start, shift, drive, detuning, rates)
    dT = start
    for q in range(stages):
        ar, ai, N, dT = y[0], y[1], y[2], start
        r0, r1, r2 = 0.0, 0.0, 0.0
        for i in range(n):
            k[q, 3 + i] = -poles[1, i] * y[3 + i]
        for j in range(q):
            x, z = a[q, j], c[q, j] * per_h
            ar, ai, N, dT = ar + x * k[j, 0], ai + x * k[j, 1], N + x * k[j, 2], dT + x * total[j]
            r0, r1, r2 = r0 + z * k[j, 0], r1 + z * k[j, 1], r2 + z * k[j, 2]
            for i in range(n):
                k[q, 3 + i] += (z - x * poles[1, i]) * k[j, 3 + i]
        if q > 0:
            f0, f1, f2, heat = optics(ar, ai, N, dT, dispersion(N, fcd)[0], drive, detuning, rates)
        back = 0.0
        for i in range(n):
            k[q, 3 + i] = (k[q, 3 + i] + poles[0, i] * heat) * damping[i]
            back += k[q, 3 + i]
        r0, r1, r2 = r0 + f0 + u0 * back, r1 + f1 + u1 * back, r2 + f2
        k0 = m[0][0] * r0 + m[0][1] * r1 + m[0][2] * r2
        k1 = m[1][0] * r0 + m[1][1] * r1 + m[1][2] * r2
        k2 = m[2][0] * r0 + m[2][1] * r1 + m[2][2] * r2
        feedback = w[0] * k0 + w[1] * k1 + w[2] * k2
        for i in range(n):
            k[q, 3 + i] += feedback * poles[0, i] * damping[i]
        k[q, 0], k[q, 1], k[q, 2], total[q] = k0, k1, k2, back + feedback * G
    last = stages - 1
    out[0], out[1], out[2] = ar + k[last, 0], ai + k[last, 1], N + k[last, 2]
    for i in range(n):
        out[3 + i] = y[3 + i] + k[last, 3 + i]
    for j in range(last):
        for i in range(n):
            out[3 + i] += a[last, j] * k[j, 3 + i]
    return start, dT + total[last]


@inlined
def step_error(y: Array, out: Array, dT: float, dT_new: float, k: Array, rtol: float, floor: Array) -> float:
    """Return the error of a step in units of the tolerance.

    Root mean square over field, carriers and temperature, so that neither the number of poles nor a zero of Re a
    matters; each relative to ``rtol`` times its size, or times ``floor`` (sqrt(fJ), 1e23/m^3, K) where it is smaller.
    """
    last = k.shape[0] - 1
    heat = 0.0
    for i in range(3, k.shape[1]):
        heat += abs(k[last, i])
    energy = max(y[0] * y[0] + y[1] * y[1], out[0] * out[0] + out[1] * out[1], floor[0] * floor[0])
    e0 = (k[last, 0] * k[last, 0] + k[last, 1] * k[last, 1]) / energy
    e1 = k[last, 2] / max(abs(y[2]), abs(out[2]), floor[1])
    e2 = heat / max(abs(dT), abs(dT_new), floor[2])
    return math.sqrt((e0 + e1 * e1 + e2 * e2) / 3.0) / rtol


@inlined
def dense_output(x: float, y0: float, y1: float, k: Array, d: Array) -> float:
    """Return one component at the fraction ``x`` of a step from its stages ``k``."""
    d1, d2, d3 = 0.0, 0.0, 0.0
    for j in range(k.size):
        d1, d2, d3 = d1 + d[0, j] * k[j], d2 + d[1, j] * k[j], d3 + d[2, j] * k[j]
    return (1.0 - x) * y0 + x * (y1 + (1.0 - x) * (d1 + x * (d2 + x * d3)))


@inlined
def _record(rows: Array, at: int, t: float, y: Array, dT: float) -> None:
    """Write t, Re a, Im a, N, dT into one row."""
    rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3], rows[at, 4] = t, y[0], y[1], y[2], dT


@compiled
def integrate(
    y: Array, duration: float, drive: float, detuning: float, rates: Rates, fcd: Array, poles: Array,
    method: Tableau, rtol: float, floor: Array, times: Array, max_steps: int,
) -> tuple[Array, Array, float, NDArray[np.int64]]:  # fmt: skip
    """Integrate from ``y`` at t = 0 to ``duration`` ns under a constant drive and detuning.

    Parameters
    ----------
    y : array, shape (3 + n,)
        Re a, Im a (sqrt(fJ)), N (1e23/m^3) and the temperatures of the poles (K).
    drive, detuning : float; sqrt(fJ)/ns, rad/ns
    rates, fcd, poles : Rates, array of shape (terms, 2), array of shape (2, n)
        from `equations.internal_rates` and `internal_poles`.
    method, rtol, floor : Tableau, float, array of shape (3,)
        error per step in field, carriers and temperature, relative to their size, or to ``floor`` where that is larger.
    times : array, ns
        wanted output times, or empty.
    max_steps : int

    Returns
    -------
    rows : array, shape (m, 5)
        t, Re a, Im a, N, dT; at ``times`` by dense output, or at the accepted steps where ``times`` is empty.
    y : array, shape (3 + n,)
        the state at the end.
    t : float
        the end, ns: ``duration`` unless the integration gave up.
    counts : array of int, shape (3,)
        accepted steps, rejected steps, and how it ended (DONE, TOO_MANY_STEPS or STEP_TOO_SMALL).
    """
    n, stages = poles.shape[1], method.a.shape[0]
    y, out, damping = y.copy(), np.empty(3 + n), np.empty(n)
    k, total = np.empty((stages, 3 + n)), np.empty(stages)
    wanted, filled = times.size, 0
    rows = np.empty((wanted if wanted > 0 else 4096, 5))
    if wanted == 0 or times[0] <= 0.0:
        _record(rows, 0, 0.0, y, np.sum(y[3:]))
        filled = 1
    t, h, h_before, size_before, growth = 0.0, 1e-2 / rates.loss, 0.0, 1.0, 5.0
    accepted, rejected = 0, 0
    while t < duration:
        if accepted + rejected >= max_steps:
            return rows[:filled], y, t, np.array([accepted, rejected, TOO_MANY_STEPS])
        last = t + 1.0001 * h >= duration
        if last:
            h = duration - t
        dT, dT_new = step(y, h, drive, detuning, rates, fcd, poles, method, out, k, total, damping)
        error = step_error(y, out, dT, dT_new, k, rtol, floor)
        size = max(error, 1e-8) ** (1.0 / method.order)  # of the step, in units of the one that the tolerance allows
        if not error <= 1.0:  # nan too
            rejected += 1
            growth = 1.0
            h *= max(0.2, 0.9 / size) if error < math.inf else 0.2
            if h < 1e-13 * max(t, 1e-3):
                return rows[:filled], y, t, np.array([accepted, rejected, STEP_TOO_SMALL])
            continue
        while filled < wanted and (last or times[filled] <= t + h):
            x = (times[filled] - t) / h
            rows[filled, 0] = times[filled]
            for i in range(3):
                rows[filled, 1 + i] = dense_output(x, y[i], out[i], k[:, i], method.dense)
            rows[filled, 4] = dense_output(x, dT, dT_new, total, method.dense)
            filled += 1
        accepted += 1
        t = duration if last else t + h
        y, out = out, y
        if wanted == 0:
            if filled == rows.shape[0]:
                rows = np.concatenate((rows, np.empty_like(rows)))
            _record(rows, filled, t, y, dT_new)
            filled += 1
        factor = 0.9 / size
        if accepted > 1:  # what the last two steps say about the next one
            factor = min(factor, factor * h / h_before * size_before / size)
        h_before, size_before = h, max(size, 0.3)
        h *= max(0.2, min(growth, factor))
        growth = 5.0
    return rows[:filled], y, t, np.array([accepted, rejected, DONE])


for kernel in (step, integrate):
    forget_if_older(kernel, equations.__file__)
