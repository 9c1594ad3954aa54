"""Periodic orbits with free parameters by multiple shooting, and the tangent vectors along which they continue.

    phi_(h_i)(y_i; q) = y_(i+1),    w_i . dy_i = 0 in every step,    V (x - x_p) = c,    x = (y_1, T = sum_i h_i, q)

with nodes y_i around the orbit, durations h_i between them, the flow phi, and w_i parallel to dy/dt at y_i: a Newton
step changes a node only normal to the orbit, while the durations are free, so the timing along the orbit can change
without the nodes. There are as many nodes as needed to keep the growth of a perturbation between them below `GROWTH`:
along a canard, which follows a repelling set, single shooting would lose many digits. V has one row per parameter q:
the tangent of a branch, or two directions on a surface of cycles for a curve of folds. The rows of W are the directions
in which the linearised equations hold, with V W = 1.

The flow is integrated at a tight tolerance (Rodas5P). Its derivatives by y and q follow a second integration with
fewer steps: these steps are repeated with dual numbers, and for q at other values of the parameter (differences).

Source: Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems (1995), Sections 4.3 and 4.4.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..kernel.integrator import Problem, Run
from ..kernel.tableaus import Method
from .cycle_problem import CycleProblem, changed, differences, value_of
from .return_map import FINE, PER_STEP, Orbit, Trace

GROWTH = 100.0  # of a deviation between two nodes
STRIDE = 6  # coarse steps between two places where a node may stand
FARTHEST = 0.5  # of the largest values, the first step
COARSE = 1e-7  # rtol of the traces that are differentiated: multipliers to 1e-6
MOST_STEPS, MOST_TO_FOLD = 7, 12  # of Newton's method
ASIDE = 0.1  # of a step along a curve of folds, the first step of the secant method across it


@dataclass(frozen=True, eq=False)
class Family:
    """A system with q free parameters, given by name; each combination of values may have a periodic orbit.

    base: the system, with its own values of the parameters.
    ranges [shape (q,), SI]: scale of each parameter, by which its changes are divided.
    """

    base: CycleProblem
    names: tuple[str, ...]
    ranges: Array

    def at(self, values: Array) -> CycleProblem:
        """The system with other values of the free parameters, shape (q,), in SI."""
        p = self.base
        for name, value in zip(self.names, values, strict=True):
            p = changed(p, name, float(value))
        return p

    def start(self) -> Array:
        """The values of the free parameters in ``base``, shape (q,), in SI."""
        return np.array([value_of(self.base, name) for name in self.names])


class Nodes(NamedTuple):
    """An approximate periodic orbit: m states on it, the durations between them, and the parameter values.

    A change of an orbit, such as a tangent, has the same form; several changes have one more axis in front.
    """

    y: Array
    """(m, n): states y_i in internal units."""
    h: Array
    """(m,): durations h_i from each node to the next, ns."""
    values: Array
    """(q,): values of the free parameters, SI."""

    def plus(self, change: "Nodes") -> "Nodes":
        """The orbit after a change."""
        return Nodes(*(a + b for a, b in zip(self, change, strict=True)))

    def times(self, along: Array) -> "Nodes":
        """The sum of several changes, each times a number of ``along``, shape (..., changes)."""
        return Nodes(*(np.tensordot(along, each, axes=1) for each in self))

    def from_node(self, first: int) -> "Nodes":
        """The orbit whose first node is that of the index ``first``."""
        return Nodes(np.roll(self.y, -first, axis=-2), np.roll(self.h, -first, axis=-1), self.values)

    @property
    def x(self) -> Array:
        """The unknowns x = (y_1, T, q), shape (n + 1 + q,)."""
        return np.concatenate([self.y[..., 0, :], self.h.sum(axis=-1, keepdims=True), self.values], axis=-1)


class Place(NamedTuple):
    """A converged periodic orbit of a `Family` at given parameter values, with tangents for continuation.

    The unknowns are x = (y_1, T, q): n states of the first node, the period, and q parameters.
    """

    nodes: Nodes
    orbit: Orbit
    unit: Array
    """(n + 1 + q,): factors by which the unknowns (y_1, T, q) are scaled, see `weights`."""
    tangents: Nodes
    """The changes of nodes, durations and parameters along each row of W, shapes (q, m, n), (q, m) and (q, q)."""
    steps: int
    """Number of Newton iterations of the corrector."""
    extent: float
    """Amplitude of the orbit, as `extent_of`."""
    slope: float = 0.0
    """On a curve of folds: dg/d(distance across the curve), 0 where it is not known."""

    @property
    def values(self) -> Array:
        """Values of the free parameters, shape (q,), in SI."""
        return self.nodes.values

    @property
    def x(self) -> Array:
        """The unknowns."""
        return self.nodes.x

    @property
    def directions(self) -> Array:
        """W, shape (q, n + 1 + q), whose rows are tangents in (y_1, T, q), scaled by ``unit``."""
        return self.tangents.x * self.unit

    def frame(self, along: Array) -> Array:
        """Orthonormal basis of the tangent space, scaled and of the shape of W; first the projection of ``along``."""
        basis, _ = np.linalg.qr(self.directions.T)
        first = along @ basis / np.linalg.norm(along @ basis)
        return np.vstack([first, null_space(first[None]).T]) @ basis.T

    def change(self, rows: Array) -> Nodes:
        """Changes of the orbit along vectors of the tangent space, ``rows``, scaled by ``unit``."""
        return self.tangents.times(np.asarray(np.linalg.lstsq(self.directions.T, rows.T, rcond=None)[0].T))


def extent_of(rows: Array) -> float:
    """Amplitude of an orbit given by its rows (t, fields, N, dT): the largest ratio of range to modulus of a column."""
    every = rows[:, 1:]
    return float((np.ptp(every, axis=0) / np.maximum(np.abs(every).max(axis=0), 1e-300)).max())


class Linear(NamedTuple):
    """The shooting equations at an approximate orbit: its integrated arcs (runs) and their derivatives V and P."""

    problem: Problem
    runs: list[Run]
    V: Array
    """(m, n, n): derivative of phi_(h_i)(y_i; q) by y_i."""
    P: Array
    """(m, n, q): its derivative by the parameters, per SI unit."""


def flow(problem: Problem, y: Array, h: float, rtol: float, per_step: int = 1) -> Run:
    """Integrate the system from the state ``y`` for ``h`` ns; ``per_step`` output rows are kept per step."""
    problem.edges[-1] = h
    return problem.integrate(y, rtol=rtol, per_step=per_step, keep_steps=True)


def weights(family: Family, trace: Trace) -> Array:
    """Scales of the unknowns, 1/(largest |y|, period, ranges of q), shape (n + 1 + q,); products are dimensionless."""
    return np.concatenate([1 / family.base.flow.scale(trace.rows), [1 / trace.T], 1 / family.ranges])


def newton(nodes: Nodes, known: Linear, rows: Array, target: Array, unit: Array) -> tuple[Nodes, Nodes] | None:
    """One Newton step of the shooting equations, closed by ``rows`` . dx = ``target``; None if the matrix is singular.

    rows [shape (q, n + 1 + q)], target [shape (q,)]: scaled by ``unit``, the factors of `weights`.
    Returns the change of the orbit in the step, and its changes along each row of W.
    """
    m, n = nodes.y.shape
    q = nodes.values.size
    size, T, ranges = np.split(1 / unit, [n, n + 1])
    column = size[:, None]
    states = m * n  # then the durations, then the parameters
    A = np.zeros((states + m + q, states + m + q))
    b = np.zeros((len(A), 1 + q))
    by_states = A[:states, :states].reshape(m, n, m, n)
    by_durations = A[:states, states:-q].reshape(m, n, m)
    by_parameters = A[:states, -q:].reshape(m, n, q)
    along = A[states:-q, :states].reshape(m, m, n)
    missed = b[:states, 0].reshape(m, n)
    for i in range(m):
        following = (i + 1) % m
        end = known.runs[i].y
        by_states[i, :, i] = known.V[i] * size / column
        by_states[i, :, following] -= np.eye(n)
        by_durations[i, :, i] = known.problem.slopes(end)[0] * T / size
        by_parameters[i] = known.P[i] * ranges / column
        along[i, i] = _along(known.problem, nodes.y[i], size)
        missed[i] = (nodes.y[following] - end) / size
    A[-q:, :n] = rows[:, :n]
    A[-q:, states:-q] = rows[:, [n]]
    A[-q:, -q:] = rows[:, n + 1 :]
    b[-q:, 0] = target
    b[-q:, 1:] = np.eye(q)
    try:
        changes = np.linalg.solve(A, b).T
    except np.linalg.LinAlgError:
        return None
    y = changes[:, :states].reshape(-1, m, n) * size
    h = changes[:, states:-q] * T
    values = changes[:, -q:] * ranges
    return Nodes(y[0], h[0], values[0]), Nodes(y[1:], h[1:], values[1:])


def _along(problem: Problem, y: Array, size: Array) -> Array:
    """Unit vector of dy/dt at the state ``y``, scaled by the sizes of the states, shape (n,)."""
    slope, _ = problem.slopes(y)
    rate = slope / size
    return rate / np.linalg.norm(rate)


def linearised(family: Family, nodes: Nodes, rtol: float) -> Linear | None:
    """Integrate all arcs of an approximate orbit and differentiate them by y and q; None where the integration fails.

    rtol: relative tolerance of the integration that is differentiated.
    """
    m, n = nodes.y.shape
    arcs = [*zip(nodes.y, nodes.h, strict=True)]
    V = np.empty((m, n, n))
    P = np.zeros((m, n, nodes.values.size))
    none = np.empty((n, 0))
    try:
        p = family.at(nodes.values)
        problem = p.kernel(Method.RODAS5P)
        runs = [flow(problem, y, h, min(rtol, FINE), PER_STEP) for y, h in arcs]
        coarse = runs if rtol <= FINE else [flow(problem, y, h, rtol) for y, h in arcs]
        steps = [run.steps for run in coarse]
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
    family: Family, trial: Nodes, rows: Array, unit: Array, *, extent: float = 1.0, rtol: float = COARSE,
    aside: float = 0.0, slope: float = 0.0,
) -> Place | None:  # fmt: skip
    """Corrector: the periodic orbit with ``rows`` . (x - x_trial) = 0 by Newton's method; None without convergence.

    rows [shape (q, n + 1 + q)]: in the scaled unknowns, with the factors ``unit`` of `weights`.
    extent: amplitude of the orbit as in `extent_of`, which limits the first step.
    rtol: relative tolerance of the integrations that are differentiated.
    aside: not 0 for a fold, where only the first row holds. All Newton steps but the first then also go along the
        second row, by this distance and after that by those of the secant method for g = det(dq/dW) = 0.
    """
    n = trial.y.shape[1]
    nodes = trial
    most = FARTHEST * extent
    size = np.inf
    off = 0.0  # the last step along the second row
    g = 0.0
    for k in range(MOST_STEPS if aside == 0 else MOST_TO_FOLD):
        linear = linearised(family, nodes, rtol) if nodes.h.min() > 0 else None
        if linear is None:
            return None
        target = (rows * unit) @ (trial.x - nodes.x)
        if aside:
            target[1] = 0.0
        solution = newton(nodes, linear, rows, target, unit)
        if solution is None:
            return None
        step, tangents = solution
        # between points of the secant method nearer than 1e-7, g differs by round-off
        clear = abs(off) > max(1e-7, size)  # the last step across moved g by more than the last Newton step
        size = _size(step, unit)
        if aside:
            before = g
            g = float(np.linalg.det(tangents.values * unit[n + 1 :]))
            slope = (g - before) / off if clear else slope
            off = _step_across(k, g, slope, aside)
            step = step.plus(tangents.times(np.array([0.0, off])))
        if not max(size, abs(off)) < most:
            return None
        # the parameters are off by the square of the distance from the fold, in the units of `weights`
        on_fold = not aside or (slope and abs(off) <= 1e-6)
        # a step of Newton's method leaves less than its square times a hundred; orbits below 1 % in range count as 1 %
        if size <= 1e-7 * max(extent, 0.01) and on_fold:
            orbit = _orbit(nodes, linear)
            scale = weights(family, orbit.trace)
            return Place(nodes, orbit, scale, tangents, k + 1, extent_of(orbit.trace.rows), slope)
        nodes = nodes.plus(step)
        most = min(FARTHEST * extent, max(2 * size, 30 * abs(aside)))
    return None


def _size(step: Nodes, unit: Array) -> float:
    """Largest change of a state or a duration in a Newton step, scaled."""
    n = step.y.shape[1]
    states = np.abs(step.y * unit[:n]).max()
    durations = np.abs(step.h * unit[n]).max()
    return float(max(states, durations))


def _step_across(k: int, g: float, slope: float, aside: float) -> float:
    """The secant method's step to g = 0 after the k-th Newton step; ``aside`` where the slope of g is not known."""
    if k == 0:
        return 0.0
    return -g / slope if slope else aside


