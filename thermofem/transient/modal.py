"""Linear transients under piecewise-linear powers, in closed form on a Krylov basis that grows until it converges.

    x(t) = V z(t),    dz/dt = -rate z + V^T B P(t)          V^T M V = 1,  V^T K V = diag(rate)

V is a rational Krylov basis (`krylov.Rounds`). Between the breakpoints of the waveforms P is a straight line and every
z a sum of exponentials. There is no time step, so the basis is the only source of error. Two more rounds through the
shifts reduce the error of the heated part about thirty times, and that of other parts and of the field about five times
(measured). As long as successive changes fall they overestimate the remaining error. Growth stops after two consecutive
changes below the tolerance at every wanted time, the second below half of the first; a single small change may be an
error that changes its sign. The constant field is in V, so the energy balance closes to round-off.

Sources: V. Druskin, L. Knizhnerman, M. Zaslavsky, SIAM J. Sci. Comput. 31, 3760 (2009) (rational Krylov spaces for
parabolic problems); A. Ruhe, Linear Algebra Appl. 58, 391 (1984).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..algebra.factor import Pencil
from ..algebra.krylov import Basis, Rounds, rates
from ..algebra.pole_responses import pole_responses
from ..arrays import Array, ArrayLike, Indices
from ..waveforms import Waveform
from .esdirk import FAR
from .integration import Trajectory, check_run
from .nonlinear import Ledger

if TYPE_CHECKING:
    from ..models import StateSpace

SLOWEST, FASTEST = 30.0, 120.0  # shifts beside 0, over `krylov.rates`: the fewest fields for steps from 1 ns on
EARLIEST = 1.5  # the last shift over the inverse of the first wanted time
FEWEST, ROUNDS = 2, 25  # rounds before the first comparison, and before the integrator takes over
OTHERS = 10.0  # weight of changes outside the heated part, where convergence is slow (measured, see the tests)
LOUDER = 10.0  # over all power before it: the response behind such a breakpoint exceeds that of the heat before it


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution on one Krylov basis at every wanted time: z, shape (times, k), and outputs, shape (times, outputs)."""

    basis: Basis
    z: Array
    outputs: Array


