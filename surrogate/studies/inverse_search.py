"""Properties of the members of a family, and searches over them with the free ranges as a unit cube."""

import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from thermofem import Campaign, CrossSection, Foster, OutputMap, checks
from thermofem.arrays import Array, NDArray
from thermofem.campaign import Variation
from thermofem.campaign.stored_tasks import WorkerDiedError, completed
from thermofem.export.poles import poles_of
from thermofem.geometry.parameter_paths import change
from thermofem.geometry.section_parts import LIGHT
from thermofem.models import two_kinds

from ..family import Family, train_family

log = logging.getLogger("thermofem")

Model = Foster | OutputMap

LACKING = 1e6  # relative misfit of a member that has no such property, such as a ring that does not pulse

Quantity = str | Callable[..., Any]


@dataclass(frozen=True)
class Optics:
    """Dependence of the ring's optical numbers on the parameters of a family.

        change of a number = sum over parameters p of slope_p (p - p_0)

    Parameters
    ----------
    slopes : dict from number to dict from parameter to slope
        d(number)/d(parameter) in SI, ``{"bus_rate": {"width": -1e17}}``.
    at : dict from parameter to float
        p_0, where the numbers of the ring hold; default the middle of the ranges, the geometric mean of a positive one.
    """

    slopes: Mapping[str, Mapping[str, float]]
    at: Mapping[str, float] = field(default_factory=dict)

    def check(self, family: Family) -> None:
        """Raise InputError for a parameter that the family does not have."""
        slopes = {f"slope of {number} by": by_name for number, by_name in self.slopes.items()}
        for label, numbers in {"at": self.at, **slopes}.items():
            for name, value in checks.mapping(f"optics: {label}", numbers).items():
                checks.choice("optics: parameter", name, family.names)
                checks.finite(f"optics: {label} {name}", value)

    def changes(self, family: Family, values: Mapping[str, float]) -> dict[str, float]:
        """Change of every optical number, by name in SI, at the member with the parameters ``values``."""
        start = family.box.named(family.box.middle) | dict(self.at)
        changes = {}
        for number, slopes in self.slopes.items():
            terms = [slope * (values[name] - start[name]) for name, slope in slopes.items()]
            changes[number] = sum(terms)
        return changes


class Follows(Protocol):
    """Interface of optics that follow the geometry: `Optics`, or `coupled.ring_family.MovingRing`."""

    def check(self, family: Family) -> None:
        """Raise InputError if these optics do not belong to the family."""
        ...

    def changes(self, family: Family, values: Mapping[str, float]) -> dict[str, float]:
        """Change of every optical number, by name in SI, at the member with the parameters ``values``."""
        ...


def rise_time(model: Model) -> float:
    """Time from 10 to 90 % of the static rise after a step, in s; of an output map at small power."""
    return _rise_time(*_poles(model))


def time_constant(model: Model) -> float:
    """Time in s after which a step has reached 1 - 1/e of its static rise; of an output map at small power."""
    return _after(-np.expm1(-1.0), *_poles(model))


def channel_steps(model: Any) -> list[dict[str, Any]] | None:
    """Thermal resistance and rise time of every channel of a linear model, from a heated input to a read output.

        step(t) = sum_i R_i (1 - exp(-t/tau_i)),    R_th = sum_i R_i,    rise time: from 10 % to 90 % of R_th

    Returns a dict for each channel: "heated", "read", "thermal_resistance" (K/W), "rise_time" (s); all inputs of the
    first output, then those of the next. None where the model cannot be written as a sum of poles.
    """
    try:
        poles = poles_of(getattr(model, "linear", model))
    except checks.InputError:
        return None
    channels = []
    for read, C in zip(model.outputs, poles.C, strict=True):
        for heated, B in zip(model.inputs, poles.B.T, strict=True):
            R = C * B / poles.rate
            step = {"thermal_resistance": float(R.sum()), "rise_time": _rise_time(R, 1 / poles.rate)}
            channels.append({"heated": heated, "read": read, **step})
    return channels


def _poles(model: Model) -> tuple[Array, Array]:
    linear = two_kinds(model).linear
    return np.asarray(linear.R), np.asarray(linear.tau)


def _rise_time(R: Array, tau: Array) -> float:
    return _after(0.9, R, tau) - _after(0.1, R, tau)


def _after(share: float, R: Array, tau: Array) -> float:
    """Time in s at which a step response reaches the fraction ``share`` of its static rise."""
    from scipy.optimize import brentq

    def missing(t: float) -> float:
        rise = -np.expm1(-t / tau) @ R
        return float(rise / R.sum() - share)

    low = 1e-4 * tau.min()
    high = 50 * tau.max()
    return float(brentq(missing, low, high, xtol=1e-16, rtol=1e-12))


