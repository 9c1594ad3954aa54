"""Where in the plane of power and detuning the ring is stable, bistable or self-pulsing, without any integration."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import OutputMap
from thermofem.data import dataset
from thermofem.data.record import Record, as_dataset, recorded
from thermofem.models import ThermalModel
from thermofem.models.contract import bare

from ..arguments import one_laser
from ..equilibria.steady import Internal, absorbable, internal, provenance
from ..heaters import constant
from ..resonator import RingResonator
from ..thermal import warn_at_top
from .grid import Grid, Point, grid_of
from .trust import trusted_map

Array = NDArray[np.float64]


@as_dataset
@one_laser
def stability_map(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> Record:
    """Classify every point of a map by the eigenvalues at all of its fixed points.

        d(perturbation)/dt = J(U, D) perturbation,     growth = max Re eigenvalue(J)

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`; the eigenvalues of a quadratic one are dense at every point, which takes longer.
    powers : array, shape (n,), W
        in the bus waveguide, larger than 0, increasing.
    detunings : array, shape (m,), Hz
        laser minus cold resonance, increasing.
    vary : mapping of str to array, optional
        other axes, as for `pulsing_map`.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over power (W) and detuning (Hz), or the axes given: regime, "self-pulsing" without a stable fixed point,
        "stable" with one, "bistable" with two or more; fixed_points and stable_points, their numbers; growth_rate
        (1/s) of the least unstable fixed point, and frequency (Hz) of its fastest growing or slowest decaying mode, 0
        if that is real.

    Raises
    ------
    InputError
        a power or detuning out of range or not increasing, an unknown name, not two axes, or a model that is not
        small, or not passive, or without a steady state at the powers.

    Where a limit cycle exists beside a stable point (a subcritical Hopf bifurcation, common with Newton's law), a ring
    switched on from cold may pulse although the point counts as stable here; `pulsing_map` integrates.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4, for the maps.
    """
    warm = constant(model, heaters, heated, read)
    grid = grid_of(ring, powers, detunings, vary, results=("frequency",)).warmed(warm)
    at = _internal(warm.model, grid)
    fixed, stable, growth, omega = survey_grid(at, grid)
    names = np.array(["self-pulsing", "stable", "bistable"])
    over = grid.names
    variables: dict[str, Any] = {
        "regime": (over, names[np.minimum(stable, 2).astype(int)], dataset.describe("regime")),
        "fixed_points": (over, fixed.astype(int), {"units": "1", "long_name": "number of fixed points"}),
        "stable_points": (over, stable.astype(int), {"units": "1", "long_name": "number of stable fixed points"}),
        "growth_rate": (over, growth, dataset.describe("growth_rate")),
        "frequency": (over, omega, dataset.describe("frequency")),
    }
    trusted_map(model, at.model, grid)
    attrs = provenance("stability map", ring, at.model) | grid.fixed | warm.attributes
    return recorded(variables, grid.coordinates(), attrs)


def _internal(model: ThermalModel, grid: Grid) -> Internal:
    """The first ring and the model, with heat at rest up to what any point of the grid can absorb."""
    largest = max(absorbable(ring, power) for row in grid.rows for ring, power, _ in row)
    small = bare(model)
    if isinstance(small, OutputMap) and 2 * small.coefficient * small.thermal_resistance * largest <= -1:
        warn_at_top(small, f"the ring may absorb up to {largest:.2g} W at these powers")
    return internal(grid.rows[0][0][0], model, largest)


def survey_grid(at: Internal, grid: Grid) -> Array:
    """Results of `spectrum.survey` at every point, in SI, shape (4, n, m), by as many threads as processors.

    Points of a row that share ring and power are surveyed at one go.
    """
    from ..equilibria import spectrum
    from ..kernels import equations as eq

    thermal = at.thermal.without_idle_poles()

    def part(points: list[Point]) -> Array:
        ring, power, _ = points[0]
        shifts = 2 * np.pi * eq.NS * np.array([nu for _, _, nu in points])
        return spectrum.survey(shifts, eq.internal_pump(ring, power), *eq.internal_rates(ring), thermal, at.static)

    def row(points: list[Point]) -> Array:
        if all(ring is points[0][0] and power == points[0][1] for ring, power, _ in points):
            return part(points)
        return np.concatenate([part([point]) for point in points], axis=1)

    first = row(grid.rows[0])  # compiles in one thread
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = np.array([first, *pool.map(row, grid.rows[1:])])
    unit = np.array([1, 1, 1 / eq.NS, 1 / (2 * np.pi * eq.NS)])[:, None, None]
    return np.asarray(rows.transpose(1, 0, 2) * unit)
