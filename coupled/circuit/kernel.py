"""Error-controlled Rosenbrock integration of several rings coupled by light and by heat, compiled.

State: y = [Re a, Im a, N of each ring, then the thermal states of each ring]. With s = 1/(gamma h), the thermal states
of a ring are eliminated from (s - J) k = r as for a ring alone (`kernels.rosenbrock`). What remains is

    (s - J_i - G_i u_i w_i^T) k_i - sum_j M_ij k_j = r_i

with M the waveguides without delay. Where light runs one way only, M is triangular in some order of the rings, and the
3 x 3 blocks are solved one after the other; elsewhere the whole matrix of 3 N rows is factorized.

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
from ..kernels.equations import Array, dispersion, optics, optics_jacobian
from ..kernels.tableaus import Tableau
from . import layout
from .layout import Complex, Heat, Integers, LightNetwork, Rings, rates_of


class Workspace(NamedTuple):
    """Arrays that a step works in."""

    inverses: Array  # (N, 3, 3)
    matrix: Array  # (3 N, 3 N)
    pivots: Integers
    right: Array  # (3 N,)
    push: Array  # (N, 2), u of each ring
    gather: Array  # (N, 3), w of each ring
    damping: Array  # (N, K)
    own: Array  # (N,), G of each ring
    before: Array  # (N,), own temperature at the start of the step
    after: Array  # (N,), at its end
    fields: Array  # (N, 3), a stage's state
    own_stage: Array  # (N,)
    backs: Array  # (N,)


@compiled
def workspace(n: int, poles: int) -> Workspace:
    """Return a new workspace for ``n`` rings of ``poles`` thermal states."""
    e = np.empty
    return Workspace(
        e((n, 3, 3)), e((3 * n, 3 * n)), np.empty(3 * n, np.int64), e(3 * n), e((n, 2)), e((n, 3)), e((n, poles)),
        e(n), e(n), e(n), e((n, 3)), e(n), e(n),
    )  # fmt: skip


@inlined
def _prepare(
    y: Array, h: float, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork, s: float, w: Workspace
) -> None:
    """Fill the workspace with the matrices of a step of ``h`` ns from ``y``, factorized."""
    n, K = heat.gain.shape
    looped = net.order.size == 0
    if looped:
        w.matrix[:] = 0.0
    for i in range(n):
        ar, ai, N = y[3 * i], y[3 * i + 1], y[3 * i + 2]
        z, G = 0.0, 0.0
        for k in range(K):
            c = heat.read[i, i, k]
            z += c * y[3 * n + i * K + k]
            w.damping[i, k] = 1.0 / (s + heat.rate[i, k])
            G += c * heat.gain[i, k] * w.damping[i, k]
        w.before[i], w.own[i] = z, G
        dT, bend = z + heat.curvature * z * z, 1.0 + 2.0 * heat.curvature * z
        shift, slope = dispersion(N, rings.fcd[i])
        J = optics_jacobian(ar, ai, N, dT, shift, slope, detuning[i], rates_of(rings, i))
        u0, u1, v = J[0][3] * bend, J[1][3] * bend, J[3]
        w.push[i, 0], w.push[i, 1] = u0, u1
        w.gather[i, 0], w.gather[i, 1], w.gather[i, 2] = v[0], v[1], v[2]
        own = 0.0 + 0.0j
        for e in range(net.start[i], net.start[i + 1]):
            if net.column[e] == i:
                own += net.entry[e]
        block = (
            (s - J[0][0] - G * u0 * v[0] - own.real, -J[0][1] - G * u0 * v[1] + own.imag, -J[0][2] - G * u0 * v[2]),
            (-J[1][0] - G * u1 * v[0] - own.imag, s - J[1][1] - G * u1 * v[1] - own.real, -J[1][2] - G * u1 * v[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
        if looped:
            for p in range(3):
                for q in range(3):
                    w.matrix[3 * i + p, 3 * i + q] = block[p][q]
            for e in range(net.start[i], net.start[i + 1]):
                j, m = net.column[e], net.entry[e]
                if j != i:
                    w.matrix[3 * i, 3 * j] -= m.real
                    w.matrix[3 * i, 3 * j + 1] += m.imag
                    w.matrix[3 * i + 1, 3 * j] -= m.imag
                    w.matrix[3 * i + 1, 3 * j + 1] -= m.real
        else:
            m3 = inverse(block)
            for p in range(3):
                for q in range(3):
                    w.inverses[i, p, q] = m3[p][q]
    if looped:
        factorize(w.matrix, w.pivots)


@inlined
def _solve(net: LightNetwork, w: Workspace) -> None:
    """Overwrite the right-hand sides by the solution of the step's linear system."""
    if net.order.size == 0:
        solve(w.matrix, w.pivots, w.right)
        return
    for at in range(net.order.size):
        i = net.order[at]
        r0, r1, r2 = w.right[3 * i], w.right[3 * i + 1], w.right[3 * i + 2]
        for e in range(net.start[i], net.start[i + 1]):
            j, m = net.column[e], net.entry[e]
            if j != i:
                r0 += m.real * w.right[3 * j] - m.imag * w.right[3 * j + 1]
                r1 += m.imag * w.right[3 * j] + m.real * w.right[3 * j + 1]
        for p in range(3):
            w.right[3 * i + p] = w.inverses[i, p, 0] * r0 + w.inverses[i, p, 1] * r1 + w.inverses[i, p, 2] * r2


