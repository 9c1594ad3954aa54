"""The loop over the steps of a circuit: error control, edges, delays, and what is kept, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..kernels.compiling import compiled, forget_if_older
from ..kernels.control import (
    DONE,
    GROWTH,
    QUIET,
    STEP_TOO_SMALL,
    STOPPED,
    TOO_MANY_ROWS,
    TOO_MANY_STEPS,
    after_acceptance,
    after_rejection,
    dense_output,
)
from ..kernels.equations import Array
from ..kernels.tableaus import Tableau
from . import equations, kernel, waves
from .equations import growing, neighbours
from .kernel import moved, step, step_error, workspace
from .layout import Complex, Heat, Integers, LaserTable, LightNetwork, Rings
from .waves import cubic_through, delayed_at, detected_at, detunings_at, energy_to, inputs_of, lasers_at, observe

ROW_LIMIT = 40_000_000  # numbers kept at the accepted steps, 320 MB


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
    f: float, t: float, h: float, piece: int, y: Array, out: Array, k: Array, d: Array, drive: LaserTable,
    net: LightNetwork, past: Array, cubics: Complex, filled: int, now: Now,
) -> None:  # fmt: skip
    """Write the observed waves at the fraction ``f`` of a step to ``now.waves``."""
    for i in range(now.fields.size):
        now.fields[i] = complex(
            dense_output(f, y[3 * i], out[3 * i], k[:, i, 0], d),
            dense_output(f, y[3 * i + 1], out[3 * i + 1], k[:, i, 1], d),
        )
    lasers_at(drive, piece, t + f * h, now.laser, now.laser_slope)
    delayed_at(t + f * h, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
    observe(net, now.fields, now.laser, now.delayed, now.waves)


@compiled
def keep_row(
    rows: Array, at: int, f: float, t: float, h: float, y: Array, out: Array, k: Array, total: Array, d: Array,
    before: Array, after: Array, other: Array, other_new: Array, heat: Heat, now: Now, gathered: Array,
) -> None:  # fmt: skip
    """Write t, then Re a, Im a, N, dT of each ring, the observed waves, and what was gathered of them, into one row."""
    n = heat.gain.shape[0]
    rows[at, 0] = t + f * h
    for i in range(n):
        for p in range(3):
            rows[at, 1 + 4 * i + p] = dense_output(f, y[3 * i + p], out[3 * i + p], k[:, i, p], d)
        z = dense_output(f, before[i], after[i], total[:, i], d)
        rows[at, 4 + 4 * i] = z + heat.curvature * z * z + (1.0 - f) * other[i] + f * other_new[i]
    for q in range(now.waves.size):
        rows[at, 1 + 4 * n + 2 * q], rows[at, 2 + 4 * n + 2 * q] = now.waves[q].real, now.waves[q].imag
    for q in range(gathered.size):
        rows[at, 1 + 4 * n + 2 * now.waves.size + q] = gathered[q]


@compiled
def gather(nodes: Complex, f: float, h: float, corner: Array, before: Array, out: Array) -> None:
    """Write the energies of the observed waves so far, if wanted, then the signals of the detectors, if there are any.

    ``before``, shape (Q or 0, + Q or 0), is at the start of the step, ``out`` at the fraction ``f`` of it.
    """
    energies = before.size - corner.size
    for q in range(energies):
        out[q] = before[q] + h * energy_to(nodes[:, q], f)
    for q in range(corner.size):
        if corner[q] > 0.0:
            out[energies + q] = detected_at(nodes[:, q], f, before[energies + q], corner[q] * h)


@compiled
def integrate(
    y: Array, drive: LaserTable, rings: Rings, heat: Heat, net: LightNetwork, method: Tableau, rtol: float,
    times: Array, average: bool, corner: Array, max_steps: int, watch: Array,
) -> tuple[Array, Array, float, Integers]:  # fmt: skip
    """Integrate a circuit from ``y`` through every piece of ``drive``, whose edges it lands on.

    Parameters
    ----------
    y : array, shape (3 N + N K,)
    times : array, ns
        wanted times after the start, or empty for the accepted steps.
    average : bool
        whether the energies of the observed waves since the start are kept, too, in fJ.
    corner : array, shape (Q,) or empty, 1/ns
        2 pi times the bandwidths of the detectors, 0 for none; empty if no wave has one.
    max_steps, watch
        as in `kernels.rosenbrock.integrate`.

    Returns
    -------
    rows : array, shape (m, 1 + 4 N + 2 Q (+ Q) (+ Q))
        t, then Re a, Im a, N, dT of each ring, Re and Im of each observed wave, the energies, and the signals of the
        detectors in uW; not the start's.
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
    past, cubics = np.empty((1024 if D > 0 else 1, 2)), np.zeros((1024 if D > 0 else 1, D, 4), np.complex128)
    filled, row = np.int64(0), np.int64(0)  # no literals: what is called with one is compiled twice
    nodes, gathered = np.zeros((4, Q), np.complex128), np.zeros((Q if average else 0) + corner.size)
    partial = np.zeros(gathered.size)
    wanted = times.size
    width = 1 + 4 * n + 2 * Q + gathered.size
    rows = np.empty((wanted if wanted > 0 else 1024, width))
    t, end = drive.edges[0], drive.edges[-1]
    slowest, loss = np.inf, 0.0
    for i in range(n):
        slowest, loss = min(slowest, rings.rates[i, 5]), max(loss, rings.rates[i, 0])
    shortest = np.inf
    for d in range(D):
        shortest = min(shortest, net.delay[d])
    cautious, quiet_step = 1e-2 / loss, 0.1 * slowest
    h, h_before, size_before, growth = min(cautious, shortest), 0.0, 1.0, GROWTH
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
                inputs_of(net, now.laser, now.delayed, inputs[q])
                detunings_at(drive, piece, at, detuning[q], bare)
                if q == 0:
                    inputs_of(net, now.laser_slope, now.delayed_slope, input_slopes)
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
                h = after_rejection(h, error, size)
                if h < 1e-13 * max(abs(t), 1e-3):
                    return rows[:row], y, t, np.array([accepted, rejected, STEP_TOO_SMALL])
                continue
            if D > 0 or gathered.size > 0:
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
                gather(nodes, f, h, corner, gathered, partial)
                keep_row(
                    rows, row, f, t, h, y, out, k, total, method.dense, w.before, w.after, other, other_new, heat, now,
                    partial,
                )  # fmt: skip
                row += 1
                if whole:
                    rows[row - 1, 0] = stop if landing else t + h
                    whole = False
            gather(nodes, 1.0, h, corner, gathered, partial)
            gathered, partial = partial, gathered
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
            h_next = after_acceptance(h, size, h_before, size_before, growth)
            h_before, size_before, growth = h, max(size, 0.3), GROWTH
            h = h_next
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


for loop in (integrate, waves_between, keep_row, extrapolate, gather):
    for module in (equations, kernel, waves):
        forget_if_older(loop, str(module.__file__))
