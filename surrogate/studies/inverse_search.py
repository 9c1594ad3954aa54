"""Searches over the members of a family: the free ranges as a unit cube, and properties of the members."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import Campaign, CrossSection, checks
from thermofem.arrays import Array, NDArray
from thermofem.campaign import Variation
from thermofem.geometry.parameters import change

from ..family import Family, train_family
from .targets import Optics, Property, Quantity, word

Ranges = Mapping[str, tuple[float, float]]

PENALTY = 1e6  # relative misfit of a member that has no such property, such as a ring that does not pulse


@dataclass(frozen=True, eq=False)
class Search:
    """Members of a family over a unit cube of the free parameters, and how far each is from the targets.

    low, high, held [shape (p,)]: ends of the ranges, equal where a parameter is fixed, and the values of those.
    wanted ["smallest" or "largest"]
    """

    family: Family
    low: Array
    high: Array
    held: Array
    properties: dict[str, Property]
    wanted: dict[str, float | str]

    @property
    def moving(self) -> NDArray[np.intp]:
        """Which parameters are free."""
        return np.flatnonzero(self.high > self.low)

    def values(self, x: Array) -> dict[str, float]:
        """Parameters at a point of the cube."""
        row, k = self.held.copy(), self.moving
        row[k] = self.low[k] + np.clip(x, 0, 1) * (self.high - self.low)[k]
        return {name: float(value) for name, value in zip(self.family.names, row, strict=True)}

    @property
    def missing(self) -> str:
        """Why members lack the properties, in words."""
        return f"{' and '.join(self.properties)}; the last said: {next(iter(self.properties.values())).reason}"

    def achieved(self, x: Array) -> dict[str, float]:
        """Properties of the member at a point of the cube."""
        values = self.values(x)
        found = {name: one(values) for name, one in self.properties.items()}
        return {name: float(value) for name, value in found.items()}

    def misfit(self, x: Array) -> Array:
        """Relative misfit of every target."""
        got = self.achieved(x)
        return np.array([PENALTY if np.isnan(got[name]) else got[name] / float(self.wanted[name]) - 1 for name in got])


def search_of(
    family: Family,
    free: Ranges | None,
    target: Mapping[Quantity, Any],
    fixed: Mapping[str, float] | None,
    optics: Optics | None,
) -> Search:
    """Check targets, ranges and fixed values, and make the search."""
    wanted = wanted_of(target)
    low, high, held = _ranges(
        family, None if free is None else checks.mapping("free", free), checks.mapping("fixed", fixed)
    )
    properties = {word(quantity): Property(family, quantity, optics) for quantity in target}
    return Search(family, low, high, held, properties, wanted)


def wanted_of(target: Mapping[Quantity, Any]) -> dict[str, float | str]:
    """Targets by the name of their quantity; InputError for what is none."""
    if not target:
        raise checks.InputError('target is empty; give what is wanted, e.g. {"thermal_resistance": 9e3}')
    wanted: dict[str, float | str] = {}
    for quantity, value in target.items():
        text = isinstance(value, str)
        wanted[word(quantity)] = value if text else checks.finite(f"target {word(quantity)}", value)
    if 0.0 in wanted.values():
        raise checks.InputError("a target of 0 has no relative misfit; give another value")
    if len(wanted) < len(target):
        raise checks.InputError(f"two targets have the same name ({', '.join(map(word, target))}); name the functions")
    return wanted


def family_over(given: Family | CrossSection, free: Ranges | None, tolerance: float) -> Family:
    """A family as it is, or one trained over ranges of the parameters of a geometry."""
    if isinstance(given, Family):
        return given
    hint = "surrogate.train_family or load_family gives one, or give a geometry"
    checks.instance("family", given, CrossSection, hint=hint)
    if not free:
        raise checks.InputError('free is empty; name what may change, e.g. {"part.core.width": (400e-9, 600e-9)}')
    variations = []
    for path, pair in checks.mapping("free", free).items():
        low, high = ends(path, pair)
        variations.append(Variation(path, (path,), change(given, path).unit, low=low, high=high))
    return train_family(Campaign(given.to_toml(), tuple(variations), samples=1), tolerance)


def ends(name: str, pair: Any) -> tuple[float, float]:
    """Both ends of a range."""
    low, high = pair
    return checks.finite(f"{name}: low", low), checks.finite(f"{name}: high", high)


def inside(family: Family, name: str, pair: Any) -> tuple[float, float]:
    """Both ends of a range that lies in the family's."""
    k = family.names.index(checks.choice("parameter", name, family.names))
    low, high = family.box.low[k], family.box.high[k]
    a, b = ends(name, pair)
    slack = 1e-9 * (high - low)
    if not low - slack <= a < b <= high + slack:
        raise checks.InputError(
            f"{name} = ({a:g}, {b:g}) must lie inside the family's {low:g} .. {high:g} {family.box.units[k]}"
        )
    return max(a, low), min(b, high)


def _ranges(family: Family, free: Ranges | None, fixed: Mapping[str, float]) -> tuple[Array, Array, Array]:
    """Low and high ends of all parameters, equal where one is fixed; and the values to begin from."""
    low, high, held = family.box.low.copy(), family.box.high.copy(), family.box.middle.copy()
    for name in (*(free or {}), *fixed):
        checks.choice("parameter", name, family.names)
    for k, name in enumerate(family.names):
        if free is not None and name in free:
            if name in fixed:
                raise checks.InputError(f"{name} is in fixed and in free; give it in one of them")
            low[k], high[k] = inside(family, name, free[name])
        elif free is not None or name in fixed:
            held[k] = checks.between(name, fixed.get(name, held[k]), low[k], high[k], unit=family.box.units[k])
            low[k] = high[k] = held[k]
    if not np.any(high > low):
        raise checks.InputError("nothing is free; name a parameter in free, or fix fewer")
    return low, high, held
