"""Uncertainty of a property of a ring under fabrication tolerances, with the sensitivity to each parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.data import quantity

from ..family import Family
from ..family.interpolation import interpolate_members
from .inverse_search import Follows, Property, Quantity, word

if TYPE_CHECKING:
    import xarray as xr

MOST = 2**20  # base samples: a gigabyte, and a standard error of the mean of a thousandth of the deviation
RESAMPLES = 200  # of the members, for the intervals of the indices
NEEDED = "a distribution of scipy.stats with its numbers is needed"
ONE_DEVIATION = 0.158655, 0.841345  # shares of a normal distribution below its mean minus and plus one deviation
OUTSIDE = 1e-3  # share of the samples that may leave the box; they are held at its edge


def uncertainty(
    family: Family,
    distributions: Mapping[str, Any],
    quantity: Quantity = "thermal_resistance",
    *,
    samples: int = 1024,
    fixed: Mapping[str, float] | None = None,
    optics: Follows | None = None,
    interpolate: int | None = None,
    executor: Executor | None = None,
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
        "thermal_resistance", "rise_time", "time_constant", or a function of a thermal model, see `surrogate.design`;
        one that returns an array (a DataArray keeps its coordinates) is a map, and one of Booleans a map of
        probabilities. Members without the property (nan, or InputError) are counted and left out; Sobol indices then
        hold for the others together with their mean in the place of those.
    samples : int
        base samples n, a power of two; the property is worked out n (p + 2) times for p parameters.
    fixed : dict from parameter to float
        of the parameters that are not varied; default the middle of their range, the geometric mean of a positive one.
    optics : Optics or coupled.ring_family.MovingRing
        how the optics follow the geometry; functions then take a second argument, the dict of changes.
    interpolate : int
        compute the property for this number of members only and interpolate between them (scikit-learn); for a
        property that takes long.
    executor : concurrent.futures.Executor
        where members are worked out, such as that of a Dask client; the quantity must then be one that it can pickle.
    seed : int

    Returns
    -------
    xarray.Dataset
        over "parameter": first_order and total_order with their 95 % intervals (``_low``, ``_high``, by bootstrap), and
        per_deviation, half the change from 16 to 84 % of one parameter; with ``optics`` also per_deviation_heat, with
        the optics at rest; over "sample": ``value``. Attributes: mean, standard_deviation, quantile_05, quantile_50,
        quantile_95, missing (share of members without the property), and with ``interpolate`` interpolation_error (rms)
        and interpolation_worst, relative, over held-out members. Of a map: mean (of Booleans the probability),
        standard_deviation, first_order and total_order at every point (nan where nothing varies). Without ``optics``
        it is the thermal part alone.

    Raises
    ------
    InputError
        a parameter that the family does not have, or that is fixed and varied at once; more than 0.1 % of the samples
        outside its box; samples that are no power of two.

    Source: I. M. Sobol, Math. Comput. Simul. 55, 271 (2001); estimators of `scipy.stats.sobol_indices`.
    """
    fixed = checks.mapping("fixed", fixed)
    names = _checked(family, checks.mapping("distributions", distributions), fixed, samples)
    dists = [_Distribution(name, distributions[name]) for name in names]
    one = Property(family, quantity, optics)
    sampled = _Sampled(_many(one, names, fixed, executor), _clip(family, names), lambda: one.reason)
    attrs: dict[str, Any] = {"quantity": word(quantity), "samples": samples}
    if interpolate is not None:
        low, high = np.array(_box(family, names)).T
        made = interpolate_members(sampled.scalars, dists, (low, high), interpolate, sampled.reason)
        attrs |= {"interpolate": interpolate, "interpolation_error": made.error, "interpolation_worst": made.worst}
        sampled.values = made
    indices = _sobol(sampled, dists, samples, seed)
    if sampled.like is not None:
        return _map(sampled, indices, names, attrs)
    found = _scalar(sampled, indices, names, attrs)
    per = {"per_deviation": _per_deviation(one, dists, fixed)}
    if optics is not None:
        rest = Property(family, quantity, _Still(optics, _values(family, dists, fixed)))
        per["per_deviation_heat"] = _per_deviation(rest, dists, fixed)
    return found.assign({name: ("parameter", values) for name, values in per.items()})


@dataclass(frozen=True)
class _Still:
    """Optics that stay as they are at one member."""

    optics: Follows
    at: Mapping[str, float]

    def check(self, family: Family) -> None:
        self.optics.check(family)

    def changes(self, family: Family, values: Mapping[str, float]) -> dict[str, float]:
        return self.optics.changes(family, self.at)


