"""Heat of one ring in internal units: its rise at rest, and what small changes about a state do.

    poles:      dx_i/dt = gain_i P - rate_i x_i,             dT = z + curvature z^2,  z = sum_i x_i
    quadratic:  dx/dt   = A x + H[x, x] + (G x + B) P,       dT = C x;      at rest x = P f(P)

f are Chebyshev series through the steady states of the model, over the powers that the ring can absorb.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from thermofem import Foster, OutputMap, Quadratic, checks
from thermofem.arrays import Array, NDArray

from ..kernel.units import FJ, NS, UW
from ..thermal import Compact

TERMS = (16, 32, 64, 128, 256)


class Linearised(NamedTuple):
    """Heat about a state x: d(dx/dt)/dx, d(dx/dt)/dP, dT and d(dT)/dx."""

    by_state: Array
    by_power: Array
    dT: Array
    read: Array


class PoleHeat(NamedTuple):
    """A Foster network, or an output map over one."""

    gain: Array  # K/fJ
    rate: Array  # 1/ns
    curvature: float  # 1/K

    @property
    def slowest(self) -> float:
        """Rate of the slowest decay, 1/ns."""
        return float(self.rate.min())

    def without_idle_poles(self) -> PoleHeat:
        """The network without poles that light does not move: those of zero gain, and all but one of equal rates."""
        rate, which = np.unique(self.rate, return_inverse=True)
        gain = np.bincount(which, self.gain).astype(float)
        return PoleHeat(gain[gain > 0], rate[gain > 0], self.curvature)

    def rise(self, P: Array) -> tuple[Array, Array]:
        """Rise at rest in K and its derivative by the absorbed power P in uW."""
        R = float((self.gain / self.rate).sum())
        return R * P * (1 + self.curvature * R * P), R * (1 + 2 * self.curvature * R * P)

    def states(self, P: Array) -> Array:
        """States at rest, shape (..., n)."""
        return np.asarray(P)[..., None] * (self.gain / self.rate)

    def linearised(self, x: Array, P: Array) -> Linearised:
        """Linearise about states x, shape (m, n), under the powers P, shape (m,)."""
        z = x.sum(axis=-1)
        read = np.repeat((1 + 2 * self.curvature * z)[:, None], self.rate.size, axis=1)
        A = np.broadcast_to(-np.diag(self.rate), (len(x), self.rate.size, self.rate.size))
        return Linearised(A, np.broadcast_to(self.gain, x.shape), z + self.curvature * z**2, read)

    def impedance(self, lam: NDArray[np.complex128], P: Array) -> NDArray[np.complex128]:
        """d(dT)/dP in K/uW of changes exp(lam t) about the state at rest under P; one shape."""
        response = np.zeros(np.shape(lam), dtype=complex)
        for gain, rate in zip(self.gain, self.rate, strict=True):
            response += gain / (lam + rate)
        return np.asarray(response * (1 + 2 * self.curvature * float((self.gain / self.rate).sum()) * P))


class QuadraticHeat(NamedTuple):
    """A quadratic model."""

    A: Array  # 1/ns
    H: Array  # 1/(K ns)
    G: Array  # 1/fJ
    B: Array  # K/fJ
    C: Array  # 1
    top: float  # uW, the largest power of the series
    f: Array  # K/uW, shape (terms, n): Chebyshev coefficients over [0, top]
    slope: Array  # those of df/d(2 P/top - 1)

    @property
    def slowest(self) -> float:
        """Rate of the slowest decay at low power, 1/ns."""
        return float(-np.linalg.eigvals(self.A).real.max())

    def without_idle_poles(self) -> QuadraticHeat:
        """The system itself."""
        return self

    def rise(self, P: Array) -> tuple[Array, Array]:
        """Rise at rest in K and its derivative by P; beyond ``top`` the tangent there."""
        states, slope = self._at_rest(P)
        return states @ self.C, slope @ self.C

    def states(self, P: Array) -> Array:
        """States at rest on the branch from zero, shape (..., n)."""
        return self._at_rest(P)[0]

    def _at_rest(self, P: Array) -> tuple[Array, Array]:
        """States at rest and their derivative by P."""
        inside = np.minimum(P, self.top)
        x = 2 * inside / self.top - 1
        f = np.moveaxis(chebyshev.chebval(x, self.f), 0, -1)
        slope = f + inside[..., None] * np.moveaxis(chebyshev.chebval(x, self.slope), 0, -1) * 2 / self.top
        return inside[..., None] * f + (P - inside)[..., None] * slope, slope

    def linearised(self, x: Array, P: Array) -> Linearised:
        """Linearise about states x, shape (m, n), under the powers P, shape (m,)."""
        by_state = self.A + 2 * np.einsum("ijk,mk->mij", self.H, x) + P[:, None, None] * self.G
        return Linearised(by_state, self.B + x @ self.G.T, x @ self.C, np.broadcast_to(self.C, x.shape))

    def impedance(self, lam: NDArray[np.complex128], P: Array) -> NDArray[np.complex128]:
        """d(dT)/dP in K/uW of changes exp(lam t) about the state at rest under P; one shape."""
        powers, which = np.unique(P, return_inverse=True)
        which = which.reshape(np.shape(P))
        at = self.linearised(self.states(powers), powers)
        rates, modes = np.linalg.eig(at.by_state)
        gains = (self.C @ modes) * np.linalg.solve(modes, at.by_power[..., None].astype(complex))[..., 0]
        response = np.zeros(np.shape(lam), dtype=complex)
        for k in range(self.C.size):
            response += gains[which, k] / (lam - rates[which, k])
        return response


Heat = PoleHeat | QuadraticHeat


def heat_of(model: Compact, largest: float) -> Heat:
    """Return a compact model in internal units, of a quadratic one for absorbed powers up to ``largest`` in W.

    Raises InputError: no steady state of a quadratic model at a power below, or one so near the end of all that no
        series holds.
    """
    if isinstance(model, Quadratic):
        A, H, G, B, C = (np.asarray(getattr(model, name), dtype=float) for name in "AHGBC")
        f = _series(model, largest) * UW
        return QuadraticHeat(A * NS, H * NS, G * FJ, B * FJ, C, largest / UW, f, np.asarray(chebyshev.chebder(f)))
    linear: Foster = model.linear if isinstance(model, OutputMap) else model
    R, tau = np.asarray(linear.R, dtype=float), np.asarray(linear.tau, dtype=float)
    curvature = float(model.coefficient) if isinstance(model, OutputMap) else 0.0
    return PoleHeat(R * UW * NS / tau, NS / tau, curvature)


def _series(model: Quadratic, largest: float) -> Array:
    """Chebyshev coefficients of f in K/W over [0, largest], shape (terms, n)."""
    for terms in TERMS:
        powers = (1 + chebyshev.chebpts1(terms)) / 2 * largest
        states = np.array([model.steady_state(power) for power in powers])  # no warning: none need be reached
        f = np.asarray(chebyshev.chebfit(2 * powers / largest - 1, states / powers[:, None], terms - 1), dtype=float)
        # the last terms are below 1e-12 of f, the error of the steady states themselves
        if np.abs(f[-3:]).max() < 1e-12 * np.abs(f).max():
            return f
    raise checks.InputError(
        f"model is quadratic and near the end of its steady states at {largest:g} W of heat; lower the power"
    )
