"""Error-controlled Rosenbrock integration that uses the structure of a ring coupled to a Foster network.

With s = 1/(gamma h), heat eliminated from (s - J) k = r leaves a 3 x 3 system, whatever the number of poles:

    k_i = (r_i + gain_i w.k_o) / (s + rate_i),        w = d(P_abs)/d(Re a, Im a, N)
    (s - J_o - G u w^T) k_o = r_o + u sum_i r_i/(s + rate_i),     G = sum_i gain_i/(s + rate_i),  u = d(optics)/d(dT)

so a step costs O(n) with a small constant, and never a dense factorization. An output map dT = z + curvature z^2 over
the network multiplies u by d(dT)/dz.

Sources: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.7; coefficients in
tableaus.json. Error norm and step-size control are in `control`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernel.tableaus import Tableau
from . import algebra, control, equations, kinds, laser, quadratic, spectrum
from .algebra import inverse
from .compiling import OPTIONS, compiled, forget_if_older, inlined, inner, overload
from .control import (
    DONE,
    EVENT,
    GROWTH,
    QUIET,
    STEP_TOO_SMALL,
    STOPPED,
    TOO_MANY_STEPS,
    TOP,
    after_acceptance,
    after_rejection,
    dense_output,
    doubled,
    fastest_growth,
    relative_change,
    squared_error,
    tally,
)
from .equations import Array, Rates, dispersion, optics, optics_jacobian
from .kinds import read, rise_of, weigh
from .laser import LaserPieces, largest_power, light


@compiled
def step(
    y: Array, h: float, pump: Array, detuning: Array, slopes: Array, rates: Rates, fcd: Array, thermal: Any,
    method: Tableau, out: Array, k: Array, total: Array, damping: Array,
) -> tuple[float, float]:  # fmt: skip
    """Take one step of ``h`` ns from ``y`` to ``out``; return z = sum of the x_i before and after.

    ``pump`` and ``detuning``, shape (stages,), are the laser at the times of the stages, ``slopes`` the derivatives of
    both at the first. Fills ``k``, shape (stages, 3 + n), with the stages (the last one is the error estimate) and
    ``total`` with the sum of each over the poles; ``damping``, shape (n,), is workspace for 1/(s + rate_i).
    """
    poles = thermal.poles
    n, stages = poles.shape[1], method.a.shape[0]
    a, c, s, per_h = method.a, method.c, 1.0 / (method.gamma * h), 1.0 / h
    start, G = 0.0, 0.0
    for i in range(n):
        start += y[3 + i]
        damping[i] = 1.0 / (s + poles[1, i])
        G += poles[0, i] * damping[i]
    shift, slope = dispersion(y[2], fcd)
    dT, dT_slope = rise_of(start, thermal)
    J = optics_jacobian(y[0], y[1], y[2], dT, shift, slope, detuning[0], rates)
    u0, u1, w = J[0][3] * dT_slope, J[1][3] * dT_slope, J[3]
    turn0, turn1 = h * slopes[1] * y[1], -h * slopes[1] * y[0]
    push = h * slopes[0]
    m = inverse(
        (
            (s - J[0][0] - G * u0 * w[0], -J[0][1] - G * u0 * w[1], -J[0][2] - G * u0 * w[2]),
            (-J[1][0] - G * u1 * w[0], s - J[1][1] - G * u1 * w[1], -J[1][2] - G * u1 * w[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
    )
    f0, f1, f2, heat = optics(y[0], y[1], y[2], dT, shift, pump[0], detuning[0], rates)
    z_now = start
    for q in range(stages):
        ar, ai, N, z_now = y[0], y[1], y[2], start
        r0, r1, r2 = 0.0, 0.0, 0.0
        for i in range(n):
            k[q, 3 + i] = -poles[1, i] * y[3 + i]
        for j in range(q):
            x, z = a[q, j], c[q, j] * per_h
            ar, ai, N, z_now = ar + x * k[j, 0], ai + x * k[j, 1], N + x * k[j, 2], z_now + x * total[j]
            r0, r1, r2 = r0 + z * k[j, 0], r1 + z * k[j, 1], r2 + z * k[j, 2]
            for i in range(n):
                k[q, 3 + i] += (z - x * poles[1, i]) * k[j, 3 + i]
        if q > 0:
            dT = rise_of(z_now, thermal)[0]
            f0, f1, f2, heat = optics(ar, ai, N, dT, dispersion(N, fcd)[0], pump[q], detuning[q], rates)
        back = 0.0
        for i in range(n):
            k[q, 3 + i] = (k[q, 3 + i] + poles[0, i] * heat) * damping[i]
            back += k[q, 3 + i]
        g = method.slope[q]
        r0, r1, r2 = r0 + f0 + u0 * back + g * turn0, r1 + f1 + u1 * back + g * (turn1 + push), r2 + f2
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
    return start, z_now + total[last]


@inlined
def step_error(
    y: Array, out: Array, z: float, z_new: float, k: Array, rtol: float, floor: Array, thermal: Any
) -> float:
    """Return the error of a step in units of ``rtol``: root mean square over field, carriers and temperature."""
    square = squared_error(y, out, k[k.shape[0] - 1], weigh(k, thermal), z, z_new, floor)
    return math.sqrt(square / 3.0) / rtol if rise_of(z_new, thermal)[1] > 0.0 else TOP


@inlined
def _record(rows: Array, at: int, t: float, y: Array, z: float, thermal: Any) -> None:
    """Write t, Re a, Im a, N, dT into one row."""
    rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3] = t, y[0], y[1], y[2]
    rows[at, 4] = rise_of(z, thermal)[0]


@inner
def _between(
    rows: Array, at: int, t: float, x: float, y: Array, out: Array, z: float, z_new: float, k: Array, total: Array,
    d: Array, thermal: Any,
) -> None:  # fmt: skip
    """Write the dense output at the fraction ``x`` of a step into one row."""
    rows[at, 0] = t
    for i in range(3):
        rows[at, 1 + i] = dense_output(x, y[i], out[i], k[:, i], d)
    zx = dense_output(x, z, z_new, total, d)
    rows[at, 4] = rise_of(zx, thermal)[0]


@inlined
def _watched(kind: int, ar: float, ai: float, N: float, dT: float) -> float:
    """Return the quantity that an event watches: U, N or dT for 1, 2 and 3."""
    return ar * ar + ai * ai if kind == 1 else N if kind == 2 else dT


def _workspace(n: int, thermal: Any) -> Any:
    """Return the work arrays that a step needs for the kind of the model."""


def _take(
    y: Array, h: float, pump: Array, detuning: Array, slopes: Array, rates: Rates, fcd: Array, thermal: Any,
    method: Tableau, out: Array, k: Array, total: Array, space: Any,
) -> Any:  # fmt: skip
    """Take one step of the model's kind."""


