"""Closed orbits: Newton's method on the return map, with parameters as further unknowns where conditions are given.

The return map is that of the collocation equations (`collocation`). With M its derivative, t and p what the period and
the parameters do to the last state, b what the residuals do, and rows of conditions,

    (M - 1) dy_0 + t dT + p dq = y_0 - y_N - b,       conditions . (dy_0, dT, dq) = right

and the stages follow by substitution. Without parameters the one condition fixes the phase, f(y_0) . dy_0 = 0.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.2 (continuation of cycles).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import algebra, collocation, equations, kinds, orbit_mesh
from .collocation import Intervals, Ring, Scheme, linearize, substitute
from .compiling import compiled, forget_if_older, merged
from .equations import Array
from .orbit_heat import heat_of
from .orbit_mesh import sizes

LARGEST_TURN, LARGEST_MOVE = 0.3, 2.0  # of the period, and of the largest values, in a step


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
def shifted(y: Array, share: float, change: Array) -> Array:
    """Return y + share change, for as many entries as ``y`` has."""
    out = np.empty(y.size)
    for i in range(y.size):
        out[i] = y[i] + share * change[i]
    return out


@compiled
def shifted_stages(Y: Array, share: float, change: Array) -> Array:
    """Return Y + share change."""
    out = np.empty(Y.shape)
    for k in range(Y.shape[0]):
        for j in range(Y.shape[1]):
            for i in range(Y.shape[2]):
                out[k, j, i] = Y[k, j, i] + share * change[k, j, i]
    return out


@compiled
def phase(start: Array, ring: Ring, size: Array, count: int) -> Array:
    """Return the condition that the beginning moves at a right angle to the orbit, shape (1, count)."""
    f = equations.right_hand_side(start, ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    row = np.zeros((1, count))
    for i in range(start.size):
        unit = size[min(max(i - 1, 0), 2)]
        row[0, i] = f[i] / (unit * unit) * size[0]
    return row


@merged
def advance(
    start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array, rows: Array, right: Array
) -> Any:
    """Return one step of Newton's method, and directions along which the equations stay solved.

    Parameters
    ----------
    start, Y, tau, T, ring, scheme, forcing
        as for `linearize`, with q parameters.
    rows : array, shape (1 + q, m + 1 + q)
        conditions on the changes of start, period and parameters.
    right : array, shape (1 + q, k)
        their right-hand sides: the first column is for the step, the others for directions.

    Returns
    -------
    changes : array, shape (k, m + 1 + q)
    stages : array, shape (k, N, s, m)
    M : array, shape (m, m + 2 + q)
        as of `linearize`.
    move : float
        largest change of the step in units of the largest values; infinite where there is no step.
    """
    M, intervals, _ = linearize(start, Y, tau, T, ring, scheme, forcing)
    changes, stages, move = solved(M, intervals, start, Y, T, ring.thermal, rows, right)
    return changes, stages, M, move


@compiled
def solved(
    M: Array, intervals: Intervals, start: Array, Y: Array, T: float, thermal: Any, rows: Array, right: Array
) -> tuple[Array, Array, float]:
    """Return changes, stages and move of `advance` from the linearised equations."""
    m, columns, wide = start.size, right.shape[1], rows.shape[1]
    out, stages = np.zeros((columns, wide)), np.zeros((columns, *Y.shape))
    matrix = np.zeros((wide, wide + columns))  # the right-hand sides in its last columns
    end, total = Y[Y.shape[0] - 1, Y.shape[1] - 1], 0.0
    for i in range(m):
        for j in range(m):
            matrix[i, j] = M[i, j]
            total += abs(M[i, j])
        matrix[i, i] -= 1.0
        for j in range(m, wide):
            matrix[i, j] = M[i, j + 1]
        matrix[i, wide] = start[i] - end[i] - M[i, m]
        total += abs(matrix[i, wide]) + abs(M[i, m + 1])
    for i in range(wide - m):
        for j in range(wide):
            matrix[m + i, j] = rows[i, j]
        for k in range(columns):
            matrix[m + i, wide + k] = right[i, k]
    if not total < 1e12:  # nan and infinity too
        return out, stages, np.inf
    algebra.eliminate(matrix)
    extras = np.zeros(1 + wide - m)
    for k in range(columns):
        for j in range(wide):
            out[k, j] = matrix[j, wide + k]
        extras[0] = 1.0 if k == 0 else 0.0
        for j in range(wide - m):
            extras[1 + j] = out[k, m + j]
        substitute(out[k], extras, intervals, Y, stages[k])
    largest = max(abs(out[0, m]) / T, moved(stages[0], sizes(Y, thermal)))
    return out, stages, largest if largest < 1e9 else np.inf


@merged
def close(
    start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, tolerance: float, most: int
) -> tuple[Array, Array, float, Array, bool, float]:
    """Close an orbit by Newton's method, at most ``most`` steps until none moves it by ``tolerance`` of its size.

    Returns start, Y, T, the derivative of the return map (with the columns of `linearize`), whether it closed, and the
    size of the last step.
    """
    start, Y, last, m, closed = start.copy(), Y.copy(), np.inf, start.size, False
    M = np.zeros((m, m + 2))
    none, right = np.empty((Y.shape[0], Y.shape[1], m, 0)), np.zeros((1, 1))
    for _ in range(most):
        row = phase(start, ring, sizes(Y, ring.thermal), m + 1)
        changes, stages, M, last = advance(start, Y, tau, T, ring, scheme, none, row, right)
        if last == np.inf:
            break
        turn = changes[0, m]
        share = min(1.0, LARGEST_TURN * T / max(abs(turn), 1e-30), LARGEST_MOVE / max(last, 1e-30))
        start, Y = shifted(start, share, changes[0]), shifted_stages(Y, share, stages[0])
        T += share * turn
        if last <= tolerance:
            closed = True
            break
    return start, Y, T, M, closed, last


@compiled
def flows(states: Array, ring: Ring) -> Array:
    """Return dy/dt at every row of ``states``."""
    out = np.empty_like(states)
    for k in range(states.shape[0]):
        f = equations.right_hand_side(states[k], ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
        for i in range(f.size):
            out[k, i] = f[i]
    return out


def respond(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array) -> Any:
    """Return what each of q parameters does to a closed orbit at fixed fractions of its period.

    ``forcing``, shape (N, s, m, q), are the derivatives of dy/dt by them at the stages. Returns the changes of the
    period, shape (q,), of the start, shape (q, m), and of the stages, shape (q, N, s, m).
    """
    m, count = start.size, forcing.shape[3]
    rows, right = np.zeros((1 + count, m + 1 + count)), np.zeros((1 + count, 1 + count))
    rows[0] = phase(start, ring, sizes(Y, ring.thermal), m + 1 + count)[0]
    for q in range(count):
        rows[1 + q, m + 1 + q], right[1 + q, 1 + q] = 1.0, 1.0
    found, changes, _, _ = advance(start, Y, tau, T, ring, scheme, forcing, rows, right)
    turns, starts = found[1:, m].copy(), found[1:, :m].copy()
    for q in range(count):
        heat_of(starts[q], changes[1 + q], turns[q], Y, tau, T, ring, scheme, forcing[:, :, :, q], start)
    return turns, starts, changes[1:].copy()


for module in (algebra, collocation, equations, kinds, orbit_mesh):
    forget_if_older(flows, str(module.__file__))
