"""The rates of light and carriers of a ring, with their derivatives, as `equations.hpp` has them; kernel's units.

    gamma(U, N) = loss + fca N + tpa U                     1/ns, loss of the field
    P_abs(U, N) = 2 (absorbed + fca N + tpa W) U           uW, heat; W = U for a single field
    dN/dt       = made - lost(N),      made = g U^2        1e23/m^3 per ns
    lost(N)     = N/tau(N) = N (1 + b N)/(tau0 (1 + a N))
    S(N)        = sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2)  rad/ns, dispersion by free carriers

Every argument is a number or an array; ``rates`` has the fields of `units.Rates` or `units.Mode`, and ``law`` those of
`units.Rates` or `units.Carriers`. `slope` differentiates absorption and recombination, which are so written once.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from thermofem.arrays import Array, ArrayLike

EPSILON = 1e-8  # 1e23/m^3, eps of S(N): 1e15 carriers per m^3, six orders below the densities that matter
STEP = 1e-30  # along the imaginary axis: its square is lost beside any density or energy
NEWTON_STEPS = 60  # most, for steady carriers
BALANCED = 1e-12  # of the generation: what is lost more or less


def slope(function: Callable[[Any], Any], x: ArrayLike) -> Array:
    """d function/dx = Im function(x + i h)/h, exact to round-off as nothing is subtracted; for analytic functions.

    Source: Squire and Trapp, SIAM Rev. 40, 110 (1998).
    """
    return np.asarray(np.imag(function(np.asarray(x) + 1j * STEP)) / STEP)


def field_loss(U: Any, N: Any, rates: Any) -> Any:
    """gamma in 1/ns; its derivatives are ``rates.tpa`` by U and ``rates.fca`` by N."""
    return rates.loss + rates.fca * N + rates.tpa * U


def absorbed_power(U: Any, N: Any, rates: Any, felt: Any = None) -> Any:
    """P_abs in uW; ``felt`` is W, the energy that sets two-photon absorption, U by default."""
    W = U if felt is None else felt
    return 2.0 * (rates.absorbed + rates.fca * N + rates.tpa * W) * U


def absorbed_slopes(U: Any, N: Any, rates: Any) -> tuple[Any, Any]:
    """Derivatives of P_abs of a single field by U (1/ns) and by N (uW per 1e23/m^3)."""
    by_U = slope(lambda energy: absorbed_power(energy, N, rates), U)
    by_N = slope(lambda density: absorbed_power(U, density, rates), N)
    return by_U, by_N


def lost(N: Any, law: Any) -> Any:
    """Recombination in 1e23/m^3 per ns; ``law`` has tau0 (ns), a and b (m^3/1e23)."""
    return N * (1 + law.b * N) / (law.tau0 * (1 + law.a * N))


def recombination(N: Any, law: Any) -> tuple[Any, Any]:
    """lost(N) in 1e23/m^3 per ns, and d lost/dN in 1/ns."""
    return lost(N, law), slope(lambda density: lost(density, law), N)


def steady_carriers(made: ArrayLike, law: Any) -> tuple[Array, Array]:
    """The density N with lost(N) = made, and dN/d(made) in ns.

    N is the positive root of b N^2 + (1 - a k) N - k = 0 with k = tau0 made; Newton's method goes on from there where
    `lost` has other terms.
    """
    made = np.asarray(made)
    b = np.asarray(law.b)
    k = law.tau0 * made
    p = 1 - law.a * k
    root = np.sqrt(p * p + 4 * b * k)
    far = root + np.abs(p)  # neither form of the root subtracts
    large = np.divide(far, 2 * b, out=np.zeros(np.broadcast(far, b).shape), where=b > 0)
    N = np.where(p > 0, 2 * k / far, large)
    for _ in range(NEWTON_STEPS):
        rate, by_N = recombination(N, law)
        if np.all(np.abs(rate - made) <= BALANCED * made):
            break
        N = np.maximum(N - (rate - made) / by_N, N / 10)
    return N, 1 / by_N


def dispersion(N: ArrayLike, fcd: Array) -> tuple[Array, Array]:
    """S(N) in rad/ns and dS/dN; ``fcd`` [shape (terms, 2)]: rows (c_k, p_k)."""
    N = np.asarray(N)
    square = N * N + EPSILON**2
    S = np.zeros(N.shape)
    slope = np.zeros(N.shape)
    for c, p in fcd:
        factor = c * square ** (0.5 * (p - 1))
        S = S + factor * N
        slope = slope + factor * (1 + (p - 1) * N * N / square)
    return S, slope
