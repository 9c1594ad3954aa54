"""The box of parameters that a family covers: names, ranges and what each parameter changes in the geometry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from thermofem import Campaign, CrossSection, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem.mesh_division import PERFECT
from thermofem.geometry.parameter_paths import Change, change
from thermofem.materials.material_library import Material

MOST = 2**24  # members at once: half a gigabyte of parameters


@dataclass(frozen=True, eq=False)
class Box:
    """Ranges of the parameters of a campaign.

    low, high [shape (p,)]: ends of the ranges, SI.
    logarithmic: whether training draws in the logarithm.
    """

    campaign: Campaign
    names: tuple[str, ...]
    low: Array
    high: Array
    logarithmic: tuple[bool, ...]

    @classmethod
    def of(cls, campaign: Campaign) -> Box:
        """The box of a campaign.

        Raises InputError: nothing is varied, words are varied, a single value, or corners that are no geometry.
        """
        if not campaign.variations:
            raise checks.InputError("the campaign varies nothing; add a [[vary]] table with from and to")
        ends = []
        for v in campaign.variations:
            if any(isinstance(value, str) for value in v.values):
                raise checks.InputError(
                    f"vary {v.name!r} lists words ({', '.join(map(str, v.values))}); a family has numbers only: train "
                    "one family for each of them"
                )
            values = [float(value) for value in v.values] or [v.low, v.high]
            if not min(values) < max(values):
                raise checks.InputError(f"vary {v.name!r} has one value only; a family needs a range, from and to")
            ends.append((min(values), max(values)))
        low, high = np.array(ends).T
        names = tuple(v.name for v in campaign.variations)
        box = cls(campaign, names, low, high, tuple(v.logarithmic for v in campaign.variations))
        box._check()
        return box

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
        return np.array([any(path.startswith("interface.") for path in v.paths) for v in self.campaign.variations])

    @cached_property
    def middle(self) -> Array:
        """Geometric mean of positive ranges, else the arithmetic one; the range of a contact begins at `PERFECT`."""
        low = np.where(self.contact, np.maximum(self.low, np.minimum(PERFECT, self.high)), self.low)
        positive = low > 0
        product = np.sqrt(np.where(positive, low * self.high, 0.0))
        return np.where(positive, product, (self.low + self.high) / 2)

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Parameters of the campaign's own geometry; the middle of the box where one lies outside."""
        section = CrossSection.from_toml_text(self.campaign.geometry)
        own = np.array([change(section, v.paths).value for v in self.campaign.variations])
        slack = 1e-9 * (self.high - self.low)
        inside = bool(((own >= self.low - slack) & (own <= self.high + slack)).all())
        row = np.clip(own, self.low, self.high) if inside else self.middle
        return dict(zip(self.names, row.tolist(), strict=True))

    def at(self, share: Array) -> Array:
        """Parameters at shares 0 to 1 of the ranges, shape (..., p)."""
        linear = self.low + share * (self.high - self.low)
        if not any(self.logarithmic):
            return np.asarray(linear)
        low = np.where(self.logarithmic, self.low, 1.0)
        ratio = np.where(self.logarithmic, self.high, 1.0) / low
        return np.asarray(np.where(self.logarithmic, low * ratio**share, linear))

    def share(self, rows: Array) -> Array:
        """The inverse of `at`."""
        linear = (rows - self.low) / (self.high - self.low)
        if not any(self.logarithmic):
            return np.asarray(linear)
        low, at = (np.where(self.logarithmic, x, 1.0) for x in (self.low, rows))
        high = np.where(self.logarithmic, self.high, 2.0)
        return np.asarray(np.where(self.logarithmic, np.log(at / low) / np.log(high / low), linear))

    def draw(self, count: int, seed: int) -> Array:
        """SurfacePoints of a scrambled Sobol sequence, shape (count, p)."""
        from scipy.stats import qmc

        shares = qmc.Sobol(self.size, seed=np.random.default_rng(seed)).random_base2(int(np.ceil(np.log2(count))))
        return self.at(shares[:count])

    def corners(self, most: int = 64) -> Array:  # 64: corners of the box whose geometry is made and checked
        """Corners of the box, all of them or ``most`` different ones drawn at random, shape (n, p)."""
        every = 2**self.size
        picked = np.arange(every) if every <= most else np.random.default_rng(0).choice(every, most, replace=False)
        bits = (picked[:, None] >> np.arange(self.size)) & 1
        return np.where(bits, self.high, self.low)

    def geometry(self, values: Array) -> CrossSection:
        """The cross-section with these values."""
        return CrossSection.from_toml_text(self.campaign.geometry_of(tuple(float(x) for x in values)))

    @cached_property
    def base(self) -> CrossSection:
        """The cross-section in the middle of the box."""
        return self.geometry(self.middle)

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """The `Change` of each parameter in the base geometry."""
        return tuple(change(self.base, v.paths) for v in self.campaign.variations)

    @cached_property
    def materials(self) -> dict[str, Material]:
        """Materials that the base geometry is made of."""
        return {m.name: m for m in (self.base.material_of(region) for region in self.base.region_names)}

    def _check(self) -> None:
        """Raise InputError where a corner of the box is no geometry."""
        for corner in self.corners():
            try:
                self.geometry(corner)
            except checks.InputError as error:
                where = ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, corner, strict=True))
                raise checks.InputError(f"the ranges contradict each other: at {where}: {error}") from None

    def row(self, values: Mapping[str, Any]) -> Array:
        """Parameters of one member, shape (p,); InputError for a missing or unknown name, or one outside the box."""
        rows = self.rows(values)
        if rows.shape[:-1] != ():
            raise checks.InputError("give one number for each parameter; arrays are for step_response and its kind")
        return rows

    def rows(self, values: Mapping[str, ArrayLike]) -> Array:
        """Parameters of many members, broadcast against each other, shape (..., p)."""
        if (row := self._plain(values)) is not None:
            return row
        for name in values:
            checks.choice("parameter", name, self.names)
        missing = [name for name in self.names if name not in values]
        if missing:
            raise checks.InputError(f"{', '.join(missing)} missing; the family has {', '.join(self.names)}")
        columns = [checks.numbers(name, values[name]) for name in self.names]
        for name, unit, column, low, high in zip(self.names, self.units, columns, self.low, self.high, strict=True):
            slack = 1e-9 * (high - low)  # 1e-9 of the range, by which a value may leave the box: round-off of units
            out = column[(column < low - slack) | (column > high + slack)]
            if out.size:
                raise checks.InputError(
                    f"{name} = {out.flat[0]:g} {unit} is outside the box of this family, {low:g} .. {high:g} {unit}; "
                    "train one with a wider range"
                )
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def _plain(self, values: Mapping[str, Any]) -> Array | None:
        """Plain numbers inside the box, in their order; None where anything else is given."""
        if values.keys() != set(self.names) or not all(isinstance(v, float) for v in values.values()):
            return None
        row = np.array([values[name] for name in self.names], dtype=float)
        return row if bool(((row >= self.low) & (row <= self.high)).all()) else None
