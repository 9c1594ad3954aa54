"""Heat at rest: the static rise as a function of the absorbed power, for every kind of thermal model.

network, output map:  dT = z + curvature z^2,  z = R P
quadratic:            dT = P f(P),  f a Chebyshev series over the powers that the ring can absorb
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from thermofem import OutputMap, Quadratic, checks

from ..kernels.kinds import Curve, Static
from ..thermal import Compact

TERMS = (16, 32, 64, 128, 256)
EXACT = 1e-12  # of f, what the last terms may amount to: the static states themselves are no better


def at_rest(model: Compact, largest: float) -> Static | Curve:
    """Return the static rise of a compact model, of a quadratic one up to the absorbed power ``largest`` in W.

    Raises InputError: as `curve`.
    """
    from ..kernels.equations import UW

    if isinstance(model, Quadratic):
        return curve(model, largest)
    curvature = model.coefficient if isinstance(model, OutputMap) else 0.0
    return Static(model.thermal_resistance * UW, float(curvature))


def curve(model: Any, largest: float) -> Curve:
    """Return the static rise of a quadratic model up to the absorbed power ``largest`` in W.

    Raises InputError: no steady state at a power below, or one so near the end of all that no series holds.
    """
    from ..kernels.equations import UW

    for terms in TERMS:
        powers = (1 + chebyshev.chebpts1(terms)) / 2 * largest
        rise = [model.C @ model.steady_state(power) for power in powers]  # no warning: none need be reached
        f = np.asarray(chebyshev.chebfit(2 * powers / largest - 1, rise / powers, terms - 1), dtype=float)
        if np.abs(f[-3:]).max() < EXACT * np.abs(f).max():
            return Curve(largest / UW, f * UW, np.asarray(chebyshev.chebder(f * UW), dtype=float))
    raise checks.InputError(
        f"model is quadratic and near the end of its steady states at {largest:g} W of heat; lower the power"
    )