def _values(family: Family, dists: Sequence[Any], fixed: Mapping[str, float]) -> dict[str, float]:
    """The member at the medians."""
    middle = dict(zip(family.names, family.box.middle.tolist(), strict=True))
    return {**middle, **fixed, **{d.name: float(d.ppf(np.array(0.5))) for d in dists}}


def _per_deviation(one: Property, dists: Sequence[Any], fixed: Mapping[str, float]) -> Array:
    """Half the change of the property from 16 to 84 % of one parameter, the others at their medians, shape (p,)."""
    at, found = _values(one.family, dists, fixed), []
    for d in dists:
        low, high = (float(d.ppf(np.array(q))) for q in ONE_DEVIATION)
        found.append(float(one({**at, d.name: high}) - one({**at, d.name: low})) / 2)
    return np.array(found)


def _checked(
    family: Family, distributions: Mapping[str, Any], fixed: Mapping[str, float], samples: int
) -> tuple[str, ...]:
    checks.instance("family", family, Family, hint="surrogate.train_family gives one")
    names = tuple(distributions)
    if not names:
        raise checks.InputError("distributions is empty; give one for at least one parameter")
    for name in (*names, *fixed):
        checks.choice("parameter", name, family.names)
    for name in fixed:
        if name in distributions:
            raise checks.InputError(f"{name} is fixed and has a distribution, too; give one of the two")
    for name, one in distributions.items():
        checks.has(name, one, "ppf", hint=NEEDED)
    if not isinstance(samples, int) or not 2 <= samples <= MOST or samples & (samples - 1):
        raise checks.InputError(f"samples = {checks.shown(samples)} must be a power of two, at most {MOST}")
    return names


class _Distribution(NamedTuple):
    """A distribution whose samples are numbers."""

    name: str
    given: Any

    def ppf(self, q: Array) -> Array:
        """Values at the shares ``q``."""
        found = checks.numbers(f"{self.name}: the distribution", self.given.ppf(q), hint="are its numbers in range?")
        return np.broadcast_to(found, np.shape(q))


class _Sampled:
    """The property of samples; values are kept as they are computed.

    values: from parameters of shape (p, n), inside the box, to shape (n,) or (n, *shape of a map).
    clip, reason: holds samples inside the box; says why members lack the property.
    """

    def __init__(
        self, values: Callable[[Array], Any], clip: Callable[[Array], Array], reason: Callable[[], str]
    ) -> None:
        self.values, self.clip, self.reason = values, clip, reason
        self.seen: list[Array] = []
        self.like: Any = None  # a member's map, where the property is one

    def scalars(self, x: Array) -> Array:
        found = self.values(self.clip(x))
        if np.ndim(found[0]):
            raise checks.InputError("interpolate is for one number, and the quantity returns an array")
        return np.asarray(found, dtype=float)

    def __call__(self, x: Array) -> Array:
        """As `scipy.stats.sobol_indices` wants it, shape (points, n)."""
        found = self.values(self.clip(x))
        if isinstance(found, np.ndarray):
            table = found[:, None].astype(float)
        else:
            maps = [one for one in found if np.ndim(one)]
            if maps:
                self.like = maps[0]
                found = [one if np.ndim(one) else np.full(np.shape(self.like), np.nan) for one in found]
            table = np.array([np.ravel(one) for one in found], dtype=float)
        self.seen.append(table)
        if np.isnan(table).all():
            raise checks.InputError(f"no sample has the property: {self.reason()}")
        whole = np.where(np.isnan(table), np.nanmean(table, axis=0), table).T
        return np.tile(whole, (2, 1)) if len(whole) == 1 else whole  # SciPy fails on one property of one parameter

    @property
    def every(self) -> Array:
        """The two independent sets of samples, shape (2 n, points)."""
        return np.concatenate(self.seen[:2])


def _sobol(sampled: _Sampled, dists: list[Any], samples: int, seed: int) -> Any:
    from scipy.stats import sobol_indices

    with np.errstate(divide="ignore", invalid="ignore"):  # points of a map where nothing varies
        return sobol_indices(func=sampled, n=samples, dists=dists, rng=np.random.default_rng(checks.seed(seed)))


def _scalar(sampled: _Sampled, indices: Any, names: tuple[str, ...], attrs: dict[str, Any]) -> xr.Dataset:
    import xarray as xr

    every = sampled.every[:, 0]
    there = every[~np.isnan(every)]
    data = {}
    intervals = _intervals(sampled, len(names), attrs["samples"])
    for kind in ("first_order", "total_order"):
        column = np.reshape(getattr(indices, kind), (2, len(names)))[0]
        low, high = intervals[kind]
        for suffix, array in (("", column), ("_low", low), ("_high", high)):
            data[kind + suffix] = ("parameter", array, {"long_name": f"Sobol index, {kind}", "units": "1"})
    low, half, high = np.quantile(there, (0.05, 0.5, 0.95))
    attrs |= {
        "mean": float(there.mean()),
        "standard_deviation": float(there.std(ddof=1)),
        "quantile_05": float(low),
        "quantile_50": float(half),
        "quantile_95": float(high),
        "missing": float(np.isnan(every).mean()),
    }
    value = ("sample", every, {"long_name": attrs["quantity"]})
    return xr.Dataset({**data, "value": value}, coords={"parameter": list(names)}, attrs=attrs)


