"""Heat at rest: the static rise as a function of the absorbed power, and its slope, for every kind of thermal model.

    network, output map:  dT = z + curvature z^2,  z = R P
    quadratic:            dT = P f(P),  f a Chebyshev series over the powers that the ring can absorb

A function here is a name for compiled code to call, and numba takes the body that fits, as in `kinds`. Internal units.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from thermofem import checks

from ..kernels.kinds import OPTIONS

Array = NDArray[np.float64]

TERMS = (16, 32, 64, 128, 256)
EXACT = 1e-12  # of f, what the last terms may amount to: the static states themselves are no better


class Static(NamedTuple):
    """A network with an output map."""

    R: float  # K/uW
    curvature: float = 0.0  # 1/K


class Curve(NamedTuple):
    """A quadratic model; beyond ``top`` the rise goes on along its tangent."""

    top: float  # uW
    f: Array  # K/uW, Chebyshev coefficients over [0, top]
    slope: Array  # those of df/dx, x = 2 P/top - 1


def curve(model: Any, largest: float) -> Curve:
    """Return the static rise of a quadratic model up to the absorbed power ``largest`` in W.

    Raises
    ------
    InputError
        no steady state at a power below, or one so near the end of all that no series holds.
    """
    from ..kernels.equations import UW

    for terms in TERMS:
        powers = (1 + chebyshev.chebpts1(terms)) / 2 * largest
        f = chebyshev.chebfit(2 * powers / largest - 1, model.steady_rise(powers) / powers, terms - 1)
        if np.abs(f[-3:]).max() < EXACT * np.abs(f).max():
            return Curve(largest / UW, f * UW, np.asarray(chebyshev.chebder(f * UW), dtype=float))
    raise checks.InputError(
        f"model is quadratic and near the end of its steady states at {largest:g} W of heat; lower the power"
    )


def rise(heat: float, static: Any) -> Any:
    """Return dT and d(dT)/dP at the absorbed power ``heat``."""


def bend(heat: float, static: Any) -> Any:
    """Return d(dT)/dz: what an output map does to small changes of a network, and 1 for a quadratic model."""


@overload(rise, jit_options=OPTIONS, strict=False)
def _rise(heat: Any, static: Any) -> Any:
    def network(heat: float, static: Any) -> tuple[float, float]:
        z = static.R * heat
        return z + static.curvature * z * z, static.R * (1.0 + 2.0 * static.curvature * z)

    def quadratic(heat: float, static: Any) -> tuple[float, float]:
        P = min(heat, static.top)
        x = 2.0 * P / static.top - 1.0
        a, b, c, d = 0.0, 0.0, 0.0, 0.0  # Clenshaw's recurrences
        for k in range(static.f.size - 1, 0, -1):
            a, b = static.f[k] + 2.0 * x * a - b, a
        for k in range(static.slope.size - 1, 0, -1):
            c, d = static.slope[k] + 2.0 * x * c - d, c
        f, slope = static.f[0] + x * a - b, static.slope[0] + x * c - d
        by_heat = f + P * slope * 2.0 / static.top
        return P * f + (heat - P) * by_heat, by_heat

    return quadratic if static.instance_class is Curve else network


@overload(bend, jit_options=OPTIONS, strict=False)
def _bend(heat: Any, static: Any) -> Any:
    def network(heat: float, static: Any) -> float:
        return 1.0 + 2.0 * static.curvature * static.R * heat

    def quadratic(heat: float, static: Any) -> float:
        return 1.0

    return quadratic if static.instance_class is Curve else network
