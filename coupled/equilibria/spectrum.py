"""Eigenvalues of ring and heat about states and at fixed points (U, D); arrays throughout.

The phase of the field does not matter at a fixed point, so a = sqrt(U). A perturbation exp(lambda t) of field, carriers
and heat needs

    (lambda + gamma) [(lambda + gamma_2)(lambda + rho) + alpha] + D^2 (lambda + rho)
                - D [beta + kerr (lambda + rho) + Z(lambda) (heat (lambda + rho) + cross)] = 0
    gamma_2 = gamma + 2 tpa U,     made = 4 g U^2,   alpha = fca made,   beta = S'(N) made,   rho = d(N/tau)/dN
    heat = 4 thermal_shift (absorbed + fca N + 2 tpa U) U,     cross = 2 thermal_shift fca U made
    kerr = 2 U times the Kerr shift of unit energy,            Z = d(dT)/dP at lambda

Internal units as in `balance`.
"""

from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, ArrayLike, NDArray

from .balance import InternalRing, balance, dispersion, fixed_points

AT_ONCE = 20_000  # Jacobians in one call of LAPACK

Complex = NDArray[np.complex128]


class Secular(NamedTuple):
    """Coefficients of the equation of lambda, as in the module's equations; none depends on D."""

    gamma: Array
    gamma_2: Array
    rho: Array
    alpha: Array
    beta: Array
    heat: Array
    cross: Array
    kerr: Array


def secular(U: ArrayLike, ring: InternalRing) -> tuple[Secular, Array]:
    """Return the coefficients at the fixed points of the energies ``U``, and their absorbed powers in uW."""
    U, rates, at = np.asarray(U, dtype=float), ring.rates, balance(U, ring)
    made = 4 * rates.g * U * U
    heat = 4 * rates.thermal_shift * (rates.absorbed + rates.fca * at.N + 2 * rates.tpa * U) * U
    coefficients = Secular(
        at.gamma,
        at.gamma + 2 * rates.tpa * U,
        (1 + rates.b * at.N * (2 + rates.a * at.N)) / (rates.tau0 * (1 + rates.a * at.N) ** 2),
        rates.fca * made,
        dispersion(at.N, ring.fcd)[1] * made,
        heat,
        2 * rates.thermal_shift * rates.fca * U * made,
        2 * rates.kerr * U,
    )
    return coefficients, at.P_abs


def states(U: Array, D: Array, ring: InternalRing) -> tuple[Array, Array]:
    """Return the states [Re a, Im a, N, x] at fixed points, their fields turned to be real, and their detunings."""
    at = balance(U, ring)
    light = np.stack([np.sqrt(U), np.zeros(np.shape(U)), at.N], axis=-1)
    return np.concatenate([light, ring.heat.states(at.P_abs)], axis=-1), at.shift - D


def jacobians(y: Array, detuning: Array, ring: InternalRing) -> Array:
    """Return d(dy/dt)/dy at states of shape (m, 3 + n) under detunings of shape (m,), as of the kernel."""
    J = np.empty((*y.shape, y.shape[1]))
    for k, one in enumerate(y):
        ring.problem.set_detuning(float(detuning[k]))
        J[k] = ring.problem.slopes(one)[1]
    return J


def eigenvalues(U: Array, D: Array, ring: InternalRing) -> Complex:
    """Return the eigenvalues at fixed points, shape (m, 3 + n), in 1/ns."""
    parts = range(0, max(len(U), 1), AT_ONCE)
    every = [jacobians(*states(U[k : k + AT_ONCE], D[k : k + AT_ONCE], ring), ring) for k in parts]
    return np.concatenate([np.linalg.eigvals(J).astype(complex) for J in every])


def leading(values: Complex) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the largest real part of each row, its angular frequency (0 if real), and how many modes grow."""
    first = np.take_along_axis(values, values.real.argmax(axis=1)[:, None], axis=1)[:, 0]
    # real, too, with |Im|/|lambda| below 1e-6: a double eigenvalue splits by the root of round-off
    omega = np.where(np.abs(first.imag) > 1e-6 * np.abs(first), np.abs(first.imag), 0.0)
    return first.real, omega, (values.real > 0).sum(axis=1)


def kinds(omega: Array, growing: NDArray[np.intp]) -> NDArray[np.str_]:
    """Return the kinds of fixed points in words, from what `leading` returns."""
    unstable = np.where(omega > 0, "unstable focus", "unstable node")
    return np.where(growing == 0, "stable", np.where(growing % 2, "saddle", unstable))


class Survey(NamedTuple):
    """Every fixed point of m laser settings, sorted by setting and energy, and counts over the settings."""

    cell: NDArray[np.intp]
    U: Array
    D: Array
    growth: Array  # 1/ns
    omega: Array  # rad/ns
    fastest: Array  # 1/ns, |lambda| of the mode that leaves fastest, 0 where none grows
    points: NDArray[np.intp]  # shape (m,)
    stable: NDArray[np.intp]  # shape (m,)


def survey(pump: Array, detuning: Array, ring: InternalRing) -> Survey:
    """Return the fixed points and their stability at laser settings in sqrt(fJ)/ns and rad/ns."""
    U, D, cell = fixed_points(pump, detuning, ring)
    values = eigenvalues(U, D, ring)
    growth, omega, growing = leading(values)
    fastest = np.where(values.real > 0, np.abs(values), 0.0).max(axis=1)
    settings = np.broadcast(np.atleast_1d(pump), np.atleast_1d(detuning)).size
    points, stable = (np.bincount(cell[which], minlength=settings) for which in (growing >= 0, growing == 0))
    return Survey(cell, U, D, growth, omega, fastest, points, stable)


def stable_points(pump: float, detuning: float, ring: InternalRing) -> Array:
    """Return the stable fixed points at a laser setting, rows (U, N, dT), by increasing energy."""
    found = survey(np.array([pump]), np.array([detuning]), ring)
    U = found.U[found.growth <= 0]
    here = balance(U, ring)
    return np.stack([U, here.N, here.dT], axis=-1)
