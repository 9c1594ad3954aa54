"""Windowed integration of the full-order field whose cost does not depend on fast spikes of the power.

The field is x = V z + r. The amplitudes z of a few fields V (`krylov`) follow the power in closed form, including
its spikes. The remainder r obeys

    d/dt [E r + H(x) - E x] = (B - E V V^T B) P - D z - K r - [F(x) - K x],    D = K V - E V diag(rate)

which is the full-order problem. Because r is small and smooth, a tolerance in kelvin allows long steps (ESDIRK, as in
`thermofem.transient`). The method is exact for any V, even an empty one; V only changes the work. F and H are those of
`nonlinear`; without temperature dependence they are K x and E x.

Within a step the power enters r through its best cubic approximation P_3, which preserves the energy. The difference
P - P_3 changes the output by at most about max|P - P_3| |H - H_V|(1/(gamma h)), the part of the impedance that V does
not contain, at the time scales of the step and below. This error, the embedded error estimate and the error of the
interpolation at the third stage are each kept below a fixed share of the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..algebra.factor import Pencil
from ..algebra.krylov import Basis
from ..algebra.system import LinearSystem
from ..waveforms import Constant, Waveform
from .esdirk import EMBEDDED, GAMMA, STAGE_TIMES, STAGES, WEIGHTS, Stepper
from .fast_part import FastPart, Piece
from .integration import between, hermite
from .newton_stages import GUESS, NewtonStepper
from .nonlinear import NonlinearEquations, NonlinearLedger
from .trajectory import Ledger

Array = NDArray[np.float64]

SHARE = 0.2  # of the tolerance, for each of the three errors of a step
SLOWER = 1 / 8  # with k(T) the error of the interpolation falls with less than the fourth power of a step (measured)
FINEST = 20  # rungs of 4 below a window before it is given up
FINER = 4.0 ** -np.arange(4)  # scales below a step at which what the basis leaves of the impedance is looked at


@dataclass(frozen=True, eq=False)
class FieldState:
    """A field at one time: x = V z + r, and what the next step needs.

    Attributes
    ----------
    time : float, s
    z, r : array, shape (k,) and (n,)
    slope : array, shape (n,)
        E^-1 times the time derivative in the equation of the module, at the end of the last step.
    source : array, shape (inputs + k,)
        the P and z that this slope was computed with.
    step : float, s
        length of the last step; 0 before the first.
    heat_in, heat_out : float, J
        since the start.
    """

    time: float
    z: Array
    r: Array
    slope: Array
    source: Array
    step: float = 0.0
    heat_in: float = 0.0
    heat_out: float = 0.0


class FieldIntegrator:
    """The full-order field of a heat problem, advanced window by window from any `FieldState`.

    Parameters
    ----------
    system : LinearSystem or NonlinearEquations
    basis : Basis
        from `krylov.krylov`; it decides the work and nothing else.
    tolerance : float, K
        for every output.
    ledger : Ledger or NonlinearLedger, optional
        closes the energy balance.
    direct : sequence of float, one for each input
        share of its power that enters at held unknowns.
    factors : Pencil, optional
        those of E and -A where the caller keeps them.
    """

    def __init__(
        self,
        system: LinearSystem | NonlinearEquations,
        basis: Basis,
        *,
        tolerance: float,
        ledger: Ledger | NonlinearLedger | None = None,
        direct: Sequence[float] = (),
        factors: Pencil | None = None,
    ) -> None:
        self.tolerance, self.basis, self.ledger = tolerance, basis, ledger
        linear = system.linear if isinstance(system, NonlinearEquations) else system
        self.linear, quiet = linear, [Constant(0.0)] * len(linear.inputs)
        self.newton = None
        if isinstance(system, NonlinearEquations):
            self.newton = NewtonStepper(system, quiet, tolerance, factors)
        self.stepper = s = self.newton or Stepper(linear, quiet, factors)
        V = basis.vectors
        self.KV = -(s.A @ V)
        self.drive = np.column_stack([s.B - s.E @ (V @ basis.heating), (s.E @ V) * basis.rate - self.KV])
        self.jump = np.column_stack([s.solve(0.0, column) for column in self.drive.T])
        fields = np.column_stack([s.factors.solve(0.0, 1.0, b) for b in linear.B.T])
        self.per_kelvin = max(map(s.norm, fields.T)) / np.abs(linear.C @ fields).max()
        self.direct = np.array(direct) if len(direct) else np.zeros(len(linear.inputs))
        self.unit = 0.0  # the first window: every step is this over a power of four, as far as the windows allow
        self._missed: dict[float, float] = {}

    def start(self, time: float = 0.0) -> FieldState:
        """The field at ambient temperature."""
        n, inputs = self.drive.shape[0], len(self.linear.inputs)
        k = self.drive.shape[1] - inputs
        return FieldState(time, np.zeros(k), np.zeros(n), np.zeros(n), np.zeros(inputs + k))

    def begin(self, x: Array, time: float = 0.0) -> FieldState:
        """The field with the rise x in K, shape (n,)."""
        V, s = self.basis.vectors, self.stepper
        z = V.T @ (s.E @ x)
        r, source = x - V @ z, np.concatenate([np.zeros(len(self.linear.inputs)), z])
        right = self.drive @ source + s.A @ r
        if self.newton is not None:
            right = right - self.newton.system.flow(x) - s.A @ x
        return FieldState(time, z, r, s.solve(0.0, right), source)

    def temperature(self, state: FieldState) -> Array:
        """Rise x in K, shape (n,)."""
        return np.asarray(self.basis.vectors @ state.z + state.r)

    def stored(self, state: FieldState) -> float:
        """Heat in the field in J; nan without a ledger."""
        return self.ledger.content(self.temperature(state)) if self.ledger else np.nan

    def advance(
        self, state: FieldState, waves: Sequence[Waveform], times: ArrayLike, *, keep: ArrayLike = ()
    ) -> tuple[Array, FieldState, Array]:
        """Advance from ``state`` to the last of ``times``.

        Parameters
        ----------
        state : FieldState
            at ``times[0]``; it stays as it is.
        waves : one Waveform for each input
        times : array, s
            where the outputs are read, increasing.
        keep : array, s
            where the whole field is kept, increasing, within the window.

        Returns
        -------
        outputs : array, shape (times, outputs), K
        state : FieldState
            at the end.
        fields : array, shape (keep, n), K

        Raises
        ------
        InputError
            times that do not start at the state's, or steps that shrink without end.
        """
        times, keep = checks.array("times", times, increasing=True), np.asarray(keep, dtype=float)
        window = float(times[-1]) - state.time
        if window <= 0 or abs(times[0] - state.time) > 1e-9 * window:
            raise checks.InputError(f"times run from {times[0]:g} to {times[-1]:g} s, the field is at {state.time:g} s")
        self.unit = self.unit or window
        fast = FastPart(self.basis, state.time, state.z, waves, times)
        C = self.linear.C
        outputs, fields = fast.z(times) @ (C @ self.basis.vectors).T, fast.z(keep) @ self.basis.vectors.T
        outputs[0] += C @ state.r
        fields[keep <= state.time] += state.r
        begin, done, count = state.time, 0, self._steps(window, state.step)
        while done < count:
            h = window / count
            t = begin + done * h
            step = self._step(fast, state, t, h)
            if step is None:
                if count > 4**FINEST:
                    raise checks.InputError(
                        f"the step at t = {t:g} s shrinks without end; is tolerance = {self.tolerance:g} K too small?"
                    )
                self.stepper.rejected += 1
                done, count = 4 * done, 4 * count
                continue
            state, error, ends = step
            read, kept = between(times, t, t + h), between(keep, t, t + h)
            outputs[read] += hermite((times[read] - t) / h, *(C @ v for v in ends))
            fields[kept] += hermite((keep[kept] - t) / h, *ends)
            done += 1
            if error * 4**4 < 1 and done % 4 == 0 and count % 4 == 0:
                done, count = done // 4, count // 4
        return outputs, state, fields

    def _steps(self, window: float, last: float) -> int:
        """Number of steps to begin a window with: each on the ladder of the first window, none longer than the last."""
        octaves = np.log2(self.unit / window)
        count = 2 if round(octaves) % 2 and abs(octaves - round(octaves)) < 1e-6 else 1
        while last and window / count > 1.001 * last:
            count *= 4
        return count

    def _step(
        self, fast: FastPart, state: FieldState, t: float, h: float
    ) -> tuple[FieldState, float, tuple[Array, ...]] | None:
        """One step: the new state, its error in units of what is allowed, and r and h dr/dt at both ends."""
        piece = fast.piece(t, h)
        missed = float(piece.leftover @ self.missed(h)) / (SHARE * self.tolerance)
        if missed > 1:
            return None
        slopes, rests = np.empty((6, state.r.size)), np.empty((6, state.r.size))
        slopes[0], rests[0] = state.slope + self.jump @ (piece.stages[0] - state.source), state.r
        z = fast.z(t + h * STAGE_TIMES)
        z[4] = piece.stages[4, piece.energy.size :]  # the fifth stage lies beyond the step
        if self.newton is None:
            self._linear(piece, h, slopes, rests)
        elif not self._nonlinear(self.newton, piece, z, h, slopes, rests):
            return None
        self.stepper.steps += 1
        ends = (rests[0], rests[-1], *(h * self._rate(piece, z[k], rests[k], slopes[k], k) for k in (0, -1)))
        step, inside = self._errors(h * ((WEIGHTS - EMBEDDED) @ slopes), rests[3] - hermite(STAGE_TIMES[[3]], *ends)[0])
        if not max(missed, step, inside) <= 1:
            return None
        error = max(missed, step, inside * (1.0 if self.newton is None else SLOWER))
        V, out = self.basis.vectors, float(self.direct @ piece.energy)
        if self.newton is not None and self.ledger:
            out += self.ledger.outflow(h, WEIGHTS, z @ V.T + rests, slopes)
        elif isinstance(self.ledger, Ledger):
            out += self.ledger.outflow(h, WEIGHTS, rests, slopes)
            out += float(self.ledger.drain_A @ (V @ (h * (WEIGHTS @ piece.stages[:, piece.energy.size :]))))
            out += float(self.ledger.drain_E @ (V @ (z[-1] - z[0])))
        new = FieldState(
            t + h, z[-1], rests[-1], slopes[-1], piece.stages[-1], h,
            state.heat_in + float(piece.energy.sum()), state.heat_out + out,
        )  # fmt: skip
        return new, error, ends

    def _linear(self, piece: Piece, h: float, slopes: Array, rests: Array) -> None:
        """Stages E s = drive [P, z] - K r."""
        s = self.stepper
        for i in range(1, 6):
            known = rests[0] + h * (STAGES[i, :i] @ slopes[:i])
            slopes[i] = s.solve(GAMMA * h, s.A @ known + self.drive @ piece.stages[i])
            rests[i] = known + GAMMA * h * slopes[i]

    def _nonlinear(self, s: NewtonStepper, piece: Piece, z: Array, h: float, slopes: Array, rests: Array) -> bool:
        """Stages with k(T) and c_p(T), in the unknown x = V z + r; False where one does not converge."""
        V, shift = self.basis.vectors, GAMMA * h
        fields = z @ V.T
        s.tolerance = 0.02 * SHARE * self.tolerance / max(s.rise, self.tolerance)
        extra = s.extra(fields[0] + rests[0])
        for i in range(1, 6):
            known = rests[0] + h * (STAGES[i, :i] @ slopes[:i])
            source = shift * (self.drive @ piece.stages[i] + self.KV @ z[i]) + extra
            x = s.stage(fields[i] + GUESS[i, :i] @ rests[:i], known + fields[i], source, shift)
            if x is None:
                return False
            rests[i] = x - fields[i]
            slopes[i] = (rests[i] - known) / shift
            if s.system.content.laws:
                slopes[i] += s.solve(0.0, s.extra(x) - extra) / shift
        return True

    def _rate(self, piece: Piece, z: Array, r: Array, slope: Array, end: int) -> Array:
        """dr/dt at one end of a step: E^-1 d/dt H(x) is slope + V dz/dt, and r is what V leaves of x."""
        if self.newton is None or not self.newton.system.content.laws:
            return slope
        power = piece.stages[end, : piece.energy.size]
        moving = self.basis.vectors @ (self.basis.heating @ power - self.basis.rate * z)
        return self.newton.rate(self.basis.vectors @ z + r, slope + moving) - moving

    def _errors(self, estimate: Array, inside: Array) -> tuple[float, float]:
        """Errors of a step in units of what is allowed: of outputs and field at its end, and of outputs inside."""
        C, allowed = self.linear.C, SHARE * self.tolerance
        worst = max(np.abs(C @ estimate).max(), self.stepper.norm(estimate) / self.per_kelvin)
        return float(worst) / allowed, float(np.abs(C @ inside).max()) / allowed

    def missed(self, h: float) -> Array:
        """|H - H_V| of the worst output by each input at the scale of a step and below, K/W, shape (inputs,)."""
        for step in GAMMA * h * FINER:
            key = float(f"{step:.8e}")
            if key not in self._missed:
                s, C = self.stepper, self.linear.C
                full = C @ np.column_stack([s.solve(step, step * b) for b in s.B.T])
                kept = (C @ self.basis.vectors) @ (step * self.basis.heating / (1 + step * self.basis.rate[:, None]))
                self._missed[key] = np.abs(full - kept).max(axis=0)
        return np.max([self._missed[float(f"{step:.8e}")] for step in GAMMA * h * FINER], axis=0)
