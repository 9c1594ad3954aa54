"""The FEM with k(T) and c_p(T) as a thermal model; its equations are those of `thermofem.transient.nonlinear`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike
from ..transient.integration import integrate, integrate_periodic
from ..transient.nonlinear import NonlinearEquations, factorize_general
from .contract import AtSmallPower, at_times, check_single
from .state_space import StateSpace

NEWTON_STEPS = 60


@dataclass(frozen=True, eq=False)
class NonlinearSystem(AtSmallPower, NonlinearEquations):
    """A thermal model with k(T) and c_p(T); keeps the contract of `thermofem.models.contract`.

    linear: the same at small power, around the ambient temperature.
    flow, content: F(x) in W and H(x) in J.
    """

    linear: StateSpace

    @property
    def dynamics(self) -> Any:
        """Not available: the full-order system is too large to be integrated with the optics.

        Raises InputError: always.
        """
        raise checks.InputError(
            f"model is the FEM with k(T), {self.order} states; reduce it first (surrogate.reduce_quadratic), or keep "
            "it in the loop (coupled.cosimulate)"
        )

    def response(self, wave: waveforms.Waveform, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K from rest, by error-controlled integration (`transient.integrate`)."""
        check_single(self.linear)

        def run(t: Array) -> Array:
            waveforms.check_heating(wave, float(t.max(initial=0.0)))
            return integrate(self, wave, t, rtol=rtol).outputs[:, 0]

        return at_times(run, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int, *, rtol: float = 1e-5) -> Array:
        """One period of the periodic state in K (`transient.integrate_periodic`)."""
        check_single(self.linear)
        waveforms.check_heating(wave, getattr(wave, "period", None))
        return integrate_periodic(self, wave, samples, rtol=rtol).outputs[:, 0]

    def steady_state(self, power: float | Sequence[float]) -> Array:
        """Rise in K of all unknowns at constant power in W (one for each input): Newton's method on F(x) = B P.

        Raises InputError: no steady state is found, as where the conductivity falls so fast that the heat cannot leave.
        """
        heat = self.linear.B @ np.broadcast_to(np.atleast_1d(checks.numbers("power", power)), len(self.inputs))
        x = np.zeros(self.order)
        last = np.inf
        for _ in range(NEWTON_STEPS):
            try:
                change = factorize_general(self.flow.jacobian(x))(heat - self.flow(x))
            except RuntimeError:  # SuperLU: the Jacobian is singular, as where k(T) has gone to nothing
                break
            size = float(np.abs(change).max())
            if not np.isfinite(size):
                break
            lowest = 0.5 * self.flow.ambient  # a step that would cool far below ambient is cut short
            x = x + change * min(1.0, lowest / max(size, lowest) if change.min() < -lowest else 1.0)
            if size <= 1e-12 * np.abs(x).max() or (size <= 1e-9 * np.abs(x).max() and size >= last / 2):
                self.flow.positive_slopes(x)
                return x
            last = size
        raise checks.InputError(
            f"power = {power} W: no steady state is found in {NEWTON_STEPS} iterations; does the conductivity fall so "
            "fast with temperature that the heat cannot leave?"
        )

    def steady_rise(self, power: float | Sequence[float]) -> Array:
        """Rise of every output at constant power in W, in K, shape (outputs,)."""
        return np.asarray(self.linear.C @ self.steady_state(power))
