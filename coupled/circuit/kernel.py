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

from ..kernels import algebra, control, equations
from ..kernels.algebra import factorize, inverse, solve
from ..kernels.compiling import compiled, forget_if_older, inlined
from ..kernels.control import relative_change, squared_error
from ..kernels.equations import Array, Rates, dispersion, optics, optics_jacobian
from ..kernels.tableaus import Tableau
from . import layout, poles
from .layout import Complex, Heat, Integers, LightNetwork, Rings
from .poles import Tables


class Workspace(NamedTuple):
    """Arrays that a step works in; the rings are the last axis."""

    inverses: Array  # (9, N), of the blocks; where light runs in loops, what eliminates the carriers
    matrix: Array  # (2 N, 2 N), of the fields where light runs in loops
    pivots: Integers
    right: Array  # (3, N)
    push: Array  # (2, N), u of each ring
    gather: Array  # (3, N), w of each ring
    own: Array  # (N,), G of each ring
    start: Array  # (3, N), Re a, Im a, N at the start of the step
    fields: Array  # (3, N), in a stage
    shift: Array  # (N,), S(N) in a stage
    before: Array  # (N,), own temperature at the start of the step
    after: Array  # (N,), at its end
    stage: Array  # (N,), in a stage
    back: Array  # (N,), what a stage adds to it before the light of the stage is known
    faded: Array  # (stages, N), what the poles add to it by themselves
    powers: Array  # (stages, N), absorbed in the stages, uW
    weight: Array  # (N,), error of the own temperature, K
    rates: Array  # (10, N)
    tables: Tables


@compiled
def workspace(rings: Rings, heat: Heat, looped: bool, stages: int) -> Workspace:
    """Return a new workspace; ``looped`` tells whether light runs in loops."""
    n, K = heat.gain.shape
    e, m = np.empty, 2 * n if looped else 0
    return Workspace(
        e((9, n)), e((m, m)), np.empty(m, np.int64), e((3, n)), e((2, n)), e((3, n)), e(n), e((3, n)),
        e((3, n)), e(n), e(n), e(n), e(n), e(n), e((stages, n)), e((stages, n)), e(n), rings.rates.T.copy(),
        poles.new_tables(heat.kind_rate.shape[0], stages, K),
    )  # fmt: skip


@inlined
def _rates(w: Workspace, i: int) -> Rates:
    """Return the rates of one ring from the workspace."""
    r = w.rates
    return Rates(r[0, i], r[1, i], r[2, i], r[3, i], r[4, i], r[5, i], r[6, i], r[7, i], r[8, i], r[9, i])


