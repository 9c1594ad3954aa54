"""Error-controlled Rosenbrock integration of several rings coupled by light and by heat, compiled.

State: y = [Re a, Im a, N of each ring, then the thermal states of each ring]. With s = 1/(gamma h), the thermal states
of a ring are eliminated from (s - J) k = r as for a ring alone (`kernels.rosenbrock`), in closed form of the powers of
the stages (`poles`). What remains is

    (s - J_i - G_i u_i w_i^T) k_i - sum_j M_ij k_j = r_i

with M the waveguides without delay. Where light runs one way only, M is triangular in some order of the rings, and the
3 x 3 blocks are solved one after the other; elsewhere carriers are eliminated and
the matrix of 2 N rows is factorized.

Heat between rings is slow. Within a step it is a known function of time: the parabola through its last three values.
What it is off at the end of a step counts as an error of that step. Light from a waveguide with delay is a known
function, too: cubic over every past step; no step is longer than the shortest delay.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..kernel.tableaus import Tableau
from ..kernels import algebra, control, equations
from ..kernels.algebra import factorize, inverse, solve
from ..kernels.compiling import compiled, forget_if_older, inlined_lean, lean
from ..kernels.control import relative_change, squared_error
from ..kernels.equations import EPSILON, Array, Rates, optics, optics_jacobian
from . import layout, poles
from .layout import Complex, Heat, Integers, LightNetwork, Rings
from .poles import Series, Tables

NEAR = 0.1  # (r - 1)/(r + 1) up to which series of 8 and 11 terms have r^p to round-off, p from -1 to 1


class Workspace(NamedTuple):
    """Arrays that a step works in; the rings are the last axis."""

    blocks: Array  # (19, N): what solves for a ring, see `_prepare`
    matrix: Array  # (2 N, 2 N), of the fields where light runs in loops
    pivots: Integers
    start: Array  # (4 N,), Re a, Im a, N and own temperature at the start of the step
    now: Array  # (4 N,), in a stage
    right: Array  # (4 N,), right-hand sides, then solutions
    push: Array  # (2, N), u of each ring
    gather: Array  # (3, N), w of each ring
    own: Array  # (N,), G of each ring
    bent: Array  # (terms, 3, N), of the terms of S(N): N^2 + eps^2 and S/N at the start, and the exponent of the first
    shift: Array  # (N,), S(N) in a stage
    near: Array  # (N,), how far N^2 + eps^2 is from that of the start
    faded: Array  # (stages, N), what the poles add to the own temperature by themselves
    powers: Array  # (stages, N), absorbed in the stages, uW
    after: Array  # (N,), own temperature at the end of the step
    weight: Array  # (N,), its error, K
    rates: Array  # (10, N)
    tables: Tables


@compiled
def workspace(rings: Rings, heat: Heat, looped: bool, stages: int, terms: int) -> Workspace:
    """Return a new workspace; ``looped`` tells whether light runs in loops, ``terms`` are those of `poles.Series`."""
    n, K = heat.gain.shape
    e, m = np.empty, 2 * n if looped else 0
    return Workspace(
        e((19, n)), e((m, m)), np.empty(m, np.int64), e(4 * n), e(4 * n), e(4 * n), e((2, n)), e((3, n)), e(n),
        e((rings.fcd.shape[1], 3, n)), e(n), e(n), e((stages, n)), e((stages, n)), e(n), e(n), rings.rates.T.copy(),
        poles.new_tables(heat.kind_rate.shape[0], terms, stages, K),
    )  # fmt: skip


@inlined_lean
def _rates(r: Array, i: int) -> Rates:
    """Return the rates of one ring of (10, N)."""
    return Rates(r[0, i], r[1, i], r[2, i], r[3, i], r[4, i], r[5, i], r[6, i], r[7, i], r[8, i], r[9, i])


@inlined_lean
def _bend(N: float, fcd: Array, i: int, bent: Array) -> tuple[float, float]:
    """Return S(N) and dS/dN of ring ``i`` and keep what `_shifts` needs."""
    shift, slope = 0.0, 0.0
    for k in range(bent.shape[0]):
        p = fcd[i, k, 1]
        square = N * N + EPSILON * EPSILON
        bent[k, 0, i], bent[k, 2, i], factor = square, 0.5 * (p - 1.0), fcd[i, k, 0]
        if p != 1.0:
            factor *= math.exp(0.5 * (p - 1.0) * math.log(square))
        bent[k, 1, i] = factor
        shift += factor * N
        slope += factor * (1.0 + (p - 1.0) * N * N / square)
    return shift, slope


@inlined_lean
def _shifts(density: Array, bent: Array, near: Array, shift: Array) -> None:
    """Write S(N) of all rings: near the start of the step by the series of log and exp, a tenth of their work."""
    for i in range(shift.size):
        shift[i] = 0.0
    for k in range(bent.shape[0]):
        curved, total = 0.0, 0.0
        for i in range(shift.size):
            curved += abs(bent[k, 2, i])
        if curved == 0.0:
            for i in range(shift.size):
                shift[i] += bent[k, 1, i] * density[i]
            continue
        for i in range(shift.size):
            square = density[i] * density[i] + EPSILON * EPSILON
            s = (square - bent[k, 0, i]) / (square + bent[k, 0, i])
            near[i] = s
            total += s * s
        if total < NEAR * NEAR:
            for i in range(shift.size):  # log(r) = 2 artanh(s), and r to the power
                s = near[i]
                b = s * s
                x = 1.0 + b * (1 / 3 + b * (1 / 5 + b * (1 / 7 + b * (1 / 9 + b * (1 / 11 + b * (1 / 13 + b / 15))))))
                x *= 2.0 * s * bent[k, 2, i]
                y = x * (1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x / 3628800)))
                y = 1.0 + x * (1.0 + x * (0.5 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + y))))))
                shift[i] += bent[k, 1, i] * y * density[i]
        else:
            for i in range(shift.size):
                ratio = (density[i] * density[i] + EPSILON * EPSILON) / bent[k, 0, i]
                shift[i] += bent[k, 1, i] * density[i] * math.exp(bent[k, 2, i] * math.log(ratio))


@inlined_lean
def _prepare(
    y: Array, h: float, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork, s: float, w: Workspace
) -> None:
    """Fill the workspace with the matrices of a step of ``h`` ns from ``y``, factorized.

    Rows of ``blocks``, where light runs one way: 0 to 8 the inverse of a ring's block; 9 to 14 what the wave on its
    bus does to its solution, and 15 to 18 to the wave behind it. Where light runs in loops: 0 to 4 what eliminates
    the carriers.
    """
    n, looped, chain = heat.gain.shape[0], net.order.size == 0, net.taken.size > 0
    start, blocks, rates, bent, matrix = w.start, w.blocks, w.rates, w.bent, w.matrix
    push, gather, response, kind, within = w.push, w.gather, w.own, heat.kind, w.tables.within
    real, imaginary, itself, taken, sent, fcd = net.real, net.imaginary, net.own, net.taken, net.sent, rings.fcd
    for i in range(n):
        ar, ai, N, z = y[3 * i], y[3 * i + 1], y[3 * i + 2], start[3 * n + i]
        start[i], start[n + i], start[2 * n + i] = ar, ai, N
        G = within[kind[i], 0, 0]
        dT, bend = z + heat.curvature * z * z, 1.0 + 2.0 * heat.curvature * z
        shift, slope = _bend(N, fcd, i, bent)
        J = optics_jacobian(ar, ai, N, dT, shift, slope, detuning[i], _rates(rates, i))
        u0, u1, v = J[0][3] * bend, J[1][3] * bend, J[3]
        response[i], push[0, i], push[1, i] = G, u0, u1
        gather[0, i], gather[1, i], gather[2, i] = v[0], v[1], v[2]
        own = itself[i]
        block = (
            (s - J[0][0] - G * u0 * v[0] - own.real, -J[0][1] - G * u0 * v[1] + own.imag, -J[0][2] - G * u0 * v[2]),
            (-J[1][0] - G * u1 * v[0] - own.imag, s - J[1][1] - G * u1 * v[1] - own.real, -J[1][2] - G * u1 * v[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
        if looped:  # carriers eliminated, two rows are left
            d = 1.0 / block[2][2]
            l0, l1 = block[0][2] * d, block[1][2] * d
            blocks[0, i], blocks[1, i], blocks[2, i], blocks[3, i], blocks[4, i] = l0, l1, d, block[2][0], block[2][1]
            for j in range(n):
                matrix[i, j], matrix[i, n + j] = -real[j, i], imaginary[j, i]
                matrix[n + i, j], matrix[n + i, n + j] = -imaginary[j, i], -real[j, i]
            matrix[i, i], matrix[i, n + i] = block[0][0] - l0 * block[2][0], block[0][1] - l0 * block[2][1]
            matrix[n + i, i], matrix[n + i, n + i] = block[1][0] - l1 * block[2][0], block[1][1] - l1 * block[2][1]
            continue
        m = inverse(block)
        for p in range(3):
            blocks[3 * p, i], blocks[3 * p + 1, i], blocks[3 * p + 2, i] = m[p][0], m[p][1], m[p][2]
        if chain:
            u, v = taken[i], sent[i]
            for p in range(3):
                blocks[9 + 2 * p, i] = m[p][0] * u.real + m[p][1] * u.imag
                blocks[10 + 2 * p, i] = m[p][1] * u.real - m[p][0] * u.imag
            blocks[15, i] = 1.0 + v.real * blocks[9, i] - v.imag * blocks[11, i]
            blocks[16, i] = v.real * blocks[10, i] - v.imag * blocks[12, i]
            blocks[17, i] = v.imag * blocks[9, i] + v.real * blocks[11, i]
            blocks[18, i] = 1.0 + v.imag * blocks[10, i] + v.real * blocks[12, i]
    if looped:
        factorize(matrix, w.pivots)


@inlined_lean
def _send(net: LightNetwork, j: int, re: float, im: float, out: Array) -> None:
    """Add what ring ``j`` with a field sends into the others."""
    real, imaginary, fed, n = net.real, net.imaginary, net.fed, net.own.size
    for i in range(fed[j, 0], fed[j, 1]):
        out[i] += real[j, i] * re - imaginary[j, i] * im
        out[n + i] += imaginary[j, i] * re + real[j, i] * im


@inlined_lean
def _along_the_bus(net: LightNetwork, blocks: Array, now: Array, right: Array) -> None:
    """Overwrite the right-hand sides by the solution, where the light of all rings before goes along one waveguide."""
    order, sent, n = net.order, net.sent, net.order.size
    c0, c1 = 0.0, 0.0  # the wave of the fields and of their changes
    for at in range(n):
        i = order[at]
        r0, r1, r2, v = right[i], right[n + i], right[2 * n + i], sent[i]
        x0 = blocks[0, i] * r0 + blocks[1, i] * r1 + blocks[2, i] * r2
        x1 = blocks[3, i] * r0 + blocks[4, i] * r1 + blocks[5, i] * r2
        x2 = blocks[6, i] * r0 + blocks[7, i] * r1 + blocks[8, i] * r2
        e0, e1 = now[i] + x0, now[n + i] + x1
        right[i] = x0 + blocks[9, i] * c0 + blocks[10, i] * c1
        right[n + i] = x1 + blocks[11, i] * c0 + blocks[12, i] * c1
        right[2 * n + i] = x2 + blocks[13, i] * c0 + blocks[14, i] * c1
        c0, c1 = (
            v.real * e0 - v.imag * e1 + (blocks[15, i] * c0 + blocks[16, i] * c1),
            v.imag * e0 + v.real * e1 + (blocks[17, i] * c0 + blocks[18, i] * c1),
        )


@inlined_lean
def _solve(net: LightNetwork, w: Workspace) -> None:
    """Add what the rings send to each other to the right-hand sides, and overwrite them by the solution."""
    x, now, m, order, n = w.right, w.now, w.blocks, net.order, net.own.size
    if net.taken.size > 0:
        _along_the_bus(net, m, now, x)
        return
    for j in range(n):
        _send(net, j, now[j], now[n + j], x)
    if order.size == 0:
        for i in range(n):
            x[i] -= m[0, i] * x[2 * n + i]
            x[n + i] -= m[1, i] * x[2 * n + i]
        solve(w.matrix, w.pivots, x[: 2 * n])
        for i in range(n):
            x[2 * n + i] = m[2, i] * (x[2 * n + i] - m[3, i] * x[i] - m[4, i] * x[n + i])
        return
    for at in range(n):
        i = order[at]
        r0, r1, r2 = x[i], x[n + i], x[2 * n + i]
        x[i] = m[0, i] * r0 + m[1, i] * r1 + m[2, i] * r2
        x[n + i] = m[3, i] * r0 + m[4, i] * r1 + m[5, i] * r2
        x[2 * n + i] = m[6, i] * r0 + m[7, i] * r1 + m[8, i] * r2
        _send(net, i, x[i], x[n + i], x)


@lean
def step(
    y: Array, h: float, inputs: Complex, input_slopes: Complex, detuning: Array, detuning_slopes: Array, rings: Rings,
    heat: Heat, net: LightNetwork, method: Tableau, series: Series, out: Array, k: Array, w: Workspace,
) -> None:  # fmt: skip
    """Take one step of ``h`` ns from ``y`` to ``out``.

    ``inputs`` and ``detuning``, shape (stages, N), belong to the times of the stages, their slopes to the first one.
    Fills ``k``, shape (stages, 4 N), with the stages of fields, carriers and own temperatures; the last stage is the
    error estimate.
    """
    n, stages = heat.gain.shape[0], method.a.shape[0]
    a, c, slopes, curvature, itself, kind = method.a, method.c, method.slope, heat.curvature, net.own, heat.kind
    start, now, right, push, gather, own = w.start, w.now, w.right, w.push, w.gather, w.own
    faded, powers, within, rates, bent, after, shift = (
        w.faded, w.powers, w.tables.within, w.rates, w.bent, w.after, w.shift,
    )  # fmt: skip
    s, per_h, last = 1.0 / (method.gamma * h), 1.0 / h, stages - 1
    poles.fill(w.tables, h, heat, method.gamma, series)
    poles.own_temperatures(y, heat, series, w.tables, start[3 * n :], faded)
    _prepare(y, h, detuning[0], rings, heat, net, s, w)
    for q in range(stages):
        g = slopes[q] * h
        for m in range(4 * n):
            now[m] = start[m]
            right[m] = 0.0
        for j in range(q):
            x, z = a[q, j], c[q, j] * per_h
            for m in range(4 * n):
                now[m] += x * k[j, m]
                right[m] += z * k[j, m]
        _shifts(now[2 * n : 3 * n], bent, w.near, shift)
        for i in range(n):
            z = now[3 * n + i]
            dT = z + curvature * z * z
            f0, f1, f2, power = optics(
                now[i], now[n + i], now[2 * n + i], dT, shift[i], 0.0, detuning[q, i], _rates(rates, i)
            )
            right[i], right[n + i], right[2 * n + i] = right[i] + f0, right[n + i] + f1, right[2 * n + i] + f2
            right[3 * n + i], powers[q, i] = faded[q, i], power
        for j in range(q + 1):
            if within.shape[0] == 1:
                x = within[0, q, j]
                for i in range(n):
                    right[3 * n + i] += x * powers[j, i]
            else:
                for i in range(n):
                    right[3 * n + i] += within[kind[i], q, j] * powers[j, i]
        for i in range(n):
            ar, ai, back = now[i], now[n + i], right[3 * n + i]
            light, m0, turn = inputs[q, i] + g * input_slopes[i], itself[i], g * detuning_slopes[i]
            right[i] += m0.real * ar - m0.imag * ai - light.imag + push[0, i] * back + turn * start[n + i]
            right[n + i] += m0.imag * ar + m0.real * ai + light.real + push[1, i] * back - turn * start[i]
        _solve(net, w)
        for i in range(n):
            feedback = gather[0, i] * right[i] + gather[1, i] * right[n + i] + gather[2, i] * right[2 * n + i]
            powers[q, i] += feedback
            right[3 * n + i] += feedback * own[i]
        for m in range(4 * n):
            k[q, m] = right[m]
    for i in range(n):
        for p in range(3):
            out[3 * i + p] = now[p * n + i] + k[last, p * n + i]
        after[i] = now[3 * n + i] + k[last, 3 * n + i]
    poles.end(y, heat, series, w.tables, powers, out, w.weight)


@inlined_lean
def step_error(
    y: Array, out: Array, k: Array, rings: Rings, rtol: float, missed: Array, other: Array, w: Workspace
) -> float:
    """Return the error of a step in units of the tolerance: of the worst ring, as for a ring alone.

    ``missed`` is the error of the extrapolated heat of the neighbours, ``other`` that heat itself, in K.
    """
    n, last, worst = w.own.size, k.shape[0] - 1, 0.0
    start, after, weight, floor = w.start, w.after, w.weight, rings.floor
    for i in range(n):
        square = squared_error(
            (y[3 * i], y[3 * i + 1], y[3 * i + 2]), (out[3 * i], out[3 * i + 1], out[3 * i + 2]),
            (k[last, i], k[last, n + i], k[last, 2 * n + i]), weight[i] + abs(missed[i]),
            start[3 * n + i] + other[i], after[i] + other[i], (floor[i, 0], floor[i, 1], floor[i, 2]),
        )  # fmt: skip
        if not square >= 0.0:  # nan
            return math.nan
        worst = max(worst, square)
    return math.sqrt(worst / 3.0) / rtol


@inlined_lean
def moved(y: Array, out: Array, rings: Rings, w: Workspace) -> float:
    """Return the largest relative change of the state of any ring in a step."""
    n, most, start, after, floor = w.own.size, 0.0, w.start, w.after, rings.floor
    for i in range(n):
        now, then = (y[3 * i], y[3 * i + 1], y[3 * i + 2]), (out[3 * i], out[3 * i + 1], out[3 * i + 2])
        size = (floor[i, 0], floor[i, 1], floor[i, 2])
        most = max(most, relative_change(now, then, start[3 * n + i], after[i], size))
    return most


for module in (equations, algebra, control, layout, poles):
    forget_if_older(workspace, str(module.__file__))
