"""Whether the rings of a map are hotter than the training of their thermal model."""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.models import ThermalModel
from thermofem.models.contract import bare

from ..contradictions import without_origin
from ..equilibria.balance import absorbable, balance, fixed_points, internal_ring
from ..kernel.units import internal_detuning, internal_pump
from ..thermal import Compact, trusted
from .grid import Grid, Point

NO_SWINGS = np.empty(0)


def trusted_map(model: ThermalModel, small: Compact, grid: Grid, swings: Array = NO_SWINGS) -> None:
    """Warn OutsideTrainingWarning where the fixed points or the cycles that are likely the hottest exceed the training.

    model: as the caller gave it; small: the same, compact.
    swings [shape of the map; K]: of the rings that pulse, nan of others; empty where they are not known.
    """
    if getattr(bare(model), "largest_rise", None) is None:
        return
    rests = _highest(small, grid)
    hottest = float(rests.max())
    if np.isfinite(swings).any():
        points = [point for row in grid.rows for point in row]
        rests[np.isnan(swings)] = np.nan
        likely = {int(np.nanargmax(values)) for values in (swings, rests, swings + rests)}
        hottest = max(hottest, *(_pulsing(small, points[k]) for k in likely))
    trusted(model, hottest)


def _highest(model: Compact, grid: Grid) -> Array:
    """The highest rise at a fixed point of every cell, K."""
    points = [point for row in grid.rows for point in row]
    out = np.zeros(len(points))
    for ring in dict.fromkeys(ring for ring, _, _ in points):
        cells = np.array([k for k, point in enumerate(points) if point[0] == ring])
        pump = np.array([internal_pump(ring, points[k][1]) for k in cells])
        shift = np.array([internal_detuning(points[k][2]) for k in cells])
        try:
            at = internal_ring(ring, model, max(absorbable(ring, points[k][1]) for k in cells))
        except checks.InputError:  # its cells have failed and say why
            continue
        U, _, cell = fixed_points(pump, shift, at)
        np.maximum.at(out, cells[cell], balance(U, at).dT)
    return out.reshape(len(grid.rows), -1)


def _pulsing(model: Compact, point: Point) -> float:
    """The highest rise of the cycle at a point, K; 0 where it is not found."""
    from ..cycles.limit_cycle import limit_cycle

    ring, power, detuning = point
    try:
        cycle: Any = limit_cycle(ring, without_origin(model), power=power, detuning=detuning)
    except checks.InputError:
        return 0.0
    return float(cycle["delta_T"].max())
