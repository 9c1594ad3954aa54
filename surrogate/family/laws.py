"""Material properties and surface coefficients of many members at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thermofem import Boundary
from thermofem.arrays import Array
from thermofem.fem.contacts import PERFECT
from thermofem.materials.laws import PowerLaw
from thermofem.materials.library import Material

from .box import Box


@dataclass(frozen=True, eq=False)
class Values:
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


def values(box: Box, rows: Array) -> Values:
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
    return Values(k_r, k_z, capacity, contact, convection)


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
