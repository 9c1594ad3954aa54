"""The static output map dT = z + coefficient z^2 of a linear model, from steady solutions with k(T) or from data.

Source: G. Kirchhoff, Vorlesungen ueber die Theorie der Waerme (Teubner, 1894): with k(T) the integral of k obeys a
nearly linear heat equation, and the temperature is a function of it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import Foster, OutputMap, checks
from thermofem.algebra.poles import pole_responses
from thermofem.data.dataset import other_geometry, responses_of, warn_of
from thermofem.models import NonlinearSystem, check_single

from .reduce import reduce

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("thermofem")

OTHER = 0.1  # relative difference of thermal resistances that is told


def output_map(system: NonlinearSystem, power: float, *, linear: Foster | None = None) -> OutputMap:
    """Linear dynamics with the static map dT = z + coefficient z^2 of two nonlinear steady solutions.

    Parameters
    ----------
    system : NonlinearSystem
        ``heat.model("core", "core")``; one input, one output.
    power : float, W
        the largest of interest; the map is the least-squares one for it and half of it.
    linear : Foster
        default the certified reduction at 1e-4.

    Returns
    -------
    OutputMap
        measured as in `reduce_quadratic`: worst error 0.8 to 1.2 % of the peak rise, mean over the drives 0.2 to 0.3 %,
        the most of one drive 0.4 %; at 167 K 1.4 % and 0.5 %.

    Raises
    ------
    InputError
        a system that is linear or has several channels, a power without a steady state.
    """
    power = check_nonlinear(system, power)
    if linear is not None:
        checks.instance("linear", linear, Foster, hint="a linear network is needed, such as surrogate.reduce gives")
        own, given = system.thermal_resistance, linear.thermal_resistance
        if abs(given - own) > OTHER * own:
            log.warning("linear has R_th = %.4g K/W and the system %.4g: is it of another ring?", given, own)
    if linear is None:
        linear = reduce(system.linear, 1e-4).model  # type: ignore[assignment]  # one channel: a Foster network
    powers = np.array([power / 2, power])
    z = system.thermal_resistance * powers
    rise = np.array([float(system.steady_rise(p)[0]) for p in powers])
    coefficient = (rise - z) @ z**2 / (z**2 @ z**2)
    return _mapped(linear, float(coefficient), float(rise[-1]), "output map of k(T) steady states")  # type: ignore[arg-type]


def fit_output_map(linear: Foster, data: xr.Dataset | Sequence[xr.Dataset]) -> OutputMap:
    """The static map of the output, dT = z + coefficient z^2, that fits data best; the linear model is kept.

    Parameters
    ----------
    linear : Foster
        at small power, as of `reduce` or a fit to a weak drive.
    data : Dataset or list of them
        with rises large enough to show the nonlinearity.

    Raises
    ------
    InputError
        data without power or rise.
    """
    checks.instance("linear", linear, Foster, hint="a linear network is needed, such as surrogate.reduce gives")
    responses = responses_of(data)
    warn_of(responses)
    datasets: Any = data if isinstance(data, list | tuple) else [data]
    if any(other_geometry(linear.origin, one.attrs) for one in datasets):
        log.warning("the data are of another geometry than the linear model: the coefficient takes up the difference")
    rate = 1 / np.asarray(linear.tau)
    z = np.concatenate([pole_responses(rate, d.wave, d.times, periodic=d.periodic) @ linear.gain for d in responses])
    rise = np.concatenate([d.rise for d in responses])
    coefficient = float((rise - z) @ z**2 / (z**2 @ z**2))
    return _mapped(linear, coefficient, float(rise.max()), "output map of a linear model, fitted to data")


def _mapped(linear: Foster, coefficient: float, largest_rise: float, method: str) -> OutputMap:
    """The output map over a linear model, with the provenance of that model."""
    origin = {**(linear.origin or {}), "method": method, "linear_method": (linear.origin or {}).get("method")}
    return OutputMap(linear, coefficient, largest_rise, origin)


def check_nonlinear(system: NonlinearSystem, power: float) -> float:
    """The power, where the system has laws of temperature and one channel.

    Raises InputError: a system that is linear or has several channels, a power out of range.
    """
    hint = "heat.model(heated, read) of a geometry with laws of temperature is needed; others take surrogate.reduce"
    checks.instance("system", system, NonlinearSystem, hint=hint)
    check_single(system)
    return checks.power("power", power)
