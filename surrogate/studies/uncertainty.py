"""Uncertainty of a property of a ring under fabrication tolerances, with the sensitivity to each parameter."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import qmc

from thermofem import checks
from thermofem.arrays import Array

from ..family import Family
from ..family.interpolation import TAIL_PROBABILITY, interpolate_members
from .inverse_search import Follows, Property, Quantity, word

MOST_BASE_SAMPLES = 2**20  # a gigabyte, and a standard error of the mean of a thousandth of the deviation
ONE_DEVIATION = 0.158655, 0.841345  # shares of a normal distribution below its mean minus and plus one deviation
INDICES = "first_order", "total_order"


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
    heated: str | None = None,
    read: str | None = None,
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
        probabilities. Members without the property (nan, or InputError) are counted and left out of the statistics;
        for the Sobol indices each takes the mean of the others.
    samples : int
        base samples n, a power of two; the property is worked out n (p + 2) times for p parameters.
    fixed : dict from parameter to float
        of the parameters that are not varied; default the middle of their range, the geometric mean of a positive one.
    optics : Optics or coupled.ring_family.MovingRing
        how the optics follow the geometry; functions then take a second argument, the dict of changes.
    interpolate : int
        compute the property for this number of members only and interpolate between them, by a polynomial;
        for a property that takes long.
    executor : concurrent.futures.Executor
        where members are worked out, such as that of a Dask client; the quantity must then be one that it can pickle.
    seed : int
    heated, read : str
        the channel of the members; default the first heated part, and itself or what the family reads first. A function
        then gets `Family.at`, which has the output "light", too, where the family reads it.

    Returns
    -------
    xarray.Dataset
        over "parameter": first_order and total_order with their 95 % intervals (``_low``, ``_high``, by bootstrap), and
        per_deviation, half the change from 16 to 84 % of one parameter; with ``optics`` also per_deviation_heat, with
        the optics at rest; over "sample": ``value``. Attributes: mean, standard_deviation, quantile_05, quantile_50,
        quantile_95, missing (share of members without the property), and with ``interpolate`` interpolation_error
        (rms, relative, over held-out members), heated and read. Of a map: mean (of Booleans the probability),
        standard_deviation, first_order and total_order at every point (nan where nothing varies). Without ``optics``
        it is the thermal part alone.

    Raises
    ------
    InputError
        a parameter that the family does not have, or that is fixed and varied at once; more than 0.1 % of the samples
        outside its box; samples that are no power of two.

    Source: I. M. Sobol, Math. Comput. Simul. 55, 271 (2001); estimators in `_indices`.
    """
    fixed = checks.mapping("fixed", fixed)
    _check(family, distributions, fixed, samples)
    study = _Study(Property(family, quantity, optics, heated, read), distributions, fixed, executor)
    attrs: dict[str, Any] = {"quantity": word(quantity), "samples": samples}
    attrs |= {"heated": study.of_member.channel.heated, "read": study.of_member.read}
    values: Callable[[Array], Any] = study.values
    if interpolate is not None:
        tails = np.tile([TAIL_PROBABILITY, 1 - TAIL_PROBABILITY], (len(distributions), 1))
        low, high = study.box
        span = np.clip(study.quantiles(tails), low[:, None], high[:, None])
        values, rms = interpolate_members(study.values, span, interpolate, lambda: study.of_member.reason)
        attrs |= {"interpolate": interpolate, "interpolation_error": rms}
    results: list[Any] = []
    for x in study.sets(samples, seed):
        results.extend(values(x))
        if all(np.isnan(value).all() for value in results):
            raise checks.InputError(f"no sample has the property: {study.of_member.reason}")
    names = list(distributions)
    like = next((value for value in results if np.ndim(value)), None)
    if like is None:
        data = _of_numbers(np.reshape(results, (-1, samples)), names, attrs)
        data["per_deviation"] = ("parameter", study.per_deviation())
        if optics is not None and callable(quantity):
            changes = optics.changes(family, study.medians)
            still = Property(family, lambda model: quantity(model, changes), heated=heated, read=read)
            data["per_deviation_heat"] = ("parameter", replace(study, of_member=still).per_deviation())
        return data
    points = np.size(like)
    missing = np.full(points, np.nan)
    table = [np.ravel(value) if np.ndim(value) else missing for value in results]
    return _of_maps(np.reshape(table, (-1, samples, points)), xr.DataArray(like), names, attrs)