def _intervals(sampled: _Sampled, parameters: int, n: int) -> dict[str, tuple[Array, Array]]:
    """95 % of the indices of resampled members; SciPy's own bootstrap takes a time that grows with n^2."""
    A, B, AB = (np.where(np.isnan(f), np.nanmean(f), f) for f in (table[:, 0] for table in sampled.seen))
    middle = np.concatenate([A, B]).mean()
    A, B, AB = A - middle, B - middle, AB.reshape(n, parameters).T - middle
    rng, found = np.random.default_rng(0), []
    for _ in range(RESAMPLES):
        k = rng.integers(n, size=n)
        a, b, ab = A[k], B[k], AB[:, k]
        variance = max(np.concatenate([a, b]).var(), 1e-300)
        found.append([(b * (ab - a)).mean(axis=1) / variance, ((a - ab) ** 2).mean(axis=1) / 2 / variance])
    low, high = np.quantile(found, (0.025, 0.975), axis=0)
    return {"first_order": (low[0], high[0]), "total_order": (low[1], high[1])}


def _map(sampled: _Sampled, indices: Any, names: tuple[str, ...], attrs: dict[str, Any]) -> xr.Dataset:
    import xarray as xr

    like = xr.DataArray(sampled.like)
    boolean, shape = like.dtype == bool, like.shape
    every = sampled.every
    spread = np.nanstd(every, axis=0, ddof=1)
    quiet = spread == 0
    words = "probability" if boolean else f"mean of {attrs['quantity']}"
    data: dict[str, Any] = {
        "mean": (like.dims, np.nanmean(every, axis=0).reshape(shape), {"long_name": words}),
        "standard_deviation": (like.dims, spread.reshape(shape), {"long_name": "standard deviation"}),
    }
    for kind in ("first_order", "total_order"):
        table = np.reshape(getattr(indices, kind), (-1, len(names)))[: quiet.size]
        table = np.where(quiet[:, None], np.nan, table).T.reshape(len(names), *shape)
        data[kind] = (("parameter", *like.dims), table, {"long_name": f"Sobol index, {kind}", "units": "1"})
    coords = {name: one for name, one in like.coords.items() if set(one.dims) <= set(like.dims)}
    attrs |= {"missing": float(np.isnan(every).any(axis=1).mean())}
    return xr.Dataset(data, coords={"parameter": list(names), **coords}, attrs=attrs)


def _box(family: Family, names: tuple[str, ...]) -> list[tuple[float, float]]:
    places = [family.names.index(name) for name in names]
    return [(float(family.box.low[k]), float(family.box.high[k])) for k in places]


def _clip(family: Family, names: tuple[str, ...]) -> Callable[[Array], Array]:
    """Samples held inside the box, or InputError where more than a few leave it."""

    def clip(x: Array) -> Array:
        rows = []
        for name, column, (low, high) in zip(names, x, _box(family, names), strict=True):
            out = float(((column < low) | (column > high)).mean())
            if out > OUTSIDE:
                unit = family.box.units[family.names.index(name)]
                ends = " to ".join(quantity.rounded(end, unit, 6) for end in (low, high))
                raise checks.InputError(
                    f"{name}: {out:.1%} of the samples lie outside the family's {ends}; "
                    "train one that reaches four standard deviations beyond the mean"
                )
            rows.append(np.clip(column, low, high))
        return np.array(rows)

    return clip


def _many(
    one: Property, names: tuple[str, ...], fixed: Mapping[str, float], executor: Executor | None
) -> Callable[[Array], Any]:
    """The property of many members from parameters of shape (p, n); the resistance of all members in one call."""
    family = one.family
    middle = dict(zip(family.names, family.box.middle, strict=True))
    rest = {name: checks.finite(name, fixed.get(name, middle[name])) for name in family.names if name not in names}

    def values(x: Array) -> Any:
        if one.quantity == "thermal_resistance":
            columns: dict[str, Any] = {**dict(zip(names, x, strict=True)), **rest}
            return family.thermal_resistance(**columns)
        return one.many([{**rest, **dict(zip(names, column, strict=True))} for column in x.T.tolist()], executor)

    return values
