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

from ..kernel.tableaus import Tableau
from . import algebra, collocation, equations, kinds, orbit_heat, orbits, rosenbrock
from .collocation import Ring, Scheme
from .compiling import compiled, forget_if_older, merged
from .equations import Array
from .laser import LaserPieces
from .orbits import advance, close, moved, shifted, shifted_stages

LONGEST_RETURN = 4.0  # periods
LARGEST_CHANGE = 0.3  # of the largest heat, in a step
NEAR = 0.1  # of the largest values: a step that small is taken on the mesh
CLOSE = 3e-4  # a chord step that small leads to the mesh
FALLS = 0.5  # of a chord step, what the next one may be
TURN = 1e-5  # change of the period in a first step on the mesh that may be the last one
STEPS = 6  # of Newton's method on the mesh
SAME = 1e-5  # of a period, of two meshes of which the second has twice as many intervals: the second errs much less
DIP = 3e-6  # of the carriers, by which they fall between two pulses; less is the noise of a trace
NOISE = 8  # rises of that kind in a trace, at the most
FEWEST = 16  # intervals of a mesh for each pulse
UNIFORM = 0.2  # share of a mesh that does not follow the steps of the trace
MOST_STEPS = 20_000_000  # of an integration


@compiled
def constant_light(pump: float, detuning: float, duration: float, level: float) -> tuple[LaserPieces, Array, Array]:
    """Return the laser, the event at ``level`` and the empty output times of `integrated`."""
    edges, power, turn, event = np.zeros(2), np.zeros((1, 4)), np.zeros((1, 4)), np.zeros(3)
    edges[1], power[0, 0], turn[0, 0] = duration, pump * pump, detuning
    if level < np.inf:
        event[0], event[1], event[2] = 2.0, level, 1.0
    return LaserPieces(edges, power, turn), event, np.zeros(0)


@merged
def integrated(
    y: Array, duration: float, level: float, ring: Ring, floor: Array, method: Tableau, rtol: float, first: float,
    watch: Array,
) -> Any:  # fmt: skip
    """Integrate over ``duration`` in ns, or until the carriers rise through ``level``; as `rosenbrock.integrate`."""
    laser, event, no_times = constant_light(ring.pump, ring.detuning, duration, level)
    return rosenbrock.integrate(
        y, laser, ring.rates, ring.fcd, ring.thermal, method, rtol, floor, no_times, np.int64(1), first, event,
        np.int64(MOST_STEPS), watch,
    )  # fmt: skip


@merged
def around(
    y: Array, T: float, pulses: int, ring: Ring, floor: Array, method: Tableau, rtol: float, watch: Array
) -> tuple[Array, Array, bool]:
    """Integrate until the carriers have risen ``pulses`` times through their value in ``y``.

    Returns the rows (t, Re a, Im a, N, dT), the end, and whether they have.
    """
    level, out, met = y[2], np.empty((0, 5)), True
    y, left = y.copy(), pulses
    for _ in range(pulses + NOISE):
        y[2] = level * (1.0 + 1e-12)  # above it, so that the level is met after the pulse and not at once
        rows, y, _, _, _, counts = integrated(y, LONGEST_RETURN * T, level, ring, floor, method, rtol, 0.0, watch)
        if counts[2] != rosenbrock.EVENT:
            met = False
            break
        out = followed(out, rows)
        left -= 1 if rows[:, 3].min() < level * (1.0 - DIP) else 0
        if left == 0:
            break
    return out, y, met and left == 0


@compiled
def followed(rows: Array, more: Array) -> Array:
    """Return the rows of a trace and of the one that begins at its end."""
    count = rows.shape[0]
    first, begin = 0, 0.0
    if count > 0:
        first, begin = 1, rows[count - 1, 0]
    out = np.empty((count + more.shape[0] - first, 5))
    for i in range(count):
        for j in range(5):
            out[i, j] = rows[i, j]
    for i in range(first, more.shape[0]):
        at = count + i - first
        for j in range(5):
            out[at, j] = more[i, j]
        out[at, 0] += begin
    return out


