"""Eigenvalues of ring and heat at a fixed point (U, D), at a cost that grows with the poles as n^2 and not as n^3.

The phase of the field does not matter, so a = sqrt(U). A perturbation exp(lambda t) of field, carriers and heat needs

    E(lambda) = (lambda + gamma) [(lambda + gamma + 2 tpa U)(lambda + rho) + alpha] + D^2 (lambda + rho)
                - D [beta + kerr (lambda + rho) + G(lambda) (heat (lambda + rho) + cross)] = 0
    G = sum_i gain_i/(lambda + rate_i)
    made = 4 g U^2,   alpha = fca made,   beta = S'(N) made,   rho = d(N/tau)/dN
    heat = 4 thermal_shift slope (absorbed + fca N + 2 tpa U) U,     cross = 2 thermal_shift slope fca U made
    slope = d(dT)/dz = 1 + 2 curvature z,                              kerr = 2 U times the Kerr shift of unit energy

E times the product of all (lambda + rate_i) is the characteristic polynomial, of degree 3 + n. All its zeros are found
at once, from those of a neighbour, and checked by their sum, which is the trace.

Source of the iteration: Aberth, Mathematics of Computation 27, 339 (1973). Internal units as in `equations`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels import equations, kinds
from ..kernels.compiling import OPTIONS, compiled, forget_if_older, inlined, overload
from ..kernels.equations import Array, Rates, absorbed_power, dispersion
from ..kernels.kinds import bend, chosen, order, rest
from . import balance as fixed

Complex = NDArray[np.complex128]

SWEEPS = 60
REAL = 1e-6  # |Im|/|lambda| below which an eigenvalue is real: a double one splits by the root of round-off
EXACT, GOOD = 1e-13, 1e-7  # relative corrections: as small as they get, and small enough where zeros nearly coincide


class Secular(NamedTuple):
    """Coefficients of E(lambda); names as in the module's equation."""

    gamma: float
    gamma_2: float
    rho: float
    alpha: float
    beta: float
    heat: float
    cross: float
    kerr: float


@compiled
def secular(U: float, rates: Rates, fcd: Array, static: Any) -> Secular:
    """Return the coefficients at the fixed point of energy ``U``; none depends on D."""
    at = fixed.balance(U, rates, fcd, static)
    N = at.N
    saturation = 1.0 + rates.a * N
    rho = (1.0 + rates.b * N * (2.0 + rates.a * N)) / (rates.tau0 * saturation * saturation)
    made = 4.0 * rates.g * U * U
    slope = bend(absorbed_power(U, N, rates), static)
    heat = slope * 4.0 * rates.thermal_shift * (rates.absorbed + rates.fca * N + 2.0 * rates.tpa * U) * U
    return Secular(
        at.gamma,
        at.gamma + 2.0 * rates.tpa * U,
        rho,
        rates.fca * made,
        dispersion(N, fcd)[1] * made,
        heat,
        slope * 2.0 * rates.thermal_shift * rates.fca * U * made,
        2.0 * rates.kerr * U,
    )


@compiled
def seculars(U: Array, rates: Rates, fcd: Array, static: Any) -> Array:
    """Return the fields of `Secular` as rows, shape (8, n)."""
    out = np.empty((8, U.size))
    for j in range(U.size):
        out[:, j] = secular(U[j], rates, fcd, static)
    return out


