"""Whether the rings of a map are hotter than the training of their thermal model."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.models import ThermalModel
from thermofem.models.contract import bare

from ..equilibria.steady import Internal, absorbable, fixed_points, internal
from ..thermal import Compact, trusted
from .grid import Grid, Point

NO_SWINGS = np.empty(0)


def trusted_map(model: ThermalModel, small: Compact, grid: Grid, swings: Array = NO_SWINGS) -> None:
    """Warn OutsideTrainingWarning where the fixed points, or the cycle with the largest swing, exceed the training.

    model: as the caller gave it; small: the same, compact.
    swings [shape of the map; K]: of the rings that pulse, nan of others; empty where they are not known.
    """
    if getattr(bare(model), "largest_rise", None) is None:
        return
    hottest = max(_at_rest(small, row) for row in grid.rows)
    if np.isfinite(swings).any():
        points = [point for row in grid.rows for point in row]
        hottest = max(hottest, _pulsing(small, points[int(np.nanargmax(swings))]))
    trusted(model, hottest)


def _at_rest(model: Compact, row: Sequence[Point]) -> float:
    """The highest rise at a fixed point of a row, K."""
    from ..equilibria import balance

    hottest = 0.0
    for (ring, power), points in groupby(row, key=lambda point: point[:2]):
        try:
            at: Internal = internal(ring, model, absorbable(ring, power))
            U = np.concatenate([fixed_points(ring, at, power, detuning)[0] for _, _, detuning in points])
        except checks.InputError:  # its cells have failed and say why
            continue
        hottest = max(hottest, float(balance.balances(U, at.rates, at.fcd, at.static)[2].max()))
    return hottest


def _pulsing(model: Compact, point: Point) -> float:
    """The highest rise of the cycle at a point, K; 0 where it is not found."""
    from ..cycles.limit_cycle import limit_cycle

    ring, power, detuning = point
    try:
        cycle: Any = limit_cycle(ring, model, power=power, detuning=detuning)
    except checks.InputError:
        return 0.0
    return float(cycle["delta_T"].max())
