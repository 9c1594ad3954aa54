"""The Hopf point in which a branch of ever smaller cycles ends: where a pair of eigenvalues crosses the imaginary axis.

The parameter is found by the secant method on the real part; the last "cycle" is the fixed point itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm
from scipy.optimize import newton

from thermofem.arrays import Array

from .orbit import CycleProblem, Orbit
from .path import FreeParameters, Place
from .scheme import scheme

if TYPE_CHECKING:
    from ..equilibria.balance import InternalRing


def hopf_near(family: FreeParameters, place: Place) -> Place | None:
    """The Hopf point near a small cycle of a family with one parameter; None where there is none."""
    omega, mean = 2 * np.pi / place.orbit.T, _mean_energy(place.orbit)
    start = float(place.values[0])
    try:
        value = float(
            newton(
                lambda v: _pair(family, v, mean, omega)[1].real, start, x1=start + 1e-5 * float(family.ranges[0]),
                tol=1e-11 * float(family.ranges[0]), maxiter=20,
            )
        )  # fmt: skip
        y, pair, J = _pair(family, value, mean, omega)
    except (RuntimeError, ValueError):
        return None
    if abs(value - start) > 0.05 * family.ranges[0]:
        return None
    T = 2 * np.pi / pair.imag
    Y = np.broadcast_to(y, place.orbit.Y.shape).copy()
    orbit = Orbit(y, Y, place.orbit.tau, float(T), np.ascontiguousarray(expm(J * T)), 0.0)
    return place._replace(orbit=orbit, values=np.array([value]))


def _mean_energy(orbit: Orbit) -> float:
    """The mean energy of an orbit in fJ."""
    weight = np.diff(orbit.tau)[:, None] * scheme().A[-1]
    return float((weight * (orbit.Y[:, :, 0] ** 2 + orbit.Y[:, :, 1] ** 2)).sum())


def _pair(family: FreeParameters, value: float, energy: float, omega: float) -> tuple[Array, complex, Array]:
    """The fixed point nearest to an energy, its eigenvalue nearest to i omega, and its Jacobian."""
    from ..equilibria.balance import absorbable, fixed_points, internal_ring

    p = family.at(np.array([value]))
    at = internal_ring(p.ring, p.model, absorbable(p.ring, p.power))
    U, D, _ = fixed_points(p.at.pump, p.at.detuning, at)
    k = int(np.argmin(np.abs(U - energy)))
    y, J = at_rest(p, at, U[k], D[k])
    values = np.linalg.eigvals(J).astype(complex)
    return y, complex(values[np.argmin(np.abs(values - 1j * omega))]), J


def at_rest(p: CycleProblem, at: InternalRing, U: float, D: float) -> tuple[Array, Array]:
    """The fixed point (U, D) of a problem, and its Jacobian; under a real pump the field turns as i/(gamma - i D)."""
    from ..equilibria.balance import balance
    from ..equilibria.spectrum import states
    from ..kernels import equations as eq

    y = states(np.array([U]), np.array([D]), at)[0][0]
    turn = 1j / (float(balance(U, at).gamma) - 1j * D)
    y[:2] = np.sqrt(U) * (np.array([turn.real, turn.imag]) / abs(turn))
    return y, np.asarray(eq.jacobian(y, p.at.detuning, p.at.rates, p.at.fcd, p.at.thermal))
