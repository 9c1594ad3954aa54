"""The loop over the steps of a circuit: error control, edges, delays, and what is kept, compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..kernel.tableaus import Tableau
from ..kernels.compiling import compiled, forget_if_older, inlined_lean
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
)
from ..kernels.equations import Array
from . import course as heat_course
from . import equations, kernel, poles, waves
from .course import Course, advance, extrapolate
from .equations import growing, neighbours
from .kernel import Workspace, moved, step, step_error, workspace
from .layout import Complex, Heat, Integers, LaserTable, LightNetwork, Rings
from .poles import Series
from .waves import (
    cubic_through,
    delayed_at,
    detected_at,
    detunings_at,
    energy_to,
    following,
    inputs_of,
    lasers_at,
    observe,
)

LOOKS, PAUSE = 10.0, 4000.0  # looks at the eigenvalues in a row, and the steps that earn one more, which costs hundreds
ROW_LIMIT = 40_000_000  # numbers kept at the accepted steps (320 MB)


class Now(NamedTuple):
    """Where a step stands, for what is read between its ends."""

    state: Array  # (4 N,), Re a, Im a, N and own temperature of the rings
    laser: Complex
    laser_slope: Complex
    delayed: Complex
    delayed_slope: Complex
    waves: Complex
    value: Array


class Stages(NamedTuple):
    """Light and detuning at the times of the stages, and their slopes at the first."""

    inputs: Complex  # (stages, N)
    input_slopes: Complex  # (N,)
    detuning: Array  # (stages, N)
    detuning_slopes: Array
    base: Array  # (N,), detuning without heat of the neighbours


@inlined_lean
def steady(drive: LaserTable, piece: int) -> tuple[bool, bool]:
    """Return whether the lasers, and whether the detunings, stay as they are in a piece."""
    light, turn = True, True
    power, detuning, turns = drive.power, drive.detuning, drive.turn
    p, d = drive.power_piece[piece], drive.detuning_piece[piece]
    for m in range(turns.size):
        for c in range(1, 4):
            light = light and power[p, m, c] == 0.0
        light = light and (turns[m] == 0.0 or power[p, m, 0] == 0.0)
    for i in range(detuning.shape[1]):
        for c in range(1, 4):
            turn = turn and detuning[d, i, c] == 0.0
    return light, turn


@inlined_lean
def drive_stages(
    t: float, h: float, piece: int, light: bool, turn: bool, drive: LaserTable, rings: Rings, heat: Heat,
    net: LightNetwork, method: Tableau, past: Array, cubics: Complex, filled: int, course: Course, now: Now,
    stages: Stages,
) -> None:  # fmt: skip
    """Fill ``stages`` for a step of ``h`` ns; what the piece keeps, ``light`` or ``turn``, only at its start."""
    D, n, places, rates, crossed = net.delay.size, stages.base.size, method.at, rings.rates, heat.crossed
    base, detuning, slopes, value = stages.base, stages.detuning, stages.detuning_slopes, now.value
    first, second = course.first, course.second
    for q in range(places.size):
        at = t + places[q] * h
        if not light or D > 0:
            lasers_at(drive, piece, at, now.laser, now.laser_slope)
            if D > 0:
                aside = (1.0 - 2.0 * places[q]) * drive.hair
                delayed_at(at, aside, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
            inputs_of(net, now.laser, now.delayed, stages.inputs[q])
            if q == 0:
                inputs_of(net, now.laser_slope, now.delayed_slope, stages.input_slopes)
        if not turn:
            detunings_at(drive, piece, at, base, value)
        if q == 0:
            for i in range(n):
                slopes[i] = 0.0 if turn else value[i]
        for i in range(n):
            detuning[q, i] = base[i]
        if crossed:
            extrapolate(course, at, value)
            for i in range(n):
                detuning[q, i] += rates[i, 8] * value[i]
    if crossed:
        ahead = t - course.time[1]  # t is the time of the newest value
        for i in range(n):
            slopes[i] += rates[i, 8] * (first[i] + second[i] * ahead)


@inlined_lean
def between(
    f: float, t: float, h: float, piece: int, out: Array, k: Array, d: Array, w: Workspace, drive: LaserTable,
    net: LightNetwork, past: Array, cubics: Complex, filled: int, now: Now,
) -> None:  # fmt: skip
    """Write the state and the observed waves at the fraction ``f`` of a step to ``now``: at 1, before a front there."""
    state, start, after, n = now.state, w.start, w.after, w.own.size
    for i in range(n):
        for p in range(3):
            state[p * n + i] = out[3 * i + p] if f == 1.0 else (1.0 - f) * start[p * n + i] + f * out[3 * i + p]
        state[3 * n + i] = (1.0 - f) * start[3 * n + i] + f * after[i]
    if f < 1.0:
        for j in range(k.shape[0]):
            part = f * (1.0 - f) * (d[0, j] + f * (d[1, j] + f * d[2, j]))
            for m in range(4 * n):
                state[m] += part * k[j, m]
    lasers_at(drive, piece, t + f * h, now.laser, now.laser_slope)
    if net.delay.size > 0:
        aside = (1.0 - 2.0 * f) * drive.hair
        delayed_at(t + f * h, aside, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
    observe(net, state, now.laser, now.delayed, now.waves)


@inlined_lean
def keep_row(
    rows: Array, at: int, f: float, time: float, other: Array, other_new: Array, heat: Heat, now: Now, gathered: Array
) -> None:
    """Write t, then Re a, Im a, N, dT of each ring, the observed waves, and what was gathered of them, into one row."""
    n, state, waves, curvature = other.size, now.state, now.waves, heat.curvature
    rows[at, 0] = time
    for i in range(n):
        for p in range(3):
            rows[at, 1 + 4 * i + p] = state[p * n + i]
        z = state[3 * n + i]
        rows[at, 4 + 4 * i] = z + curvature * z * z + (1.0 - f) * other[i] + f * other_new[i]
    for q in range(waves.size):
        rows[at, 1 + 4 * n + 2 * q], rows[at, 2 + 4 * n + 2 * q] = waves[q].real, waves[q].imag
    for q in range(gathered.size):
        rows[at, 1 + 4 * n + 2 * waves.size + q] = gathered[q]


@inlined_lean
def renew(
    rows: Array, row: int, t: float, y: Array, drive: LaserTable, net: LightNetwork, past: Array,
    cubics: Complex, filled: int, now: Now,
) -> None:  # fmt: skip
    """Overwrite the waves in rows at the start ``t`` of a piece by those after it; ``now`` holds its lasers."""
    n, state, waves = net.own.size, now.state, now.waves
    for i in range(n):
        state[i], state[n + i] = y[3 * i], y[3 * i + 1]
    if net.delay.size > 0:
        delayed_at(t, drive.hair, net.delay, past, cubics, filled, now.delayed, now.delayed_slope)
    observe(net, state, now.laser, now.delayed, waves)
    at = row - 1
    while at >= 0 and rows[at, 0] >= t - drive.hair:
        for q in range(waves.size):
            rows[at, 1 + 4 * n + 2 * q], rows[at, 2 + 4 * n + 2 * q] = waves[q].real, waves[q].imag
        at -= 1


@inlined_lean
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
    y: Array, drive: LaserTable, rings: Rings, heat: Heat, net: LightNetwork, method: Tableau, series: Series,
    rtol: float, times: Array, average: bool, corner: Array, max_steps: int, watch: Array,
) -> tuple[Array, Array, float, Integers]:  # fmt: skip
    """Integrate a circuit from ``y`` through every piece of ``drive``, whose edges it lands on.

    y [shape (3 N + N K,)]
    times [ns]: wanted times after the start, or empty for the accepted steps.
    average: whether the energies of the observed waves since the start are kept, too, in fJ.
    corner [shape (Q,) or empty, 1/ns]: 2 pi times the bandwidths of the detectors, 0 for none; empty if no wave has
        one.
    max_steps, watch: as in `kernels.rosenbrock.integrate`.
    Returns rows [shape (m, 1 + 4 N + 2 Q (+ Q) (+ Q))]: t, then Re a, Im a, N, dT of each ring, Re and Im of each
        observed wave, the energies, and the signals of the detectors in uW; not the start's. Waves at an edge are
        those after it.
    Returns [y, t, counts]: the state and time of the end; accepted steps, rejected steps, and how it ended.
    """
    n, K = heat.gain.shape
    stages, D, Q, L = method.a.shape[0], net.delay.size, net.seen_ring.shape[0], drive.power.shape[1]
    y, out = y.copy(), np.empty_like(y)
    w = workspace(rings, heat, net.order.size == 0, stages, series.stages.shape[0])
    k = np.zeros((stages, 4 * n))
    lit = Stages(
        np.zeros((stages, n), np.complex128),
        np.zeros(n, np.complex128),
        np.zeros((stages, n)),
        np.zeros(n),
        np.zeros(n),
    )
    now = Now(
        np.zeros(4 * n), np.zeros(L, np.complex128), np.zeros(L, np.complex128),
        np.zeros(D, np.complex128), np.zeros(D, np.complex128), np.zeros(Q, np.complex128), np.zeros(n),
    )  # fmt: skip
    was, plain = np.zeros(L, np.complex128), np.zeros(n)
    other, other_new, missed = np.zeros(n), np.zeros(n), np.zeros(n)
    course = Course(np.zeros(3), np.zeros((3, n)), np.zeros(n), np.zeros(n))
    known: Any = np.int64(1)
    past, cubics = np.empty((1024 if D > 0 else 1, 3)), np.zeros((1024 if D > 0 else 1, D, 4), np.complex128)
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
    if (D > 0 or gathered.size > 0) and drive.beat > 0.0:
        # the cubic through nodes of exp(i x t) at thirds of a step is off by (x h)^4/1944
        shortest = min(shortest, (1944.0 * rtol) ** 0.25 / drive.beat)
    cautious, quiet_step = 1e-2 / loss, 0.1 * slowest
    restart, fresh = cautious, False  # the step to try after a jump, and whether this is one
    h, h_before, size_before, growth = min(cautious, shortest), 0.0, 1.0, GROWTH
    accepted, rejected, look_again, looks = 0, 0, 0, LOOKS
    looked, cap = 0.0, math.inf
    neighbours(y, heat, other)
    advance(course, known, t, other)
    for i in range(n):
        z = 0.0
        for p in range(K):
            z += heat.read[i, i, p] * y[3 * n + i * K + p]
        w.start[3 * n + i], w.after[i] = z, z
    for piece in range(drive.edges.size - 1):
        begin, stop = drive.edges[piece], drive.edges[piece + 1]
        was[:] = now.laser
        if piece > 0:
            lasers_at(drive, piece - 1, begin, was, now.laser_slope)
            detunings_at(drive, piece - 1, begin, plain, missed)
        lasers_at(drive, piece, begin, now.laser, now.laser_slope)
        detunings_at(drive, piece, begin, lit.base, lit.detuning_slopes)
        renew(rows, row, begin, y, drive, net, past, cubics, filled, now)
        light, turn = steady(drive, piece)
        for q in range(stages):
            inputs_of(net, now.laser, now.delayed, lit.inputs[q])
        lit.input_slopes[:] = 0.0
        if piece > 0:
            jump = D > 0  # or an edge of the light that comes back
            for m in range(L):
                jump = jump or abs(now.laser[m] - was[m]) > 1e-6 * math.sqrt(drive.largest[m])
            for i in range(n):
                jump = jump or abs(lit.base[i] - plain[i]) > 1e-6 * rings.rates[i, 0]
            if jump:
                h, h_before, fresh = min(h, restart), 0.0, True
                looked, cap = 0.0, math.inf
        while t < stop:
            if accepted + rejected >= max_steps or watch[0] > 0.0:
                ended = STOPPED if watch[0] > 0.0 else TOO_MANY_STEPS
                return rows[:row], y, t, np.array([accepted, rejected, ended])
            watch[1] = t
            if D > 0:
                h = following(t, h, net.delay, past, filled)
            planned = h
            landing = t + 1.0001 * h >= stop
            if landing:
                h = stop - t
            drive_stages(
                t, h, piece, light, turn, drive, rings, heat, net, method, past, cubics, filled, course, now, lit
            )
            step(
                y, h, lit.inputs, lit.input_slopes, lit.detuning, lit.detuning_slopes, rings, heat, net, method,
                series, out, k, w,
            )  # fmt: skip
            if heat.crossed:
                neighbours(out, heat, other_new)
                extrapolate(course, t + h, now.value)
                for i in range(n):
                    missed[i] = other_new[i] - now.value[i]
            else:
                missed[:] = 0.0
            error = step_error(y, out, k, rings, rtol, missed, other, w)
            size = max(error, 1e-8) ** (1.0 / method.order)
            if not error <= 1.0:  # nan too
                rejected += 1
                growth = 1.0
                h = after_rejection(h, error, size)
                if h < 1e-13 * max(abs(t), 1e-3):
                    return rows[:row], y, t, np.array([accepted, rejected, STEP_TOO_SMALL])
                continue
            if fresh:  # what would have been right; a longer one would not resolve how the field changes
                restart, fresh = min(h * max(0.2, min(GROWTH, 0.8 / size)), 0.5 / loss), False
            if D > 0 or gathered.size > 0:
                for j in range(4):
                    between(j / 3.0, t, h, piece, out, k, method.dense, w, drive, net, past, cubics, filled, now)
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
                between(f, t, h, piece, out, k, method.dense, w, drive, net, past, cubics, filled, now)
                gather(nodes, f, h, corner, gathered, partial)
                keep_row(rows, row, f, t + f * h, other, other_new, heat, now, partial)
                row += 1
                if whole:
                    rows[row - 1, 0] = stop if landing else t + h
                    whole = False
            if gathered.size > 0:
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
                past[filled, 0], past[filled, 1], past[filled, 2] = t, h, max(h, planned)
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
                known = min(known + 1, 3)
                advance(course, known, t, other)
            h_next = after_acceptance(h, size, h_before, size_before, growth)
            h_before, size_before, growth = h, max(size, 0.3), GROWTH
            h = h_next
            if landing and t < end:
                h = max(h, planned)
            looks = min(looks + 1.0 / PAUSE, LOOKS)
            coming = stop - t if t < stop else drive.edges[min(piece + 2, drive.edges.size - 1)] - t
            if min(h, coming) > quiet_step:
                if moved(out, y, rings, w) > QUIET:
                    looked, cap = 0.0, math.inf
                elif h > 4.0 * looked or accepted >= look_again:
                    if looks >= 1.0:
                        looked, look_again, looks = h, accepted + 20, looks - 1.0
                        fastest = growing(y, lit.detuning[0], rings, heat, net)
                        cap = 0.25 / fastest if fastest > 0.0 else math.inf
                    else:
                        h = min(h, max(4.0 * looked, quiet_step))
                h = min(h, cap)
            h = min(h, shortest)
    return rows[:row], y, t, np.array([accepted, rejected, DONE])


for module in (equations, heat_course, kernel, poles, waves):
    forget_if_older(integrate, str(module.__file__))