@compiled
def mesh_of(rows: Array, number: int) -> Array:
    """Return ``number`` intervals with nearly as many of the ``rows`` in each, none much wider than the mean."""
    out, at, last, t = np.empty(number + 1), 0, rows.shape[0] - 1, rows[:, 0]
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
    matrix = np.zeros((m + 1, 2 * m + 1))  # the columns of the identity in its last ones
    f = equations.right_hand_side(y, ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
    for i in range(m):
        for j in range(m):
            matrix[i, j] = -M[i, j]
        matrix[i, i] += 1.0
        matrix[i, m], matrix[i, m + 1 + i] = -f[i], 1.0
    matrix[m, 2] = 1.0
    algebra.eliminate(matrix)
    out = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            out[i, j] = matrix[i, m + 1 + j]
    return out


@compiled
def chord_step(chord: Array, y: Array, end: Array) -> Array:
    """Return C (y_T - y_0), shape (1, 1, m)."""
    out = np.zeros((1, 1, y.size))
    for i in range(y.size):
        for j in range(y.size):
            out[0, 0, i] += chord[i, j] * (end[j] - y[j])
    return out


@compiled
def nearer(y: Array, change: Array, Y: Array) -> Array:
    """Return y + dy, in a step that changes no heat by more than `LARGEST_CHANGE` of the warmest one in ``Y``."""
    last, warmest, most = Y.shape[1] - 1, 0.0, 1e-30
    for i in range(3, y.size):
        most = max(most, abs(change[i]))
        for k in range(Y.shape[0]):
            warmest = max(warmest, abs(Y[k, last, i]))
    return shifted(y, min(1.0, LARGEST_CHANGE * warmest / most), change)


@compiled
def monodromy(M: Array) -> Array:
    """Return the columns of a derivative of the return map that belong to the state."""
    m = M.shape[0]
    out = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            out[i, j] = M[i, j]
    return out


@compiled
def _largest(rows: Array) -> Array:
    """Return the largest |a|, N and dT of the rows (t, Re a, Im a, N, dT) of a trace."""
    size = np.full(3, 1e-30)
    for i in range(rows.shape[0]):
        size[0] = max(size[0], np.sqrt(rows[i, 1] * rows[i, 1] + rows[i, 2] * rows[i, 2]))
        size[1], size[2] = max(size[1], rows[i, 3]), max(size[2], abs(rows[i, 4]))
    return size


@compiled
def off(M: Array) -> float:
    """Return the distance from 1 of the multiplier along the orbit: it tells how fine the mesh is."""
    return float(np.abs(np.linalg.eigvals(M.astype(np.complex128)) - 1.0).min())


@merged
def near(
    y: Array, T: float, pulses: int, guess: Array, ring: Ring, floor: Array, scheme: Scheme, method: Tableau,
    rtol: float, share: float, tolerance: float, shots: int, resolved: float, watch: Array,
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
    resolved : float
        an `off` above which the mesh becomes twice as fine, until the period changes by less than `SAME`.
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
    kept = (y, np.empty((0, 0, m)), np.empty(0), T, np.empty((0, 0)), np.inf)
    section, right = np.zeros((1, m + 1)), np.zeros((1, 1))
    section[0, 2] = 1.0  # the beginning keeps its carriers
    for _ in range(shots):
        rows, end, met = around(y, T, pulses, ring, floor, method, rtol, watch)
        if not met or rows.shape[0] < 4:
            break
        T = rows[rows.shape[0] - 1, 0]
        if known:
            if chord.size == 0:
                chord = chord_of(guess, end, ring)
            line = chord_step(chord, y, end)
            far = moved(line, _largest(rows))
            if CLOSE < far < FALLS * min(before, 1.0):
                y, before = shifted(y, 1.0, line[0, 0]), far
                continue
        tau = mesh_of(rows, max(FEWEST * pulses, int(share * rows.shape[0])))
        Y = orbit_heat.along(rows, y, tau, ring, scheme)
        none = np.empty((Y.shape[0], Y.shape[1], m, 0))
        changes, stages, M, move = advance(y, Y, tau, T, ring, scheme, none, section, right)
        if move == np.inf:
            break
        if move < NEAR:
            start, turned = shifted(y, 1.0, changes[0]), T + changes[0, m]
            closed = move <= tolerance and abs(changes[0, m]) <= TURN * T
            Y_new = shifted_stages(Y, 1.0, stages[0])
            if not closed:
                start, Y_new, turned, M, closed, move = close(start, Y_new, tau, turned, ring, scheme, tolerance, STEPS)
            if closed and turned > 0.0:
                orbit_heat.warm(start, Y_new, tau, turned, ring, scheme)
                last, found = kept[3], kept[5] < np.inf
                kept = (start, Y_new, tau, turned, monodromy(M), move)
                if resolved == np.inf or off(kept[4]) <= resolved or (found and abs(turned - last) <= SAME * turned):
                    break
                y, T, share, known, before = start, turned, 2.0 * share, False, np.inf
                continue
        chord, known, before = chord_of(M, end, ring), True, np.inf
        y = nearer(y, changes[0], Y)
    return kept


for module in (algebra, collocation, equations, kinds, orbits):
    forget_if_older(chord_of, str(module.__file__))
