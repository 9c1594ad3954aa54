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

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..algebra.factor import Pencil
from ..algebra.krylov import Basis
from ..arrays import Array, ArrayLike
from ..waveforms import Constant, Waveform
from .esdirk import EMBEDDED, GAMMA, STAGE_TIMES, STAGES, WEIGHTS, Stepper
from .fast_part import Advanced, FastPart, FieldState, Inside, Piece
from .integration import Ledger, between
from .newton_stages import GUESS, NewtonStepper
from .nonlinear import Curvature, NonlinearEquations, NonlinearLedger, curvature, flow_of

if TYPE_CHECKING:
    from ..models import StateSpace

SHARE = 0.2  # of the tolerance, for each of the three errors of a step
LOOKED_AT = [1, 2]  # stages that the cubic of `Inside` is compared with
ROUNDS = 4  # of dz/dt = dw/dt - e'(z) dz/dt; each leaves a share of c_p's relative change
SETTLED = 1e-3  # of the tolerance, that the iteration of the fast part may leave
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
        KV = -(s.A @ V)
        self.EV = s.E @ V
        self.forcing = np.column_stack([s.B - self.EV @ basis.heating, self.EV * basis.rate - KV])
        self.curved = Curvature(*np.zeros((3, *(V.shape[1],) * 3)))
        if isinstance(system, NonlinearEquations):
            self.curved = curvature(system, basis)
            self.flow = flow_of(system, V)
            self.loads = np.column_stack([KV, self.forcing, self.EV])
            self.readers = np.stack([s.solve(0.0, row) for row in np.asarray(linear.C)])
        else:
            self.jump = np.column_stack([s.solve(0.0, column) for column in self.forcing.T])
        fields = np.column_stack([s.factors.solve(0.0, 1.0, b) for b in linear.B.T])
        self.per_kelvin = max(map(s.norm, fields.T)) / np.abs(linear.C @ fields).max()
        self.direct = np.array(direct) if len(direct) else np.zeros(len(linear.inputs))
        self.unit = 0.0  # the first window: every step is this over a power of four, as far as the windows allow
        self._missed: dict[float, float] = {}
        self._passed: Advanced  # the last window

    def start(self) -> FieldState:
        """The field at ambient temperature, at t = 0."""
        n, inputs = self.forcing.shape[0], len(self.linear.inputs)
        k = self.forcing.shape[1] - inputs
        return FieldState(0.0, np.zeros(k), np.zeros(n), np.zeros(n), np.zeros(inputs + k))

    def begin(self, x: Array) -> FieldState:
        """The field with the rise x in K, shape (n,), at t = 0."""
        V, s = self.basis.vectors, self.stepper
        z = V.T @ (s.E @ x)
        r = x - V @ z
        source = np.concatenate([np.zeros(len(self.linear.inputs)), z])
        if self.newton is None:
            return FieldState(0.0, z, r, s.solve(0.0, self.forcing @ source + s.A @ r), source)
        flow, _ = self.curved(z[None])
        slope = self.loads @ np.concatenate([z, source, flow[0]]) - self.newton.system.flow(x)
        return FieldState(0.0, z, r, slope, source)

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
        begin, done, count = state.time, 0, self._steps(window, state.step)
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
                fields[kept] += whole()((keep[kept] - t) / h)
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
        z, r, slope = self._revised_end(end, new, old, gained, length)
        out = float(self.direct @ gained)
        if self.ledger:
            drained = [self._drained(self.ledger, fast, length, end.r) for fast in (new, old)]
            out += drained[0] - drained[1]
        state = replace(
            end, z=z, r=r, slope=slope, heat_in=end.heat_in + float(gained.sum()), heat_out=end.heat_out + out
        )
        return self._outputs(new, times), state, fields + (new.z(keep) - old.z(keep)) @ self.basis.vectors.T

    def _revised_end(
        self, end: FieldState, new: FastPart, old: FastPart, gained: Array, length: float
    ) -> tuple[Array, Array, Array]:
        """z, r and slope at the end of a revised window; ``gained`` [J]: energy of each input beyond that before.

        r gains the heat of the changed powers that V does not represent, spread for the length of a step. With c_p(T) r
        changes further, so that H(x) keeps the heat that the steps of r brought.
        """
        V, s, z, before = self.basis.vectors, self.stepper, new.values[-1], old.values[-1]
        left = self.forcing @ np.concatenate([gained, length * (new.mean() - old.mean())])
        if self.newton is None:
            return z, end.r + s.solve(GAMMA * end.step, left), end.slope
        bent = length * self.flow((new.mean_products() - old.mean_products())[None])[0]
        flow, held = self.curved(np.stack([z, before]))
        x = V @ z + end.r
        was = V @ before + end.r
        system = self.newton.system
        moved = self.EV @ (z + held[0] - before - held[1])
        moved += s.E @ s.solve(GAMMA * end.step, left + self.EV @ (V.T @ bent) - bent)
        x = self._holding(self.newton, x, system.content(was) + moved)
        slope = end.slope + self.loads @ np.concatenate([z - before, np.zeros(end.source.size), flow[0] - flow[1]])
        return z, x - V @ z, slope - system.flow(x) + system.flow(was)

    @property
    def remainder(self) -> float:
        """Largest change of an output through the remainder r within the last window of `advance`, K."""
        begin = self.linear.C @ self._passed.begin.r
        return max(float(np.abs(inside(STAGE_TIMES) - begin).max()) for _, _, inside in self._passed.steps)

    def _holding(self, s: NewtonStepper, x: Array, target: Array) -> Array:
        """Rise near x with the heat content H(x) = target in J."""
        for _ in range(ROUNDS):
            change = s.solve(0.0, target - s.system.content(x)) / s.nodal.slope(x)
            x = x + change
            if s.norm(change) <= SETTLED * self.tolerance * self.per_kelvin:
                break
        return x

    def _fast(self, state: FieldState, waves: Sequence[Waveform], times: Array) -> FastPart:
        """Amplitudes z in the window that begins at ``state``."""
        reach = np.abs(self.linear.C @ self.basis.vectors).max(axis=0, initial=np.finfo(float).tiny)
        left = SETTLED * self.tolerance / (reach * max(reach.size, 1))
        return FastPart(self.basis, state.time, state.z, waves, times, self.curved if self.newton else None, left)

    def _drained(self, ledger: Ledger | NonlinearLedger, fast: FastPart, length: float, r: Array) -> float:
        """Heat in J that leaves in a window of this length, from the mean field and its change."""
        begin, mean, end = np.stack([fast.values[0], fast.mean(), fast.values[-1]]) @ self.basis.vectors.T + r
        slopes = np.stack([0 * begin, (end - begin) / length, 0 * begin])
        return ledger.outflow(length, np.array([0.0, 1.0, 0.0]), np.stack([begin, mean, end]), slopes)

    def _steps(self, window: float, last: float) -> int:
        """Initial number of steps of a window; a step is the first window over a power of four, at most ``last``."""
        octaves = np.log2(self.unit / window)
        count = 2 if round(octaves) % 2 and abs(octaves - round(octaves)) < 1e-6 else 1
        while last and window / count > 1.001 * last:
            count *= 4
        return count

    def _step(
        self, fast: FastPart, state: FieldState, t: float, h: float
    ) -> tuple[FieldState, float, Inside, Callable[[], Inside]] | None:
        """Take one step; returns the new state, the error over the tolerance, and outputs and r inside the step."""
        piece = fast.piece(t, h)
        missed = float(piece.leftover @ self.missed(h)) / (SHARE * self.tolerance)
        if missed > 1:
            return None
        s, C, V = self.stepper, self.linear.C, self.basis.vectors
        correction = np.zeros(6)
        jump = piece.stages[0] - state.source
        z = fast.z(t + h * STAGE_TIMES)
        z[4] = piece.stages[4, piece.energy.size :]  # the fifth stage lies beyond the step
        if self.newton is None:
            done = s.step(state.r, state.slope + self.jump @ jump, h, piece.stages @ self.forcing.T)
        else:
            correction = self._correction(fast, z, t, h)
            slope = state.slope + self.forcing @ jump + (correction[0] - state.correction)
            done = self._nonlinear(self.newton, piece, z, h, slope, state.r, correction)
        if done is None:
            return None
        slopes, rests = done
        rate, estimate = slopes[-1], h * ((WEIGHTS - EMBEDDED) @ slopes)
        if self.newton is None:
            read = C @ rate
        else:
            rate = self._load(self.newton, piece, z[-1], rests[-1], rate)
            read = self.readers @ rate
            estimate = s.solve(0.0, estimate)
        at = rests @ C.T
        inside = Inside(at[0], at[3], at[5], h * read)
        step, apart = self._errors(estimate, at[LOOKED_AT] - inside(STAGE_TIMES[LOOKED_AT]))
        if not max(missed, step, apart) <= 1:
            return None
        # 1 / 8: with k(T) the error of the interpolation falls with less than the fourth power of a step (measured)
        error = max(missed, step, apart * (1.0 if self.newton is None else (1 / 8)))
        out = float(self.direct @ piece.energy)
        if self.ledger:
            amplitudes = z if self.newton else piece.stages[:, piece.energy.size :]
            out += self.ledger.outflow(h, WEIGHTS, amplitudes @ V.T + rests, slopes + V @ (z[-1] - z[0]) / h)
        new = FieldState(
            t + h, z[-1], rests[-1], slopes[-1], piece.stages[-1], h,
            state.heat_in + float(piece.energy.sum()), state.heat_out + out, correction[-1],
        )  # fmt: skip

        def whole() -> Inside:
            return Inside(rests[0], rests[3], rests[5], h * (rate if self.newton is None else s.solve(0.0, rate)))

        return new, error, inside, whole

    def _nonlinear(
        self, s: NewtonStepper, piece: Piece, z: Array, h: float, slope: Array, r: Array, correction: Array
    ) -> tuple[Array, Array] | None:
        """Slopes in W and remainders r at the six stages with k(T), c_p(T), (6, n) each; None if one does not converge.

        The unknown is x = V z + r.
        """
        slopes = np.empty((6, r.size))
        rests = np.empty((6, r.size))
        slopes[0], rests[0] = slope, r
        shift = GAMMA * h
        fields = z @ self.basis.vectors.T
        flow, held = self.curved(z)
        follows = (z + held) @ self.EV.T
        targets = follows + shift * (np.hstack([z, piece.stages, flow]) @ self.loads.T + correction)
        s.tolerance = 0.02 * SHARE * self.tolerance / max(s.rise, self.tolerance)
        start = s.system.content(fields[0] + rests[0]) - follows[0]
        for i in range(1, 6):
            known = start + h * (STAGES[i, :i] @ slopes[:i])
            x = s.stage(fields[i] + GUESS[i, :i] @ rests[:i], known + targets[i], shift)
            if x is None:
                return None
            rests[i] = x - fields[i]
            slopes[i] = (s.system.content(x) - follows[i] - known) / shift
        s.steps += 1
        return slopes, rests

    def _correction(self, fast: FastPart, z: Array, t: float, h: float) -> Array:
        """Error of E V f - [F(V z) - K V z] at the stages of a step, to second order in z; W, shape (6, n).

        The products z_j z_k enter as their best cubics, as the power does: heat of pulses between stages counts.
        """
        missed = self.flow(fast.products(t, h) - z[:, :, None] * z[:, None, :])
        return np.asarray(missed @ self.basis.vectors @ self.EV.T - missed)

    def _load(self, s: NewtonStepper, piece: Piece, z: Array, r: Array, slope: Array) -> Array:
        """E dr/dt at the end of a step, from H'(x) dx/dt = slope + E V d(z + e)/dt with H' inverted node by node."""
        x, curved, one = self.basis.vectors @ z + r, self.curved, z[None]
        moving = self.basis.heating @ piece.stages[-1, : piece.energy.size] - self.basis.rate * z - curved(one)[0][0]
        rate = moving
        for _ in range(ROUNDS):
            rate = moving - curved.along(one, rate[None])[1][0]
        return (slope + self.EV @ moving - s.system.content.derivative(x)(self.basis.vectors @ rate)) / s.nodal.slope(x)

    def _errors(self, estimate: Array, inside: Array) -> tuple[float, float]:
        """Errors of a step relative to the tolerance: of outputs and field at its end, and of outputs inside it."""
        C, allowed = self.linear.C, SHARE * self.tolerance
        worst = max(np.abs(C @ estimate).max(), self.stepper.norm(estimate) / self.per_kelvin)
        return float(worst) / allowed, float(np.abs(inside).max()) / allowed

    def missed(self, h: float) -> Array:
        """|H - H_V| of the worst output for each input, at time scales up to a step h; K/W, shape (inputs,)."""
        steps = [float(f"{step:.8e}") for step in GAMMA * h * FINER]
        for step in steps:
            if step not in self._missed:
                s, C = self.stepper, self.linear.C
                full = C @ np.column_stack([s.solve(step, step * b) for b in s.B.T])
                kept = (C @ self.basis.vectors) @ (step * self.basis.heating / (1 + step * self.basis.rate[:, None]))
                self._missed[step] = np.abs(full - kept).max(axis=0)
        return np.max([self._missed[step] for step in steps], axis=0)
