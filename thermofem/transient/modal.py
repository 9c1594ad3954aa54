"""Linear transients under straight-line powers, in closed form on a few fields that are grown until they suffice.

    x(t) = V z(t),    dz/dt = -rate z + V^T B P(t)          V^T M V = 1,  V^T K V = diag(rate)

V is a rational Krylov space (`krylov.Space`); between the breakpoints of the waveforms P is a straight line and every z
an exponential. Nothing is stepped, so only V can be wrong. Two more rounds through the shifts bring the heated part
about thirty times, any other part and the field about five times nearer to the full-order answer (measured); what they
change therefore bounds what is missing, and the space grows until that is below the tolerance at every wanted time.
With the constant field in V the energy balance closes to round-off: it is a test function of the heat equation then.

Sources: V. Druskin, L. Knizhnerman, M. Zaslavsky, SIAM J. Sci. Comput. 31, 3760 (2009) (rational Krylov spaces for
parabolic problems); A. Ruhe, Linear Algebra Appl. 58, 391 (1984).
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..factor import Pencil
from ..model import StateSpace, pole_responses
from ..waveforms import Waveform
from .esdirk import FAR
from .integration import Ledger, Trajectory, check_run
from .krylov import Basis, Space
from .nonlinear import NonlinearLedger

Array = NDArray[np.float64]

SHIFTS = 3  # as few fields as four or five (measured on strip, heated ring, disc), and fewer factors
REACH = 120.0  # where the order was smallest for steps from 1 ns on
EARLIEST = 1.5  # the last shift over the inverse of the first wanted time
ROUNDS = 30  # before the answer is left to the integrator
FEWEST = 3


@dataclass(frozen=True, eq=False)
class Answer:
    """What one size of the space says at every wanted time: z, shape (times, k), outputs, and fields at some."""

    basis: Basis
    z: Array
    outputs: Array
    fields: Array


class Modal:
    """The space of one heated part, kept from run to run. Safe to share between threads.

    Parameters
    ----------
    system : StateSpace
        E and -A symmetric positive definite; of its outputs nothing is kept.
    factors : Pencil
        of E and -A, where the caller keeps them.
    """

    def __init__(self, system: StateSpace, factors: Pencil | None = None) -> None:
        self.system = system
        self.factors = factors or Pencil(system.E, -system.A)
        self._space: Space | None = None
        self._lock = threading.Lock()

    def run(
        self,
        C: Array,
        waves: Waveform | Sequence[Waveform],
        times: ArrayLike,
        *,
        rtol: float,
        snapshots: ArrayLike = (),
        ledger: Ledger | NonlinearLedger | None = None,
        periodic: bool = False,
    ) -> Trajectory | None:
        """Outputs C x at ``times`` and fields at ``snapshots``, from rest or in the periodic state.

        None where a power is not straight between its breakpoints, or the answer has not settled after `ROUNDS` rounds;
        other arguments and errors as of `integration.integrate`.
        """
        waves = tuple(waves) if isinstance(waves, Sequence) else (waves,)
        times, kept = check_run(times, snapshots, rtol)
        if not all(wave.piecewise_linear for wave in waves):
            return None
        wanted = np.unique(np.concatenate([[0.0], times, kept]))
        first = float(wanted[1]) if wanted.size > 1 else 1.0
        answers: list[Answer] = []
        for rounds in range(FEWEST, ROUNDS):
            space, size = self._grown(rounds, first)
            basis = space.basis(size, None if ledger is None else np.ones(self.system.order))
            if basis.rate[0] <= 0:  # a mode that grows: no heat flow
                return None
            z = sum(
                pole_responses(basis.rate, wave, wanted, periodic=periodic) * column
                for wave, column in zip(waves, basis.heating.T, strict=True)
            )
            fields = z[wanted.searchsorted(kept)] @ basis.vectors.T
            answers.append(Answer(basis, z, z @ (C @ basis.vectors).T, fields))
            if len(answers) > 2 and _settled(answers[-3], answers[-1], C, space.M, rtol):
                break
        else:
            return None
        found = answers[-1]
        heat = _balance(found, ledger, waves, float(wanted[-1])) if isinstance(ledger, Ledger) else [np.nan] * 3
        return Trajectory(
            times=times,
            outputs=found.outputs[wanted.searchsorted(times)],
            final=found.basis.vectors @ found.z[-1],
            snapshots=found.fields,
            heat_in=heat[0],
            heat_stored=heat[1],
            heat_out=heat[2],
            steps=sum(wave.breakpoints(0.0, float(wanted[-1])).size + 1 for wave in waves),
            rejected=0,
            factorizations=space.shifts.size,
            solves=size,
            method="closed form",
        )

    def _grown(self, rounds: int, first: float) -> tuple[Space, int]:
        """The space with at least ``rounds`` rounds, for times from ``first`` in s on, and its size after them."""
        with self._lock:
            fastest = EARLIEST / first
            if self._space is None or fastest > 1.01 * self._space.shifts[-1]:
                keep = self.factors.keep
                self._space = Space(self.system, SHIFTS, reach=REACH, fastest=fastest, factor=lambda s: keep(s, 1.0))
            while len(self._space.sizes) <= rounds:
                self._space.grow()
            return self._space, self._space.sizes[rounds]


def _settled(old: Answer, new: Answer, C: Array, M: Any, rtol: float) -> bool:
    """Whether the last rounds moved every output and every kept field by less than ``rtol``.

    Relative to the largest value so far, of an output at least to `esdirk.FAR` of what the field would mean there.
    """
    basis = new.basis
    size = np.maximum.accumulate(np.linalg.norm(new.z, axis=1))
    steady = basis.heating.sum(axis=1) / basis.rate
    far = FAR * np.abs(C @ (basis.vectors @ steady)) / np.linalg.norm(steady)
    scale = np.maximum(np.maximum.accumulate(np.abs(new.outputs), axis=0), np.multiply.outer(size, far))
    if np.any(np.abs(new.outputs - old.outputs) > rtol * scale):
        return False
    moved = new.fields - old.fields
    return all(x @ (M @ x) <= rtol**2 * (y @ (M @ y)) for x, y in zip(moved, new.fields, strict=True))


def _balance(found: Answer, ledger: Ledger, waves: Sequence[Waveform], end: float) -> tuple[float, float, float]:
    """Heat in J that entered, is stored, and left: the integral of x is V (V^T B int P - change of z) / rate."""
    basis, energies = found.basis, np.array([end * wave.mean(0.0, end) if end else 0.0 for wave in waves])
    change = found.z[-1] - found.z[0]
    integral = basis.vectors @ ((basis.heating @ energies - change) / basis.rate)
    gained, entered = basis.vectors @ change, float(energies.sum())
    left = ledger.direct * entered + float(ledger.drain_A @ integral + ledger.drain_E @ gained)
    return entered, ledger.content(gained), left
