"""Uncertainty of a property of a ring under fabrication tolerances, with the sensitivity to each parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster, checks

from .design import QUANTITIES
from .family import Family

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

OUTSIDE = 1e-3  # share of the samples that may leave the box; they are held at its edge


def uncertainty(
    family: Family,
    distributions: Mapping[str, Any],
    quantity: str | Callable[[Foster], float] = "thermal_resistance",
    *,
    samples: int = 1024,
    fixed: Mapping[str, float] | None = None,
    seed: int = 0,
) -> xr.Dataset:
    """Distribution of a property of the members, and the Sobol index of every parameter.

        S_i = Var(E[q | p_i])/Var(q),    T_i = 1 - Var(E[q | all but p_i])/Var(q)

    Parameters
    ----------
    family : Family
    distributions : dict from parameter to a SciPy distribution
        independent: ``{"radius": scipy.stats.norm(7e-6, 20e-9)}``; anything with ``ppf``.
    quantity : str or callable
        "thermal_resistance", "rise_time", or a function of a thermal model, see `surrogate.design`. Members without the
        property (nan, or InputError) are counted and left out; Sobol indices then hold for the others together with
        their mean in the place of those.
    samples : int
        base samples n, a power of two; the property is worked out n (p + 2) times for p parameters.
    fixed : dict from parameter to float
        of the parameters that are not varied; default the middle of their range.
    seed : int

    Returns
    -------
    xarray.Dataset
        over "parameter": first_order and total_order with their 95 % intervals (``_low``, ``_high``, by bootstrap);
        over "sample": ``value``. Attributes: mean, standard_deviation, quantile_05, quantile_50, quantile_95, missing
        (share of members without the property). The optics' dependence on geometry is not part of it.

    Raises
    ------
    InputError
        a parameter that the family does not have, more than 0.1 % of the samples outside its box, or samples that are
        no power of two.

    Source: I. M. Sobol, Math. Comput. Simul. 55, 271 (2001); estimators of `scipy.stats.sobol_indices`.
    """
    import xarray as xr
    from scipy.stats import sobol_indices

    if not isinstance(family, Family):
        raise checks.InputError(f"family is a {type(family).__name__}; surrogate.train_family gives one")
    names = tuple(distributions)
    if not names:
        raise checks.InputError("distributions is empty; give one for at least one parameter")
    for name in (*names, *(fixed or {})):
        checks.choice("parameter", name, family.names)
    for name, one in distributions.items():
        checks.has(name, one, "ppf", hint="a distribution of scipy.stats with its numbers is needed")
    if samples < 2 or samples & (samples - 1):
        raise checks.InputError(f"samples = {samples} must be a power of two")
    values = _property(family, names, quantity, fixed or {})
    seen: list[Array] = []

    def function(x: Array) -> Array:
        found = values(x)
        seen.append(found)
        return np.where(np.isnan(found), np.nanmean(found), found)[None]

    dists = [distributions[name] for name in names]
    indices = sobol_indices(func=function, n=samples, dists=dists, rng=np.random.default_rng(seed))
    ends = indices.bootstrap(confidence_level=0.95, n_resamples=200)
    every = np.concatenate(seen[:2])  # the two independent sets of samples
    there = every[~np.isnan(every)]
    data = {}
    for kind in ("first_order", "total_order"):
        interval = getattr(ends, kind).confidence_interval
        for suffix, array in (("", getattr(indices, kind)), ("_low", interval.low), ("_high", interval.high)):
            data[kind + suffix] = ("parameter", np.ravel(array), {"long_name": f"Sobol index, {kind}", "units": "1"})
    low, half, high = np.quantile(there, (0.05, 0.5, 0.95))
    return xr.Dataset(
        {**data, "value": ("sample", every, {"long_name": _word(quantity)})},
        coords={"parameter": list(names)},
        attrs={
            "quantity": _word(quantity),
            "mean": float(there.mean()),
            "standard_deviation": float(there.std(ddof=1)),
            "quantile_05": float(low),
            "quantile_50": float(half),
            "quantile_95": float(high),
            "missing": float(np.isnan(every).mean()),
        },
    )


def _word(quantity: str | Callable[[Foster], float]) -> str:
    return quantity if isinstance(quantity, str) else getattr(quantity, "__name__", "quantity")


def _property(
    family: Family, names: tuple[str, ...], quantity: str | Callable[[Foster], float], fixed: Mapping[str, float]
) -> Callable[[Array], Array]:
    """The property of many members, from an array of shape (parameters, n); nan where a member has none."""
    middle = dict(zip(family.names, family.box.middle, strict=True))
    rest = {name: float(fixed.get(name, middle[name])) for name in family.names if name not in names}
    ends = {name: (lo, hi) for name, lo, hi in zip(family.names, family.box.low, family.box.high, strict=True)}
    one: Callable[[Foster], float] | None = None
    if not isinstance(quantity, str):
        one = quantity
    elif checks.choice("quantity", quantity, QUANTITIES, hint="or give a function of a model") != "thermal_resistance":
        one = QUANTITIES[quantity]

    def values(x: Array) -> Array:
        inside = {}
        for name, column in zip(names, x, strict=True):
            low, high = ends[name]
            out = float(((column < low) | (column > high)).mean())
            if out > OUTSIDE:
                raise checks.InputError(
                    f"{name}: {out:.1%} of the samples lie outside the family's {low:g} .. {high:g}; train a wider one"
                )
            inside[name] = np.clip(column, low, high)
        if one is None:
            rows = family.box.rows({**inside, **rest})
            channel = family.ports.index(family.inputs[0]), family.ports.index(family.outputs[0])
            return family.members.resistances(rows, *channel)
        found = np.empty(x.shape[1])
        for k in range(found.size):
            model = family.at({**rest, **{name: float(column[k]) for name, column in inside.items()}})
            try:
                found[k] = one(model)
            except checks.InputError:
                found[k] = np.nan
        return found

    return values
