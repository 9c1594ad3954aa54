"""The box of parameters that a family covers: names, ranges, and the geometry and materials of its members."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import qmc

from thermofem import Boundary, Campaign, CrossSection, Material, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.campaign import Variation
from thermofem.data import quantity
from thermofem.fem.surfaces import PERFECT, resistances
from thermofem.geometry.parameter_paths import Change, change
from thermofem.materials.material_laws import PowerLaw


@dataclass(frozen=True, eq=False)
class Box:
    """Ranges of the parameters of a campaign.

    low, high [shape (p,)]: ends of the ranges, SI.
    """

    campaign: Campaign
    low: Array
    high: Array

    @classmethod
    def of(cls, campaign: Campaign) -> Box:
        """Box of the parameters that a campaign varies.

        Raises InputError: nothing is varied, words are varied, a single value, or corners that are no geometry.
        """
        hint = "add a [[vary]] table with from and to"
        checks.enough("the campaign", len(campaign.variations), 1, "parameters", hint=hint)
        low, high = np.array([_range(v) for v in campaign.variations]).T
        box = cls(campaign, low, high)
        for corner in box.corners():
            with checks.prefixed(f"the ranges contradict each other: at {box.words(corner)}"):
                box.geometry(corner)
        return box

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(v.name for v in self.campaign.variations)

    @cached_property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters training draws evenly in their logarithm, shape (p,)."""
        return np.array([v.logarithmic for v in self.campaign.variations])

    def named(self, row: Array) -> dict[str, float]:
        """The parameters ``row`` of one member, shape (p,), by name."""
        return dict(zip(self.names, row.tolist(), strict=True))

    def words(self, row: Array) -> str:
        """Text "name = value, ..." of the parameters ``row`` of one member, with units."""
        triples = zip(self.names, row, self.units, strict=True)
        return ", ".join(f"{name} = {quantity.rounded(value, unit, 6)}" for name, value, unit in triples)

    @property
    def range_words(self) -> dict[str, str]:
        """Text "low .. high" of each range by the name of its parameter, with units."""
        words = {}
        for name, unit, *ends in zip(self.names, self.units, self.low, self.high, strict=True):
            words[name] = " .. ".join(quantity.rounded(end, unit, 6) for end in ends)
        return words

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each parameter."""
        return tuple(v.unit for v in self.campaign.variations)

    @cached_property
    def contact(self) -> NDArray[np.bool_]:
        """Which parameters are contact resistances, shape (p,)."""
        contacts = [any(path.startswith("interface.") for path in v.paths) for v in self.campaign.variations]
        return np.array(contacts)

    @cached_property
    def middle(self) -> Array:
        """Middle of each range, SI, shape (p,): geometric mean of a positive range, else arithmetic mean.

        The range of a contact resistance is taken from `PERFECT` on.
        """
        perfect = np.where(self.contact, np.minimum(PERFECT, self.high), self.low)
        low = np.maximum(self.low, perfect)
        positive = low > 0
        product = np.where(positive, low * self.high, 0.0)
        mean = (self.low + self.high) / 2
        return np.where(positive, np.sqrt(product), mean)

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Parameters by name of the campaign's own geometry; the middle of the box where one lies outside its range."""
        section = CrossSection.from_toml_text(self.campaign.geometry)
        values = np.array([change(section, v.paths).value for v in self.campaign.variations])
        slack = 1e-9 * (self.high - self.low)
        row = np.clip(values, self.low, self.high)
        outside = np.any(np.abs(values - row) > slack)
        return self.named(self.middle if outside else row)

    def _spacing(self, x: Array) -> Array:
        """The quantity that training spaces evenly: a parameter, or its logarithm."""
        spaced = np.array(x, dtype=float)
        return np.log(x, out=spaced, where=self.logarithmic)

    def at(self, share: Array) -> Array:
        """Parameters (SI) at fractions 0 to 1 of their ranges, shape (..., p)."""
        low = self._spacing(self.low)
        high = self._spacing(self.high)
        x = low + share * (high - low)
        return np.exp(x, out=x, where=self.logarithmic)

    def share(self, rows: Array) -> Array:
        """Each parameter as a fraction of its range, 0 at the low and 1 at the high end; the inverse of `at`.

            share = (f(x) - f(low))/(f(high) - f(low)),    f(x) = ln x where the range is logarithmic, else x

        rows [shape (..., p), SI]: parameters x; the result has the same shape.
        """
        low = self._spacing(self.low)
        high = self._spacing(self.high)
        return (self._spacing(rows) - low) / (high - low)

    def slope(self, share: Array) -> Array:
        """Derivative of each parameter (SI) with respect to its fraction of the range, shape (..., p)."""
        width = self._spacing(self.high) - self._spacing(self.low)
        dx = np.where(self.logarithmic, self.at(share), 1.0)
        return width * dx

    def draw(self, count: int, seed: int, *, unseen: bool = False) -> Array:
        """Random parameters by a scrambled Sobol sequence, shape (count, p); ``unseen``: not those of the same seed."""
        # 7919: added to the seed, so that two draws have no point in common
        seed += 7919 * unseen
        sobol = qmc.Sobol(self.size, seed=np.random.default_rng(seed))
        bits = int(np.ceil(np.log2(count)))
        shares = sobol.random_base2(bits)
        return self.at(shares[:count])

    def corners(self, most: int = 64) -> Array:  # 64: corners of the box whose geometry is made and checked
        """Corners of the box, all of them or ``most`` different ones drawn at random, shape (n, p)."""
        every = 2**self.size
        picked = np.arange(every)
        if every > most:
            picked = np.random.default_rng(0).choice(every, most, replace=False)
        bits = (picked[:, None] >> np.arange(self.size)) & 1
        return np.where(bits, self.high, self.low)

    def geometry(self, values: Array) -> CrossSection:
        """The cross-section with the parameters ``values`` in SI, shape (p,)."""
        numbers = tuple(float(x) for x in values)
        text = self.campaign.geometry_of(numbers)
        return CrossSection.from_toml_text(text)

    @cached_property
    def base(self) -> CrossSection:
        """The cross-section in the middle of the box."""
        return self.geometry(self.middle)

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """Derivatives of outlines and materials in the middle of the box: one `Change` for each parameter."""
        return tuple(change(self.base, v.paths) for v in self.campaign.variations)

    @cached_property
    def materials(self) -> dict[str, Material]:
        """Materials that the base geometry is made of."""
        materials = map(self.base.material_of, self.base.region_names)
        return {material.name: material for material in materials}

    def row(self, values: Mapping[str, Any]) -> Array:
        """Parameters of one member, shape (p,); InputError for a missing or unknown name, or one outside the box."""
        rows = self.rows(values)
        checks.shape("one member", rows, (self.size,))
        return rows

    def rows(self, values: Mapping[str, ArrayLike]) -> Array:
        """Parameters of many members, broadcast against each other, shape (..., p)."""
        for name in values:
            checks.choice("parameter", name, self.names)
        missing = [name for name in self.names if name not in values]
        if missing:
            raise checks.InputError(f"{', '.join(missing)} missing; the family has {', '.join(self.names)}")
        columns = [checks.numbers(name, values[name]) for name in self.names]
        for k, column in enumerate(columns):
            low = self.low[k]
            high = self.high[k]
            slack = 1e-9 * (high - low)  # 1e-9 of the range, by which a value may leave the box: round-off of units
            outside = (column < low - slack) | (column > high + slack)
            if outside.any():
                value = column[outside].flat[0]
                hint = "train a family with a wider range"
                checks.between(self.names[k], value, low, high, unit=self.units[k], hint=hint)
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def properties(self, rows: Array) -> Properties:
        """Material properties and surface resistances of n members with the parameters ``rows``, shape (n, p)."""
        base = self.base
        count = len(rows)
        varied: dict[str, Array] = {}  # numbers of materials, by "NAME.PROPERTY"
        stated = {f"interface.{part}": R for part, R in resistances(base).items()}
        for side in ("bottom", "top", "outer"):
            h = getattr(base, side).exchange
            if h:
                stated[f"boundary.{side}"] = 1 / h
        resistance = {name: np.full(count, R) for name, R in stated.items()}
        ambient = np.full(count, base.ambient)
        for column, middle, variation in zip(rows.T, self.middle, self.campaign.variations, strict=True):
            for path in variation.paths:
                kind, _, of_kind = path.partition(".")
                surface, _, number = path.rpartition(".")
                if path == "ambient":
                    ambient = column
                elif kind == "material":
                    varied[of_kind] = column
                elif kind == "interface":  # beside others of the same part
                    resistance[surface] = np.maximum(resistance[surface] - middle + column, PERFECT)
                elif kind == "boundary":
                    resistance[surface] = 1 / Boundary.KINDS[number].exchange(column)
        k_r = {}
        k_z = {}
        capacity = {}
        for name, material in self.materials.items():
            prefix = f"{name}."
            numbers = {key.removeprefix(prefix): x for key, x in varied.items() if key.startswith(prefix)}
            k_r[name], k_z[name], capacity[name] = _material(material, numbers, ambient)
        return Properties(k_r, k_z, capacity, resistance)


