"""Cycles with free parameters by multiple shooting, and the directions in which cycles lie beside one.

    phi_(h_i)(y_i; q) = y_(i+1),    w_i . dy_i = 0 in every step,    V (x - x_p) = c,    x = (y_1, T = sum_i h_i, q)

with nodes y_i around the orbit, the flow phi of the kernel, and w_i along dy/dt at a node: nodes move across the orbit
only, and the durations h_i are free. So the pulses may come earlier or later without the nodes changing. A node stands
wherever a deviation would grow by more than `GROWTH` since the last one: behind a canard, where an orbit follows what
repels it, a trace from one node alone would be off by many orders. V has as many rows as there are parameters q: one
for a branch, its tangent; two for a curve of folds. Along a direction W the equations stay solved, and V W = 1.

The flow is that of precise traces (Rodas5P); its derivatives by y and q come from coarser ones, whose steps are taken
again on dual numbers and, for q, with two other values.

Source: Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems (1995), Sections 4.3 and 4.4.
"""

from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..kernel.integrator import Problem, Run
from ..kernel.tableaus import Method
from .cycle_problem import CycleProblem, changed, differences, value_of
from .return_map import FINE, PER_STEP, Orbit, Trace

GROWTH = 100.0  # of a deviation between two nodes
STRIDE = 6  # coarse steps between two places where a node may stand
CLOSE_ENOUGH = 1e-7  # a step of Newton's method that small leaves less than its square times a hundred
SMALLEST = 0.01  # range of an orbit, of its largest values, to which they are compared at least
FARTHEST = 0.5  # of the largest values, the first step
COARSE = 1e-7  # rtol of the traces that are differentiated: multipliers to 1e-6
MOST_STEPS = 7  # of Newton's method


@dataclass(frozen=True, eq=False)
class Family:
    """A ring whose named numbers are free.

    ranges: the units in which they are measured, SI.
    """

    base: CycleProblem
    names: tuple[str, ...]
    ranges: Array

    def at(self, values: Array) -> CycleProblem:
        """The ring with other values, in SI."""
        p = self.base
        for name, value in zip(self.names, values, strict=True):
            p = changed(p, name, float(value))
        return p

    def start(self) -> Array:
        """The values of the ring itself."""
        return np.array([value_of(self.base, name) for name in self.names])


class Nodes(NamedTuple):
    """A trial orbit."""

    y: Array
    """(m, n) states."""
    h: Array
    """(m,) ns from each node to the next."""
    values: Array
    """(q,) of the parameters, SI."""


class Place(NamedTuple):
    """A cycle of a family."""

    nodes: Nodes
    orbit: Orbit
    unit: Array
    """Factors that make the unknowns (y_1, T, q) comparable."""
    directions: Array
    """(q, n + 1 + q): W, changes of (y_1, T, q)."""
    moves: Array
    """(q, m, n + 1): those of every node and its duration."""
    steps: int
    """Of Newton's method that led here."""

    @property
    def values(self) -> Array:
        """The parameters, SI."""
        return self.nodes.values

    @property
    def extent(self) -> float:
        """Range of the orbit, of its largest values."""
        return extent_of(self.orbit.trace.rows)

    def moved(self, along: Array) -> float:
        """The largest change of a state at any node, of its largest value. along: coefficients of directions."""
        n = self.nodes.y.shape[1]
        return float(np.abs(np.tensordot(along, self.moves, axes=1)[:, :n] * self.unit[:n]).max())


def extent_of(rows: Array) -> float:
    """Range of fields, carriers or temperature, of their largest values."""
    every = rows[:, 1:]
    return float((np.ptp(every, axis=0) / np.maximum(np.abs(every).max(axis=0), 1e-300)).max())


class Linear(NamedTuple):
    """The equations at a trial orbit and their derivatives."""

    problem: Problem
    runs: list[Run]
    V: Array
    """(m, n, n), of the flow between the nodes by the states."""
    P: Array
    """(m, n, q), by the parameters."""


def flow(problem: Problem, y: Array, h: float, rtol: float, per_step: int = 1) -> Run:
    """Integrate for ``h`` ns."""
    problem.edges[-1] = h
    return problem.integrate(y, rtol=rtol, per_step=per_step, keep_steps=True)


def weights(family: Family, trace: Trace) -> Array:
    """Factors that make the unknowns (y_1, T, q) comparable: largest values, period, ranges."""
    return np.concatenate([1 / family.base.flow.scale(trace.rows), [1 / trace.T], 1 / family.ranges])


