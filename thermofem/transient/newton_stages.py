"""Stages of the ESDIRK method for k(T) and c_p(T): Newton's method with factors of a symmetric neighbour.

Stage i solves  H(x_i) + gamma h F(x_i) = H(x_0) + h sum_{j<i} a_ij dH_j + gamma h B P_i  for the rise x_i. The Jacobian
is sum_l M_l D_l + gamma h sum_l K_l D'_l with diagonal D, the laws' derivatives at the nodes; its neighbour

    sum_l sqrt(D_l) M_l sqrt(D_l) + gamma h sum_l sqrt(D'_l) K_l sqrt(D'_l)

is symmetric and has the ordering of the linear factors. It follows the state where a derivative has moved by `DRIFT`,
or by `SLIGHT_DRIFT` when another step length asks for factors anyway. Each iteration costs one solve. A step with a
stage whose iterations stall is made shorter.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, hstack

from ..algebra.factor import Pencil
from ..arrays import Array
from ..waveforms import Waveform
from .esdirk import GAMMA, STAGE_TIMES, STAGES, Stepper, through
from .nonlinear import NodalOperator, NonlinearEquations, at_nodes

DRIFT = 0.2  # relative change of a law's derivative at any node beyond which the factors are made again (measured)
SLIGHT_DRIFT = 0.03  # the same where the step has changed length, so that factors are to be made anyway (measured)
ITERATIONS = 10  # per stage, before the step is made shorter
STALLED = 0.95  # ratio of successive corrections above which it is made shorter at once
NEWTON_SHARE = 0.02  # of the step's error, left by the iteration; a larger share disturbs the error estimate (measured)

# value at each stage of the polynomial through the stages before it
GUESS = np.zeros((6, 6))
for _i in range(1, 6):
    GUESS[_i, :_i] = through(STAGE_TIMES[:_i], STAGE_TIMES[_i])
# the same through some of them, with the slope at one as the last column: (states, slope), the best found (measured)
THROUGH = {1: ((0,), 0), 2: ((0, 1), 0), 3: ((0, 1, 2), 1), 4: ((1, 3), 3), 5: ((0, 1, 2, 3, 4), 4)}
SLOPED = np.zeros((6, 7))
for _i, (_at, _k) in THROUGH.items():
    _p = np.arange(len(_at) + 1)
    _rows = np.vstack([STAGE_TIMES[list(_at), None] ** _p, _p * STAGE_TIMES[_k] ** np.maximum(_p - 1, 0)])
    SLOPED[_i, [*_at, 6]] = np.linalg.solve(_rows.T, STAGE_TIMES[_i] ** _p)


def _predicted(i: int, states: Array, slopes: Array, h: float | Array) -> Array:
    """Starting guess of x at stage i, from the states and slopes of the stages before it."""
    _, sloped = THROUGH[i]
    by_slope = SLOPED[i, 6] * h * slopes[sloped]
    return SLOPED[i, :i] @ states[:i] + by_slope


class NewtonStepper(Stepper):
    """A `Stepper` with k(T) and c_p(T), whose stages are solved by Newton's method.

    tolerance: relative error of the iterations allowed in a step.
    """

    def __init__(
        self,
        system: NonlinearEquations,
        waves: Waveform | Sequence[Waveform],
        tolerance: float,
        factors: Pencil | None = None,
    ) -> None:
        super().__init__(system.linear, waves, factors)
        self.system = system
        self.tolerance = NEWTON_SHARE * tolerance * (0.5 if system.content.laws else 1.0)
        self._weight = self.E.diagonal()
        steady = self._measure(self.steady)
        largest = max(float(steady[:-1].max()), np.finfo(float).tiny)
        # 1e-12 K, of laws at 300 K and sums over nodes: corrections below do not shrink any further
        self.least = 1e-12 / self.tolerance / largest
        self._scale = self.least * steady
        self._rate = 0.0  # of convergence, per K of the largest rise: it grows with the rise
        self.nodal = _Nodal(system.content, self.E.diagonal())
        self._both = hstack([system.content.matrix, system.flow.matrix], format="csr")
        self._near = Pencil(self.E, -self.A)
        self._neighbours = [_Neighbour(operator) for operator in (system.content, system.flow)]
        self._last: tuple[Array, Array] | None = None  # slope and dH/dt in W where the last step ended

    def start_slope(self, x: Array, t: float, h: float, stop: float) -> Array:
        """E^-1 dH/dt at the start of a smooth piece."""
        power = self.sources(t, h, stop)[0]
        return self.solve(0.0, power - self.system.flow(x))

    def rate(self, x: Array, slope: Array) -> Array:
        """dx/dt from the slope s of a step: solves H'(x) dx/dt = E s by iteration, starting node by node."""
        if not self.system.content.laws:
            return slope
        nodal = self.nodal.slope(x)
        rate = slope / nodal
        capacity = self.system.content.derivative(x)
        target = self.E @ slope
        # E-norms by its diagonal: no solve where node by node is right already; it only interpolates between steps
        weight = 1 / self._weight
        allowed = 1e-3 * np.sqrt(target**2 @ weight)
        for _ in range(ITERATIONS):
            residual = target - capacity(rate)
            if np.sqrt(residual**2 @ weight) <= allowed:
                break
            rate = rate + self.solve(0.0, residual) / nodal
        return rate

    def step(self, x: Array, slope: Array, h: float, sources: Array) -> tuple[Array, Array] | None:
        """One step as `Stepper.step`; None where a stage does not converge: the step is too long.

        Exact in dH/dt of the heat content H; slopes are E^-1 dH/dt node by node, for the error estimate.
        """
        allowed = DRIFT if self._near.ready(1.0, GAMMA * h) else SLIGHT_DRIFT
        if max(neighbour.drift(x) for neighbour in self._neighbours) > allowed:
            self._near.replace(*(neighbour.at(x) for neighbour in self._neighbours))
        slopes, states, flows = np.empty((3, 6, x.size))
        slopes[0] = slope
        states[0] = x
        continues = self._last is not None and np.array_equal(self._last[0], slope)
        flows[0] = self._last[1] if self._last and continues else self.E @ slope
        matrix = self.system.content.matrix
        extended = self.system.content.extended(x)
        shift = GAMMA * h
        nodal = self.nodal.integral(extended)
        start = matrix @ extended
        per_slope = h / self.nodal.slope(x)
        for i in range(1, 6):
            before = start + h * (STAGES[i, :i] @ flows[:i])
            guess = _predicted(i, states, slopes, per_slope)
            solution = self.stage(guess, before + shift * sources[i], shift)
            if solution is None:
                return None
            states[i] = solution
            extended = self.system.content.extended(solution)
            flows[i] = (matrix @ extended - before) / shift  # not from F: that would amplify the error of the iteration
            by_stages = h * (STAGES[i, :i] @ slopes[:i])
            slopes[i] = (self.nodal.integral(extended) - nodal - by_stages) / shift
        self._last = slopes[5], flows[5]
        self.steps += 1
        return slopes, states

    @np.errstate(over="ignore", invalid="ignore")  # a size that is not finite ends the iteration
    def stage(self, x: Array, target: Array, shift: float) -> Array | None:
        """Solve one stage, H(x) + shift F(x) = target, for the rise x in K, by iteration from the guess ``x``.

        None where the iterations do not converge.
        """
        flow = self.system.flow
        content = self.system.content
        tiny = np.finfo(float).tiny
        rate = 0.0
        last = np.inf
        for k in range(ITERATIONS):
            both = np.concatenate([content.extended(x), shift * flow.extended(x)])
            change = self._near.solve(1.0, shift, target - self._both @ both)
            self.solves += 1
            x = x + change
            if not k:
                self._scale = np.maximum(self._scale, self._measure(x))
            relative = self._measure(change) / np.maximum(self._scale, tiny)
            size = float(relative.max())
            rate = size / last if k else min(self._rate * self.rise, STALLED)
            last = size
            # a rate is judged after three iterations: a good guess makes the first ratios large
            stalls = k >= 3 and rate > STALLED
            if not np.isfinite(size) or stalls:
                return None
            remaining_error_is_small = size * rate <= self.tolerance * (1 - rate)
            rate_is_known = k or rate > 0 or size <= self.tolerance
            if remaining_error_is_small and rate_is_known:
                if k and self.rise:
                    self._rate = max(rate / self.rise, 0.9 * self._rate)
                return x
        return None

    @property
    def factorizations(self) -> int:
        """Factorizations so far."""
        return super().factorizations + self._near.factorizations

    @property
    def rise(self) -> float:
        """Largest rise of any output so far, K."""
        return float(self._scale[:-1].max())

    def _measure(self, x: Array) -> Any:
        """Absolute outputs and the norm of the field in K, shape (outputs + 1,)."""
        norm = np.sqrt(self._weight @ (x * x))
        return np.append(np.abs(self.C @ x), norm)