def _orbit(nodes: Nodes, known: Linear) -> Orbit:
    """Join the arcs of converged nodes to one orbit, with V the product of their derivatives."""
    runs = known.runs
    begins = np.concatenate([[0.0], np.cumsum(nodes.h)])
    for run, begin in zip(runs, begins, strict=False):
        run.rows[:, 0] += begin
    rows = np.concatenate([run.rows[min(i, 1) :] for i, run in enumerate(runs)])
    parts = [(y, run.steps) for y, run in zip(nodes.y, runs, strict=True)]
    V = np.eye(nodes.y.shape[1])
    for arc in known.V:
        V = arc @ V
    trace = Trace(nodes.y[0], runs[-1].y, float(begins[-1]), rows, parts)
    return Orbit(trace, V)


def predicted(family: Family, place: Place, rows: Array, step: float, rtol: float = COARSE) -> Place | None:
    """Predictor and corrector: the next cycle, or the next fold where there are two rows (a `Place.frame`).

    step: distance from ``place`` along the first row.
    """
    trial = place.nodes.plus(place.change(step * rows[0]))
    aside = ASIDE * step * (len(rows) - 1)
    return corrected(family, trial, rows, place.unit, extent=place.extent, rtol=rtol, aside=aside, slope=place.slope)


def placed(problem: Problem, nodes: Nodes, size: Array) -> Nodes:
    """Choose nodes on an orbit: no perturbation normal to it grows by more than `GROWTH` from one to the next.

    size [shape (n,)]: scales of the states.
    """
    y = [nodes.y[0]]
    h = []
    since = 0.0
    grown = np.empty((0, size.size, size.size))  # from every place since the last node to here
    for node, duration in zip(nodes.y, nodes.h, strict=True):
        steps = flow(problem, node, duration, COARSE).steps
        state = node
        passed = 0.0
        for part in np.split(steps, range(STRIDE, steps.size, STRIDE)):
            after, V = problem.follow(state, part, np.eye(size.size))
            along = _along(problem, after, size)
            V = V * size / size[:, None]
            V -= np.outer(along, along @ V)
            grown = np.concatenate([V @ grown, V[None]])
            if len(grown) > 1 and np.linalg.norm(grown, axis=(1, 2)).max() > GROWTH:
                y.append(flow(problem, node, passed, FINE).y if passed > 0 else node)
                h.append(since)
                since = 0.0
                grown = V[None]
            state = after
            passed += float(part.sum())
            since += float(part.sum())
    return Nodes(np.array(y), np.array([*h, since]), nodes.values)


