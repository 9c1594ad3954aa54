"""Where in the plane of power and detuning the ring is stable, bistable or self-pulsing, without any integration."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, dataset
from thermofem.arrays import Array, ArrayLike
from thermofem.models import ThermalModel

from ..equilibria.balance import absorbable
from ..heaters import warmed
from ..kernel.units import NS
from ..resonator import RingResonator
from ..thermal import Compact, provenance, trusted, warn_at_top
from .grid import Grid, fixed_of, grid_of


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
) -> xr.Dataset:
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
    warm = warmed(ring, model, heaters, heated, read)
    grid = grid_of(ring, powers, detunings, vary).warmed(warm)
    small = warm.model
    fixed, stable, growth, omega, rise = _survey(small, grid)
    trusted(model, rise)
    names = np.array(["self-pulsing", "stable", "bistable"])
    over = grid.names
    variables: dict[str, Any] = {
        "regime": (over, names[np.minimum(stable, 2).astype(int)], dataset.describe("regime")),
        "fixed_points": (over, fixed.astype(int), {"units": "1", "long_name": "number of fixed points"}),
        "stable_points": (over, stable.astype(int), {"units": "1", "long_name": "number of stable fixed points"}),
        "growth_rate": (over, growth, dataset.describe("growth_rate")),
        "frequency": (over, omega, dataset.describe("frequency")),
    }
    attrs = provenance("stability map", ring, small) | grid.fixed | warm.attributes
    return xr.Dataset(variables, grid.coordinates(), attrs)


def _survey(model: Compact, grid: Grid) -> Array:
    """Return numbers of fixed and stable points, growth (1/s), frequency (Hz), highest rise (K), shape (5, n, m)."""
    points = grid.points
    largest = max(absorbable(ring, power) for ring, power, _ in points)
    if model.thermal_resistance * largest >= 2 * model.top:
        warn_at_top(model.top, f"the ring may absorb up to {largest:.2g} W at these powers")
    rows = []
    for found in fixed_of(model, points):
        if isinstance(found, str):
            raise InputError(found)
        least = found.growth.argmin()
        stable = (found.growth <= 0).sum()
        growth = found.growth[least] / NS
        omega = found.omega[least] / (2 * np.pi * NS)
        rows.append([found.growth.size, stable, growth, omega, found.every[:, 2].max()])
    return np.array(rows).T.reshape(5, *(axis.size for axis in grid.axes))