@compiled
def step(
    y: Array, h: float, inputs: Complex, input_slopes: Complex, detuning: Array, detuning_slopes: Array, rings: Rings,
    heat: Heat, net: LightNetwork, method: Tableau, out: Array, k: Array, x: Array, total: Array, w: Workspace,
) -> None:  # fmt: skip
    """Take one step of ``h`` ns from ``y`` to ``out``.

    ``inputs`` and ``detuning``, shape (stages, N), belong to the times of the stages, their slopes to the first one.
    Fills ``k``, shape (stages, N, 3), and ``x``, shape (stages, N, K), with the stages, the last of which is the error
    estimate, and ``total``, shape (stages, N), with what the thermal stages add to each ring's own temperature.
    """
    n, K = heat.gain.shape
    stages, a, c = method.a.shape[0], method.a, method.c
    s, per_h = 1.0 / (method.gamma * h), 1.0 / h
    _prepare(y, h, detuning[0], rings, heat, net, s, w)
    for q in range(stages):
        g = method.slope[q]
        for i in range(n):
            ar, ai, N, z = y[3 * i], y[3 * i + 1], y[3 * i + 2], w.before[i]
            for j in range(q):
                f = a[q, j]
                ar, ai, N, z = ar + f * k[j, i, 0], ai + f * k[j, i, 1], N + f * k[j, i, 2], z + f * total[j, i]
            w.fields[i, 0], w.fields[i, 1], w.fields[i, 2], w.own_stage[i] = ar, ai, N, z
        for i in range(n):
            ar, ai, N, z = w.fields[i, 0], w.fields[i, 1], w.fields[i, 2], w.own_stage[i]
            dT = z + heat.curvature * z * z
            shift = dispersion(N, rings.fcd[i])[0]
            f0, f1, f2, power = optics(ar, ai, N, dT, shift, 0.0, detuning[q, i], rates_of(rings, i))
            b = inputs[q, i]
            f0, f1 = f0 - b.imag, f1 + b.real
            for e in range(net.start[i], net.start[i + 1]):
                j, m = net.column[e], net.entry[e]
                f0 += m.real * w.fields[j, 0] - m.imag * w.fields[j, 1]
                f1 += m.imag * w.fields[j, 0] + m.real * w.fields[j, 1]
            r0, r1, r2 = 0.0, 0.0, 0.0
            for j in range(q):
                z = c[q, j] * per_h
                r0, r1, r2 = r0 + z * k[j, i, 0], r1 + z * k[j, i, 1], r2 + z * k[j, i, 2]
            rate, gain, own, at = heat.rate[i], heat.gain[i], heat.read[i, i], 3 * n + i * K
            stage = x[q, i]
            for p in range(K):
                stage[p] = -rate[p] * y[at + p]
            for j in range(q):
                f, z = a[q, j], c[q, j] * per_h
                earlier = x[j, i]
                for p in range(K):
                    stage[p] += (z - f * rate[p]) * earlier[p]
            back = 0.0
            for p in range(K):
                stage[p] = (stage[p] + gain[p] * power) * w.damping[i, p]
                back += own[p] * stage[p]
            w.backs[i] = back
            u0, u1, turn, slope = w.push[i, 0], w.push[i, 1], h * detuning_slopes[i], input_slopes[i]
            w.right[3 * i] = r0 + f0 + u0 * back + g * (turn * y[3 * i + 1] - h * slope.imag)
            w.right[3 * i + 1] = r1 + f1 + u1 * back + g * (-turn * y[3 * i] + h * slope.real)
            w.right[3 * i + 2] = r2 + f2
        _solve(net, w)
        for i in range(n):
            k0, k1, k2 = w.right[3 * i], w.right[3 * i + 1], w.right[3 * i + 2]
            k[q, i, 0], k[q, i, 1], k[q, i, 2] = k0, k1, k2
            feedback = w.gather[i, 0] * k0 + w.gather[i, 1] * k1 + w.gather[i, 2] * k2
            for p in range(K):
                x[q, i, p] += feedback * heat.gain[i, p] * w.damping[i, p]
            total[q, i] = w.backs[i] + feedback * w.own[i]
    last = stages - 1
    for i in range(n):
        for p in range(3):
            out[3 * i + p] = w.fields[i, p] + k[last, i, p]
        w.after[i] = w.own_stage[i] + total[last, i]
        at = 3 * n + i * K
        for p in range(K):
            out[at + p] = y[at + p] + x[last, i, p]
        for j in range(last):
            f = a[last, j]
            for p in range(K):
                out[at + p] += f * x[j, i, p]


