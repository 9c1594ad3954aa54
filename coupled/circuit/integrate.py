"""The loop over the steps of a circuit: error control, edges, delays, and what is kept, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..kernels import equations
from ..kernels.compiling import compiled, forget_if_older
from ..kernels.equations import Array, Rates, absorbed_power, dispersion, optics, optics_jacobian
from ..kernels.tableaus import Tableau
from . import kernel
from .kernel import (
    DONE,
    QUIET,
    ROW_LIMIT,
    STEP_TOO_SMALL,
    STOPPED,
    TOO_MANY_ROWS,
    TOO_MANY_STEPS,
    Complex,
    Drive,
    Heat,
    Integers,
    Network,
    Rings,
    _inputs,
    _rates,
    delayed_at,
    dense,
    detunings_at,
    lasers_at,
    moved,
    neighbours,
    step,
    step_error,
    workspace,
)

LARGEST_SPECTRUM = 90  # rows of the Jacobian of the whole circuit whose eigenvalues are looked at


@compiled
def right_hand_side(
    y: Array, laser: Complex, delayed: Complex, detuning: Array, rings: Rings, heat: Heat, net: Network
) -> Array:
    """Return dy/dt in internal units, shape (3 N + N K,), at the waves of lasers and delayed waveguides."""
    n, K = heat.gain.shape
    out, other, b = np.empty_like(y), np.empty(n), np.empty(n, np.complex128)
    neighbours(y, heat, other)
    _inputs(net, laser, delayed, b)
    for i in range(n):
        z = 0.0
        for k in range(K):
            z += heat.read[i, i, k] * y[3 * n + i * K + k]
        rates = _rates(rings, i)
        turned = detuning[i] + rates.thermal_shift * other[i]
        shift = dispersion(y[3 * i + 2], rings.fcd[i])[0]
        dT = z + heat.curvature * z * z
        f0, f1, f2, power = optics(y[3 * i], y[3 * i + 1], y[3 * i + 2], dT, shift, 0.0, turned, rates)
        light = 1j * b[i]
        for e in range(net.start[i], net.start[i + 1]):
            j = net.column[e]
            light += net.entry[e] * complex(y[3 * j], y[3 * j + 1])
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = f0 + light.real, f1 + light.imag, f2
        for k in range(K):
            at = 3 * n + i * K + k
            out[at] = heat.gain[i, k] * power - heat.rate[i, k] * y[at]
    return out


@compiled
def jacobian(y: Array, detuning: Array, rings: Rings, heat: Heat, net: Network) -> Array:
    """Return d(dy/dt)/dy of the circuit, with the light of delayed waveguides held."""
    n, K = heat.gain.shape
    out, other = np.zeros((y.size, y.size)), np.empty(n)
    neighbours(y, heat, other)
    for i in range(n):
        z = 0.0
        for k in range(K):
            z += heat.read[i, i, k] * y[3 * n + i * K + k]
        rates = _rates(rings, i)
        turned = detuning[i] + rates.thermal_shift * other[i]
        dT, bend = z + heat.curvature * z * z, 1.0 + 2.0 * heat.curvature * z
        shift, slope = dispersion(y[3 * i + 2], rings.fcd[i])
        J = optics_jacobian(y[3 * i], y[3 * i + 1], y[3 * i + 2], dT, shift, slope, turned, rates)
        for p in range(3):
            for q in range(3):
                out[3 * i + p, 3 * i + q] = J[p][q]
            for j in range(n):
                for k in range(K):
                    factor = bend if j == i else 1.0
                    out[3 * i + p, 3 * n + j * K + k] = J[p][3] * factor * heat.read[i, j, k]
        for e in range(net.start[i], net.start[i + 1]):
            j, m = net.column[e], net.entry[e]
            out[3 * i, 3 * j] += m.real
            out[3 * i, 3 * j + 1] -= m.imag
            out[3 * i + 1, 3 * j] += m.imag
            out[3 * i + 1, 3 * j + 1] += m.real
        for k in range(K):
            at = 3 * n + i * K + k
            out[at, at] = -heat.rate[i, k]
            for q in range(3):
                out[at, 3 * i + q] = heat.gain[i, k] * J[3][q]
    return out


@compiled
def growing(y: Array, detuning: Array, rings: Rings, heat: Heat, net: Network) -> float:
    """Return the modulus of the fastest mode that grows, in 1/ns, or 0 where all decay.

    Of the whole circuit where it is small, else of each ring with its own heat.
    """
    n, K = heat.gain.shape
    fastest = 0.0
    if y.size <= LARGEST_SPECTRUM:
        for value in np.linalg.eigvals(jacobian(y, detuning, rings, heat, net).astype(np.complex128)):
            if value.real > 0.0:
                fastest = max(fastest, abs(value))
        return fastest
    other = np.empty(n)
    neighbours(y, heat, other)
    start, none = np.zeros(2, np.int64), np.empty(0, np.complex128)
    alone = Network(
        start, np.empty(0, np.int64), none, np.zeros(1, np.int64), np.empty((1, 0), np.complex128),
        np.empty((1, 0), np.complex128), np.empty((0, 1), np.complex128), np.empty((0, 0), np.complex128),
        np.empty((0, 0), np.complex128), np.empty(0),
    )  # fmt: skip
    state, turned = np.empty(3 + K), np.empty(1)
    for i in range(n):
        one = Rings(rings.rates[i : i + 1], rings.fcd[i : i + 1], rings.floor[i : i + 1])
        own = np.empty((1, 1, K))
        own[0, 0] = heat.read[i, i]
        single = Heat(heat.gain[i : i + 1], heat.rate[i : i + 1], own, heat.curvature, False)
        state[:3] = y[3 * i : 3 * i + 3]
        state[3:] = y[3 * n + i * K : 3 * n + (i + 1) * K]
        turned[0] = detuning[i] + rings.rates[i, 8] * other[i]
        for value in np.linalg.eigvals(jacobian(state, turned, one, single, alone).astype(np.complex128)):
            if value.real > 0.0:
                fastest = max(fastest, abs(value))
    return fastest


class Course(NamedTuple):
    """The heat of the neighbours at the last accepted steps, newest first, and what it is extrapolated from."""

    time: Array  # shape (3,)
    value: Array  # shape (3, N)


@compiled
def extrapolate(course: Course, known: int, t: float, value: Array, slope: Array) -> None:
    """Write the parabola through the last values at ``t``, and its slope; fewer points give a line or a constant."""
    for i in range(value.size):
        v0 = course.value[0, i]
        value[i], slope[i] = v0, 0.0
        if known > 1:
            first = (v0 - course.value[1, i]) / (course.time[0] - course.time[1])
            value[i], slope[i] = v0 + first * (t - course.time[0]), first
            if known > 2:
                early = (course.value[1, i] - course.value[2, i]) / (course.time[1] - course.time[2])
                second = (first - early) / (course.time[0] - course.time[2])
                value[i] += second * (t - course.time[0]) * (t - course.time[1])
                slope[i] += second * (2.0 * t - course.time[0] - course.time[1])


@compiled
def observe(net: Network, fields: Complex, laser: Complex, delayed: Complex, out: Complex) -> None:
    """Write the observed waves in sqrt(uW)."""
    for q in range(out.size):
        total = 0.0 + 0.0j
        for i in range(fields.size):
            total += net.seen_ring[q, i] * fields[i]
        for m in range(laser.size):
            total += net.seen_laser[q, m] * laser[m]
        for d in range(delayed.size):
            total += net.seen_delay[q, d] * delayed[d]
        out[q] = total


class Now(NamedTuple):
    """Where a step stands, for what is read between its ends."""

    fields: Complex
    laser: Complex
    laser_slope: Complex
    delayed: Complex
    delayed_slope: Complex
    waves: Complex
    value: Array
    slope: Array


@compiled
def waves_between(
    f: float, t: float, h: float, piece: int, y: Array, out: Array, k: Array, d: Array, drive: Drive, net: Network,
    past: Array, cubics: Complex, filled: int, now: Now,
) -> None:  # fmt: skip
    """Write the observed waves at the fraction ``f`` of a step to ``now.waves``."""
    for i in range(now.fields.size):
        now.fields[i] = complex(
            dense(f, y[3 * i], out[3 * i], k[:, i, 0], d), dense(f, y[3 * i + 1], out[3 * i + 1], k[:, i, 1], d)
        )
    lasers_at(drive, piece, t + f * h, now.laser, now.laser_slope)
    delayed_at(t + f * h, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
    observe(net, now.fields, now.laser, now.delayed, now.waves)


@compiled
def keep_row(
    rows: Array, at: int, f: float, t: float, h: float, y: Array, out: Array, k: Array, total: Array, d: Array,
    before: Array, after: Array, other: Array, other_new: Array, heat: Heat, now: Now, energy: Array,
) -> None:  # fmt: skip
    """Write t, then Re a, Im a, N, dT of each ring, the observed waves, and their energies so far, into one row."""
    n = heat.gain.shape[0]
    rows[at, 0] = t + f * h
    for i in range(n):
        for p in range(3):
            rows[at, 1 + 4 * i + p] = dense(f, y[3 * i + p], out[3 * i + p], k[:, i, p], d)
        z = dense(f, before[i], after[i], total[:, i], d)
        rows[at, 4 + 4 * i] = z + heat.curvature * z * z + (1.0 - f) * other[i] + f * other_new[i]
    for q in range(now.waves.size):
        rows[at, 1 + 4 * n + 2 * q], rows[at, 2 + 4 * n + 2 * q] = now.waves[q].real, now.waves[q].imag
    for q in range(energy.size):
        rows[at, 1 + 4 * n + 2 * now.waves.size + q] = energy[q]


@compiled
def cubic_through(p0: complex, p1: complex, p2: complex, p3: complex) -> tuple[complex, complex, complex, complex]:
    """Return the cubic through values at 0, 1/3, 2/3 and 1, constant term first."""
    c1 = -5.5 * p0 + 9.0 * p1 - 4.5 * p2 + p3
    c2 = 9.0 * p0 - 22.5 * p1 + 18.0 * p2 - 4.5 * p3
    c3 = -4.5 * p0 + 13.5 * p1 - 13.5 * p2 + 4.5 * p3
    return p0, c1, c2, c3


@compiled
def integrate(
    y: Array, drive: Drive, rings: Rings, heat: Heat, net: Network, method: Tableau, rtol: float, times: Array,
    average: bool, max_steps: int, watch: Array,
) -> tuple[Array, Array, float, Integers]:  # fmt: skip
    """Integrate a circuit from ``y`` through every piece of ``drive``, whose edges it lands on.

    Parameters
    ----------
    y : array, shape (3 N + N K,)
    times : array, ns
        wanted times after the start, or empty for the accepted steps.
    average : bool
        whether the energies of the observed waves since the start are kept, too, in fJ.
    max_steps, watch
        as in `kernels.rosenbrock.integrate`.

    Returns
    -------
    rows : array, shape (m, 1 + 4 N + 2 Q (+ Q))
        t, then Re a, Im a, N, dT of each ring, Re and Im of each observed wave, and the energies; not the start's.
    y, t, counts
        the state and time of the end; accepted steps, rejected steps, and how it ended.
    """
    n, K = heat.gain.shape
    stages, D, Q, L = method.a.shape[0], net.delay.size, net.seen_ring.shape[0], drive.power.shape[1]
    y, out, w = y.copy(), np.empty_like(y), workspace(n, K)
    k, x, total = np.zeros((stages, n, 3)), np.zeros((stages, n, K)), np.zeros((stages, n))
    inputs, input_slopes = np.zeros((stages, n), np.complex128), np.zeros(n, np.complex128)
    detuning, detuning_slopes = np.zeros((stages, n)), np.zeros(n)
    now = Now(
        np.zeros(n, np.complex128), np.zeros(L, np.complex128), np.zeros(L, np.complex128),
        np.zeros(D, np.complex128), np.zeros(D, np.complex128), np.zeros(Q, np.complex128), np.zeros(n), np.zeros(n),
    )  # fmt: skip
    plain, bare = np.zeros(n), np.zeros(n)
    other, other_new, missed = np.zeros(n), np.zeros(n), np.zeros(n)
    course, known = Course(np.zeros(3), np.zeros((3, n))), 1
    past, cubics, filled = np.empty((1024 if D > 0 else 1, 2)), np.zeros((1024 if D > 0 else 1, D, 4), np.complex128), 0
    nodes, energy = np.zeros((4, Q), np.complex128), np.zeros(Q if average else 0)
    partial = np.zeros(energy.size)
    wanted, row = times.size, 0
    width = 1 + 4 * n + 2 * Q + energy.size
    rows = np.empty((wanted if wanted > 0 else 1024, width))
    t, end = drive.edges[0], drive.edges[-1]
    slowest, loss = np.inf, 0.0
    for i in range(n):
        slowest, loss = min(slowest, rings.rates[i, 5]), max(loss, rings.rates[i, 0])
    shortest = np.inf
    for d in range(D):
        shortest = min(shortest, net.delay[d])
    cautious, quiet_step = 1e-2 / loss, 0.1 * slowest
    h, h_before, size_before, growth = min(cautious, shortest), 0.0, 1.0, 5.0
    accepted, rejected, look_again = 0, 0, 0
    looked, cap = 0.0, math.inf
    neighbours(y, heat, other)
    course.time[0] = t
    course.value[0] = other
    for i in range(n):
        z = 0.0
        for p in range(K):
            z += heat.read[i, i, p] * y[3 * n + i * K + p]
        w.before[i], w.after[i] = z, z
    for piece in range(drive.edges.size - 1):
        begin, stop = drive.edges[piece], drive.edges[piece + 1]
        if piece > 0:
            lasers_at(drive, piece - 1, begin, now.laser, now.laser_slope)
            was = now.laser.copy()
            detunings_at(drive, piece - 1, begin, plain, bare)
            lasers_at(drive, piece, begin, now.laser, now.laser_slope)
            detunings_at(drive, piece, begin, missed, bare)
            jump = D > 0  # or an edge of the light that comes back
            for m in range(L):
                jump = jump or abs(now.laser[m] - was[m]) > 1e-6 * math.sqrt(drive.largest[m])
            for i in range(n):
                jump = jump or abs(missed[i] - plain[i]) > 1e-6 * rings.rates[i, 0]
            if jump:
                h, h_before = min(h, cautious), 0.0
            looked, cap = 0.0, math.inf
        while t < stop:
            if accepted + rejected >= max_steps or watch[0] > 0.0:
                ended = STOPPED if watch[0] > 0.0 else TOO_MANY_STEPS
                return rows[:row], y, t, np.array([accepted, rejected, ended])
            watch[1] = t
            planned = h
            landing = t + 1.0001 * h >= stop
            if landing:
                h = stop - t
            for q in range(stages):
                at = t + method.at[q] * h
                lasers_at(drive, piece, at, now.laser, now.laser_slope)
                if D > 0:
                    delayed_at(at, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
                _inputs(net, now.laser, now.delayed, inputs[q])
                detunings_at(drive, piece, at, detuning[q], bare)
                if q == 0:
                    _inputs(net, now.laser_slope, now.delayed_slope, input_slopes)
                    for i in range(n):
                        detuning_slopes[i] = bare[i]
                if heat.crossed:
                    extrapolate(course, known, at, now.value, now.slope)
                    for i in range(n):
                        detuning[q, i] += rings.rates[i, 8] * now.value[i]
                        if q == 0:
                            detuning_slopes[i] += rings.rates[i, 8] * now.slope[i]
            step(y, h, inputs, input_slopes, detuning, detuning_slopes, rings, heat, net, method, out, k, x, total, w)
            if heat.crossed:
                neighbours(out, heat, other_new)
                extrapolate(course, known, t + h, now.value, now.slope)
                for i in range(n):
                    missed[i] = other_new[i] - now.value[i]
            else:
                missed[:] = 0.0
            error = step_error(y, out, k, x, rings, heat, rtol, missed, other, w)
            size = max(error, 1e-8) ** (1.0 / method.order)
            if not error <= 1.0:  # nan too
                rejected += 1
                growth = 1.0
                h *= max(0.2, 0.9 / size) if error < math.inf else 0.2
                if h < 1e-13 * max(abs(t), 1e-3):
                    return rows[:row], y, t, np.array([accepted, rejected, STEP_TOO_SMALL])
                continue
            if D > 0 or average:
                for j in range(4):
                    waves_between(j / 3.0, t, h, piece, y, out, k, method.dense, drive, net, past, cubics, filled, now)
                    for q in range(Q):
                        nodes[j, q] = now.waves[q]
            last = landing and stop == end
            whole = wanted == 0
            if whole and row == rows.shape[0]:
                if 2 * row * width > ROW_LIMIT:
                    return rows[:row], y, t, np.array([accepted, rejected, TOO_MANY_ROWS])
                rows = np.concatenate((rows, np.empty_like(rows)))
            while whole or (row < wanted and (last or times[row] <= t + h)):
                f = 1.0 if whole else (times[row] - t) / h
                waves_between(f, t, h, piece, y, out, k, method.dense, drive, net, past, cubics, filled, now)
                for q in range(energy.size):
                    partial[q] = energy[q] + h * _energy(nodes[:, q], f)
                keep_row(
                    rows, row, f, t, h, y, out, k, total, method.dense, w.before, w.after, other, other_new, heat, now,
                    partial,
                )  # fmt: skip
                row += 1
                if whole:
                    rows[row - 1, 0] = stop if landing else t + h
                    whole = False
            for q in range(energy.size):
                energy[q] += h * _energy(nodes[:, q], 1.0)
            accepted += 1
            if D > 0:
                if filled == past.shape[0]:
                    first = 0
                    longest = net.delay.max()
                    while first < filled - 1 and past[first + 1, 0] < t - longest:
                        first += 1
                    if first > filled // 2:  # forget what nobody asks for any more
                        for j in range(filled - first):
                            past[j] = past[first + j]
                            cubics[j] = cubics[first + j]
                        filled -= first
                    else:
                        past = np.concatenate((past, np.empty_like(past)))
                        cubics = np.concatenate((cubics, np.empty_like(cubics)))
                past[filled, 0], past[filled, 1] = t, h
                for d in range(D):
                    c = cubic_through(nodes[0, d], nodes[1, d], nodes[2, d], nodes[3, d])
                    for j in range(4):
                        cubics[filled, d, j] = c[j]
                filled += 1
            t = stop if landing else t + h
            y, out = out, y
            for i in range(n):
                other[i] = other_new[i]
            if heat.crossed:
                for j in range(2):
                    course.time[2 - j] = course.time[1 - j]
                    for i in range(n):
                        course.value[2 - j, i] = course.value[1 - j, i]
                course.time[0] = t
                for i in range(n):
                    course.value[0, i] = other[i]
                known = min(known + 1, 3)
            factor = 0.9 / size
            if h_before > 0.0:  # what the last two steps say about the next one
                factor = min(factor, factor * h / h_before * size_before / size)
            h_before, size_before = h, max(size, 0.3)
            h *= max(0.2, min(growth, factor))
            growth = 5.0
            if landing and t < end:
                h = max(h, planned)
            if h > quiet_step:
                if moved(out, y, rings, w) > QUIET:
                    looked, cap = 0.0, math.inf
                elif h > 4.0 * looked or accepted >= look_again:
                    looked, look_again = h, accepted + 20
                    fastest = growing(y, detuning[0], rings, heat, net)
                    cap = 0.25 / fastest if fastest > 0.0 else math.inf
                h = min(h, cap)
            h = min(h, shortest)
    return rows[:row], y, t, np.array([accepted, rejected, DONE])


@compiled
def _energy(nodes: Complex, f: float) -> float:
    """Return the integral of |wave|^2 from 0 to ``f`` of a step of length 1, the wave a cubic through its nodes."""
    c0, c1, c2, c3 = cubic_through(
        complex(abs(nodes[0]) ** 2),
        complex(abs(nodes[1]) ** 2),
        complex(abs(nodes[2]) ** 2),
        complex(abs(nodes[3]) ** 2),
    )
    return (f * (c0 + f * (c1 / 2.0 + f * (c2 / 3.0 + f * c3 / 4.0)))).real


@compiled
def heating(rows: Array, rates: Array) -> Array:
    """Return the absorbed power in uW of one ring from its rows Re a, Im a, N."""
    r = Rates(rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6], rates[7], rates[8], rates[9])
    out = np.empty(rows.shape[0])
    for m in range(rows.shape[0]):
        out[m] = absorbed_power(rows[m, 0] * rows[m, 0] + rows[m, 1] * rows[m, 1], rows[m, 2], r)
    return out


for compiled_kernel in (right_hand_side, jacobian, growing, integrate, heating):
    for module in (equations, kernel):
        forget_if_older(compiled_kernel, str(module.__file__))
