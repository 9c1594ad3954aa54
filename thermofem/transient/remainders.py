"""The remainder r of a full-order field x = V z + r, without and with laws of the temperature (`deflation`).

Linear:      E dr/dt = forcing (P, z) - K r
Nonlinear:   d/dt [H(x) - E V (z + e)] = loads (z, P, z, f) - F(x)

    forcing = [B - E V V^T B, E V diag(rate) - K V],     loads = [K V, forcing, E V]

Both classes take the same steps: `begin` at a given field, `step`, and `revised` at the end of a window whose powers
changed a little.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..algebra.factor import Pencil
from ..algebra.krylov import Basis
from ..arrays import Array
from ..waveforms import Constant
from .esdirk import EMBEDDED, GAMMA, STAGE_TIMES, STAGES, WEIGHTS, Stepper
from .fast_part import FastPart, FieldState, Piece
from .newton_stages import GUESS, NewtonStepper
from .nonlinear import NonlinearEquations, curvature, flow_of

if TYPE_CHECKING:
    from ..models import StateSpace

ROUNDS = 4  # of dz/dt = dw/dt - e'(z) dz/dt; each leaves a share of c_p's relative change
ERROR_SHARE = 0.2  # of the tolerance, for each of the three errors of a step
SETTLED_SHARE = 1e-3  # of the tolerance, that an iteration may leave


class RemainderStep(NamedTuple):
    """One step of the remainder: n states, six stages."""

    slopes: Array
    """(6, n): of the equation of the remainder, at the stages."""
    states: Array
    """(6, n): r at the stages, K."""
    estimate: Array
    """(n,): embedded estimate of the error of r, K."""
    end_rate: Array
    """(n,): dr/dt at the end, K/s."""
    amplitudes: Array
    """(6, k): z at the stages, with which the heat that leaves is computed."""
    correction: Array | float
    """(n,), W: what the step added to the slope at its end."""


class RevisedEnd(NamedTuple):
    """The end of a window that is solved again: amplitudes z, remainder r and slope."""

    z: Array
    r: Array
    slope: Array


class _Parts:
    """Matrices of both kinds: E V, K V and the forcing of the remainder by powers and amplitudes.

    per_kelvin: energy norm of a field whose output is 1 K.
    """

    def __init__(self, stepper: Stepper, basis: Basis) -> None:
        V = basis.vectors
        self.stepper = stepper
        self.basis = basis
        self.KV = -(stepper.A @ V)
        self.EV = stepper.E @ V
        by_power = stepper.B - self.EV @ basis.heating
        by_amplitude = self.EV * basis.rate - self.KV
        self.forcing = np.column_stack([by_power, by_amplitude])
        per_watt = [stepper.factors.solve(0.0, 1.0, column) for column in stepper.B.T]
        largest_output = np.abs(stepper.C @ np.column_stack(per_watt)).max()
        self.per_kelvin = max(map(stepper.norm, per_watt)) / largest_output

    def gained(self, new: FastPart, old: FastPart, energy: Array, length: float) -> Array:
        """Heat in J that revised powers bring to the remainder; ``energy`` [J]: of each input beyond that before."""
        of_amplitudes = length * (new.mean() - old.mean())
        return self.forcing @ np.concatenate([energy, of_amplitudes])


class LinearRemainder(_Parts):
    """The remainder of a linear system."""

    inside_share = 1.0  # of the error inside a step that counts for the next step's length

    def __init__(self, system: StateSpace, basis: Basis, factors: Pencil | None) -> None:
        quiet = [Constant(0.0)] * len(system.inputs)
        super().__init__(Stepper(system, quiet, factors), basis)
        self.curved = None
        self.jump = np.column_stack([self.stepper.solve(0.0, column) for column in self.forcing.T])

    def begin(self, x: Array, z: Array, r: Array, source: Array) -> Array:
        """Slope at the start from a field x = V z + r with the powers and amplitudes ``source``."""
        s = self.stepper
        return s.solve(0.0, self.forcing @ source + s.A @ r)

    def step(self, fast: FastPart, piece: Piece, state: FieldState, t: float, h: float) -> RemainderStep | None:
        """One step; None where it must be shorter."""
        s = self.stepper
        change = piece.stages[0] - state.source
        slope = state.slope + self.jump @ change
        solution = s.step(state.r, slope, h, piece.stages @ self.forcing.T)
        if solution is None:
            return None
        slopes, states = solution
        estimate = h * ((WEIGHTS - EMBEDDED) @ slopes)
        amplitudes = piece.stages[:, piece.energy.size :]
        return RemainderStep(slopes, states, estimate, slopes[-1], amplitudes, 0.0)

    def revised(self, end: FieldState, new: FastPart, old: FastPart, gained: Array, length: float) -> RevisedEnd:
        """End of a revised window; ``gained`` [J]: energy of each input beyond that before.

        r gains the heat of the changed powers that V does not represent, spread for the length of a step.
        """
        heat = self.gained(new, old, gained, length)
        r = end.r + self.stepper.solve(GAMMA * end.step, heat)
        return RevisedEnd(new.values[-1], r, end.slope)


class NonlinearRemainder(_Parts):
    """The remainder with k(T) and c_p(T)."""

    stepper: NewtonStepper
    inside_share = 1 / 8  # the error of the interpolation falls with less than the fourth power of a step (measured)

    def __init__(self, system: NonlinearEquations, basis: Basis, tolerance: float, factors: Pencil | None) -> None:
        linear = system.linear
        quiet = [Constant(0.0)] * len(linear.inputs)
        super().__init__(NewtonStepper(system, quiet, tolerance, factors), basis)
        self.tolerance = tolerance
        self.curved = curvature(system, basis)
        self.flow = flow_of(system, basis.vectors)
        self.loads = np.column_stack([self.KV, self.forcing, self.EV])

    def begin(self, x: Array, z: Array, r: Array, source: Array) -> Array:
        """Slope at the start from a field x = V z + r with the powers and amplitudes ``source``."""
        (flow,), _ = self.curved(z[None])
        load = self.loads @ np.concatenate([z, source, flow])
        return load - self.stepper.system.flow(x)

    def step(self, fast: FastPart, piece: Piece, state: FieldState, t: float, h: float) -> RemainderStep | None:
        """One step; None where it must be shorter."""
        s = self.stepper
        z = fast.z(t + h * STAGE_TIMES)
        z[4] = piece.stages[4, piece.energy.size :]  # the fifth stage lies beyond the step
        correction = self._correction(fast, z, t, h)
        change = piece.stages[0] - state.source
        slope = state.slope + self.forcing @ change + (correction[0] - state.correction)
        solution = self._stages(piece, z, h, slope, state.r, correction)
        if solution is None:
            return None
        slopes, states = solution
        end_rate = s.solve(0.0, self._load(piece, z[-1], states[-1], slopes[-1]))
        estimate = s.solve(0.0, h * ((WEIGHTS - EMBEDDED) @ slopes))
        return RemainderStep(slopes, states, estimate, end_rate, z, correction[-1])

    def revised(self, end: FieldState, new: FastPart, old: FastPart, gained: Array, length: float) -> RevisedEnd:
        """End of a revised window; ``gained`` [J]: energy of each input beyond that before.

        r gains the heat of the changed powers that V does not represent, spread for the length of a step. With c_p(T) r
        changes further, so that H(x) keeps the heat that the steps of r brought.
        """
        V = self.basis.vectors
        s = self.stepper
        system = s.system
        z = new.values[-1]
        before = old.values[-1]
        heat = self.gained(new, old, gained, length)
        products = new.mean_products() - old.mean_products()
        bent = length * self.flow(products[None])[0]
        flow, held = self.curved(np.stack([z, before]))
        old_x = V @ before + end.r
        moved = self.EV @ (z + held[0] - before - held[1])
        spread = heat + self.EV @ (V.T @ bent) - bent
        moved += s.E @ s.solve(GAMMA * end.step, spread)
        x = self._holding(V @ z + end.r, system.content(old_x) + moved)
        unchanged = np.zeros(end.source.size)
        load = self.loads @ np.concatenate([z - before, unchanged, flow[0] - flow[1]])
        slope = end.slope + load - system.flow(x) + system.flow(old_x)
        return RevisedEnd(z, x - V @ z, slope)

    def _holding(self, x: Array, target: Array) -> Array:
        """Rise near x with the heat content H(x) = target in J."""
        s = self.stepper
        allowed = SETTLED_SHARE * self.tolerance * self.per_kelvin
        for _ in range(ROUNDS):
            missing = target - s.system.content(x)
            change = s.solve(0.0, missing) / s.nodal.slope(x)
            x = x + change
            if s.norm(change) <= allowed:
                break
        return x

    def _stages(
        self, piece: Piece, z: Array, h: float, slope: Array, r: Array, correction: Array
    ) -> tuple[Array, Array] | None:
        """Slopes in W and remainders r at the six stages, (6, n) each; None if one does not converge.

        The unknown is x = V z + r.
        """
        s = self.stepper
        slopes = np.empty((6, r.size))
        states = np.empty((6, r.size))
        slopes[0] = slope
        states[0] = r
        shift = GAMMA * h
        fields = z @ self.basis.vectors.T
        flow, held = self.curved(z)
        follows = (z + held) @ self.EV.T
        loads = np.hstack([z, piece.stages, flow]) @ self.loads.T
        targets = follows + shift * (loads + correction)
        # Newton's method may leave 0.02 of the error of a step in a stage
        s.tolerance = 0.02 * ERROR_SHARE * self.tolerance / max(s.rise, self.tolerance)
        start = s.system.content(fields[0] + states[0]) - follows[0]
        for i in range(1, 6):
            before = start + h * (STAGES[i, :i] @ slopes[:i])
            guess = fields[i] + GUESS[i, :i] @ states[:i]
            x = s.stage(guess, before + targets[i], shift)
            if x is None:
                return None
            states[i] = x - fields[i]
            slopes[i] = (s.system.content(x) - follows[i] - before) / shift
        s.steps += 1
        return slopes, states

    def _correction(self, fast: FastPart, z: Array, t: float, h: float) -> Array:
        """Error of E V f - [F(V z) - K V z] at the stages of a step, to second order in z; W, shape (6, n).

        The products z_j z_k enter as their best cubics, as the power does: heat of pulses between stages counts.
        """
        products = z[:, :, None] * z[:, None, :]
        missed = self.flow(fast.products(t, h) - products)
        return missed @ self.basis.vectors @ self.EV.T - missed

    def _load(self, piece: Piece, z: Array, r: Array, slope: Array) -> Array:
        """E dr/dt at the end of a step, from H'(x) dx/dt = slope + E V d(z + e)/dt with H' inverted node by node."""
        s = self.stepper
        x = self.basis.vectors @ z + r
        one = z[None]
        power = piece.stages[-1, : piece.energy.size]
        flow, _ = self.curved(one)
        moving = self.basis.heating @ power - self.basis.rate * z - flow[0]
        rate = moving
        for _ in range(ROUNDS):
            _, held = self.curved.along(one, rate[None])
            rate = moving - held[0]
        capacity = s.system.content.derivative(x)
        gained = capacity(self.basis.vectors @ rate)
        return (slope + self.EV @ moving - gained) / s.nodal.slope(x)
