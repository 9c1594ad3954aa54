"""The rates of light and carriers of a ring, with their derivatives, as `equations.hpp` has them; kernel's units.

    gamma(U, N) = loss + fca N + tpa U                     1/ns, loss of the field
    P_abs(U, N) = 2 (absorbed + fca N + tpa W) U           uW, heat; W = U for a single field
    dN/dt       = made - lost(N),      made = g U^2        1e23/m^3 per ns
    lost(N)     = N/tau(N) = N (1 + b N)/(tau0 (1 + a N))
    S(N)        = sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2)  rad/ns, dispersion by free carriers

Every argument is a number or an array; ``rates`` has the fields of `units.Rates` or `units.Mode`.
"""

from typing import Any

import numpy as np

from thermofem.arrays import Array, ArrayLike

EPSILON = 1e-8  # 1e23/m^3, eps of S(N): 1e15 carriers per m^3, six orders below the densities that matter


def field_loss(U: Any, N: Any, rates: Any) -> Any:
    """gamma in 1/ns; its derivatives are ``rates.tpa`` by U and ``rates.fca`` by N."""
    return rates.loss + rates.fca * N + rates.tpa * U


def absorbed_power(U: Any, N: Any, rates: Any, felt: Any = None) -> Any:
    """P_abs in uW; ``felt`` is W, the energy that sets two-photon absorption, U by default."""
    W = U if felt is None else felt
    return 2.0 * (rates.absorbed + rates.fca * N + rates.tpa * W) * U


def absorbed_slopes(U: Any, N: Any, rates: Any) -> tuple[Any, Any]:
    """Derivatives of P_abs of a single field by U (1/ns) and by N (uW per 1e23/m^3)."""
    by_U = 2 * (rates.absorbed + rates.fca * N + 2 * rates.tpa * U)
    by_N = 2 * rates.fca * U
    return by_U, by_N


def recombination(N: Any, tau0: Any, a: Any, b: Any) -> tuple[Any, Any]:
    """lost(N) in 1e23/m^3 per ns, and d lost/dN in 1/ns."""
    growth = 1 + a * N
    lost = N * (1 + b * N) / (tau0 * growth)
    slope = (1 + b * N * (2 + a * N)) / (tau0 * growth**2)
    return lost, slope


def steady_carriers(made: ArrayLike, tau0: Any, a: Any, b: Any) -> tuple[Array, Array]:
    """The density N with lost(N) = made, and dN/d(made) in ns.

    N is the positive root of b N^2 + (1 - a k) N - k = 0 with k = tau0 made.
    """
    k = tau0 * np.asarray(made)
    p = 1 - a * k
    root = np.sqrt(p * p + 4 * b * k)
    far = root + np.abs(p)  # neither form of the root subtracts
    large = np.divide(far, 2 * b, out=np.zeros(np.broadcast(far, b).shape), where=np.asarray(b) > 0)
    N = np.where(p > 0, 2 * k / far, large)
    return N, tau0 * (1 + a * N) / root


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
