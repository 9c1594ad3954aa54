"""Where in the plane of power and detuning the ring is stable, bistable or self-pulsing, without any integration."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem.model import Foster, ThermalModel

from .resonator import RingResonator
from .steady import check_axis, check_ring, provenance
from .thermal import network

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


def stability_map(ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike) -> xr.Dataset:
    """Classify every point of a map by the eigenvalues at all of its fixed points.

        d(perturbation)/dt = J(U, D) perturbation,     growth = max Re eigenvalue(J)

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        linear and small: a Foster network or a StateSpace with at most 500 states.
    powers : array, shape (n,), W
        in the bus waveguide, larger than 0, increasing.
    detunings : array, shape (m,), Hz
        laser minus cold resonance, increasing.

    Returns
    -------
    xarray.Dataset
        over power (W) and detuning (Hz): regime, "self-pulsing" without a stable fixed point, "stable" with one,
        "bistable" with two or more; fixed_points and stable_points, their numbers; growth_rate (1/s) of the least
        unstable fixed point, and frequency (Hz) of its fastest growing or slowest decaying mode, 0 if that is real.

    Raises
    ------
    InputError
        a power or detuning out of range or not increasing, or a model that is not linear, small and passive.

    Where a limit cycle exists beside a stable point (a subcritical Hopf bifurcation, common with Newton's law), a ring
    switched on from cold may pulse although the point counts as stable here; `pulsing_map` integrates.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4, for the maps.
    """
    import xarray as xr

    from thermofem import dataset

    check_ring(ring)
    P, nu = check_axis("powers", powers), check_axis("detunings", detunings)
    poles = network(model)
    rows = _rows(ring, poles, P, nu)
    fixed, stable, growth, omega = (np.stack([row[k] for row in rows]) for k in range(4))
    names = np.array(["self-pulsing", "stable", "bistable"])
    over = ("power", "detuning")
    variables: dict[str, Any] = {
        "regime": (over, names[np.minimum(stable, 2).astype(int)], dataset.describe("regime")),
        "fixed_points": (over, fixed.astype(int), {"units": "1", "long_name": "number of fixed points"}),
        "stable_points": (over, stable.astype(int), {"units": "1", "long_name": "number of stable fixed points"}),
        "growth_rate": (over, growth, dataset.describe("growth_rate")),
        "frequency": (over, omega, dataset.describe("frequency")),
    }
    return xr.Dataset(variables, coords=axes_of(P, nu), attrs=provenance("stability map", ring, poles))


def axes_of(powers: Array, detunings: Array) -> dict[str, Any]:
    """Coordinates of a map."""
    from thermofem import dataset

    return {
        "power": ("power", powers, dataset.describe("input_power")),
        "detuning": ("detuning", detunings, dataset.describe("detuning")),
    }


def _rows(ring: RingResonator, model: Foster, powers: Array, detunings: Array) -> list[Array]:
    """What `spectrum.survey` finds at each power, in SI, by as many threads as there are processors."""
    from . import equations as eq
    from . import spectrum

    rates, fcd = eq.internal_rates(ring)
    poles = _heated_poles(eq.internal_poles(model))
    shifts = 2 * np.pi * eq.NS * detunings

    def row(power: float) -> Array:
        return spectrum.survey(shifts, eq.internal_drive(ring, power), rates, fcd, poles)

    first = row(float(powers[0]))  # compiles in one thread
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = [first, *pool.map(row, powers[1:].tolist())]
    unit = np.array([1, 1, 1 / eq.NS, 1 / (2 * np.pi * eq.NS)])[:, None]
    return [r * unit for r in rows]


def _heated_poles(poles: Array) -> Array:
    """The poles that heat reaches, equal ones merged: the rest neither grow nor are seen."""
    rate, where = np.unique(poles[1], return_inverse=True)
    merged = np.array([np.bincount(where, poles[0]), rate])
    return np.ascontiguousarray(merged[:, merged[0] > 0])
