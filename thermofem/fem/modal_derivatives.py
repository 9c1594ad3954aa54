"""Derivatives of a response from a few fields and the derivatives of the matrices between them.

With M-orthonormal modes V of rates lambda, heat and reading functionals b, c and their projections beta, gamma,

    Z(s) = sum_m gamma_m beta_m / (lambda_m + s)
    dZ(s) = sum_m (gamma_m db_m + dc_m beta_m)/(lambda_m + s)
            - sum_mn gamma_m (dK_mn + s dM_mn) beta_n / ((lambda_m + s)(lambda_n + s))

dK = V^T (dK/dp) V and so on with V held: exact where V holds the solutions at s. The step response has the same sum
with each fraction over s carried to the time domain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra.poles import pole_responses
from ..arrays import Array, NDArray
from ..waveforms import Waveform

STEP = 1e-4  # of a rate: half the width of the difference that gives the answer of a double pole to 1e-8


@dataclass(frozen=True, eq=False)
class ModalDerivative:
    """One channel in modes, and the derivatives of its matrices with respect to p parameters.

    rate [shape (k,), 1/s]
    heating, reading [shape (k,)]: V^T b and V^T c.
    of_K, of_M [shape (p, k, k)]
    of_heating, of_reading [shape (p, k)]: V^T db and V^T dc.
    """

    rate: Array
    heating: Array
    reading: Array
    of_K: Array
    of_M: Array
    of_heating: Array
    of_reading: Array

    @property
    def _source(self) -> Array:
        """Shape (p, k)."""
        return self.of_heating * self.reading + self.of_reading * self.heating

    @property
    def _pairs(self) -> tuple[Array, Array]:
        """gamma_m dK_mn beta_n and the same of M, shape (p, k, k)."""
        weight = np.outer(self.reading, self.heating)
        return self.of_K * weight, self.of_M * weight

    def resistance(self) -> Array:
        """dR_th in K/W per unit, shape (p,)."""
        K, _ = self._pairs
        return self._source @ (1 / self.rate) - np.einsum("pmn,m,n->p", K, 1 / self.rate, 1 / self.rate)

    def impedance(self, frequency: Array) -> NDArray[np.complex128]:
        """dZ(f) in K/W per unit, shape (p, f)."""
        K, M = self._pairs
        s = 2j * np.pi * frequency
        x = 1 / (self.rate[:, None] + s)
        through = np.einsum("pmn,mf,nf->pf", K, x, x) + s * np.einsum("pmn,mf,nf->pf", M, x, x)
        return np.asarray(self._source @ x - through)

    def step_response(self, times: Array) -> Array:
        """d of the rise in K/W after a unit step, shape (p, t).

        1/(s (l + s)) -> (1 - exp(-l t))/l,      1/((l + s)(m + s)) -> D = (exp(-l t) - exp(-m t))/(m - l),
        1/(s (l + s)(m + s)) -> (1 - exp(-l t) - l D)/(l m).
        """
        K, M = self._pairs
        slow = np.minimum(self.rate[:, None], self.rate)
        apart = np.abs(self.rate[:, None] - self.rate)
        near = np.where(apart > 0, apart, 1.0)
        result = np.empty((len(K), times.size))
        for k, t in enumerate(times):
            decay = np.exp(-slow * t)
            D = decay * np.where(apart > 0, -np.expm1(-apart * t) / near, t)
            of_K = (-np.expm1(-slow * t) - slow * D) / np.outer(self.rate, self.rate)
            rise = -np.expm1(-self.rate * t) / self.rate
            result[:, k] = self._source @ rise - np.einsum("pmn,mn->p", K, of_K) - np.einsum("pmn,mn->p", M, D)
        return result

    def poles(self) -> tuple[Array, Array]:
        """d R_i in K/W and d tau_i in s per unit, each of shape (p, k), where poles are simple.

        dlambda_i = (dK - lambda_i dM)_ii,
        dv_i = -(dM_ii/2) v_i + sum_{j != i} (dK - lambda_i dM)_ji/(lambda_i - lambda_j) v_j
        """
        rate, b, c = self.rate, self.heating, self.reading
        apart = rate - rate[:, None]  # [j, i] = lambda_i - lambda_j
        inverse = np.where(apart == 0, 0.0, 1 / np.where(apart == 0, 1.0, apart))
        mixed = self.of_K - rate * self.of_M  # [p, j, i]
        of_rate = np.einsum("pii->pi", mixed)
        turn = mixed * inverse - np.einsum("pii->pi", self.of_M)[:, :, None] / 2 * np.eye(rate.size)
        of_b = self.of_heating + np.einsum("j,pji->pi", b, turn)
        of_c = self.of_reading + np.einsum("j,pji->pi", c, turn)
        of_R = (of_b * c + b * of_c) / rate - b * c * of_rate / rate**2
        return of_R, -of_rate / rate**2

    def response(self, wave: Waveform, times: Array, *, periodic: bool = False) -> Array:
        """d of the rise in K under a power, shape (p, t), where poles are simple.

        With g_i = R_i lambda_i and the answer X_i of a pole of rate lambda_i,
        d(rise) = sum_i dg_i X_i + g_i dX_i/dlambda_i dlambda_i.
        """
        of_R, of_tau = self.poles()
        rate, gain = self.rate, self.heating * self.reading
        of_rate = -of_tau * rate**2
        X, up, down = (
            pole_responses(rate * factor, wave, times, periodic=periodic) for factor in (1, 1 + STEP, 1 - STEP)
        )
        of_X = (up - down) / (2 * STEP * rate)
        return np.asarray((of_R * rate + gain / rate * of_rate) @ X.T + (gain * of_rate) @ of_X.T)