QUANTITIES: dict[str, Callable[[Model], float]] = {
    "thermal_resistance": lambda model: model.thermal_resistance,
    "rise_time": rise_time,
    "time_constant": time_constant,
}


def word(quantity: Quantity) -> str:
    """Name of a quantity: the text itself, or the name of the function."""
    return quantity if isinstance(quantity, str) else getattr(quantity, "__name__", "quantity").strip("<>")


class Property:
    """A property as a function of a member's parameters; nan where its computation raises InputError.

    heated, read: channel of the model that the property is one of; default the family's first, and of a function
        `Family.at`, which has "light", too, where the family reads it.
    reason: why the last member without the property has none.
    """

    def __init__(
        self,
        family: Family,
        quantity: Quantity,
        optics: Follows | None = None,
        heated: str | None = None,
        read: str | None = None,
    ) -> None:
        if optics is not None:
            checks.has("optics", optics, "changes", hint="surrogate.Optics, or coupled.ring_family.MovingRing")
            optics.check(family)
        if isinstance(quantity, str):
            checks.choice("quantity", quantity, QUANTITIES, hint="or give a function of a model")
        self.family = family
        self.quantity = quantity
        self.optics = optics
        self.channel = family.channel(heated, read)
        self.whole = heated is None and read is None and callable(quantity)
        self.reason = "none was looked at"

    @property
    def read(self) -> str:
        """Names of the outputs of the model that the property is one of, with commas."""
        lit = self.whole and self.family.has_light_beside
        return f"{self.channel.read}, {LIGHT}" if lit else self.channel.read

    def many(self, members: Sequence[Mapping[str, float]], executor: Executor | None = None) -> list[Any]:
        """Values of the property for many members, in chunks on the executor if one is given.

        nan for the members of a chunk that killed its worker process twice.
        """
        if executor is None:
            return [self(values) for values in members]
        # 64: chunks of many members, one task of an executor each
        size = max(1, len(members) // 64)
        chunks = {k: members[k : k + size] for k in range(0, len(members), size)}
        results: dict[int, list[tuple[Any, str]]] = {}
        for (k, chunk), done in completed(self._of_chunk, chunks.items(), executor=executor):
            try:
                results[k] = done.result()
            except WorkerDiedError as error:
                log.warning("members without %s (%d): %s", word(self.quantity), len(chunk), error)
                results[k] = [(np.nan, str(error))] * len(chunk)
        pairs = [pair for k in chunks for pair in results[k]]
        self.reason = next((reason for _, reason in pairs[::-1] if reason), self.reason)
        return [value for value, _ in pairs]

    def _of_chunk(self, chunk: tuple[int, Sequence[Mapping[str, float]]]) -> list[tuple[Any, str]]:
        """Value of the property for each member, and why it has none ("" where it has one)."""
        pairs = []
        for values in chunk[1]:
            self.reason = ""
            value = self(values)
            pairs.append((value, self.reason))
        return pairs

    def __call__(self, values: Mapping[str, float]) -> Any:
        """Value of the property for the member with the parameters ``values`` in SI; nan where it has none."""
        model = self.family.of_channel(self.channel, values)
        try:
            if isinstance(self.quantity, str):
                return QUANTITIES[self.quantity](model)
            whole: Any = self.family.at(values) if self.whole else model
            changes = () if self.optics is None else (self.optics.changes(self.family, values),)
            return self.quantity(whole, *changes)
        except checks.InputError as error:
            self.reason = str(error)
            return np.nan


Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Search:
    """Search over the members of a family, whose free parameters span a unit cube, for given target values.

    low, high, held [shape (p,)]: ends of the ranges (equal where a parameter is fixed), and values of fixed parameters.
    """

    family: Family
    low: Array
    high: Array
    held: Array
    properties: dict[str, Property]
    wanted: dict[str, float]

    @property
    def moving(self) -> NDArray[np.intp]:
        """Indices of the free parameters."""
        return np.flatnonzero(self.high > self.low)

    def values(self, x: Array) -> dict[str, float]:
        """Parameters by name in SI at a point of the unit cube, shape (free,)."""
        k = self.moving
        width = self.high[k] - self.low[k]
        row = self.held.copy()
        row[k] = self.low[k] + np.clip(x, 0, 1) * width
        return self.family.box.named(row)

    @property
    def missing(self) -> str:
        """Text that says why members lack the properties."""
        first, *_ = self.properties.values()
        return f"{' and '.join(self.properties)}; the last said: {first.reason}"

    def achieved(self, x: Array) -> dict[str, float]:
        """Properties by name of the member at a point of the unit cube."""
        values = self.values(x)
        return {name: float(of_member(values)) for name, of_member in self.properties.items()}

    def misfit(self, x: Array) -> Array:
        """value/target - 1 of each property at a point of the unit cube, shape (targets,); `LACKING` for nan."""
        return self._misfit(list(self.achieved(x).values()))

    def misfits(self, points: Array, executor: Executor | None = None) -> Array:
        """`misfit` at many points of the unit cube, shape (n, targets)."""
        members = [self.values(x) for x in points]
        columns = [of_members.many(members, executor) for of_members in self.properties.values()]
        return np.array([self._misfit(row) for row in zip(*columns, strict=True)])

    def _misfit(self, achieved: Sequence[float]) -> Array:
        targets = list(self.wanted.values())
        off = np.array(achieved, dtype=float) / targets - 1
        return np.where(np.isnan(off), LACKING, off)

    @property
    def nominal(self) -> Array:
        """Point of the unit cube, shape (free,), of the geometry that the family was made of, or the nearest to it."""
        k = self.moving
        row = np.array(list(self.family.box.nominal.values()))
        beyond = row[k] - self.low[k]
        width = self.high[k] - self.low[k]
        return np.clip(beyond / width, 0, 1)


def at_edge(names: Sequence[str], shares: Array) -> tuple[str, ...]:
    """Names of the parameters whose share of their range, 0 to 1, lies at one of its ends."""
    distances = np.minimum(shares, 1 - shares)
    # 1e-6: of a range: a parameter as near as this to its end is an active constraint
    return tuple(itertools.compress(names, distances <= 1e-6))


def search_of(
    family: Family,
    free: Ranges | None,
    target: Mapping[Quantity, float],
    fixed: Mapping[str, float] | None,
    optics: Follows | None,
    heated: str | None,
    read: str | None,
) -> Search:
    """Check targets, ranges and fixed values, and make the `Search`."""
    fixed = checks.mapping("fixed", fixed)
    low = family.box.low.copy()
    high = family.box.high.copy()
    held = family.box.middle.copy()
    stated = [*(free or {}), *fixed]
    for name in stated:
        checks.choice("parameter", name, family.names)
    checks.unique("free and fixed", stated, hint="a parameter is one of them")
    for k, name in enumerate(family.names):
        if free is not None and name in free:
            low[k], high[k] = inside(family, name, free[name])
        elif free is not None or name in fixed:
            value = fixed.get(name, held[k])
            held[k] = checks.between(name, value, low[k], high[k], unit=family.box.units[k])
            low[k] = high[k] = held[k]
    if not np.any(high > low):
        raise checks.InputError("nothing is free; name a parameter in free, or fix fewer")
    properties = {word(quantity): Property(family, quantity, optics, heated, read) for quantity in target}
    return Search(family, low, high, held, properties, wanted_of(target))


def wanted_of(target: Mapping[Quantity, float]) -> dict[str, float]:
    """Target values by the name of their quantity; InputError for a quantity or a value that cannot be a target."""
    checks.unique("target", list(map(word, target)), hint="name the functions")
    targets = {}
    for quantity, value in target.items():
        name = word(quantity)
        targets[name] = checks.finite(f"target {name}", value)
    if 0 in targets.values():
        raise checks.InputError("a target of 0 has no relative misfit; give another value")
    return targets


def family_over(
    given: Family | CrossSection, free: Ranges | None, tolerance: float, executor: Executor | None = None
) -> Family:
    """The given family, or one trained over the ranges ``free`` of the parameters of a cross-section."""
    if isinstance(given, Family):
        return given
    variations = []
    for path, (low, high) in checks.mapping("free", free).items():
        unit = change(given, path).unit
        variations.append(Variation(path, (path,), unit, low=low, high=high))
    campaign = Campaign(given.to_toml(), tuple(variations), samples=1)
    return train_family(campaign, tolerance, executor=executor)


def inside(family: Family, name: str, pair: tuple[float, float]) -> tuple[float, float]:
    """Check that a range (low, high) lies inside that of the family; return it, cut to the family's range."""
    low, high = family.ranges[checks.choice("parameter", name, family.names)]
    slack = 1e-9 * (high - low)
    a = checks.between(f"{name}: low", pair[0], low - slack, high)
    b = checks.between(f"{name}: high", pair[1], a, high + slack)
    return max(a, low), min(b, high)