class _Nodal:
    """Approximation of a `NodalOperator` by one law at each node: its laws there, weighted by the matrix diagonal."""

    def __init__(self, operator: NodalOperator, diagonal: Array) -> None:
        self.operator = operator
        self.size = diagonal.size
        self.laws = []
        for _, nodes, block in operator.parts():
            weight = np.asarray(block.tocsr()[nodes, np.arange(nodes.size)]).ravel()
            self.laws.append((nodes, weight / diagonal[nodes]))

    def slope(self, x: Array) -> Array:
        """Derivative of the weighted law at each node, shape (n,)."""
        total = np.ones(self.size)
        for (at, weight), slope in zip(self.laws, self.operator.slopes(x), strict=True):
            total[at] += weight * (slope - 1)
        return total

    def integral(self, extended: Array) -> Array:
        """Integral of the weighted law from ambient at each node in K, shape (n,), from `NodalOperator.extended`."""
        ends = np.cumsum([self.size, *(at.size for at, _ in self.laws)])
        x, *laws = np.split(extended, ends[:-1])
        total = x.copy()
        for (at, weight), law in zip(self.laws, laws, strict=True):
            total[at] += weight * (law - x[at])
        return total


class _Neighbour:
    """Symmetric approximation of the Jacobian of a `NodalOperator`."""

    def __init__(self, operator: NodalOperator) -> None:
        n = operator.matrix.shape[0]
        self.operator = operator
        self.slopes = [np.ones(nodes.size) for _, nodes in operator.laws]
        self.rest = operator.matrix[:, :n]
        self.blocks = []
        for _, nodes, block in operator.parts():
            picked = at_nodes(np.ones(nodes.size), nodes, n)
            self.blocks.append((picked.T @ block[nodes] @ picked).tocoo())

    def drift(self, x: Array) -> float:
        """Largest relative change of a law's derivative since `at`; InputError for a law that is not positive."""
        new = self.operator.slopes(x, positive=True)
        ratios = [slope / before for slope, before in zip(new, self.slopes, strict=True)]
        return max([float(np.abs(ratio - 1).max()) for ratio in ratios], default=0.0)

    def at(self, x: Array) -> Any:
        """The approximation at the rise ``x``, sparse."""
        self.slopes = self.operator.slopes(x)
        total = self.rest
        for (_, nodes), block, slope in zip(self.operator.laws, self.blocks, self.slopes, strict=True):
            root = np.zeros(x.size)
            root[nodes] = np.sqrt(slope)
            weighted = block.data * root[block.row] * root[block.col]
            total = total + csr_matrix((weighted, (block.row, block.col)), shape=block.shape)
        return total