def on_good_nodes(family: Family, place: Place, rows: Array) -> tuple[Place, Array] | None:
    """Choose new nodes for a cycle (`placed`) and correct it; return it with its frame that begins as ``rows``.

    The first node is where the orbit changes most along the last of ``rows``: on a branch of canards another first node
    and the period may be nearly constant while other parts of the orbit change.
    """
    n = place.orbit.start.size
    change = place.change(rows)
    moved = np.linalg.norm(change.y[-1] * place.unit[:n], axis=1)
    first = int(moved.argmax()) if moved.max() > 2 * moved[0] else 0
    problem = family.at(place.values).kernel(Method.RODAS5P)
    nodes = placed(problem, place.nodes.from_node(first), 1 / place.unit[:n])
    if nodes.h.size == place.nodes.h.size == 1:
        return place, rows
    rows = change.from_node(first).x * place.unit
    sizes = np.linalg.norm(rows, axis=1)
    slope = place.slope / float(np.prod(sizes) * sizes[-1])
    better = corrected(family, nodes, rows / sizes[:, None], place.unit, extent=place.extent, slope=slope)
    return better and (better, better.frame(rows[0]))


def first_place(family: Family, trace: Trace) -> Place | None:
    """The periodic orbit near an almost closed trajectory, with parameters held; None without convergence."""
    n = trace.start.size
    q = len(family.names)
    unit = weights(family, trace)
    whole = Nodes(trace.start[None], np.array([trace.T]), family.start())
    nodes = placed(family.base.flow.fine, whole, 1 / unit[:n])
    return corrected(family, nodes, np.eye(n + 1 + q)[n + 1 :], unit)
