"""The settled cycles of a row of a map: every point from its neighbour's cycle where no fixed point is stable.

Where one is, the ring may rest there or pulse beside it; a transient from a cold ring decides which.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import checks

from ..cycles.measures import measure
from ..cycles.orbit import CycleProblem, problem, shoot
from ..cycles.parameters import under_laser
from ..cycles.start import RestError, Settled, nontrivial, settled, stable_points
from ..equilibria.steady import absorbable, internal
from ..pulsing import Regime
from .grid import Point

ROUGH = 1e-4  # error of the polynomials between the stages, for periods to better than 1e-6
LONGEST = 3e5  # ns, a transient from a cold ring
NEIGHBOUR_SHOTS = 3  # along traces, from a neighbour's cycle

Found = tuple[str, float, float, float, str]


def settled_row(model: Any, points: list[Point], watch: NDArray[np.float64]) -> list[Found]:
    """Return regime, period (s), duty, swing (K) and the reason at every point of a row."""
    out: list[Found] = []
    before: Settled | None = None
    p, at, last = None, None, None
    for ring, power, detuning in points:
        if watch[0] > 0:
            raise KeyboardInterrupt
        try:
            if p is None or last is None or ring is not last[0]:
                p = problem(ring, model, power, detuning)
            if at is None or (ring, power) != last:
                at, last = internal(ring, model, absorbable(ring, power)), (ring, power)
            p = under_laser(p, power, detuning)
            cell, before = _point(p, stable_points(p, at), before)
        except (checks.InputError, RuntimeError, np.linalg.LinAlgError) as error:
            cell, before = ("failed", np.nan, np.nan, np.nan, str(error)), None
        out.append(cell)
    return out


def _point(p: CycleProblem, still: NDArray[np.float64], before: Settled | None) -> tuple[Found, Settled | None]:
    """One point; ``before`` is the neighbour's cycle."""
    found = None
    if before is not None and before.pulses == 1 and still.size == 0:
        near = shoot(p, before.orbit.start, before.orbit.T, 1, ROUGH, NEIGHBOUR_SHOTS)
        if near is not None and (size := float(np.abs(nontrivial(near)).max())) < 1:
            found = Settled(near, 1)
    if found is None:
        try:
            found = settled(p, np.zeros(p.units.size), points=still, error=ROUGH, longest=LONGEST)
        except RestError as rest:
            return (str(Regime.STABLE), np.nan, np.nan, 0.0, str(rest)), None
        except checks.InputError as error:
            return (str(Regime.SLOW_TRANSIENT), np.nan, np.nan, np.nan, str(error)), None
        size = float(np.abs(nontrivial(found.orbit)).max())
    seen = measure(p, found.orbit)
    words = f"settled cycle; a deviation shrinks to {size:.3g} of itself in a period"
    if found.pulses > 1:
        words += f"; {found.pulses} pulses in a period"
    return (str(Regime.SELF_PULSING), found.orbit.T * 1e-9, seen.duty, seen.swing, words), found
