"""Windowed integration of the full-order field whose cost does not depend on fast spikes of the power.

The field is x = V z + r. The amplitudes z of a few fields V (`krylov`) follow the power in closed form, including
its spikes. The remainder r obeys

    d/dt [E r + H(x) - E x] = (B - E V V^T B) P - D z - K r - [F(x) - K x],    D = K V - E V diag(rate)

which is the full-order problem. Because r is small and smooth, a tolerance in kelvin allows long steps (ESDIRK, as in
`thermofem.transient`). The method is exact for any V, even an empty one; V only changes the work. F and H are those of
`nonlinear`; without temperature dependence they are K x and E x.

With k(T) and c_p(T) the amplitudes obey d(z + e)/dt = -rate z - f + heating P with f(z) and e(z) of `Curvature`, so
that r holds only what these leave, and

    d/dt [H(x) - E V (z + e)] = (B - E V V^T B) P - D z + K V z + E V f - F(x).

Within a step the power enters r through its best cubic approximation P_3, which preserves the energy, and so does what
is quadratic in z. The difference P - P_3 changes the output by at most about max|P - P_3| |H - H_V|(1/(gamma h)), the
part of the impedance that V does not contain, at the time scales of the step and below. This error, the embedded error
estimate and the distance of the interpolation from two further stages are each kept below a share of the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..algebra.factor import Pencil
from ..algebra.krylov import Basis
from ..arrays import Array, ArrayLike
from ..waveforms import Waveform
from .esdirk import GAMMA, STAGE_TIMES, WEIGHTS, Stepper
from .fast_part import Advanced, FastPart, FieldState, Inside
from .integration import between
from .nonlinear import Ledger, NonlinearEquations
from .remainders import ERROR_SHARE, SETTLED_SHARE, LinearRemainder, NonlinearRemainder

if TYPE_CHECKING:
    from ..models import StateSpace

LOOKED_AT = [1, 2]  # stages that the cubic of `Inside` is compared with
FINER = 4.0 ** -np.arange(4)  # scales below a step at which what the basis leaves of the impedance is looked at


class FieldIntegrator:
    """Advances the full-order field of a heat problem, one window of time after another.

    basis: from `krylov.krylov`; it decides the work and nothing else.
    tolerance [K]: for every output.
    ledger: closes the energy balance.
    direct [one for each input]: fraction of its power that enters at held unknowns.
    factors: factorizations of E and -A that the caller keeps; None makes them.
    """

    def __init__(
        self,
        system: StateSpace | NonlinearEquations,
        basis: Basis,
        *,
        tolerance: float,
        ledger: Ledger | None = None,
        direct: Sequence[float] = (),
        factors: Pencil | None = None,
    ) -> None:
        self.tolerance = tolerance
        self.basis = basis
        self.ledger = ledger
        self.equations: LinearRemainder | NonlinearRemainder
        if isinstance(system, NonlinearEquations):
            self.linear = system.linear
            self.equations = NonlinearRemainder(system, basis, tolerance, factors)
        else:
            self.linear = system
            self.equations = LinearRemainder(system, basis, factors)
        self.stepper: Stepper = self.equations.stepper
        self.direct = np.array(direct) if len(direct) else np.zeros(len(self.linear.inputs))
        self.unit = 0.0  # the first window: every step is this over a power of four, as far as the windows allow
        self._missed: dict[float, Array] = {}
        self._passed: Advanced  # the last window

    def start(self) -> FieldState:
        """The field at ambient temperature, at t = 0."""
        return self.begin(np.zeros(self.linear.order))

    def begin(self, x: Array) -> FieldState:
        """The field with the rise x in K, shape (n,), at t = 0."""
        V = self.basis.vectors
        z = V.T @ (self.stepper.E @ x)
        r = x - V @ z
        no_power = np.zeros(len(self.linear.inputs))
        source = np.concatenate([no_power, z])
        return FieldState(0.0, z, r, self.equations.begin(x, z, r, source), source)

    def temperature(self, state: FieldState) -> Array:
        """Rise x in K, shape (n,)."""
        return self.basis.vectors @ state.z + state.r

    def stored(self, state: FieldState) -> float:
        """Heat in the field in J; nan without a ledger."""
        return self.ledger.content(self.temperature(state)) if self.ledger else np.nan

    def advance(
        self, state: FieldState, waves: Sequence[Waveform], times: ArrayLike, *, keep: ArrayLike = ()
    ) -> tuple[Array, FieldState, Array]:
        """Advance from ``state`` to the last of ``times``.

        state: at ``times[0]``; not changed.
        waves [one Waveform for each input]
        times [s]: where the outputs are read, increasing.
        keep [s]: where the whole field is kept, increasing, within the window.
        Returns outputs [shape (times, outputs), K]
        Returns state: at the end.
        Returns fields [shape (keep, n), K]
        Raises InputError: times that do not start at the state's, or steps that shrink without end.
        """
        times = checks.array("times", times, increasing=True)
        keep = np.asarray(keep, dtype=float)
        window = float(times[-1]) - state.time
        if window <= 0 or abs(times[0] - state.time) > 1e-9 * window:
            raise checks.InputError(f"times run from {times[0]:g} to {times[-1]:g} s, the field is at {state.time:g} s")
        self.unit = self.unit or window
        first = state
        taken = []
        fast = self._fast(state, waves, times)
        fields = fast.z(keep) @ self.basis.vectors.T
        fields[keep <= state.time] += state.r
        begin = state.time
        done = 0
        count = self._steps(window, state.step)
        while done < count:
            h = window / count
            t = begin + done * h
            step = self._step(fast, state, t, h)
            if step is None:
                if count > 4**20:  # 20 levels of 4 below a window before it is given up
                    raise checks.InputError(
                        f"the step at t = {t:g} s shrinks without end; is tolerance = {self.tolerance:g} K too small?"
                    )
                self.stepper.rejected += 1
                done = 4 * done
                count = 4 * count
                continue
            state, error, inside, whole = step
            taken.append((t, h, inside))
            kept = between(keep, t, t + h)
            if kept.size:
                fields[kept] += whole((keep[kept] - t) / h)
            done += 1
            if error * 4**4 < 1 and done % 4 == 0 and count % 4 == 0:
                done = done // 4
                count = count // 4
        self._passed = Advanced(first, fast, taken, state, fields)
        return self._outputs(fast, times), state, fields

    def _outputs(self, fast: FastPart, times: Array) -> Array:
        """Outputs in K over the last window, with the amplitudes ``fast``, shape (times, outputs)."""
        C = self.linear.C
        outputs = fast.z(times) @ (C @ self.basis.vectors).T
        outputs[0] += C @ self._passed.begin.r
        for t, h, inside in self._passed.steps:
            read = between(times, t, t + h)
            outputs[read] += inside((times[read] - t) / h)
        return outputs

    def revised(
        self, waves: Sequence[Waveform], times: ArrayLike, *, keep: ArrayLike = ()
    ) -> tuple[Array, FieldState, Array]:
        """Solve the last window again for slightly different powers: new amplitudes z, but the same remainder r.

        The error is |H - H_V| times the change of the power, that is the part of the change that V leaves to r
        (`remainder`). Parameters and result are those of `advance`, without the state.
        """
        first, old, _, end, fields = self._passed
        times = np.asarray(times, dtype=float)
        keep = np.asarray(keep, dtype=float)
        length = end.time - first.time
        new = self._fast(first, waves, times)
        gained = new.energy() - old.energy()
        z, r, slope = self.equations.revised(end, new, old, gained, length)
        heat_out = end.heat_out + float(self.direct @ gained)
        if self.ledger:
            drained = self._drained(self.ledger, new, length, end.r)
            heat_out += drained - self._drained(self.ledger, old, length, end.r)
        heat_in = end.heat_in + float(gained.sum())
        state = replace(end, z=z, r=r, slope=slope, heat_in=heat_in, heat_out=heat_out)
        change = (new.z(keep) - old.z(keep)) @ self.basis.vectors.T
        return self._outputs(new, times), state, fields + change

    @property
    def remainder(self) -> float:
        """Largest change of an output through the remainder r within the last window of `advance`, K."""
        begin = self.linear.C @ self._passed.begin.r
        changes = [inside(STAGE_TIMES) - begin for _, _, inside in self._passed.steps]
        return max(float(np.abs(change).max()) for change in changes)

    def _fast(self, state: FieldState, waves: Sequence[Waveform], times: Array) -> FastPart:
        """Amplitudes z in the window that begins at ``state``."""
        reach = np.abs(self.linear.C @ self.basis.vectors).max(axis=0, initial=np.finfo(float).tiny)
        allowed = SETTLED_SHARE * self.tolerance / (reach * max(reach.size, 1))
        return FastPart(self.basis, state.time, state.z, waves, times, self.equations.curved, allowed)

    def _drained(self, ledger: Ledger, fast: FastPart, length: float, r: Array) -> float:
        """Heat in J that leaves in a window of this length, from the mean field and its change."""
        amplitudes = np.stack([fast.values[0], fast.mean(), fast.values[-1]])
        fields = amplitudes @ self.basis.vectors.T + r
        only_mean = np.array([0.0, 1.0, 0.0])
        return ledger.outflow(length, only_mean, fields)

    def _steps(self, window: float, last: float) -> int:
        """Initial number of steps of a window; a step is the first window over a power of four, at most ``last``."""
        octaves = np.log2(self.unit / window)
        whole = round(octaves)
        count = 2 if whole % 2 and abs(octaves - whole) < 1e-6 else 1
        while last and window / count > 1.001 * last:
            count *= 4
        return count

    def _step(
        self, fast: FastPart, state: FieldState, t: float, h: float
    ) -> tuple[FieldState, float, Inside, Inside] | None:
        """Take one step; returns the new state, the error over the tolerance, and outputs and r inside the step."""
        piece = fast.piece(t, h)
        allowed = ERROR_SHARE * self.tolerance
        missed = float(piece.leftover @ self.missed(h)) / allowed
        if missed > 1:
            return None
        step = self.equations.step(fast, piece, state, t, h)
        if step is None:
            return None
        C = self.linear.C
        whole = Inside(step.states[0], step.states[3], step.states[5], h * step.end_rate)
        inside = Inside(*(C @ values for values in whole))
        apart = step.states[LOOKED_AT] @ C.T - inside(STAGE_TIMES[LOOKED_AT])
        end_error, inside_error = self._errors(step.estimate, apart)
        largest = max(missed, end_error, inside_error)
        if not largest <= 1:
            return None
        error = max(missed, end_error, inside_error * self.equations.inside_share)
        z = fast.z(np.array([t, t + h]))
        heat_out = state.heat_out + float(self.direct @ piece.energy)
        if self.ledger:
            fields = step.amplitudes @ self.basis.vectors.T + step.states
            heat_out += self.ledger.outflow(h, WEIGHTS, fields)
        heat_in = state.heat_in + float(piece.energy.sum())
        new = FieldState(
            t + h, z[1], step.states[-1], step.slopes[-1], piece.stages[-1], h, heat_in, heat_out, step.correction
        )  # fmt: skip
        return new, error, inside, whole

    def _errors(self, estimate: Array, inside: Array) -> tuple[float, float]:
        """Errors of a step relative to the tolerance: of outputs and field at its end, and of outputs inside it."""
        allowed = ERROR_SHARE * self.tolerance
        outputs = np.abs(self.linear.C @ estimate).max()
        field = self.stepper.norm(estimate) / self.equations.per_kelvin
        end_error = float(max(outputs, field))
        inside_error = float(np.abs(inside).max())
        return end_error / allowed, inside_error / allowed

    def missed(self, h: float) -> Array:
        """|H - H_V| of the worst output for each input, at time scales up to a step h; K/W, shape (inputs,)."""
        steps = [float(f"{step:.8e}") for step in GAMMA * h * FINER]
        for step in steps:
            if step not in self._missed:
                self._missed[step] = self._impedance_left(step)
        return np.max([self._missed[step] for step in steps], axis=0)

    def _impedance_left(self, shift: float) -> Array:
        """|H - H_V| at 1/``shift`` of the worst output for each input, K/W, shape (inputs,)."""
        s = self.stepper
        C = self.linear.C
        full = C @ np.column_stack([s.solve(shift, shift * b) for b in s.B.T])
        decay = 1 + shift * self.basis.rate[:, None]
        in_basis = (C @ self.basis.vectors) @ (shift * self.basis.heating / decay)
        return np.abs(full - in_basis).max(axis=0)
