"""Where a family is affine: outlines on lines across r and z, and the properties of many members at once.

Every outline that runs along r or z lies on a line; its position is linear in the parameters. Between two lines

    r = a_i + b_i rho,    z = c_j + d_j zeta

with rho and zeta the coordinates of the reference geometry. Lines near the heated parts move along with them, so that
the mesh there keeps its sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from thermofem import Boundary, CrossSection
from thermofem.arrays import Array, NDArray
from thermofem.fem.mesh_division import PERFECT
from thermofem.geometry.parameter_paths import Change
from thermofem.geometry.regions import outlines
from thermofem.materials.material_library import VOID, Material
from thermofem.materials.property_laws import PowerLaw

from .parameter_box import Box

SAME = 1e-13  # m; lines nearer than this, which move alike, are one


class NotAffineError(ValueError):
    """The parameters do not move outlines along lines in a fixed order; the reason in words."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Lines across one axis, in increasing order.

    base [shape (l,), m]: positions in the reference geometry.
    slope [shape (l, p)]: change of each position per unit of each parameter.
    """

    base: Array
    slope: Array

    def at(self, offset: Array) -> Array:
        """Positions for parameters that differ from the middle by ``offset``, shape (..., p) -> (..., l)."""
        return self.base + offset @ self.slope.T

    def maps(self, offset: Array) -> tuple[Array, Array]:
        """a and b of every interval, each of shape (..., l - 1)."""
        position = self.at(offset)
        b = (position[..., 1:] - position[..., :-1]) / self._gaps
        return position[..., :-1] - b * self.base[:-1], b

    @cached_property
    def _gaps(self) -> Array:
        return np.diff(self.base)

    def moved(self, x: Array, interval: NDArray[np.intp], offset: Array) -> Array:
        """Positions of points in given intervals."""
        a, b = self.maps(offset)
        return a[interval] + b[interval] * x


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Lines across both axes and the owner of every cell between them.

    owner [list of list of (str or None)]: layer or part of cell (i, j); None where nothing is meshed.
    """

    r: Axis
    z: Axis
    owner: list[list[str | None]]

    @classmethod
    def of(cls, box: Box) -> CellGrid:
        """Lines of the geometry in the middle of the box.

        Raises NotAffineError: a wall that leans, a shell, or lines that meet inside the box.
        """
        base, half = box.base, np.maximum(box.high - box.middle, box.middle - box.low)
        if base.kind == "straight":
            raise NotAffineError("the terms of a family on lines have the weight 2 pi r of a ring")
        if base.probes:
            raise NotAffineError("shells around parts and copies off the axis do not follow lines")
        r, z = _lines(base, box.changes)
        ranges = box.low - box.middle, box.high - box.middle
        heated = [part for part in base.parts if part.heated]
        r, z = (_ordered(axis, ranges, half) for axis in (r, z))
        r = _with_companions(r, ranges, [x for part in heated for x in (part.inner_radius, part.outer_radius)])
        z = _with_companions(z, ranges, [x for part in heated for x in (part.bottom, part.top)])
        return cls(r, z, _owners(base, r.base, z.base))


def _lines(base: CrossSection, changes: Sequence[Change]) -> tuple[Axis, Axis]:
    """All lines, unsorted."""
    position: tuple[list[float], list[float]] = ([], [])
    slope: tuple[list[Array], list[Array]] = ([], [])
    for name, outline in outlines(base).items():
        velocity = np.array([change.outlines.get(name, np.zeros((4, 2))) for change in changes])  # (p, 4, 2)
        for axis, sides in ((0, ((0, 3), (1, 2))), (1, ((0, 1), (2, 3)))):
            for a, b in sides:
                length = np.abs(outline).max()
                apart = abs(outline[a, axis] - outline[b, axis])
                # 1e-9 of a length: a wall that leans less runs along z
                if apart > 1e-9 * length or np.any(np.abs(velocity[:, a, axis] - velocity[:, b, axis]) > 1e-12):
                    raise NotAffineError(f"the walls of {name!r} lean")
                position[axis].append(float(outline[a, axis]))
                slope[axis].append(velocity[:, a, axis])
    return Axis(np.array(position[0]), np.array(slope[0])), Axis(np.array(position[1]), np.array(slope[1]))


def _ordered(axis: Axis, ranges: tuple[Array, Array], half: Array) -> Axis:
    """Each line once, in an order that holds everywhere in the box."""
    order = np.lexsort((*axis.slope.T, axis.base))
    base, slope = axis.base[order], axis.slope[order]
    kept = [0]
    for k in range(1, len(base)):
        alike = [m for m in kept if abs(base[k] - base[m]) < SAME and np.all(np.abs(slope[k] - slope[m]) * half < SAME)]
        if not alike:
            kept.append(k)
    base, slope = base[kept], slope[kept]
    low, _ = _gaps(Axis(base, slope), ranges)
    if low.min(initial=np.inf) <= SAME:
        raise NotAffineError(f"two outlines near {base[int(low.argmin())]:g} m meet inside the box")
    return Axis(base, slope)