def _check(family: Family, distributions: Mapping[str, Any], fixed: Mapping[str, float], samples: int) -> None:
    for name in (*distributions, *fixed):
        checks.choice("parameter", name, family.names)
    checks.unique("distributions and fixed", [*distributions, *fixed], hint="a parameter varies or is fixed")
    for name, distribution in distributions.items():
        checks.has(name, distribution, "ppf", hint="a distribution of scipy.stats with its numbers is needed")
    countable = isinstance(samples, int) and 2 <= samples <= MOST_BASE_SAMPLES
    if not countable or samples & (samples - 1):
        shown = checks.shown(samples)
        raise checks.InputError(f"samples = {shown} must be a power of two, at most {MOST_BASE_SAMPLES}")


@dataclass(frozen=True, eq=False)
class _Study:
    """A property, the distributions of the p parameters that vary, and the values of fixed parameters."""

    of_member: Property
    distributions: Mapping[str, Any]
    fixed: Mapping[str, float]
    executor: Executor | None

    @property
    def box(self) -> tuple[Array, Array]:
        """Both ends of the family's ranges, shape (p,)."""
        ranges = self.of_member.family.ranges
        low, high = np.array([ranges[name] for name in self.distributions]).T
        return low, high

    @property
    def held(self) -> dict[str, float]:
        """Values by name of the parameters that do not vary."""
        box = self.of_member.family.box
        values = box.named(box.middle) | dict(self.fixed)
        return {name: checks.finite(name, x) for name, x in values.items() if name not in self.distributions}

    @property
    def medians(self) -> dict[str, float]:
        """Parameters by name at the medians of the distributions."""
        halves = np.full((len(self.distributions), 1), 0.5)
        medians = self.quantiles(halves)[:, 0].tolist()
        return self.held | dict(zip(self.distributions, medians, strict=True))

    def quantiles(self, shares: Array) -> Array:
        """Quantiles of the p distributions at the probabilities ``shares``, shape (p, n)."""
        quantiles = []
        for (name, distribution), q in zip(self.distributions.items(), shares, strict=True):
            hint = "are its numbers in range?"
            x = checks.numbers(f"{name}: the distribution", distribution.ppf(q), hint=hint)
            quantiles.append(np.broadcast_to(x, q.shape))
        return np.array(quantiles)

    def sets(self, samples: int, seed: int) -> list[Array]:
        """Two independent sets of members A and B, and A with one parameter of B for each; shape (p, samples).

        InputError where more than a few leave the box; those are held at its edge.
        """
        p = len(self.distributions)
        low, high = np.array(self.box)[..., None]
        sobol = qmc.Sobol(2 * p, bits=64, seed=np.random.default_rng(checks.seed(seed)))
        A, B = map(self.quantiles, sobol.random(samples).T.reshape(2, p, samples))
        outside = [((x < low) | (x > high)).mean(axis=1) for x in (A, B)]
        self._check_shares(np.max(outside, axis=0))
        A = np.clip(A, low, high)
        B = np.clip(B, low, high)
        swapped = np.eye(p, dtype=bool)[..., None]
        return [A, B, *np.where(swapped, B, A)]

    def _check_shares(self, outside: Array) -> None:
        """Raise InputError where more than a few samples leave the box; ``outside``: their share, shape (p,)."""
        words = self.of_member.family.box.range_words
        for k, name in enumerate(self.distributions):
            # 1e-3: share of the samples that may leave the box; they are held at its edge
            if outside[k] > 1e-3:
                ends = words[name].replace("..", "to")
                raise checks.InputError(
                    f"{name}: {outside[k]:.1%} of the samples lie outside the family's {ends}; "
                    "train one that reaches four standard deviations beyond the mean"
                )

    def values(self, x: Array) -> Any:
        """The property of n members with varied parameters x, shape (p, n); R_th of all of them in one call."""
        held: dict[str, Any] = self.held
        if self.of_member.quantity == "thermal_resistance":
            columns = held | dict(zip(self.distributions, x, strict=True))
            channel = self.of_member.channel
            return self.of_member.family.thermal_resistance(heated=channel.heated, read=channel.read, **columns)
        members = [held | dict(zip(self.distributions, row, strict=True)) for row in x.T.tolist()]
        return self.of_member.many(members, self.executor)

    def per_deviation(self) -> Array:
        """Half the change of the property from the 16 to the 84 % quantile of one parameter at a time, shape (p,)."""
        shares = np.tile(ONE_DEVIATION, (len(self.distributions), 1))
        ends = self.quantiles(shares)
        medians = self.medians
        changes = []
        for name, (low, high) in zip(self.distributions, ends.tolist(), strict=True):
            up = self.of_member(medians | {name: high})
            down = self.of_member(medians | {name: low})
            changes.append((up - down) / 2)
        return np.array(changes, dtype=float)