@inlined
def _prepare(
    y: Array, h: float, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork, s: float, w: Workspace
) -> None:
    """Fill the workspace with the matrices of a step of ``h`` ns from ``y``, factorized."""
    n = heat.gain.shape[0]
    looped = net.order.size == 0
    poles.own_temperatures(y, heat, w.tables, w.before, w.faded)
    for i in range(n):
        ar, ai, N, z = y[3 * i], y[3 * i + 1], y[3 * i + 2], w.before[i]
        w.start[0, i], w.start[1, i], w.start[2, i] = ar, ai, N
        G = w.tables.within[heat.kind[i], 0, 0]
        dT, bend = z + heat.curvature * z * z, 1.0 + 2.0 * heat.curvature * z
        shift, slope = dispersion(N, rings.fcd[i])
        J = optics_jacobian(ar, ai, N, dT, shift, slope, detuning[i], _rates(w, i))
        u0, u1, v = J[0][3] * bend, J[1][3] * bend, J[3]
        w.own[i], w.shift[i], w.push[0, i], w.push[1, i] = G, shift, u0, u1
        w.gather[0, i], w.gather[1, i], w.gather[2, i] = v[0], v[1], v[2]
        own = net.own[i]
        block = (
            (s - J[0][0] - G * u0 * v[0] - own.real, -J[0][1] - G * u0 * v[1] + own.imag, -J[0][2] - G * u0 * v[2]),
            (-J[1][0] - G * u1 * v[0] - own.imag, s - J[1][1] - G * u1 * v[1] - own.real, -J[1][2] - G * u1 * v[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
        if looped:  # carriers eliminated, two rows are left
            d = 1.0 / block[2][2]
            l0, l1 = block[0][2] * d, block[1][2] * d
            w.inverses[0, i], w.inverses[1, i], w.inverses[2, i] = l0, l1, d
            w.inverses[3, i], w.inverses[4, i] = block[2][0], block[2][1]
            for j in range(n):
                w.matrix[i, j], w.matrix[i, n + j] = -net.real[j, i], net.imaginary[j, i]
                w.matrix[n + i, j], w.matrix[n + i, n + j] = -net.imaginary[j, i], -net.real[j, i]
            w.matrix[i, i], w.matrix[i, n + i] = block[0][0] - l0 * block[2][0], block[0][1] - l0 * block[2][1]
            w.matrix[n + i, i], w.matrix[n + i, n + i] = block[1][0] - l1 * block[2][0], block[1][1] - l1 * block[2][1]
        else:
            m3 = inverse(block)
            for p in range(3):
                for q in range(3):
                    w.inverses[3 * p + q, i] = m3[p][q]
    if looped:
        factorize(w.matrix, w.pivots)


@inlined
def _send(net: LightNetwork, j: int, real: float, imaginary: float, one: Array, other: Array) -> None:
    """Add what ring ``j`` with a field sends into the others."""
    re, im = net.real[j], net.imaginary[j]
    for i in range(net.fed[j, 0], net.fed[j, 1]):
        one[i] += re[i] * real - im[i] * imaginary
        other[i] += im[i] * real + re[i] * imaginary


@inlined
def _exchange(net: LightNetwork, fields: Array, right: Array) -> None:
    """Add what all rings send into the others."""
    if net.taken.size == 0:
        for j in range(fields.shape[1]):
            _send(net, j, fields[0, j], fields[1, j], right[0], right[1])
        return
    c0, c1 = 0.0, 0.0
    for at in range(net.order.size):
        i = net.order[at]
        u, v = net.taken[i], net.sent[i]
        right[0, i] += u.real * c0 - u.imag * c1
        right[1, i] += u.imag * c0 + u.real * c1
        c0 += v.real * fields[0, i] - v.imag * fields[1, i]
        c1 += v.imag * fields[0, i] + v.real * fields[1, i]


@inlined
def _solve(net: LightNetwork, w: Workspace) -> None:
    """Overwrite the right-hand sides by the solution of the step's linear system."""
    x, m = w.right, w.inverses
    if net.order.size == 0:
        n = x.shape[1]
        for i in range(n):
            x[0, i] -= m[0, i] * x[2, i]
            x[1, i] -= m[1, i] * x[2, i]
        solve(w.matrix, w.pivots, x.reshape(x.size)[: 2 * n])
        for i in range(n):
            x[2, i] = m[2, i] * (x[2, i] - m[3, i] * x[0, i] - m[4, i] * x[1, i])
        return
    chain, c0, c1 = net.taken.size > 0, 0.0, 0.0
    for at in range(net.order.size):
        i = net.order[at]
        r0, r1, r2 = x[0, i], x[1, i], x[2, i]
        if chain:
            u = net.taken[i]
            r0, r1 = r0 + u.real * c0 - u.imag * c1, r1 + u.imag * c0 + u.real * c1
        x[0, i] = m[0, i] * r0 + m[1, i] * r1 + m[2, i] * r2
        x[1, i] = m[3, i] * r0 + m[4, i] * r1 + m[5, i] * r2
        x[2, i] = m[6, i] * r0 + m[7, i] * r1 + m[8, i] * r2
        if chain:
            v = net.sent[i]
            c0, c1 = c0 + v.real * x[0, i] - v.imag * x[1, i], c1 + v.imag * x[0, i] + v.real * x[1, i]
        else:
            _send(net, i, x[0, i], x[1, i], x[0], x[1])


@inlined
def _add(out: Array, factor: float, terms: Array) -> None:
    for i in range(out.size):
        out[i] += factor * terms[i]


@compiled
def step(
    y: Array, h: float, inputs: Complex, input_slopes: Complex, detuning: Array, detuning_slopes: Array, rings: Rings,
    heat: Heat, net: LightNetwork, method: Tableau, out: Array, k: Array, total: Array, w: Workspace,
) -> None:  # fmt: skip
    """Take one step of ``h`` ns from ``y`` to ``out``.

    ``inputs`` and ``detuning``, shape (stages, N), belong to the times of the stages, their slopes to the first one.
    Fills ``k``, shape (stages, 3, N), with the stages, the last of which is the error estimate, and ``total``, shape
    (stages, N), with what the thermal stages add to each ring's own temperature.
    """
    n = heat.gain.shape[0]
    stages, a, c = method.a.shape[0], method.a, method.c
    s, per_h, last = 1.0 / (method.gamma * h), 1.0 / h, method.a.shape[0] - 1
    poles.fill(w.tables, h, heat, method)
    _prepare(y, h, detuning[0], rings, heat, net, s, w)
    start, fields, right = w.start.reshape(3 * n), w.fields.reshape(3 * n), w.right.reshape(3 * n)
    flat = k.reshape((stages, 3 * n))
    within = w.tables.within
    for q in range(stages):
        g = method.slope[q]
        for i in range(3 * n):
            fields[i] = start[i]
            right[i] = 0.0
        for i in range(n):
            w.stage[i] = w.before[i]
            w.back[i] = w.faded[q, i]
        for j in range(q):
            _add(fields, a[q, j], flat[j])
            _add(right, c[q, j] * per_h, flat[j])
            _add(w.stage, a[q, j], total[j])
        for i in range(n):
            ar, ai, N, z = w.fields[0, i], w.fields[1, i], w.fields[2, i], w.stage[i]
            shift = w.shift[i] if q == 0 else dispersion(N, rings.fcd[i])[0]
            dT = z + heat.curvature * z * z
            f0, f1, f2, power = optics(ar, ai, N, dT, shift, 0.0, detuning[q, i], _rates(w, i))
            w.right[0, i], w.right[1, i], w.right[2, i] = w.right[0, i] + f0, w.right[1, i] + f1, w.right[2, i] + f2
            w.powers[q, i] = power
        if within.shape[0] == 1:
            for j in range(q):
                _add(w.back, within[0, q, j], w.powers[j])
            _add(w.back, within[0, q, q], w.powers[q])
        else:
            for i in range(n):
                for j in range(q + 1):
                    w.back[i] += within[heat.kind[i], q, j] * w.powers[j, i]
        for i in range(n):
            b, own, rise = inputs[q, i], net.own[i], g * h * input_slopes[i]
            ar, ai, back, turn = w.fields[0, i], w.fields[1, i], w.back[i], g * h * detuning_slopes[i]
            light, push = own.real * ar - own.imag * ai - b.imag - rise.imag, w.push[0, i] * back
            w.right[0, i] += light + push + turn * w.start[1, i]
            light, push = own.imag * ar + own.real * ai + b.real + rise.real, w.push[1, i] * back
            w.right[1, i] += light + push - turn * w.start[0, i]
        _exchange(net, w.fields, w.right)
        _solve(net, w)
        for i in range(3 * n):
            flat[q, i] = right[i]
        for i in range(n):
            feedback = w.gather[0, i] * w.right[0, i] + w.gather[1, i] * w.right[1, i] + w.gather[2, i] * w.right[2, i]
            w.powers[q, i] += feedback
            total[q, i] = w.back[i] + feedback * w.own[i]
    for i in range(n):
        for p in range(3):
            out[3 * i + p] = w.fields[p, i] + k[last, p, i]
        w.after[i] = w.stage[i] + total[last, i]
    poles.end(y, heat, w.tables, w.powers, out, w.weight)


@inlined
def step_error(
    y: Array, out: Array, k: Array, rings: Rings, rtol: float, missed: Array, other: Array, w: Workspace
) -> float:
    """Return the error of a step in units of the tolerance: of the worst ring, as for a ring alone.

    ``missed`` is the error of the extrapolated heat of the neighbours, ``other`` that heat itself, in K.
    """
    last, worst = k.shape[0] - 1, 0.0
    for i in range(w.own.size):
        weight = w.weight[i] + abs(missed[i])
        now, then = y[3 * i : 3 * i + 3], out[3 * i : 3 * i + 3]
        light = (k[last, 0, i], k[last, 1, i], k[last, 2, i])
        square = squared_error(now, then, light, weight, w.before[i] + other[i], w.after[i] + other[i], rings.floor[i])
        if not square >= 0.0:  # nan
            return math.nan
        worst = max(worst, square)
    return math.sqrt(worst / 3.0) / rtol


@inlined
def moved(y: Array, out: Array, rings: Rings, w: Workspace) -> float:
    """Return the largest relative change of the state of any ring in a step."""
    most = 0.0
    for i in range(rings.rates.shape[0]):
        now, then = y[3 * i : 3 * i + 3], out[3 * i : 3 * i + 3]
        most = max(most, relative_change(now, then, w.before[i], w.after[i], rings.floor[i]))
    return most


for kernel in (step, workspace):
    for module in (equations, algebra, control, layout, poles):
        forget_if_older(kernel, str(module.__file__))