def _gaps(axis: Axis, ranges: tuple[Array, Array]) -> tuple[Array, Array]:
    """Smallest and largest distance of neighbouring lines over the box."""
    base, slope = np.diff(axis.base), np.diff(axis.slope, axis=0)
    each = np.stack([slope * ranges[0], slope * ranges[1]])
    return base + each.min(axis=0).sum(axis=1), base + each.max(axis=0).sum(axis=1)


def _with_companions(axis: Axis, ranges: tuple[Array, Array], walls: Sequence[float]) -> Axis:
    """Lines beside the walls of heated parts that move along with them, where the gap changes over the box."""
    low, high = _gaps(axis, ranges)
    base, slope = list(axis.base), list(axis.slope)
    for k in range(len(low)):
        if high[k] < 1.1 * low[k]:  # 1.1: a gap that changes by less over the box needs no such line
            continue
        ends = [e for e in (k, k + 1) if np.abs(np.asarray(walls) - axis.base[e]).min() < SAME]
        for e in ends:
            # 1e-6 m; at most this far from a heated part a line moves along with it
            away = min(1e-6, low[k] / (3 if len(ends) > 1 else 2))
            base.append(axis.base[e] + (away if e == k else -away))
            slope.append(axis.slope[e])
    order = np.argsort(base)
    return Axis(np.array(base)[order], np.array(slope)[order])


def _owners(base: CrossSection, r: Array, z: Array) -> list[list[str | None]]:
    shapes = outlines(base)
    void = {part.name for part in base.parts if part.material == VOID}

    def owner(x: float, y: float) -> str | None:
        for name in reversed(shapes):
            (left, bottom), (right, top) = shapes[name].min(axis=0), shapes[name].max(axis=0)
            if left < x < right and bottom < y < top:
                return None if name in void else name
        return None

    return [[owner(x, y) for y in (z[:-1] + z[1:]) / 2] for x in (r[:-1] + r[1:]) / 2]


@dataclass(frozen=True, eq=False)
class Properties:
    """Properties at the ambient temperature, each of shape (n,) or ().

    k_r, k_z, capacity [dict from material to array; W/(m K) and J/(m^3 K)]
    contact [dict from part to array; m^2 K/W]
    convection [dict from side to array; W/(m^2 K)]
    """

    k_r: dict[str, Array]
    k_z: dict[str, Array]
    capacity: dict[str, Array]
    contact: dict[str, Array]
    convection: dict[str, Array]


def member_properties(box: Box, rows: Array) -> Properties:
    """Properties for members with the parameters ``rows``, shape (n, p)."""
    base, paths = box.base, [v.paths for v in box.campaign.variations]
    used = box.materials
    given: dict[str, dict[str, Array]] = {name: {} for name in used}
    contact: dict[str, Array] = {}
    for interface in base.interfaces:
        contact[interface.part] = contact.get(interface.part, 0.0) + np.full(len(rows), interface.resistance)
    convection = {
        side: np.full(len(rows), h)
        for side in ("bottom", "top", "outer")
        if (h := getattr(base, side).exchange(base.ambient))
    }
    ambient = np.full(len(rows), base.ambient)
    for column, each in zip(rows.T, paths, strict=True):
        for path in each:
            kind, *middle = path.split(".")
            if path == "ambient":
                ambient = column
            elif kind == "material":
                split = 2 if len(middle) > 2 and middle[-2] in ("conductivity", "specific_heat") else 1
                name = ".".join(middle[:-split])
                if name in given:
                    given[name][".".join(middle[-split:])] = column
            elif kind == "interface":
                name = ".".join(middle[:-1])
                first = next(interface for interface in reversed(base.interfaces) if interface.part == name)
                contact[name] = contact[name] - first.resistance + column
            elif kind == "boundary":
                given_side: Boundary = getattr(base, middle[0])
                convection[middle[0]] = column * (given_side.exchange(base.ambient) / given_side.coefficient)
    contact = {name: np.maximum(value, PERFECT) for name, value in contact.items()}
    k_r, k_z, capacity = {}, {}, {}
    for name, material in used.items():
        k_r[name], k_z[name], capacity[name] = _material(material, given[name], ambient)
    return Properties(k_r, k_z, capacity, contact, convection)


def _material(material: Material, given: dict[str, Array], T0: Array) -> tuple[Array, Array, Array]:
    """k_r, k_z and rho c_p of one material with some of its numbers replaced by arrays."""

    def factor(kind: str) -> Array:
        law = getattr(material, f"{kind}_law")
        if not isinstance(law, PowerLaw):
            return np.asarray(law.factor(T0))
        exponent = given.get(f"{kind}.exponent", law.exponent)
        reference = given.get(f"{kind}.reference", law.reference)
        return np.asarray((T0 / reference) ** exponent)

    def number(kind: str) -> Array | float:
        names = (kind, f"{kind}.value", f"{kind}.r")
        return next((given[name] for name in names if name in given), getattr(material, kind))

    along_r = number("conductivity")
    along_z = material.conductivity_z if material.conductivity_z is not None else along_r
    along_z = given.get("conductivity.z", along_z)
    k = factor("conductivity")
    c = number("density") * number("specific_heat") * factor("specific_heat")
    return np.asarray(along_r * k), np.asarray(along_z * k), np.broadcast_to(c, T0.shape)