@compiled
def state(U: float, D: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> tuple[Array, float]:
    """Return the state at the fixed point, turned so that the field is real, and its detuning."""
    at = fixed.balance(U, rates, fcd, static)
    y = np.empty(3 + order(thermal))
    y[0], y[1], y[2] = np.sqrt(U), 0.0, at.N
    rest(absorbed_power(U, at.N, rates), thermal, y)
    return y, at.shift - D


@compiled
def warmth(U: Array, rates: Rates, fcd: Array, thermal: Any, static: Any) -> Array:
    """Return the thermal states at the fixed points of the energies ``U``, shape (m, n)."""
    out = np.empty((U.size, order(thermal)))
    for j in range(U.size):
        out[j] = state(U[j], 0.0, rates, fcd, thermal, static)[0][3:]
    return out


@compiled
def dense(U: float, D: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> Complex:
    """Return the eigenvalues of the Jacobian, shape (3 + n,), in 1/ns, by a dense factorization."""
    y, detuning = state(U, D, rates, fcd, thermal, static)
    return np.linalg.eigvals(equations.jacobian(y, detuning, rates, fcd, thermal).astype(np.complex128))


@inlined
def _inverse(z: complex) -> complex:
    """Return 1/z, and 0 for 0, without the scaling that guards against overflow; three times faster."""
    square = z.real * z.real + z.imag * z.imag
    return complex(z.real, -z.imag) * (1.0 / square) if square > 0.0 else 0j


@inlined
def _newton(z: complex, c: Secular, D: float, poles: Array) -> complex:
    """Return p(z)/p'(z) of the characteristic polynomial p."""
    G, G_slope, logs = 0j, 0j, 0j
    for i in range(poles.shape[1]):
        inverse = _inverse(z + poles[1, i])
        if inverse == 0j:  # only a pole that meets no light is a zero
            return 0j
        G += poles[0, i] * inverse
        G_slope -= poles[0, i] * inverse * inverse
        logs += inverse
    u, v, w = z + c.gamma, z + c.gamma_2, z + c.rho
    source = c.heat * w + c.cross
    E = u * (v * w + c.alpha) + D * D * w - D * (c.beta + c.kerr * w + G * source)
    E_slope = v * w + c.alpha + u * (v + w) + D * D - D * (c.kerr + G_slope * source + G * c.heat)
    return E * _inverse(E_slope + logs * E)


@compiled
def follow(z: Complex, c: Secular, D: float, poles: Array) -> bool:
    """Move ``z``, the eigenvalues of a neighbour, to those at ``c`` and ``D``; return whether they can be trusted."""
    m = z.size
    for k in range(m):  # apart, and off the real axis, which the iteration would never leave
        z[k] *= 1.0 + (1e-4 + 1e-5 * k) * (1.0 + 1j)
    largest = 1.0
    for _ in range(SWEEPS):
        before, largest = largest, 0.0
        for k in range(m):
            step = _newton(z[k], c, D, poles)
            repulsion = 0j
            for j in range(m):
                if j != k:
                    repulsion += _inverse(z[k] - z[j])
            step *= _inverse(1.0 - step * repulsion)
            z[k] -= step
            largest = max(largest, abs(step) / abs(z[k]))
        if largest < EXACT or (largest < GOOD and largest > 0.5 * before):
            break
    total = np.sum(z)
    trace = -(c.gamma + c.gamma_2 + c.rho + np.sum(poles[1]))
    return largest < GOOD and abs(total - trace) < GOOD * abs(trace)


def _again(z: Complex, U: float, D: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> Any:
    """Move ``z`` as `follow` does and return whether it can be trusted; never for a quadratic model."""


@overload(_again, jit_options=OPTIONS, strict=False)
def _again_of(z: Any, U: Any, D: Any, rates: Any, fcd: Any, thermal: Any, static: Any) -> Any:
    def network(z: Complex, U: float, D: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> bool:
        return bool(follow(z, secular(U, rates, fcd, static), D, thermal.poles))

    def quadratic(z: Complex, U: float, D: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> bool:
        return False

    return chosen(thermal, network, quadratic)


@compiled
def survey(detunings: Array, pump: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> Array:
    """Return what linear stability says at one power, shape (4, m) for ``detunings`` in rad/ns, shape (m,).

    Rows: number of fixed points, number of stable ones, and of the least unstable fixed point the largest real part of
    its eigenvalues (1/ns) and the angular frequency that goes with it (rad/ns, 0 if real).
    """
    s_end = fixed.reach(np.max(np.abs(detunings)), pump, rates, fcd, static)
    pieces = fixed.turning_points(s_end, pump, rates, fcd, static)
    near = np.empty((pieces.size, 3 + order(thermal)), dtype=np.complex128)  # eigenvalues last seen on each branch
    known = np.zeros(pieces.size, dtype=np.bool_)
    out = np.zeros((4, detunings.size))
    for j in range(detunings.size):
        out[2, j] = np.inf
        points = fixed.fixed_points(detunings[j], pump, rates, fcd, static, pieces)
        out[0, j] = points.shape[1]
        for k in range(points.shape[1]):
            U, D = points[0, k], points[1, k]
            branch = k if points.shape[1] > 1 or D > 0.0 else pieces.size - 1
            z = near[branch]
            if not known[branch] or not _again(z, U, D, rates, fcd, thermal, static):
                found = dense(U, D, rates, fcd, thermal, static)
                for i in range(z.size):
                    z[i] = found[i]
            known[branch] = True
            first = z[np.argmax(z.real)]
            if first.real < 0.0:
                out[1, j] += 1
            if first.real < out[2, j]:
                out[2, j] = first.real
                out[3, j] = abs(first.imag) if abs(first.imag) > REAL * abs(first) else 0.0
    return out


@compiled
def stable(detunings: Array, counts: Array, pump: float, rates: Rates, fcd: Array, thermal: Any, static: Any) -> Array:
    """Return the stable fixed points at one power by increasing energy, rows (U, N, dT), shape (m, most, 3).

    Rows of nan follow them. ``counts`` are the numbers of stable ones where known, as of `survey`, else -1; eigenvalues
    are computed where only a part of the fixed points is stable.
    """
    s_end = fixed.reach(np.max(np.abs(detunings)), pump, rates, fcd, static)
    pieces = fixed.turning_points(s_end, pump, rates, fcd, static)
    out = np.full((detunings.size, pieces.size - 1, 3), np.nan)
    for j in range(detunings.size):
        if counts[j] == 0.0:
            continue
        points, filled = fixed.fixed_points(detunings[j], pump, rates, fcd, static, pieces), 0
        for k in np.argsort(points[0]):
            U, D = points[0, k], points[1, k]
            if counts[j] == points.shape[1] or dense(U, D, rates, fcd, thermal, static).real.max() <= 0.0:
                at = fixed.balance(U, rates, fcd, static)
                out[j, filled, 0], out[j, filled, 1], out[j, filled, 2] = U, at.N, at.dT
                filled += 1
    return out


for module in (equations, fixed, kinds):
    forget_if_older(survey, str(module.__file__))
