"""Closed orbits: Newton's method on the return map, and the mesh that follows the orbit.

The return map is that of the collocation equations (`collocation`). With M its derivative, t what the period does to
the last state and b what the residuals do,

    (M - 1) dy_0 + t dT = y_0 - y_N - b,          f(y_0) . dy_0 = 0

and the stages follow by substitution. The mesh equidistributes the error of the polynomials between the stages, whose
next derivative is told by the jumps of their highest one from interval to interval.

Source of the mesh: Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems (1995), Section 9.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from . import collocation, equations, kinds
from .collocation import Ring, Scheme, linearize, substitute
from .compiling import compiled, forget_if_older
from .equations import Array
from .kinds import read

LARGEST_TURN, LARGEST_MOVE = 0.3, 2.0  # of the period, and of the largest values, in a step
BISECTIONS = 34  # of a bracket, to 1e-13 of the period
FLATTEST = 0.05  # of its mean, the smallest density of the mesh


@compiled
def sizes(Y: Array, thermal: Any) -> Array:
    """Return the largest |a|, N and dT of an orbit, in internal units."""
    field, carriers, heat = 1e-30, 1e-30, 1e-30
    for k in range(Y.shape[0]):
        for j in range(Y.shape[1]):
            y = Y[k, j]
            field = max(field, np.sqrt(y[0] * y[0] + y[1] * y[1]))
            carriers = max(carriers, abs(y[2]))
        heat = max(heat, abs(read(Y[k, Y.shape[1] - 1], thermal)))
    return np.array([field, carriers, heat])


@compiled
def moved(change: Array, size: Array) -> float:
    """Return the largest change of a state in units of ``size``."""
    most = 0.0
    for k in range(change.shape[0]):
        for j in range(change.shape[1]):
            d = change[k, j]
            most = max(most, np.sqrt(d[0] * d[0] + d[1] * d[1]) / size[0], abs(d[2]) / size[1])
            for i in range(3, d.size):
                most = max(most, abs(d[i]) / size[2])
    return most


@compiled
def correct(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, section: bool) -> Any:
    """Return one step of Newton's method: the changes of start, T and Y, the derivative of the return map, and a size.

    The size is the largest change in units of the largest values, infinite where there is no step. On a ``section`` the
    beginning keeps its carriers; else it moves at a right angle to the orbit.
    """
    m = start.size
    change = np.zeros_like(Y)
    matrix, right = np.zeros((m + 1, m + 1)), np.zeros(m + 1)
    M, intervals, _ = linearize(start, Y, tau, T, ring, scheme, np.empty((Y.shape[0], Y.shape[1], m, 0)))
    size = sizes(Y, ring.thermal)
    f = equations.right_hand_side(start, ring.drive, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    end = Y[Y.shape[0] - 1, Y.shape[1] - 1]
    total = 0.0
    for i in range(m):
        for j in range(m):
            matrix[i, j] = M[i, j]
            total += abs(M[i, j])
        matrix[i, i] -= 1.0
        matrix[i, m] = M[i, m + 1]
        unit = size[min(max(i - 1, 0), 2)]
        matrix[m, i] = f[i] / (unit * unit) * size[0]
        right[i] = start[i] - end[i] - M[i, m]
        total += abs(right[i]) + abs(M[i, m + 1])
    if section:
        matrix[m, :] = 0.0
        matrix[m, 2] = 1.0
    if not total < 1e12:  # nan and infinity too
        return np.zeros(m), 0.0, change, M, np.inf
    full = np.linalg.solve(matrix, right)
    first = full[:m].copy()
    substitute(first, np.array([1.0, full[m]]), intervals, Y, change)
    largest = max(abs(full[m]) / T, moved(change, size))
    return first, full[m], change, M, largest if largest < 1e9 else np.inf


@compiled
def close(
    start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, tolerance: float, most: int
) -> tuple[Array, Array, float, Array, bool, float]:
    """Close an orbit by Newton's method, at most ``most`` steps until none moves it by ``tolerance`` of its size.

    Returns start, Y, T, the derivative of the return map (with the columns of `linearize`), whether it closed, and the
    size of the last step.
    """
    start, Y, last = start.copy(), Y.copy(), np.inf
    M = np.zeros((start.size, start.size + 2))
    for _ in range(most):
        first, turn, change, M, last = correct(start, Y, tau, T, ring, scheme, False)
        if last == np.inf:
            break
        share = min(1.0, LARGEST_TURN * T / max(abs(turn), 1e-30), LARGEST_MOVE / max(last, 1e-30))
        start = start + share * first
        Y = Y + share * change
        T += share * turn
        if last <= tolerance:
            return start, Y, T, M, True, last
    return start, Y, T, M, False, last


@compiled
def densities(start: Array, Y: Array, tau: Array, scheme: Scheme, thermal: Any) -> Array:
    """Return for every interval the (s + 1)th root of the error that a unit of the period would have there.

    The error is that of the polynomials, relative to the largest values of field, carriers and temperature.
    """
    number, s = Y.shape[:2]
    size = sizes(Y, thermal)
    top = np.zeros((number, 4))
    for k in range(number):
        width = (tau[k + 1] - tau[k]) ** s
        for j in range(s + 1):
            y = (start if k == 0 else Y[k - 1, s - 1]) if j == 0 else Y[k, j - 1]
            for a in range(3):
                top[k, a] += scheme.top[j] * y[a] / (size[min(max(a - 1, 0), 1)] * width)
            top[k, 3] += scheme.top[j] * read(y, thermal) / (size[2] * width)
    reach = 0.0  # the largest |x (x - c_1) .. (x - c_s)| of an interval
    for i in range(1, 64):
        x = i / 64
        product = x
        for j in range(s):
            product *= x - scheme.c[j]
        reach = max(reach, abs(product))
    jumps = np.empty(number)
    for k in range(number):  # between the intervals k and k + 1
        after = (k + 1) % number
        gap = 0.5 * (tau[k + 1] - tau[k] + tau[after + 1] - tau[after])
        total = 0.0
        for a in range(4):
            total += (top[after, a] - top[k, a]) ** 2
        jumps[k] = np.sqrt(total) / gap / (s + 1)
    out = np.empty(number)
    for k in range(number):
        out[k] = (reach * max(jumps[k], jumps[k - 1])) ** (1.0 / (s + 1))
    return out


@compiled
def spaced(tau: Array, density: Array, number: int) -> Array:
    """Return a mesh of ``number`` intervals that all hold the same part of the integral of ``density``."""
    old = density.size
    mean = 0.0
    for k in range(old):
        mean += density[k] * (tau[k + 1] - tau[k])
    level = np.empty(old)
    for k in range(old):  # half way from the mesh there is, in logarithms: the jumps of a rough mesh are rough
        near = (density[k - 1] * density[k] * density[k] * density[(k + 1) % old]) ** 0.25
        level[k] = max(np.sqrt(near / (mean * old * (tau[k + 1] - tau[k]))), FLATTEST)
    total = np.zeros(old + 1)
    for k in range(old):
        total[k + 1] = total[k] + level[k] * (tau[k + 1] - tau[k])
    out, at = np.empty(number + 1), 0
    out[0], out[number] = 0.0, 1.0
    for i in range(1, number):
        want = total[old] * i / number
        while total[at + 1] < want:
            at += 1
        out[i] = tau[at] + (want - total[at]) / level[at]
    return out


@compiled
def interpolate(start: Array, Y: Array, tau: Array, scheme: Scheme, at: Array) -> Array:
    """Return the states at the fractions ``at`` of the period, increasing, by the polynomials; shape (.., m)."""
    number, s, m = Y.shape
    out, k = np.zeros((at.size, m)), 0
    if at.size == 1:
        k = min(max(np.searchsorted(tau, at[0]) - 1, 0), number - 1)
    for p in range(at.size):
        while k < number - 1 and at[p] > tau[k + 1]:
            k += 1
        x = (at[p] - tau[k]) / (tau[k + 1] - tau[k])
        for j in range(s + 1):
            node = 0.0 if j == 0 else scheme.c[j - 1]
            weight = 1.0
            for i in range(s + 1):
                if i != j:
                    other = 0.0 if i == 0 else scheme.c[i - 1]
                    weight *= (x - other) / (node - other)
            y = (start if k == 0 else Y[k - 1, s - 1]) if j == 0 else Y[k, j - 1]
            for a in range(m):
                out[p, a] += weight * y[a]
    return out


@compiled
def stages(tau: Array, c: Array) -> Array:
    """Return the fractions of the period at all stages, shape (N s,)."""
    out = np.empty((tau.size - 1) * c.size)
    for k in range(tau.size - 1):
        for j in range(c.size):
            out[k * c.size + j] = tau[k] + c[j] * (tau[k + 1] - tau[k])
    return out


@compiled
def look(start: Array, Y: Array, tau: Array, ring: Ring, scheme: Scheme, at: Array) -> Array:
    """Return rows U, dU/dt, dT, d(dT)/dt at the fractions ``at`` of the period, increasing; shape (.., 4)."""
    states = interpolate(start, Y, tau, scheme, at)
    out = np.empty((at.size, 4))
    for p in range(at.size):
        y = states[p]
        f = equations.right_hand_side(y, ring.drive, ring.detuning, ring.rates, ring.fcd, ring.thermal)
        dT, slope = kinds.lift(read(y, ring.thermal), ring.thermal)
        out[p, 0], out[p, 1] = y[0] * y[0] + y[1] * y[1], 2.0 * (y[0] * f[0] + y[1] * f[1])
        out[p, 2], out[p, 3] = dT, slope * read(f, ring.thermal)
    return out


@compiled
def passes(
    start: Array, Y: Array, tau: Array, ring: Ring, scheme: Scheme, grid: Array, seen: Array, column: int, level: float
) -> Array:
    """Return where a column of `look`, ``seen`` on the ``grid``, passes ``level``: one bisection in every bracket."""
    out, found, at = np.empty(grid.size), 0, np.empty(1)
    for i in range(grid.size - 1):
        up = seen[i + 1, column] > level
        if (seen[i, column] > level) == up:
            continue
        left, right = grid[i], grid[i + 1]
        for _ in range(BISECTIONS):
            at[0] = 0.5 * (left + right)
            if (look(start, Y, tau, ring, scheme, at)[0, column] > level) == up:
                right = at[0]
            else:
                left = at[0]
        out[found] = 0.5 * (left + right)
        found += 1
    return out[:found]


@compiled
def along(rows: Array, start: Array, tau: Array, ring: Ring, scheme: Scheme) -> Array:
    """Return trial states at the stages, shape (N, s, m), from the accepted steps of an integration over a period.

    Light and carriers by cubics through ``rows`` (t, Re a, Im a, N, dT) and their slopes; heat follows from ``start``
    under the power that they absorb.
    """
    number, s, m, count = tau.size - 1, scheme.c.size, start.size, rows.shape[0]
    begin, T, at = rows[0, 0], rows[count - 1, 0] - rows[0, 0], 0
    Y, slope = np.zeros((number, s, m)), np.empty((count, 3))
    for i in range(count):
        ar, ai, N = rows[i, 1], rows[i, 2], rows[i, 3]
        shift = equations.dispersion(N, ring.fcd)[0]
        slope[i, 0], slope[i, 1], slope[i, 2], _ = equations.optics(
            ar, ai, N, rows[i, 4], shift, ring.drive, ring.detuning, ring.rates
        )
    for k in range(number):
        for j in range(s):
            t = begin + T * (tau[k] + scheme.c[j] * (tau[k + 1] - tau[k]))
            while at < count - 2 and rows[at + 1, 0] < t:
                at += 1
            h = rows[at + 1, 0] - rows[at, 0]
            x = (t - rows[at, 0]) / h
            for a in range(3):
                y0, y1 = rows[at, 1 + a], rows[at + 1, 1 + a]
                bend = (1.0 - 2.0 * x) * (y1 - y0) + h * ((x - 1.0) * slope[at, a] + x * slope[at + 1, a])
                Y[k, j, a] = (1.0 - x) * y0 + x * y1 + x * (x - 1.0) * bend
            Y[k, j, 2] = max(Y[k, j, 2], 0.0)
    warm(start, Y, tau, T, ring, scheme)
    return Y


def warm(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme) -> None:
    """Write the states of heat to ``Y``, from those of ``start``, under the power that the rest of ``Y`` absorbs."""


@overload(warm, strict=False)
def _warm_of(start, Y, tau, T, ring, scheme):  # type: ignore[no-untyped-def]
    def network(start, Y, tau, T, ring, scheme):  # type: ignore[no-untyped-def]
        number, s, m = Y.shape
        P, poles = np.empty(s), ring.thermal.poles
        for k in range(number):
            h = T * (tau[k + 1] - tau[k])
            begin = start if k == 0 else Y[k - 1, s - 1]
            for j in range(s):
                y = Y[k, j]
                P[j] = equations.absorbed_power(y[0] * y[0] + y[1] * y[1], y[2], ring.rates)
            for i in range(m - 3):
                Y[k, s - 1, 3 + i] = 0.0
            for q in range(scheme.eigenvalue.size):
                lam, P_hat = scheme.eigenvalue[q], 0.0 * scheme.eigenvalue[q]
                for j in range(s):
                    P_hat += scheme.forth[q, j] * P[j]
                for i in range(m - 3):
                    X = (scheme.one[q] * begin[3 + i] + h * poles[0, i] * lam * P_hat) / (1.0 + h * poles[1, i] * lam)
                    Y[k, s - 1, 3 + i] += (scheme.back[s - 1, q] * X).real

    def full(start, Y, tau, T, ring, scheme):  # type: ignore[no-untyped-def]
        number, s, m = Y.shape
        n, heat = m - 3, ring.thermal
        f, J, right = np.empty((s, m)), np.empty((s * n, s * n)), np.empty(s * n)
        for k in range(number):
            h = T * (tau[k + 1] - tau[k])
            begin = start if k == 0 else Y[k - 1, s - 1]
            for j in range(s):
                Y[k, j, 3:] = begin[3:]
            for _ in range(3):  # mildly nonlinear: the third step is at round-off, and this is a trial state
                for j in range(s):
                    y = Y[k, j]
                    P = equations.absorbed_power(y[0] * y[0] + y[1] * y[1], y[2], ring.rates)
                    kinds.flow(y, P, heat, f[j])
                    for a in range(n):
                        for b in range(n):
                            slope = heat.A[a, b] + P * heat.G[a, b]
                            for i in range(n):
                                slope += 2.0 * heat.H[a, b, i] * y[3 + i]
                            for p in range(s):
                                J[n * p + a, n * j + b] = -h * scheme.A[p, j] * slope
                for j in range(s):
                    for a in range(n):
                        J[n * j + a, n * j + a] += 1.0
                        right[n * j + a] = begin[3 + a] - Y[k, j, 3 + a]
                        for p in range(s):
                            right[n * j + a] += h * scheme.A[j, p] * f[p, 3 + a]
                step = np.linalg.solve(J, right)
                for j in range(s):
                    for a in range(n):
                        Y[k, j, 3 + a] += step[n * j + a]

    heat = ring.types[ring.fields.index("thermal")]
    return kinds.chosen(heat, network, full)


@compiled
def flows(states: Array, ring: Ring) -> Array:
    """Return dy/dt at every row of ``states``."""
    out = np.empty_like(states)
    for k in range(states.shape[0]):
        out[k] = equations.right_hand_side(states[k], ring.drive, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    return out


@compiled
def respond(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array) -> Any:
    """Return what each of q parameters does to a closed orbit at fixed fractions of its period.

    ``forcing``, shape (N, s, m, q), are the derivatives of dy/dt by them at the stages. Returns the changes of the
    period, shape (q,), of the start, shape (q, m), and of the stages, shape (q, N, s, m).
    """
    m, count = start.size, forcing.shape[3]
    number, s = Y.shape[:2]
    M, intervals, _ = linearize(start, Y, tau, T, ring, scheme, forcing)
    matrix, right = np.zeros((m + 1, m + 1)), np.zeros((m + 1, count))
    f = equations.right_hand_side(start, ring.drive, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    for i in range(m):
        for j in range(m):
            matrix[i, j] = M[i, j]
        matrix[i, i] -= 1.0
        matrix[i, m], matrix[m, i] = M[i, m + 1], f[i]
        for q in range(count):
            right[i, q] = -M[i, m + 2 + q]
    found = np.linalg.solve(matrix, right)
    turns, starts, changes = np.empty(count), np.empty((count, m)), np.empty((count, number, s, m))
    extras = np.zeros(2 + count)
    for q in range(count):
        extras[:] = 0.0
        extras[1], extras[2 + q] = found[m, q], 1.0
        turns[q] = found[m, q]
        starts[q] = found[:m, q]
        substitute(starts[q], extras, intervals, Y, changes[q])
        heat_of(starts[q], changes[q], turns[q], Y, tau, T, ring, scheme, forcing[:, :, :, q], start)
    return turns, starts, changes


def heat_of(
    first: Array,
    change: Array,
    turn: float,
    Y: Array,
    tau: Array,
    T: float,
    ring: Ring,
    scheme: Scheme,
    forcing: Array,
    start: Array,
) -> None:
    """Write the changes of a network's heat between the ends of the intervals to ``change``."""


