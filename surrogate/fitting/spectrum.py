"""Time-constant spectrum of heat data by nonnegative least squares: always stable, always passive.

    dT = sum_i R_i psi(t; tau_i),  R_i >= 0,  tau_i on a logarithmic grid,  sum_i R_i = R_th where it is known

There is nothing to search: the problem is convex and its optimum has few nonzero R_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from thermofem import Foster, checks
from thermofem.arrays import Array
from thermofem.data import quantity

from .fit import Fit, Training

if TYPE_CHECKING:
    import xarray as xr

MARGIN = 10.0  # the grid reaches this factor beyond the times that the data show
SLOW, BEYOND = 3.0, 0.1  # share of the resistance in poles so many times slower than the data that is worth a note


def fit_spectrum(
    data: xr.Dataset | Sequence[xr.Dataset],
    *,
    per_decade: int = 8,
    thermal_resistance: float | None = None,
) -> Fit:
    """Fit the spectrum of time constants.

    Parameters
    ----------
    data : Dataset or list of them
        each is weighted by its swing.
    per_decade : int, 2 to 40
        time constants of the grid in each decade.
    thermal_resistance : float, K/W
        static gain to impose; default the Datasets' own, where they carry it.

    Returns
    -------
    Fit
        a Foster network of typically 15 to 30 poles; ``standard_errors`` are nan, as the grid is not fitted.

    Raises
    ------
    InputError
        data without power or rise, or that no heating pole fits.
    """
    checks.between("per_decade", per_decade, 2, 40)
    training = Training.of(data, thermal_resistance=thermal_resistance, impose=True)
    problem = training.problem
    shortest, longest = problem.span
    low, high = shortest / MARGIN, longest * (MARGIN if problem.thermal_resistance is not None else 1)
    tau = np.geomspace(low, high, int(np.ceil(per_decade * np.log10(high / low))) + 1)
    phi = problem.columns(-np.log(tau))
    gain = problem.gains(phi)
    kept = gain > 0
    if not kept.any():
        raise checks.InputError("no pole of the spectrum heats; do power and delta_T belong together?")
    R = (gain * tau)[kept]
    if problem.thermal_resistance is not None:
        R = R * problem.thermal_resistance / R.sum()
    misfit = (problem.target - phi @ gain)[: problem.weight.size]
    training.check_explained(float(np.sqrt(np.mean(misfit**2))))
    count = R.size
    names = [f"{name}_{i}" for name in ("R", "tau") for i in range(1, count + 1)]
    fit = Fit(
        model=Foster(R=R, tau=tau[kept], **training.parts),
        parameters=dict(zip(names, [*R.tolist(), *tau[kept].tolist()], strict=True)),
        standard_errors=dict.fromkeys(names, float("nan")),
        correlations=np.full((2 * count, 2 * count), np.nan),
        residual=float(np.sqrt(np.mean((misfit / problem.weight) ** 2))),
        relative_residual=float(np.sqrt(np.mean(misfit**2))),
        training=training.names,
        notes=(*training.doubts, *_beyond(R, tau[kept], longest)),
        geometry=training.geometry,
    )
    return replace(fit, model=replace(fit.model, origin=fit.provenance))


def _beyond(R: Array, tau: Array, longest: float) -> list[str]:
    """A sentence where much of the thermal resistance lies in poles that the data are too short to show."""
    share = float(R[tau > SLOW * longest].sum() / R.sum())
    if share <= BEYOND:
        return []
    return [
        f"{share:.0%} of the thermal resistance lies in poles slower than {quantity.rounded(SLOW * longest, 's')}, "
        "which the data are too short to show: only the stated thermal_resistance says so"
    ]