@overload(_workspace, jit_options=OPTIONS, strict=False)
def _workspace_of(n: Any, thermal: Any) -> Any:
    def network(n, thermal):  # type: ignore[no-untyped-def]
        return np.empty(n)

    def full(n, thermal):  # type: ignore[no-untyped-def]
        return np.empty((n, n)), np.empty(n, np.int64), np.empty((3, 3 + n))

    return kinds.chosen(thermal, network, full)


@overload(_take, jit_options=OPTIONS, strict=False)
def _take_of(y, h, pump, detuning, slopes, rates, fcd, thermal, method, out, k, total, space):  # type: ignore[no-untyped-def]
    return kinds.chosen(thermal, step.py_func, quadratic.step.py_func)


@inner
def growing(y: Array, detuning: float, rates: Rates, fcd: Array, thermal: Any) -> float:
    """Return the modulus of the fastest mode that grows at a state, in 1/ns, or 0 where all decay."""
    return fastest_growth(equations.jacobian(y, detuning, rates, fcd, thermal))


@compiled
def integrate(
    y: Array, laser: LaserPieces, rates: Rates, fcd: Array, thermal: Any, method: Tableau, rtol: float, floor: Array,
    times: Array, per_step: int, first: float, event: Array, max_steps: int, watch: Array,
) -> tuple[Array, Array, float, float, Array, NDArray[np.int64]]:  # fmt: skip
    """Integrate from ``y`` through every piece of ``laser``, whose edges it lands on.

    Parameters
    ----------
    y : array, shape (3 + n,)
        Re a, Im a (sqrt(fJ)), N (1e23/m^3) and the states of the thermal model.
    laser : LaserPieces
    rates, fcd, thermal : Rates, array of shape (terms, 2), Thermal
        from `equations.internal_rates` and `internal_thermal`.
    method, rtol, floor : Tableau, float, array of shape (3,)
        error per step in field, carriers and temperature, relative to their size, or to ``floor`` where that is larger.
    times : array, ns
        wanted output times, or empty.
    per_step : int
        rows for every accepted step, at equal distances to its end, where ``times`` is empty.
    first : float, ns
        the first step tried; 0 for a cautious one.
    event : array, shape (3,)
        what is watched (0 nothing, 1 U in fJ, 2 N, 3 dT), the level, and whether the integration ends there (0 or 1).
    max_steps : int
    watch : array, shape (2 or more,)
        looked at and written to in every step, by and for another thread: whether to stop (0 or 1), and t in ns.

    Returns
    -------
    rows : array, shape (m, 5)
        t, Re a, Im a, N, dT; at ``times`` by dense output, or at the accepted steps where ``times`` is empty.
    y : array, shape (3 + n,)
        the state at the end.
    t : float
        the end, ns: the last edge unless an event came before or the integration gave up.
    h : float
        the step it would take next, ns.
    crossings : array, ns
        when the watched quantity rose through its level.
    counts : array of int, shape (3,)
        accepted steps, rejected steps, and how it ended (DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, EVENT, STOPPED).

    Steps are bounded where the state rests: an L-stable method damps with a long step what grows by the equations, and
    would stay on an unstable fixed point. A state that a step moves by less than 1 % has its Jacobian's eigenvalues
    looked at whenever the step has grown fourfold, and every 20 steps; those that grow bound it by |lambda| h <= 1/4.
    """
    n, stages = y.size - 3, method.a.shape[0]
    y, out = y.copy(), np.empty(3 + n)
    space = _workspace(n, thermal)
    k, total = np.zeros((stages, 3 + n)), np.empty(stages)
    pump, detuning, slopes = np.empty(stages), np.empty(stages), np.zeros(2)
    zero: Any = np.int64(0)  # no literal: what is called with one is compiled twice
    wanted, filled = times.size, zero
    rows = np.empty((wanted if wanted > 0 else 4096, 5))
    probe = np.empty((1, 5))
    crossings, crossed, kind = np.empty(16), 0, int(event[0])
    t, end = laser.edges[0], laser.edges[-1]
    z_new = read(y, thermal)
    seen = _watched(kind, y[0], y[1], y[2], rise_of(z_new, thermal)[0]) - event[1]
    if wanted == 0:
        _record(rows, filled, t, y, z_new, thermal)
        filled = 1
    while filled < wanted and times[filled] <= t:
        _record(rows, filled, times[filled], y, z_new, thermal)
        filled += 1
    largest = largest_power(laser.edges, laser.power)
    cautious = 1e-2 / rates.loss
    h, h_before, size_before, growth = first if first > 0.0 else cautious, 0.0, 1.0, GROWTH
    accepted, rejected, ended = 0, 0, DONE
    quiet_step = 0.1 * rates.tau0  # no mode of carriers and heat turns within a shorter one
    look_again = 0
    looked, cap = 0.0, math.inf  # the step at the last look at the eigenvalues, and the bound from it
    for piece in range(laser.edges.size - 1):
        begin, stop = laser.edges[piece], laser.edges[piece + 1]
        p, d = laser.power[piece], laser.detuning[piece]
        steady = p[1] == 0.0 and p[2] == 0.0 and p[3] == 0.0 and d[1] == 0.0 and d[2] == 0.0 and d[3] == 0.0
        before_pump, before_detuning = pump[0], detuning[0]
        light(laser, piece, 0.0, 0.0, method.at, largest, pump, detuning, slopes)
        if piece > 0:
            was = begin - laser.edges[piece - 1]
            q, e = laser.power[piece - 1], laser.detuning[piece - 1]
            before_pump = math.sqrt(max(q[0] + was * (q[1] + was * (q[2] + was * q[3])), 0.0))
            before_detuning = e[0] + was * (e[1] + was * (e[2] + was * e[3]))
            jump = abs(pump[0] - before_pump) > 1e-6 * math.sqrt(largest)
            if jump or abs(detuning[0] - before_detuning) > 1e-6 * rates.loss:
                h, h_before = min(h, cautious), 0.0
            looked, cap = 0.0, math.inf
        while t < stop:
            if accepted + rejected >= max_steps or watch[0] > 0.0:
                ended = STOPPED if watch[0] > 0.0 else TOO_MANY_STEPS
                break
            watch[1] = t
            planned = h
            landing = t + 1.0001 * h >= stop
            if landing:
                h = stop - t
            if not steady:
                light(laser, piece, t - begin, h, method.at, largest, pump, detuning, slopes)
            z, z_new = _take(y, h, pump, detuning, slopes, rates, fcd, thermal, method, out, k, total, space)
            error = step_error(y, out, z, z_new, k, rtol, floor, thermal)
            size = max(error, 1e-8) ** (1.0 / method.order)  # of the step, in units of the one the tolerance allows
            if not error <= 1.0:  # nan too
                rejected += 1
                growth = 1.0
                h = after_rejection(h, error, size)
                if h < 1e-13 * max(abs(t), 1e-3) or (error == TOP and h < 1e-3 * cautious):
                    ended = STEP_TOO_SMALL
                    break
                continue
            if kind > 0:
                rest = _watched(kind, out[0], out[1], out[2], rise_of(z_new, thermal)[0]) - event[1]
                if seen < 0.0 and rest >= 0.0:
                    low, high = 0.0, 1.0
                    for _ in range(40):  # bisection of the dense output
                        x = 0.5 * (low + high)
                        _between(probe, zero, t, x, y, out, z, z_new, k, total, method.dense, thermal)
                        if _watched(kind, probe[0, 1], probe[0, 2], probe[0, 3], probe[0, 4]) < event[1]:
                            low = x
                        else:
                            high = x
                    if crossed == crossings.size:
                        longer = np.empty(2 * crossed)
                        for i in range(crossed):
                            longer[i] = crossings[i]
                        crossings = longer
                    crossings[crossed] = t + high * h
                    crossed += 1
                    if event[2] > 0.0:  # ends here, with the dense output as its state
                        while filled < wanted and times[filled] <= t + high * h:
                            x = (times[filled] - t) / h
                            _between(rows, filled, times[filled], x, y, out, z, z_new, k, total, method.dense, thermal)
                            filled += 1
                        if wanted == 0:
                            _between(
                                rows, filled, t + high * h, high, y, out, z, z_new, k, total, method.dense, thermal
                            )
                            filled += 1
                        for i in range(3 + n):
                            out[i] = dense_output(high, y[i], out[i], k[:, i], method.dense)
                        y, t, ended = out, t + high * h, EVENT
                        accepted += 1
                        break
                seen = rest
            last = landing and stop == end
            while filled < wanted and (last or times[filled] <= t + h):
                x = (times[filled] - t) / h
                _between(rows, filled, times[filled], x, y, out, z, z_new, k, total, method.dense, thermal)
                filled += 1
            accepted += 1
            if wanted == 0:
                if filled + per_step > rows.shape[0]:
                    rows = doubled(rows)
                for j in range(1, per_step):
                    x = j / per_step
                    _between(rows, filled, t + x * h, x, y, out, z, z_new, k, total, method.dense, thermal)
                    filled += 1
            t = stop if landing else t + h
            y, out = out, y
            if wanted == 0:
                _record(rows, filled, t, y, z_new, thermal)
                filled += 1
            h_next = after_acceptance(h, size, h_before, size_before, growth)
            h_before, size_before, growth = h, max(size, 0.3), GROWTH
            h = h_next
            if landing and t < end:
                h = max(h, planned)
            if h > quiet_step:
                if relative_change(out, y, z, z_new, floor) > QUIET:
                    looked, cap = 0.0, math.inf
                elif h > 4.0 * looked or accepted >= look_again:
                    looked, look_again = h, accepted + 20
                    fastest = growing(y, detuning[0], rates, fcd, thermal)
                    cap = 0.25 / fastest if fastest > 0.0 else math.inf
                h = min(h, cap)
        if ended != DONE:
            break
    return rows[:filled], y, t, h, crossings[:crossed], tally(accepted, rejected, ended)


for kernel in (quadratic.step, integrate):
    for module in (equations, algebra, control, kinds, laser, quadratic, spectrum):
        forget_if_older(kernel, str(module.__file__))
