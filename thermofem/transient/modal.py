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
from ..arrays import Array, ArrayLike, NDArray
from ..waveforms import Waveform
from .esdirk import FAR
from .integration import Ledger, Trajectory, check_run
from .nonlinear import NonlinearLedger

if TYPE_CHECKING:
    from ..models import StateSpace

SLOWEST, FASTEST = 30.0, 120.0  # shifts beside 0, over `krylov.rates`: the fewest fields for steps from 1 ns on
SPAN = 2.5  # decades at most between two shifts: so two do for steps from 1 ns on, with as few fields as three or four
EARLIEST = 1.5  # the last shift over the inverse of the first wanted time
FEWEST, ROUNDS = 2, 25  # rounds before the first comparison, and before the integrator takes over
OTHERS = 10.0  # weight of changes outside the heated part, where convergence is slow (measured, see the tests)
LOUDER = 10.0  # over all power before it: the response behind such a breakpoint exceeds that of the heat before it


@dataclass(frozen=True, eq=False)
class Answer:
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
        ledger: Ledger | NonlinearLedger | None = None,
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
        wanted = np.unique(np.concatenate([[0.0], times, kept]))
        shown = wanted.searchsorted(kept)
        first = _first(wave, wanted)
        answers = list[Answer]()
        last = np.inf
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
            z = pole_responses(basis.rate, wave, wanted, periodic=periodic) * basis.heating[:, 0]
            answers = [*answers[-2:], Answer(basis, z, z @ basis.read(C).T)]
            if len(answers) == 3:
                before, last = last, _change(answers[0], answers[-1], C, space, shown) / rtol
                # 1e-2 of the tolerance: below it a change counts as none, however slowly the changes fall
                if max(before, last) <= 1 and last <= max(before / 2, 1e-2):
                    break
        else:
            return None
        found = answers[-1]
        heat = _balance(found, ledger, wave, float(wanted[-1])) if isinstance(ledger, Ledger) else [np.nan] * 3
        return Trajectory(
            times=times,
            outputs=found.outputs[wanted.searchsorted(times)],
            final=found.basis.vectors @ found.z[-1],
            snapshots=found.z[shown] @ found.basis.vectors.T if shown.size else np.empty((0, self.system.order)),
            heat_in=heat[0],
            heat_stored=heat[1],
            heat_out=heat[2],
            steps=wave.breakpoints(0.0, float(wanted[-1])).size + 1,
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
                high = max(high, min(10 ** np.ceil(np.log10(EARLIEST / first)), self._cell))
            if high not in self._spaces:
                gaps = max(1, int(np.ceil(np.log10(high / low) / SPAN)))
                shifts = np.append(0.0, np.geomspace(low, high, gaps + 1))
                self._spaces[high] = Rounds(self.system, shifts, [self.factors.keep(s, 1.0) for s in shifts])
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
        return float((-self.system.A.diagonal() / self.system.E.diagonal()).max())


def _first(wave: Waveform, wanted: Array) -> float:
    """Shortest time in s to a wanted time, counted from each power that is `LOUDER` than all before it."""
    if not wanted[-1]:
        return np.inf
    lines = wave.pieces(0.0, float(wanted[-1]))
    power = np.abs([lines.coefficients[:, 0], lines.ends]).max(axis=0)
    so_far = np.append(0.0, np.maximum.accumulate(power)[:-1])
    starts = lines.edges[:-1][power > LOUDER * so_far]
    at = wanted.searchsorted(starts * (1 + 5e-13), side="right")  # round-off behind an edge is on it
    return float((np.append(wanted, np.inf)[at] - starts).min(initial=np.inf))


def _change(old: Answer, new: Answer, C: Array, space: Rounds, shown: NDArray[np.intp]) -> float:
    """Largest relative change between two solutions: of an output, or of fields at the times ``shown`` (indices).

    Relative to the largest value so far; for an output at least to `esdirk.FAR` of its value in a steady field.
    Changes of fields, and of outputs that are not heated, count `OTHERS` times.
    """
    basis, tiny = new.basis, np.finfo(float).tiny
    size = np.maximum.accumulate(np.linalg.norm(new.z, axis=1))
    steady = basis.heating.sum(axis=1) / basis.rate
    far = FAR * np.abs(basis.read(C) @ steady) / np.linalg.norm(steady)
    scale = np.maximum(np.maximum.accumulate(np.abs(new.outputs), axis=0), np.multiply.outer(size, far))
    changes = (np.abs(new.outputs - old.outputs) / np.maximum(scale, tiny)).max(axis=0)
    weights = [1.0 if any(np.array_equal(row, b) for b in space.B.T) else OTHERS for row in C]
    moved = list(weights * changes)
    if shown.size:  # the new space contains the old one, so the fields are those of z
        z, was = new.z[shown], old.z[shown] @ (old.basis.vectors.T @ (space.M @ basis.vectors))
        moved.append(OTHERS * (np.linalg.norm(z - was, axis=1) / np.maximum(np.linalg.norm(z, axis=1), tiny)).max())
    return float(max(moved))


def _balance(found: Answer, ledger: Ledger, wave: Waveform, end: float) -> tuple[float, float, float]:
    """Heat in J that entered, that is stored and that left.

    The integral of x over time is V (V^T B int P dt - change of z)/rate.
    """
    basis, change = found.basis, found.z[-1] - found.z[0]
    entered = end * float(wave.mean(0.0, end)) if end else 0.0
    integral = basis.vectors @ ((basis.heating[:, 0] * entered - change) / basis.rate)
    gained = basis.vectors @ change
    left = ledger.direct * entered + float(ledger.drain_A @ integral + ledger.drain_E @ gained)
    return entered, ledger.content(gained), left