@compiled
def step_error(
    y: Array, out: Array, k: Array, x: Array, rings: Rings, heat: Heat, rtol: float, missed: Array, other: Array,
    w: Workspace,
) -> float:  # fmt: skip
    """Return the error of a step in units of the tolerance: of the worst ring, as for a ring alone.

    ``missed`` is the error of the extrapolated heat of the neighbours, ``other`` that heat itself, in K.
    """
    n, K = heat.gain.shape
    last, worst = k.shape[0] - 1, 0.0
    for i in range(n):
        weight = abs(missed[i])
        for p in range(K):
            weight += abs(heat.read[i, i, p] * x[last, i, p])
        now, then = y[3 * i : 3 * i + 3], out[3 * i : 3 * i + 3]
        square = squared_error(
            now, then, k[last, i], weight, w.before[i] + other[i], w.after[i] + other[i], rings.floor[i]
        )
        worst = max(worst, square)
        if not worst >= 0.0:  # nan
            return math.nan
    return math.sqrt(worst / 3.0) / rtol


@compiled
def moved(y: Array, out: Array, rings: Rings, w: Workspace) -> float:
    """Return the largest relative change of the state of any ring in a step."""
    most = 0.0
    for i in range(rings.rates.shape[0]):
        now, then = y[3 * i : 3 * i + 3], out[3 * i : 3 * i + 3]
        most = max(most, relative_change(now, then, w.before[i], w.after[i], rings.floor[i]))
    return most


for kernel in (step, workspace, step_error, moved):
    for module in (equations, algebra, control, layout):
        forget_if_older(kernel, str(module.__file__))