def _centred(f: Array) -> Array:
    """Values (p + 2, n, ...) minus the mean of sets A and B; nan first becomes the mean of A, B or the other sets."""
    filled = []
    for part in (f[:1], f[1:2], f[2:]):
        mean = np.nanmean(part, axis=(0, 1))
        filled.append(np.where(np.isnan(part), mean, part))
    whole = np.concatenate(filled)
    return whole - whole[:2].mean(axis=(0, 1))


def _indices(f: Array) -> Array:
    """First-order and total Sobol indices, shape (2, p, ...), of centred values; 0 where nothing varies.

        S_i = mean(f_B (f_i - f_A))/V,    T_i = mean((f_A - f_i)^2)/(2 V),    V = variance of f_A and f_B

    f [shape (p + 2, n, ...)]: of the members A and B, and of A with parameter i of B.

    Source: Saltelli et al., Comput. Phys. Commun. 181, 259 (2010), Table 2 (b) and (f).
    """
    A, B, *_ = f
    AB = f[2:]
    V = f[:2].var(axis=(0, 1))
    first = (B * (AB - A)).mean(axis=1)
    total = ((A - AB) ** 2).mean(axis=1) / 2
    both = np.array([first, total])
    return np.divide(both, V, out=np.zeros_like(both), where=V > 0)


def _of_numbers(f: Array, names: list[str], attrs: dict[str, Any]) -> xr.Dataset:
    """Statistics of a scalar property with values f (p + 2, n); intervals of the Sobol indices by bootstrap."""
    every = f[:2].ravel()
    centred = _centred(f)
    missing = np.isnan(every)
    present = every[~missing]
    random = np.random.default_rng(0)
    n = f.shape[1]
    resampled = []
    # 200: resampled sets of members, for the intervals of the indices
    for _ in range(200):
        members = random.integers(n, size=n)
        resampled.append(_indices(centred[:, members]))
    low, high = np.quantile(resampled, (0.025, 0.975), axis=0)
    data = {}
    for suffix, pair in (("", _indices(centred)), ("_low", low), ("_high", high)):
        for kind, column in zip(INDICES, pair, strict=True):
            about = {"long_name": f"Sobol index, {kind}", "units": "1"}
            data[kind + suffix] = ("parameter", column, about)
    attrs |= {"mean": float(present.mean()), "standard_deviation": float(present.std(ddof=1))}
    for percent in (5, 50, 95):
        attrs[f"quantile_{percent:02d}"] = float(np.quantile(present, percent / 100))
    attrs["missing"] = float(missing.mean())
    value = ("sample", every, {"long_name": attrs["quantity"]})
    return xr.Dataset({**data, "value": value}, coords={"parameter": names}, attrs=attrs)


def _of_maps(f: Array, like: xr.DataArray, names: list[str], attrs: dict[str, Any]) -> xr.Dataset:
    """Statistics of a map with values f (p + 2, n, points), at each of its points."""
    every = f[:2].reshape(-1, f.shape[2])
    spread = np.nanstd(every, axis=0, ddof=1)
    mean = np.nanmean(every, axis=0)
    words = "probability" if like.dtype == bool else f"mean of {attrs['quantity']}"
    data: dict[str, Any] = {
        "mean": (like.dims, mean.reshape(like.shape), {"long_name": words}),
        "standard_deviation": (like.dims, spread.reshape(like.shape), {"long_name": "standard deviation"}),
    }
    indices = np.where(spread == 0, np.nan, _indices(_centred(f)))
    for kind, table in zip(INDICES, indices, strict=True):
        about = {"long_name": f"Sobol index, {kind}", "units": "1"}
        data[kind] = (("parameter", *like.dims), table.reshape(-1, *like.shape), about)
    coords = {name: values for name, values in like.coords.items() if set(values.dims) <= set(like.dims)}
    lacking = np.isnan(every).any(axis=1)
    attrs["missing"] = float(lacking.mean())
    return xr.Dataset(data, coords={"parameter": names, **coords}, attrs=attrs)