def _range(v: Variation) -> tuple[float, float]:
    """Both ends of the range of a parameter; InputError for words or a single value."""
    words = any(isinstance(value, str) for value in v.values)
    values = [0.0] if words else v.values or (v.low, v.high)
    low = float(min(values))
    high = float(max(values))
    if low >= high:
        listed = ", ".join(map(str, v.values))
        raise checks.InputError(
            f"vary {v.name!r} lists {listed}; a family needs a range of numbers, from and to; "
            "of words train one for each"
        )
    return low, high


@dataclass(frozen=True, eq=False)
class Properties:
    """Material properties at the ambient temperature and surface resistances, each of shape (n,) or ().

    k_r, k_z, capacity [dict from material to array; W/(m K) and J/(m^3 K)]
    resistance [dict from "interface.PART" and "boundary.SIDE" to array; m^2 K/W]: of contacts, and 1/h where
        heat is exchanged.
    """

    k_r: dict[str, Array]
    k_z: dict[str, Array]
    capacity: dict[str, Array]
    resistance: dict[str, Array]


def _material(material: Material, varied: dict[str, Array], T0: Array) -> tuple[Array, Array, Array]:
    """k_r, k_z in W/(m K) and rho c_p in J/(m^3 K) of a material, where the arrays ``varied`` replace some numbers."""

    def factor(kind: str) -> Array:
        law = getattr(material, f"{kind}_law")
        if not isinstance(law, PowerLaw):
            return np.asarray(law.factor(T0))
        exponent = varied.get(f"{kind}.exponent", law.exponent)
        reference = varied.get(f"{kind}.reference", law.reference)
        ratio = T0 / reference
        return ratio**exponent

    def number(kind: str) -> Array | float:
        for name in (kind, f"{kind}.value", f"{kind}.r"):
            if name in varied:
                return varied[name]
        value: float = getattr(material, kind)
        return value

    along_r = number("conductivity")
    along_z = material.conductivity_z if material.conductivity_z is not None else along_r
    along_z = varied.get("conductivity.z", along_z)
    k = factor("conductivity")
    c = number("density") * number("specific_heat") * factor("specific_heat")
    return np.asarray(along_r * k), np.asarray(along_z * k), np.broadcast_to(c, T0.shape)
