"""Whether the rings of a map are hotter than the training of their thermal model."""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.models import ThermalModel
from thermofem.models.contract import bare

from ..equilibria.steady import fixed_points
from ..thermal import Compact, trusted
from .grid import Grid, Point
from .quick import at_rest

NO_SWINGS = np.empty(0)


def trusted_map(model: ThermalModel, small: Compact, grid: Grid, swings: Array = NO_SWINGS) -> None:
    """Warn OutsideTrainingWarning where the fixed points or the cycles that are likely the hottest exceed the training.

    model: as the caller gave it; small: the same, compact.
    swings [shape of the map; K]: of the rings that pulse, nan of others; empty where they are not known.
    """
    if getattr(bare(model), "largest_rise", None) is None:
        return
    rests = np.array([[_highest(small, point) for point in row] for row in grid.rows])
    hottest = float(rests.max())
    if np.isfinite(swings).any():
        points = [point for row in grid.rows for point in row]
        rests[np.isnan(swings)] = np.nan
        likely = {int(np.nanargmax(values)) for values in (swings, rests, swings + rests)}
        hottest = max(hottest, *(_pulsing(small, points[k]) for k in likely))
    trusted(model, hottest)


def _highest(model: Compact, point: Point) -> float:
    """The highest rise at a fixed point, K."""
    from ..equilibria import balance

    ring, power, detuning = point
    try:
        at = at_rest(ring, model, power)
        U, _ = fixed_points(ring, at, power, detuning)
    except checks.InputError:  # its cell has failed and says why
        return 0.0
    return float(balance.balances(U, at.rates, at.fcd, at.static)[2].max())


def _pulsing(model: Compact, point: Point) -> float:
    """The highest rise of the cycle at a point, K; 0 where it is not found."""
    from ..cycles.limit_cycle import limit_cycle

    ring, power, detuning = point
    try:
        cycle: Any = limit_cycle(ring, model, power=power, detuning=detuning)
    except checks.InputError:
        return 0.0
    return float(cycle["delta_T"].max())