@overload(heat_of, strict=False)
def _heat_of(first, change, turn, Y, tau, T, ring, scheme, forcing, start):  # type: ignore[no-untyped-def]
    def network(first, change, turn, Y, tau, T, ring, scheme, forcing, start):  # type: ignore[no-untyped-def]
        number, s, m = Y.shape
        poles, rates = ring.thermal.poles, ring.rates
        matrix, right, dP = np.empty((s, s)), np.empty(s), np.empty(s)
        P = np.empty(s)
        for k in range(number):
            h = T * (tau[k + 1] - tau[k])
            for j in range(s):
                y, d = Y[k, j], change[k, j]
                U, dU = y[0] * y[0] + y[1] * y[1], 2.0 * (y[0] * d[0] + y[1] * d[1])
                P[j] = equations.absorbed_power(U, y[2], rates)
                dP[j] = 2.0 * (rates.absorbed + rates.fca * y[2] + 2.0 * rates.tpa * U) * dU
                dP[j] += 2.0 * rates.fca * d[2] * U
            for i in range(m - 3):
                g, r = poles[0, i], poles[1, i]
                for j in range(s):
                    right[j] = first[3 + i] if k == 0 else change[k - 1, s - 1, 3 + i]
                    for p in range(s):
                        matrix[j, p] = h * r * scheme.A[j, p]
                        push = g * dP[p] + forcing[k, p, 3 + i] + turn / T * (g * P[p] - r * Y[k, p, 3 + i])
                        right[j] += h * scheme.A[j, p] * push
                    matrix[j, j] += 1.0
                solved = np.linalg.solve(matrix, right)
                for j in range(s - 1):
                    change[k, j, 3 + i] = solved[j]

    def full(first, change, turn, Y, tau, T, ring, scheme, forcing, start):  # type: ignore[no-untyped-def]
        pass

    heat = ring.types[ring.fields.index("thermal")]
    return kinds.chosen(heat, network, full)


@compiled
def relax(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme) -> None:
    """Bring heat to its periodic state under the power that the orbit absorbs, in ``start`` and ``Y``."""
    n, step = start.size - 3, 1e-3
    start[3:] = 0.0
    for _ in range(4):  # Newton's method, with differences: one step for a network
        warm(start, Y, tau, T, ring, scheme)
        gap, matrix = Y[-1, -1, 3:] - start[3:], np.empty((n, n))
        for j in range(n):
            other = start.copy()
            other[3 + j] += step
            moved_Y = Y.copy()
            warm(other, moved_Y, tau, T, ring, scheme)
            for i in range(n):
                matrix[i, j] = (moved_Y[-1, -1, 3 + i] - Y[-1, -1, 3 + i]) / step
            matrix[j, j] -= 1.0
        start[3:] -= np.linalg.solve(matrix, gap)
    warm(start, Y, tau, T, ring, scheme)


for kernel in (flows, respond, look, passes, relax, along, correct, close, densities, interpolate, sizes, moved):
    for module in (collocation, equations, kinds):
        forget_if_older(kernel, str(module.__file__))