def newton(
    nodes: Nodes, known: Linear, rows: Array, target: Array, unit: Array
) -> tuple[Nodes, Array, Array, float] | None:
    """A step to ``rows`` . dx = ``target``: the nodes behind it, W, its moves, and the largest change.

    ``rows`` and the change are in the units of ``unit``.
    """
    m, n = nodes.y.shape
    q, size, T = nodes.values.size, 1 / unit[:n], 1 / unit[n]
    across = np.stack([known.problem.slopes(y)[0] for y in nodes.y]) / size
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    A, b = np.zeros((m * (n + 1) + q,) * 2), np.zeros((m * (n + 1) + q, 1 + q))
    at_h, at_q = m * n, m * (n + 1)
    for i in range(m):
        here, after = slice(i * n, (i + 1) * n), (i + 1) % m * n
        A[here, here] = known.V[i] * size / size[:, None]
        A[here, after : after + n] -= np.eye(n)
        A[here, at_h + i] = known.problem.slopes(known.runs[i].y)[0] * T / size
        A[here, at_q:] = known.P[i] / unit[n + 1 :] / size[:, None]
        b[here, 0] = (nodes.y[(i + 1) % m] - known.runs[i].y) / size
        A[at_h + i, here] = across[i]
    A[at_q:, :n], A[at_q:, at_h:at_q], A[at_q:, at_q:] = rows[:, :n], rows[:, n : n + 1], rows[:, n + 1 :]
    b[at_q:, 0], b[at_q:, 1:] = target, np.eye(q)
    try:
        found = np.linalg.solve(A, b).T
    except np.linalg.LinAlgError:
        return None
    dy, dh, dq = found[:, :at_h].reshape(-1, m, n) * size, found[:, at_h:at_q] * T, found[:, at_q:] / unit[n + 1 :]
    after = Nodes(nodes.y + dy[0], nodes.h + dh[0], nodes.values + dq[0])
    directions = np.concatenate([dy[1:, 0], dh[1:].sum(axis=1, keepdims=True), dq[1:]], axis=1)
    return after, directions, np.concatenate([dy[1:], dh[1:, :, None]], axis=2), float(np.abs(found[0, :at_q]).max())


def linearised(family: Family, nodes: Nodes, rtol: float) -> Linear | None:
    """Follow all arcs of a trial orbit, and differentiate them along traces of ``rtol``; None where that fails."""
    m, n = nodes.y.shape
    arcs = [*zip(nodes.y, nodes.h, strict=True)]
    V, P, none = np.empty((m, n, n)), np.zeros((m, n, nodes.values.size)), np.empty((n, 0))
    try:
        p = family.at(nodes.values)
        problem = p.kernel(Method.RODAS5P)
        runs = [flow(problem, y, h, min(rtol, FINE), PER_STEP) for y, h in arcs]
        steps = [run.steps for run in (runs if rtol <= FINE else (flow(problem, y, h, rtol) for y, h in arcs))]
        for i in range(m):
            V[i] = problem.follow(nodes.y[i], steps[i], np.eye(n))[1]
        for k, name in enumerate(family.names):
            for weight, other in differences(p, name):
                there = other.kernel(Method.RODAS5P)
                for i in range(m):
                    P[i, :, k] += weight * there.follow(nodes.y[i], steps[i], none)[0]
    except InputError:  # out of the range of the parameter, or the light runs away
        return None
    return Linear(problem, runs, V, P)


def corrected(
    family: Family, trial: Nodes, rows: Array, unit: Array, *, extent: float = 1.0, rtol: float = COARSE
) -> Place | None:
    """Close a trial orbit with ``rows`` . (x - trial) = 0, ``rows`` in the units of ``unit``; None where that fails.

    extent: range of the orbit, of its largest values.
    rtol: of the traces that are differentiated.
    """
    nodes, best = trial, np.inf
    for k in range(MOST_STEPS):
        known = linearised(family, nodes, rtol)
        step = known and newton(nodes, known, rows, (rows * unit) @ (position(trial) - position(nodes)), unit)
        if not known or not step:
            return None
        after, directions, moves, size = step
        if not size < min(FARTHEST * extent, 2 * best) or not after.h.min() > 0:
            return None
        if size <= CLOSE_ENOUGH * max(extent, SMALLEST):
            orbit = _orbit(nodes, known, size)
            return Place(nodes, orbit, weights(family, orbit.trace), directions, moves, k + 1)
        nodes, best = after, size
    return None