class Modal:
    """Closed-form transients of one heated part; its Krylov spaces are kept for further runs, safely between threads.

    system: E and -A symmetric positive definite; its outputs are not used.
    factors: factorizations of E and -A that the caller keeps; None makes them.
    """

    def __init__(self, system: StateSpace, factors: Pencil | None = None) -> None:
        self.system = system
        self.factors = factors or Pencil(system.E, -system.A)
        self._spaces: dict[float, Rounds] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the matrices: factors cannot be sent to another process, which makes the spaces again."""
        return Modal, (self.system, self.factors)

    def run(
        self,
        C: Array,
        wave: Waveform,
        times: ArrayLike,
        *,
        rtol: float,
        snapshots: ArrayLike = (),
        ledger: Ledger | None = None,
        periodic: bool = False,
    ) -> Trajectory | None:
        """Outputs C x and fields, from rest or in the periodic state.

        C [shape (outputs, n)]
        wave: power of the input, W.
        times, snapshots [s]: increasing, not negative; of one period where ``periodic``.
        rtol: as of `integration.integrate`.
        Returns: None where a power is not straight between its breakpoints, E or -A is not symmetric positive definite,
            the space cannot grow, or the solution has not converged after `ROUNDS` rounds.
        Raises InputError: times not increasing or negative, rtol out of range.
        """
        times, kept = check_run(times, snapshots, rtol)
        if not wave.piecewise_linear:
            return None
        every = np.unique(np.concatenate([[0.0], times, kept]))
        stop = float(every[-1])
        shown = every.searchsorted(kept)
        first = _first(wave, every)
        solutions = list[Solution]()
        change = np.inf
        size = 0
        for rounds in range(FEWEST, ROUNDS):
            smaller = size
            try:
                space, size = self._grown(rounds, first)
            except checks.InputError:  # E or -A is not definite
                return None
            if smaller == size < self.system.order:
                return None  # the space cannot grow, so convergence cannot be checked
            basis = space.basis(size, constant=ledger is not None)
            if basis.rate[0] <= 0:  # a growing mode: -A is not positive definite
                return None
            z = pole_responses(basis.rate, wave, every, periodic=periodic) * basis.heating[:, 0]
            solution = Solution(basis, z, z @ basis.read(C).T)
            solutions = [*solutions[-2:], solution]
            if len(solutions) == 3:
                before = change
                change = _change(solutions[0], solution, C, space, shown) / rtol
                # below 1e-2 of the tolerance a change counts as none, however slowly the changes fall
                if max(before, change) <= 1 and change <= max(before / 2, 1e-2):
                    break
        else:
            return None
        V = basis.vectors
        snapshots = solution.z[shown] @ V.T if shown.size else np.empty((0, self.system.order))
        heat = _balance(solution, ledger, wave, stop) if ledger else [np.nan] * 3
        return Trajectory(
            times=times,
            outputs=solution.outputs[every.searchsorted(times)],
            final=V @ solution.z[-1],
            snapshots=snapshots,
            heat_in=heat[0],
            heat_stored=heat[1],
            heat_out=heat[2],
            steps=wave.breakpoints(0.0, stop).size + 1,
            rejected=0,
            factorizations=space.shifts.size,
            solves=size,
            method="closed form",
        )

    def _grown(self, rounds: int, first: float) -> tuple[Rounds, int]:
        """Krylov space for times from ``first`` s on with at least ``rounds`` rounds, and its size after them."""
        with self._lock:
            slow, fast = self._rates
            low = SLOWEST * slow
            high = FASTEST * fast
            if EARLIEST / first > high:  # rounded up to a decade and limited by the fastest rate of the mesh
                decade = 10 ** np.ceil(np.log10(EARLIEST / first))
                high = max(high, min(decade, self._cell))
            if high not in self._spaces:
                # at most 2.5 decades apart: two then do for steps from 1 ns on, with as few fields as three or four
                gaps = max(1, int(np.ceil(np.log10(high / low) / 2.5)))
                shifts = np.append(0.0, np.geomspace(low, high, gaps + 1))
                solvers = [self.factors.keep(shift, 1.0) for shift in shifts]
                self._spaces[high] = Rounds(self.system, shifts, solvers)
            space = self._spaces[high]
            while len(space.sizes) <= rounds:
                space.grow()
            return space, space.sizes[rounds]

    @cached_property
    def _rates(self) -> tuple[float, float]:
        """Slowest and fastest rate in 1/s, as of `krylov.rates`."""
        return rates(self.system, self.factors.keep(0.0, 1.0))

    @cached_property
    def _cell(self) -> float:
        """Approximate rate in 1/s of the fastest cell of the mesh."""
        fastest = (-self.system.A.diagonal() / self.system.E.diagonal()).max()
        return float(fastest)


def _first(wave: Waveform, times: Array) -> float:
    """Shortest time in s to one of ``times``, counted from each power that is `LOUDER` than all before it."""
    if not times[-1]:
        return np.inf
    lines = wave.pieces(0.0, float(times[-1]))
    power = np.abs([lines.coefficients[:, 0], lines.ends]).max(axis=0)
    so_far = np.append(0.0, np.maximum.accumulate(power)[:-1])
    starts = lines.edges[:-1][power > LOUDER * so_far]
    rows = times.searchsorted(starts * (1 + 5e-13), side="right")  # round-off behind an edge is on it
    after = np.append(times, np.inf)[rows]
    return float((after - starts).min(initial=np.inf))


def _change(old: Solution, new: Solution, C: Array, space: Rounds, shown: Indices) -> float:
    """Largest relative change between two solutions: of an output, or of fields at the times ``shown`` (indices).

    Relative to the largest value so far; for an output at least to `esdirk.FAR` of its value in a steady field.
    Changes of fields, and of outputs that are not heated, count `OTHERS` times.
    """
    basis = new.basis
    tiny = np.finfo(float).tiny
    size = np.maximum.accumulate(np.linalg.norm(new.z, axis=1))
    steady = basis.heating.sum(axis=1) / basis.rate
    far = FAR * np.abs(basis.read(C) @ steady) / np.linalg.norm(steady)
    largest = np.maximum.accumulate(np.abs(new.outputs), axis=0)
    scale = np.maximum(largest, np.multiply.outer(size, far))
    relative = np.abs(new.outputs - old.outputs) / np.maximum(scale, tiny)
    weights = [1.0 if _is_heated(row, space) else OTHERS for row in C]
    changes = list(weights * relative.max(axis=0))
    if shown.size:  # the new space contains the old one, so the fields are those of z
        z = new.z[shown]
        between_bases = old.basis.vectors.T @ (space.M @ basis.vectors)
        moved = np.linalg.norm(z - old.z[shown] @ between_bases, axis=1)
        field_change = moved / np.maximum(np.linalg.norm(z, axis=1), tiny)
        changes.append(OTHERS * field_change.max())
    return float(max(changes))


def _is_heated(row: Array, space: Rounds) -> bool:
    """Whether an output is the mean of a part that is heated."""
    return any(np.array_equal(row, column) for column in space.B.T)


def _balance(solution: Solution, ledger: Ledger, wave: Waveform, end: float) -> tuple[float, float, float]:
    """Heat in J that entered, that is stored and that left.

    The integral of x over time is V (V^T B int P dt - change of z)/rate.
    """
    basis = solution.basis
    change = solution.z[-1] - solution.z[0]
    entered = end * float(wave.mean(0.0, end)) if end else 0.0
    decayed = basis.heating[:, 0] * entered - change
    integral = basis.vectors @ (decayed / basis.rate)
    gained = basis.vectors @ change
    drained = ledger.drain(integral) - ledger.held(gained)
    left = ledger.direct * entered + float(drained[0])
    return entered, ledger.content(gained), left
