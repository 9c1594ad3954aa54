"""The settled cycles of a row of a map: every point from its neighbours' cycles where no fixed point is stable.

Where one is, the ring may rest there or pulse beside it; a transient from a cold ring decides which.
"""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import checks

from ..cycles.orbit import CycleProblem, closer, problem, shoot
from ..cycles.parameters import under_laser
from ..cycles.scheme import scheme
from ..cycles.start import FLAT, RestError, Settled, nontrivial, settled, stable_points
from ..equilibria.steady import absorbable, internal
from ..pulsing import DUTY_LEVEL, Regime
from .grid import Point

LONGEST = 3e5  # ns, a transient from a cold ring
SURE = 0.98  # a multiplier above which the rest of an error is magnified too much

AHEAD = {1: (1.0,), 2: (2.0, -1.0), 3: (3.0, -3.0, 1.0)}  # the next of a few equidistant values, by a polynomial

Found = tuple[str, float, float, float, str]


def settled_row(model: Any, points: list[Point], watch: NDArray[np.float64]) -> list[Found]:
    """Return regime, period (s), duty, swing (K) and the reason at every point of a row."""
    out: list[Found] = []
    before: list[Settled] = []  # cycles of the points just before, the last one first
    for (ring, power), group in groupby(points, key=lambda point: point[:2]):
        part = [detuning for _, _, detuning in group]
        try:
            p = problem(ring, model, power, part[0])
            at = internal(ring, model, absorbable(ring, power))
            still = _stable(p, at, part)
        except (checks.InputError, RuntimeError, np.linalg.LinAlgError) as error:
            out += [("failed", np.nan, np.nan, np.nan, str(error))] * len(part)
            before = []
            continue
        for detuning, rest in zip(part, still, strict=True):
            if watch[0] > 0:
                raise KeyboardInterrupt
            try:
                p = under_laser(p, power, detuning)
                cell, found = _point(p, stable_points(p, at) if rest else np.empty((0, 3)), before)
            except (checks.InputError, RuntimeError, np.linalg.LinAlgError) as error:
                cell, found = ("failed", np.nan, np.nan, np.nan, str(error)), None
            before = [] if found is None or found.pulses > 1 else [found, *before[:2]]
            out.append(cell)
    return out


def _stable(p: CycleProblem, at: Any, detunings: list[float]) -> NDArray[np.bool_]:
    """Whether a fixed point is stable at every detuning."""
    from ..equilibria import spectrum
    from ..kernels import equations as eq

    shifts = np.array([eq.internal_detuning(nu) for nu in detunings])
    seen = spectrum.survey(shifts, p.at.pump, at.rates, at.fcd, at.thermal.without_idle_poles(), at.static)
    return np.asarray(seen[1] > 0)


def _point(p: CycleProblem, still: NDArray[np.float64], before: list[Settled]) -> tuple[Found, Settled | None]:
    """One point; ``before`` are the cycles of up to three neighbours."""
    from ..kernels import orbit_measure

    found = _beside(p, before) if before and still.size == 0 else None
    if found is None:
        try:
            found = settled(p, np.zeros(p.units.size), points=still, rough=True, longest=LONGEST)
        except RestError as rest:
            return (str(Regime.STABLE), np.nan, np.nan, 0.0, str(rest)), None
        except checks.InputError as error:
            return (str(Regime.SLOW_TRANSIENT), np.nan, np.nan, np.nan, str(error)), None
    if found.size > SURE:
        found = found._replace(orbit=closer(p, found.orbit))
    orbit, size = found.orbit, found.size
    duty, swing, _, _ = orbit_measure.measured(orbit.start, orbit.Y, orbit.tau, p.at.thermal, scheme(), DUTY_LEVEL)
    words = f"settled cycle; a deviation shrinks to {size:.3g} of itself in a period"
    if found.pulses > 1:
        words += f"; {found.pulses} pulses in a period"
    return (str(Regime.SELF_PULSING), orbit.T * 1e-9, float(duty), float(swing), words), found


def _beside(p: CycleProblem, before: list[Settled]) -> Settled | None:
    """The stable cycle of one pulse next to those of neighbours; None where there is none."""
    ahead = np.array(AHEAD[len(before)])
    y = ahead @ np.stack([found.orbit.start for found in before])
    T = float(ahead @ np.array([found.orbit.T for found in before]))
    orbit = shoot(p, y, T, 1, True, before[0].orbit.M)
    if orbit is None or np.ptp(orbit.Y[:, :, 2]) <= FLAT * orbit.Y[:, :, 2].max():
        return None
    size = float(np.abs(nontrivial(orbit)).max())
    return Settled(orbit, 1, size) if size < 1 else None