def _orbit(nodes: Nodes, known: Linear, move: float) -> Orbit:
    """The closed orbit through the nodes."""
    runs = known.runs
    begins = np.concatenate([[0.0], np.cumsum(nodes.h)])
    for run, begin in zip(runs, begins, strict=False):
        run.rows[:, 0] += begin
    rows = np.concatenate([run.rows[min(i, 1) :] for i, run in enumerate(runs)])
    parts = [(y, run.steps) for y, run in zip(nodes.y, runs, strict=True)]
    whole = reduce(lambda before, V: V @ before, known.V, np.eye(nodes.y.shape[1]))
    return Orbit(Trace(nodes.y[0], runs[-1].y, float(begins[-1]), rows, parts), whole, move)


def position(nodes: Nodes) -> Array:
    """The unknowns x = (y_1, T, q)."""
    return np.concatenate([nodes.y[0], [nodes.h.sum()], nodes.values])


def predicted(family: Family, place: Place, along: Array, rows: Array, rtol: float = COARSE) -> Place | None:
    """Correct the prediction ``along`` (coefficients of the directions, shape (q,)) on the plane of ``rows``."""
    nodes, n, move = place.nodes, place.nodes.y.shape[1], np.tensordot(along, place.moves, axes=1)
    values = nodes.values + (along @ place.directions)[n + 1 :]
    trial = Nodes(nodes.y + move[:, :n], nodes.h + move[:, n], values)
    return corrected(family, trial, rows, place.unit, extent=place.extent, rtol=rtol) if trial.h.min() > 0 else None


def placed(problem: Problem, nodes: Nodes, size: Array) -> Nodes:
    """The orbit with nodes where they are wanted: no deviation across it grows by more than `GROWTH` in between."""
    y, h, since = [nodes.y[0]], [], 0.0
    grown = np.empty((0, size.size, size.size))  # from every place since the last node to here
    for at, duration in zip(nodes.y, nodes.h, strict=True):
        steps = flow(problem, at, duration, COARSE).steps
        now, passed = at, 0.0
        for part in np.split(steps, range(STRIDE, steps.size, STRIDE)):
            after, V = problem.follow(now, part, np.eye(size.size))
            along = problem.slopes(after)[0] / size
            along /= np.linalg.norm(along)
            V = V * size / size[:, None]
            V -= np.outer(along, along @ V)
            grown = np.concatenate([V @ grown, V[None]])
            if len(grown) > 1 and np.linalg.norm(grown, axis=(1, 2)).max() > GROWTH:
                y.append(flow(problem, at, passed, FINE).y if passed > 0 else at)
                h.append(since)
                since, grown = 0.0, V[None]
            now, passed, since = after, passed + float(part.sum()), since + float(part.sum())
    return Nodes(np.array(y), np.array([*h, since]), nodes.values)


def turned(place: Place, rows: Array) -> tuple[Nodes, Array]:
    """Nodes that begin where the last of the directions ``rows`` moves the orbit most, and the same directions there.

    Of a canard neither an end nor the period may change while its middle does.
    """
    n = place.orbit.start.size
    along = np.linalg.lstsq((place.directions * place.unit).T, rows.T, rcond=None)[0].T
    moves = np.tensordot(along, place.moves, axes=1)
    sizes = np.linalg.norm(moves[-1, :, :n] * place.unit[:n], axis=1)
    first = int(sizes.argmax()) if sizes.max() > 2 * sizes[0] else 0
    nodes = place.nodes._replace(y=np.roll(place.nodes.y, -first, axis=0), h=np.roll(place.nodes.h, -first))
    there = np.concatenate([moves[:, first, :n], (along @ place.directions)[:, n:]], axis=1) * place.unit
    return nodes, there


def on_good_nodes(family: Family, place: Place, rows: Array) -> tuple[Place, Array] | None:
    """The cycle with as many nodes as it needs, and the directions ``rows`` at its first, which may be another."""
    nodes, rows = turned(place, rows)
    nodes = placed(family.at(place.values).kernel(Method.RODAS5P), nodes, 1 / place.unit[: place.orbit.start.size])
    if nodes.h.size == place.nodes.h.size == 1:
        return place, rows
    planes = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    found = corrected(family, nodes, planes, place.unit, extent=place.extent)
    return found and (found, rows)


def first_place(family: Family, trace: Trace) -> Place | None:
    """The cycle near a trace that almost returns, with the parameters held; None where Newton's method finds none."""
    n, q, unit = trace.start.size, len(family.names), weights(family, trace)
    whole = Nodes(trace.start[None], np.array([trace.T]), family.start())
    nodes = placed(family.base.flow.fine, whole, 1 / unit[:n])
    return corrected(family, nodes, np.eye(n + 1 + q)[n + 1 :], unit)
