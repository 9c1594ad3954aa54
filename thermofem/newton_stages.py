"""Stages of the ESDIRK method for k(T) and c_p(T): Newton's method with the frozen factors of the linear system.

Stage i solves  H(x_i) + gamma h F(x_i) = H(x_0) + h sum_{j<i} a_ij E s_j + gamma h B P_i,  with slopes s = E^-1 dH/dt.
Each iteration costs one solve with E - gamma h A at the ambient temperature; where they stall, the factors are made
again from the Jacobian at the present state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .esdirk import GAMMA, STAGE_TIMES, STAGES, Stepper
from .factor import Solve
from .nonlinear import NonlinearSystem, factorize_general
from .waveforms import Waveform

Array = NDArray[np.float64]

ITERATIONS = 10  # per stage, before the factors are renewed
PATIENCE = 3  # iterations before their rate is judged: a good guess makes the first ratios large
STALLED = 0.95  # ratio of successive corrections above which they are renewed at once
SHARE = 0.02  # of the step's error that the iteration may leave; more, and the error estimate sees it (measured)

# value at each stage of the polynomial through the stages before it
_GUESS = np.zeros((6, 6))
for _i in range(1, 6):
    for _j in range(_i):
        _others = np.delete(STAGE_TIMES[:_i], _j)
        _GUESS[_i, _j] = np.prod((STAGE_TIMES[_i] - _others) / (STAGE_TIMES[_j] - _others))


class NewtonStepper(Stepper):
    """A `Stepper` whose stages are nonlinear; ``tolerance`` is the relative error allowed in a step."""

    def __init__(self, system: NonlinearSystem, waves: Waveform | Sequence[Waveform], tolerance: float) -> None:
        super().__init__(system.linear, waves)
        self.system = system
        self.tolerance = SHARE * tolerance * (0.5 if system.content.laws else 1.0)
        self.iterations = self.refreshes = 0
        self._weight = self.E.diagonal()
        self._scale = np.zeros(1 + self.C.shape[0])
        self._rate = 0.0  # of convergence, per K of the largest rise: it grows with the rise
        self._at: Array | None = None  # where the renewed factors belong; None: the linear ones serve
        self._renewed: dict[float, Solve] = {}

    def start_slope(self, x: Array, t: float, h: float, stop: float) -> Array:
        """E^-1 dH/dt at the start of a smooth piece."""
        return self.solve(0.0, self.B @ self.powers(t, h, stop)[0] - self.system.flow(x))

    def rate(self, x: Array, slope: Array) -> Array:
        """dx/dt from a slope: solves H'(x) dx/dt = E s by iteration with E."""
        if not self.system.content.laws:
            return slope
        capacity, rate, target = self.system.content.jacobian(x), slope, self.E @ slope
        for _ in range(ITERATIONS):
            change = self.solve(0.0, target - capacity @ rate)
            rate = rate + change
            if np.abs(change).max() <= 1e-4 * np.abs(rate).max():  # it only interpolates between steps
                break
        return rate

    def step(self, x: Array, slope: Array, h: float, powers: Array) -> tuple[Array, Array] | None:
        """One step as `Stepper.step`; None where even renewed factors do not converge: the step is too long."""
        slopes, states = np.empty((6, x.size)), np.empty((6, x.size))
        slopes[0], states[0] = slope, x
        shift, extra = GAMMA * h, self._extra(x)
        for i in range(1, 6):
            past = STAGES[i, :i] @ slopes[:i]
            known, source = x + h * past, shift * (self.B @ powers[i])
            if self.system.content.laws:
                source = source + extra
            found = self._newton(_GUESS[i, :i] @ states[:i], known, source, shift)
            if found is None:
                return None
            states[i] = found
            slopes[i] = (found - known) / shift  # not from F: that would blow up what the iteration left
            if self.system.content.laws:
                slopes[i] += self.solve(0.0, self._extra(found) - extra) / shift
        self.steps += 1
        return slopes, states

    def _extra(self, x: Array) -> Array:
        """H(x) - E x."""
        return self.system.content(x) - self.E @ x if self.system.content.laws else np.zeros_like(x)

    def _newton(self, x: Array, known: Array, source: Array, shift: float) -> Array | None:
        """Solve one stage from the guess ``x``; renew the factors once where they stall."""
        start = x
        for renewed in (False, True):
            if renewed:
                self._renew(start)
                x = start
            rate, last = 0.0, np.inf
            for k in range(ITERATIONS):
                rest = self.E @ (known - x) + source - self._extra(x) - shift * self.system.flow(x)
                change = self._correct(shift, rest)
                x = x + change
                self.iterations += 1
                size = self._size(change, x)
                if not np.isfinite(size):
                    break
                rate = size / last if k else min(self._rate * self._rise, STALLED)
                last = size
                if k >= PATIENCE and rate > STALLED:
                    break
                if size * rate <= self.tolerance * (1 - rate) and (k or rate > 0 or size <= self.tolerance):
                    if k and self._rise:
                        self._rate = max(rate / self._rise, 0.9 * self._rate)
                    return x
        return None

    def _correct(self, shift: float, rest: Array) -> Array:
        if self._at is None:
            return self.solve(shift, rest)
        key = float(f"{shift:.8e}")
        if key not in self._renewed:
            matrix = self.system.content.jacobian(self._at) + shift * self.system.flow.jacobian(self._at)
            self._renewed[key] = factorize_general(matrix)
            self.factorizations += 1
        self.solves += 1
        return self._renewed[key](rest)

    def _renew(self, x: Array) -> None:
        self._at, self._renewed = x, {}
        self.refreshes += 1

    def _size(self, change: Array, x: Array) -> float:
        """Largest of the changes of field and outputs, each relative to the largest value it has had."""
        self._scale = np.maximum(self._scale, self._measure(x))
        return float(np.max(self._measure(change) / np.maximum(self._scale, np.finfo(float).tiny)))

    @property
    def _rise(self) -> float:
        return float(self._scale[:-1].max())

    def _measure(self, x: Array) -> Any:
        return np.append(np.abs(self.C @ x), np.sqrt(self._weight @ (x * x)))
