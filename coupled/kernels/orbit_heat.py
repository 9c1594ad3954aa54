"""Heat along a trial orbit: its states under the power that the light absorbs, their changes, their periodic state."""

from __future__ import annotations

import numpy as np

from . import equations, kinds
from .collocation import Ring, Scheme
from .compiling import OPTIONS, compiled, forget_if_older, overload
from .equations import Array


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
            ar, ai, N, rows[i, 4], shift, ring.pump, ring.detuning, ring.rates
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


@compiled
def warm(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme) -> None:
    """Write the states of heat to ``Y``, from those of ``start``, under the power that the rest of ``Y`` absorbs."""
    _warm(start, Y, tau, T, ring, scheme)


def _warm(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme) -> None:
    """`warm` of the kind of the model."""


@overload(_warm, jit_options=OPTIONS, strict=False)
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
                for i in range(3, m):
                    Y[k, j, i] = 0.0
            for q in range(scheme.eigenvalue.size):
                lam, P_hat = scheme.eigenvalue[q], 0.0 * scheme.eigenvalue[q]
                for j in range(s):
                    P_hat += scheme.forth[q, j] * P[j]
                for i in range(m - 3):
                    X = (scheme.one[q] * begin[3 + i] + h * poles[0, i] * lam * P_hat) / (1.0 + h * poles[1, i] * lam)
                    for j in range(s):
                        Y[k, j, 3 + i] += (scheme.back[j, q] * X).real

    def full(start, Y, tau, T, ring, scheme):  # type: ignore[no-untyped-def]
        number, s, m = Y.shape
        n, heat = m - 3, ring.thermal
        f, J, right = np.empty((s, m)), np.empty((s * n, s * n)), np.empty(s * n)
        for k in range(number):
            h = T * (tau[k + 1] - tau[k])
            begin = start if k == 0 else Y[k - 1, s - 1]
            for j in range(s):
                for a in range(3, m):
                    Y[k, j, a] = begin[a]
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
def heat_of(
    first: Array, change: Array, turn: float, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme,
    forcing: Array, start: Array,
) -> None:  # fmt: skip
    """Write the changes of a network's heat between the ends of the intervals to ``change``."""
    _heat_of(first, change, turn, Y, tau, T, ring, scheme, forcing, start)


def _heat_of(
    first: Array, change: Array, turn: float, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme,
    forcing: Array, start: Array,
) -> None:  # fmt: skip
    """`heat_of` for the kind of the model."""


@overload(_heat_of, jit_options=OPTIONS, strict=False)
def _heat_of_kind(first, change, turn, Y, tau, T, ring, scheme, forcing, start):  # type: ignore[no-untyped-def]
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


for module in (equations, kinds):
    forget_if_older(relax, str(module.__file__))
