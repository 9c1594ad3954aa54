"""Closed orbits along traces: from a state whose carriers rise, until they do so again, corrected by Newton's method.

The derivative of the return map comes from the collocation equations on a mesh of the trace (`orbits.advance`), and is
kept for the traces that follow while each lies much nearer to the orbit than the last (chord Newton):

    dy_0 = C (y_T - y_0),     C from (M - 1) dy_0 + f dT = y_0 - y_T,  dN_0 = 0

Near the orbit the stages of the mesh move, too.

Source: Kelley, Solving Nonlinear Equations with Newton's Method (2003), Section 2.3.1 (the chord method).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import collocation, equations, kinds, orbit_heat, orbits, rosenbrock
from .collocation import Ring, Scheme
from .compiling import compiled, forget_if_older, merged
from .equations import Array
from .laser import LaserPieces
from .orbits import close
from .tableaus import Tableau

LONGEST_RETURN = 4.0  # periods
LARGEST_CHANGE = 0.3  # of the largest heat, in a step
NEAR = 0.1  # of the largest values: a step that small is taken on the mesh
CLOSE = 3e-4  # a chord step that small leads to the mesh
FALLS = 0.5  # of a chord step, what the next one may be
TURN = 1e-5  # change of the period in a first step on the mesh that may be the last one
STEPS = 6  # of Newton's method on the mesh
FEWEST = 16  # intervals of a mesh for each pulse
UNIFORM = 0.2  # share of a mesh that does not follow the steps of the trace
MOST_STEPS = 20_000_000  # of an integration


@merged
def integrated(
    y: Array, duration: float, level: float, ring: Ring, floor: Array, method: Tableau, rtol: float, first: float,
    watch: Array,
) -> Any:  # fmt: skip
    """Integrate over ``duration`` in ns, or until the carriers rise through ``level``; as `rosenbrock.integrate`."""
    power, detuning = np.zeros((1, 4)), np.zeros((1, 4))
    power[0, 0], detuning[0, 0] = ring.pump * ring.pump, ring.detuning
    laser, event = LaserPieces(np.array([0.0, duration]), power, detuning), np.zeros(3)
    if level < np.inf:
        event[0], event[1], event[2] = 2.0, level, 1.0
    return rosenbrock.integrate(
        y, laser, ring.rates, ring.fcd, ring.thermal, method, rtol, floor, np.empty(0), np.int64(1), first, event,
        np.int64(MOST_STEPS), watch,
    )  # fmt: skip


@merged
def around(
    y: Array, T: float, pulses: int, ring: Ring, floor: Array, method: Tableau, rtol: float, watch: Array
) -> tuple[Array, Array, bool]:
    """Integrate until the carriers have risen ``pulses`` times through their value in ``y``.

    Returns the rows (t, Re a, Im a, N, dT), the end, and whether they have.
    """
    level, out = y[2], np.empty((0, 5))
    y = y.copy()
    for k in range(pulses):
        y[2] = level * (1.0 + 1e-12)  # above it, so that the level is met after the pulse and not at once
        rows, y, _, _, _, counts = integrated(y, LONGEST_RETURN * T, level, ring, floor, method, rtol, 0.0, watch)
        if counts[2] != rosenbrock.EVENT:
            return out, y, False
        if k > 0:
            rows[:, 0] += out[out.shape[0] - 1, 0]
            out = np.concatenate((out, rows[1:]))
        else:
            out = rows
    return out, y, True


@compiled
def mesh_of(t: Array, number: int) -> Array:
    """Return ``number`` intervals with nearly as many of the times ``t`` in each, none much wider than the mean."""
    out, at, last = np.empty(number + 1), 0, t.size - 1
    span = t[last] - t[0]
    for i in range(number + 1):
        want = i / number
        while at < last - 1 and (1.0 - UNIFORM) * (at + 1) / last + UNIFORM * (t[at + 1] - t[0]) / span < want:
            at += 1
        low = (1.0 - UNIFORM) * at / last + UNIFORM * (t[at] - t[0]) / span
        high = (1.0 - UNIFORM) * (at + 1) / last + UNIFORM * (t[at + 1] - t[0]) / span
        out[i] = (t[at] - t[0] + (want - low) / (high - low) * (t[at + 1] - t[at])) / span
    out[0], out[number] = 0.0, 1.0
    return out


@compiled
def chord_of(M: Array, y: Array, ring: Ring) -> Array:
    """Return C, shape (m, m), from the derivative of the return map; ``y`` is the end of a trace, where light follows.

    The beginning of a trial orbit need not be such a point: there the light may change a thousand times faster.
    """
    m = y.size
    matrix = np.zeros((m + 1, m + 1))
    f = equations.right_hand_side(y, ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    for i in range(m):
        for j in range(m):
            matrix[i, j] = -M[i, j]
        matrix[i, i] += 1.0
        matrix[i, m] = -f[i]
    matrix[m, 2] = 1.0
    return np.ascontiguousarray(np.linalg.inv(matrix)[:m, :m])


@compiled
def _largest(rows: Array) -> Array:
    """Return the largest |a|, N and dT of the rows (t, Re a, Im a, N, dT) of a trace."""
    size = np.full(3, 1e-30)
    for i in range(rows.shape[0]):
        size[0] = max(size[0], np.sqrt(rows[i, 1] * rows[i, 1] + rows[i, 2] * rows[i, 2]))
        size[1], size[2] = max(size[1], rows[i, 3]), max(size[2], abs(rows[i, 4]))
    return size


@merged
def near(
    y: Array, T: float, pulses: int, guess: Array, ring: Ring, floor: Array, scheme: Scheme, method: Tableau,
    rtol: float, share: float, tolerance: float, shots: int, watch: Array,
) -> Any:  # fmt: skip
    """Close an orbit of ``pulses`` pulses from a state on it whose carriers rise, near ``T`` ns.

    Parameters
    ----------
    y, T, pulses : array of shape (m,), float, int
    guess : array, shape (m, m) or (0, 0)
        derivative of the return map of a neighbour, if there is one.
    ring, floor, scheme, method, rtol : Ring, array, Scheme, Tableau, float
    share : float
        intervals of the mesh for each step of the trace.
    tolerance : float
        size of the last step on the mesh, relative to the largest values; it leaves about its square.
    shots : int
        the most traces.
    watch : array
        as for `rosenbrock.integrate`.

    Returns
    -------
    start, Y, tau, T : arrays, float
    M : array, shape (m, m)
        derivative of the return map.
    move : float
        size of the last step; infinite where no orbit was found.
    """
    y, m, before, known = y.copy(), y.size, np.inf, guess.shape[0] == y.size
    chord = np.empty((0, 0))
    section, right = np.zeros((1, m + 1)), np.zeros((1, 1))
    section[0, 2] = 1.0  # the beginning keeps its carriers
    line = np.empty((1, 1, m))
    for _ in range(shots):
        rows, end, met = around(y, T, pulses, ring, floor, method, rtol, watch)
        if not met or rows.shape[0] < 4:
            break
        T = rows[rows.shape[0] - 1, 0]
        if known:
            if chord.size == 0:
                chord = chord_of(guess, end, ring)
            line[0, 0] = chord @ (end - y)
            far = orbits.moved(line, _largest(rows))
            if CLOSE < far < FALLS * min(before, 1.0):
                y, before = y + line[0, 0], far
                continue
        tau = mesh_of(rows[:, 0].copy(), max(FEWEST * pulses, int(share * rows.shape[0])))
        Y = orbit_heat.along(rows, y, tau, ring, scheme)
        none = np.empty((Y.shape[0], Y.shape[1], m, 0))
        changes, stages, M, move = orbits.advance(y, Y, tau, T, ring, scheme, none, section, right)
        if move == np.inf:
            break
        if move < NEAR:
            start, turned = y + changes[0, :m], T + changes[0, m]
            closed = move <= tolerance and abs(changes[0, m]) <= TURN * T
            Y_new = Y + stages[0]
            if not closed:
                start, Y_new, turned, M, closed, move = close(start, Y_new, tau, turned, ring, scheme, tolerance, STEPS)
            if closed and turned > 0.0:
                orbit_heat.warm(start, Y_new, tau, turned, ring, scheme)
                return start, Y_new, tau, turned, M[:, :m].copy(), move
        chord, known, before = chord_of(M, end, ring), True, np.inf
        warmest, change = np.abs(Y[:, Y.shape[1] - 1, 3:]).max(), max(np.abs(changes[0, 3:m]).max(), 1e-30)
        y = y + min(1.0, LARGEST_CHANGE * warmest / change) * changes[0, :m]
    return y, np.empty((0, 0, m)), np.empty(0), T, np.empty((0, 0)), np.inf


for module in (collocation, equations, kinds):
    forget_if_older(chord_of, str(module.__file__))
