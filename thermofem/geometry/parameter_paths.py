"""Derivatives of outlines, materials and surfaces with respect to one parameter of a geometry.

A path names the parameter as in a campaign: "part.core.radius", "layer.box.thickness", "material.SiO2.conductivity".
Several paths may form one parameter; they then change together, each by the same amount.

The same paths set values in the table of a geometry file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array
from ..checks import InputError
from ..data import quantity
from ..materials.index_laws import constant
from ..materials.material_library import with_value
from ..materials.property_laws import Law, PowerLaw
from .geometry_file import UNITS, as_text
from .regions import outlines
from .section_parts import BUSES, LIGHT, SAME, Boundary, images

if TYPE_CHECKING:
    from ..materials.material_library import Material
    from .cross_section import CrossSection
    from .section_parts import Part

_NAMED = {
    "part": "name",
    "layer": "name",
    "probe": "name",
    "interface": "part",
    "bus": "name",
}  # lists of tables, and what names one
_TABLES = ("material", "boundary", "light")
_LAWS = ("conductivity", "specific_heat")  # properties that may be tables themselves: "material.Si.conductivity.z"
_CENTRE, _EDGES = ("radius", "width"), ("inner_radius", "outer_radius")
_FORMS = f"{' and '.join(_CENTRE)}, or {' and '.join(_EDGES)}"
_HINT = 'write it as "part.core.width", "layer.box.thickness", "material.SiO2.conductivity" or "outer_radius"'


def change_values(table: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Set the values of some paths in a geometry file's table in place; numbers in SI, or text with units."""
    check_once(values)
    sizes: dict[str, str] = {}
    for path, value in values.items():
        key = path.split(".")[-1]
        if path.startswith("part.") and key in (*_CENTRE, *_EDGES):
            name = path.removeprefix("part.").removesuffix(f".{key}")
            first = sizes.setdefault(name, key)
            if (first in _CENTRE) != (key in _CENTRE):
                raise InputError(f"part {name!r}: {first} and {key} are of two forms; give two of one: {_FORMS}")
            for item in table["part"]:
                if item["name"] == name:
                    _measure(item, key)
        place(table, path, as_text(path, value))


def check_once(paths: Iterable[str]) -> None:
    """InputError where two paths lead to one value: the last one would count."""
    places = [path.removesuffix(".value").removesuffix(".convection") for path in paths]
    checks.unique("list of paths", places, hint="both set one value")


def _measure(item: dict[str, Any], key: str) -> None:
    """Convert the radii of a part to the form that ``key`` belongs to: centre and width, or inner and outer edge."""
    wanted, other = (_CENTRE, _EDGES) if key in _CENTRE else (_EDGES, _CENTRE)
    if key in item or "x" in item:
        return
    one, two = (quantity.parse(item.pop(name), "m") for name in other)
    if wanted == _CENTRE:
        _no_disc(item["name"], one)
        sizes = ((one + two) / 2, two - one)
    else:
        sizes = (one - two / 2, one + two / 2)
    item |= {name: quantity.write(size, "m") for name, size in zip(wanted, sizes, strict=True)}


def _no_disc(name: str, inner_radius: float) -> None:
    """InputError where a part has no centre line: to vary its radius would make it a ring."""
    if not inner_radius:
        raise InputError(f"part {name!r} is a disc; take part.{name}.outer_radius")


def place(table: dict[str, Any], path: str, text: Any) -> None:
    """Set one value of a geometry file's table in place; the reader of the geometry checks whether the key exists.

    Raises InputError: the path names a part, layer, interface or material that is not there.
    """
    kind, *middle, key = path.split(".") if "." in path else ("", path)
    name = ".".join(middle)  # names may hold dots
    for number, bus in enumerate(table.get("bus", [])):
        bus.setdefault("name", BUSES[min(number, 1)])
    if kind in _NAMED and name:
        items = {item.get(_NAMED[kind]): item for item in table.get(kind, [])}
        items[checks.choice(f"path {path!r}: {kind}", name, [str(k) for k in items])][key] = text
    elif kind in ("boundary", "light") and not name:
        table.setdefault(kind, {})[key] = text
    elif not kind and key not in (*_NAMED, *_TABLES):
        table[key] = text
    elif kind == "material" and middle[1:] and middle[-1] in _LAWS:
        material = table.setdefault(kind, {}).setdefault(".".join(middle[:-1]), {})
        given = material.get(middle[-1], {})
        law = given if isinstance(given, dict) else {"value": given}
        material[middle[-1]] = with_value(middle[-1], law, text) if key == "value" else {**law, key: text}
    elif kind in ("material", "boundary") and name:
        values = table.setdefault(kind, {})
        if kind == "boundary":
            values[name] = {key: text}
        elif isinstance(values.setdefault(name, {}).get(key), dict):
            values[name][key] = with_value(key, values[name][key], text)
        else:
            values[name][key] = text
    else:
        raise InputError(f"path {path!r} leads nowhere; {_HINT}")


_PART = {
    "ring": ("radius", "width", "inner_radius", "outer_radius", "bottom", "height", "sidewall_angle"),
    "straight": ("x", "width", "bottom", "height", "sidewall_angle"),
}
_MATERIAL = ("conductivity", "density", "specific_heat", "index", "thermo_optic")
_STEP = 1e-3  # K; of the central difference of a law of temperature, whose error is 1e-9 of its curvature


@dataclass(frozen=True, eq=False)
class Change:
    """Derivatives with respect to one parameter.

    name: of the parameter.
    value: of the parameter, SI (of its first path).
    outlines [dict from layer or part to array, shape (4, 2)]: velocity of its corners, in m per unit.
    conductivity, heat_capacity [dict from material to array (2,) or float]: of (k_r, k_z) in W/(m K) and of rho c_p
        in J/(m^3 K) at the ambient temperature, per unit.
    contact, convection, shell [dict from part, side or probe to float]: of the contact resistance, the coefficient and
        the thickness, per unit.
    optical [dict from material, bus or "light" to dict from key to float]: of index, thermo_optic, gap, straight, loss
        and wavelength, per unit.
    """

    name: str
    value: float
    unit: str
    outlines: dict[str, Array] = field(default_factory=dict)
    conductivity: dict[str, Array] = field(default_factory=dict)
    heat_capacity: dict[str, float] = field(default_factory=dict)
    contact: dict[str, float] = field(default_factory=dict)
    convection: dict[str, float] = field(default_factory=dict)
    shell: dict[str, float] = field(default_factory=dict)
    optical: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def moves(self) -> bool:
        """Whether any outline moves."""
        return any(np.any(velocity) for velocity in self.outlines.values())


def change(geometry: CrossSection, parameter: str | Sequence[str]) -> Change:
    """Derivatives of outlines and coefficients with respect to a parameter.

    parameter [str, or several paths that change together by the same amount]
    Raises InputError: a path that leads nowhere, or to what has no derivative.
    """
    paths = (parameter,) if isinstance(parameter, str) else tuple(parameter)
    single = [_change(geometry, path) for path in paths]
    units = sorted({one.unit for one in single})
    if len(units) > 1:
        raise InputError(f"parameter {' + '.join(paths)}: the paths have different units ({', '.join(units)})")
    kinds = ("outlines", "conductivity", "heat_capacity", "contact", "convection", "shell", "optical")
    sums = {kind: _sum([getattr(one, kind) for one in single]) for kind in kinds}
    return Change(" + ".join(paths), single[0].value, units[0], **sums)


def _sum(each: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The sum of nested mappings, key by key."""
    total: dict[str, Any] = {}
    for one in each:
        for name, value in one.items():
            inner = isinstance(value, dict)
            total[name] = _sum([total.get(name, {}), value]) if inner else total.get(name, 0.0) + value
    return total


def _change(geometry: CrossSection, path: str) -> Change:
    kind, *middle = path.split(".")
    if path == ("outer_radius" if geometry.kind == "ring" else "half_width"):
        left = -1.0 if geometry.inner_end < 0 else 0.0  # the left corners of the layers of a whole section move, too
        wider = np.array([(left, 0.0), (1.0, 0.0), (1.0, 0.0), (left, 0.0)])
        return Change(path, geometry.outer_radius, "m", {layer.name: wider for layer in geometry.layers})
    if path == "ambient":
        return _ambient(geometry)
    if kind == "material" and len(middle) >= 2:
        return _material(geometry, path, middle)
    name, key = ".".join(middle[:-1]), middle[-1] if middle else ""
    readers = {"part": _part, "layer": _layer, "boundary": _boundary}
    if kind in readers and name:
        return readers[kind](geometry, path, name, key)
    if kind in _NUMBERS and key and bool(name) == (kind != "light"):
        return _number(geometry, path, kind, name, key)
    raise InputError(f"path {path!r} leads nowhere; {_HINT}")


def _part(geometry: CrossSection, path: str, name: str, key: str) -> Change:
    parts = {part.name: part for part in geometry.parts}
    part = parts[checks.choice(f"path {path!r}: part", name, parts)]
    checks.choice(f"path {path!r}: key", key, _PART[geometry.kind], hint="a material has no derivative")
    if not part.straight and key in ("radius", "width", "inner_radius"):
        _no_disc(name, part.inner_radius)
    if not part.height:
        raise InputError(f"path {path!r}: part {name!r} has height 0 and is not there; nothing moves")
    values = {
        "radius": (part.inner_radius + part.outer_radius) / 2,
        "width": part.outer_radius - part.inner_radius,
    }
    value = values[key] if key in values else float(getattr(part, key))
    return Change(path, value, UNITS[key], _moved(geometry, part, _corners(part, key)))


def _moved(geometry: CrossSection, part: Part, corners: Array) -> dict[str, Array]:
    """Velocities of the outlines that are meshed where one part moves.

    In a mirrored section the response is even in x, so that moving one part changes it by half of what moving it and
    its image does: the half that is solved moves with the mean of the two.
    """
    if not geometry.mirrored:
        return {part.name: corners}
    image = corners[[1, 0, 3, 2]] * [-1, 1]
    if abs(part.inner_radius + part.outer_radius) <= SAME:  # its own image: corners on the mirror plane stay there
        return {part.name: (corners + image) / 2 * [[0, 1], [1, 1], [1, 1], [0, 1]]}
    if part.name in outlines(geometry):
        return {part.name: corners / 2}
    number = geometry.parts.index(part)
    twin = next(p for p in geometry.parts[max(number - 1, 0) : number + 2] if images(part, p))
    return {twin.name: image / 2}


def _corners(part: Part, key: str) -> Array:
    """Velocity of the corners of a part, in the order of `Part.outline`; shape (4, 2)."""
    inner = {"radius": 1.0, "width": -0.5, "inner_radius": 1.0}.get(key, 0.0)
    outer = {"radius": 1.0, "width": 0.5, "outer_radius": 1.0}.get(key, 0.0)
    foot, top = {"bottom": (1.0, 1.0), "height": (0.0, 1.0)}.get(key, (0.0, 0.0))
    lean = 0.0
    if key == "x":
        inner = outer = 1.0
    if key == "height":  # the lean is height/(2 tan(angle))
        lean = math.cos(part.sidewall_angle) / math.sin(part.sidewall_angle) / 2
    elif key == "sidewall_angle":
        lean = -part.height / 2 / math.sin(part.sidewall_angle) ** 2
    inner_lean = lean if part.inner_radius or part.straight else 0.0
    return np.array([(inner - inner_lean, foot), (outer + lean, foot), (outer - lean, top), (inner + inner_lean, top)])


def _layer(geometry: CrossSection, path: str, name: str, key: str) -> Change:
    names = [layer.name for layer in geometry.layers]
    moved = names.index(checks.choice(f"path {path!r}: layer", name, names))
    checks.choice(f"path {path!r}: key", key, ("thickness",), hint="a material has no derivative")
    datum = next(k for k, layer in enumerate(geometry.layers) if layer.datum)
    edges = np.arange(len(names) + 1)
    speed = np.where(edges <= moved, -1.0, 0.0) if moved <= datum else np.where(edges > moved, 1.0, 0.0)
    boxes = {
        layer: np.array([(0.0, speed[k]), (0.0, speed[k]), (0.0, speed[k + 1]), (0.0, speed[k + 1])])
        for k, layer in enumerate(names)
    }
    return Change(path, geometry.layers[moved].thickness, "m", boxes)


_NUMBERS = {
    "interface": ("resistance",),
    "probe": ("shell",),
    "bus": ("gap", "straight"),
    "light": ("wavelength", "loss"),
}


def _number(geometry: CrossSection, path: str, kind: str, name: str, key: str) -> Change:
    """A number of an interface, a probe, a [[bus]] or [light], which moves no mesh."""
    given: Any = geometry.light
    if kind != "light":
        each = {"interface": geometry.interfaces, "probe": geometry.probes, "bus": geometry.buses}[kind]
        known = {getattr(one, _NAMED[kind]): one for one in each}
        given = known[checks.choice(f"path {path!r}: {kind}", name, known)]
    checks.choice(f"path {path!r}: key", key, _NUMBERS[kind])
    if getattr(given, key, None) is None:
        raise InputError(f"path {path!r} leads nowhere; {geometry.name!r} does not give it")
    of = {"interface": {"contact": {name: 1.0}}, "probe": {"shell": {name: 1.0}}}
    slope: dict[str, Any] = of.get(kind, {"optical": {name or LIGHT: {key: 1.0}}})
    return Change(path, float(getattr(given, key)), UNITS[key], **slope)


def _boundary(geometry: CrossSection, path: str, side: str, key: str) -> Change:
    checks.choice(f"path {path!r}: side", side, ("bottom", "top", "outer"))
    boundary: Boundary = getattr(geometry, side)
    known = [boundary.kind] if boundary.coefficient else []
    checks.choice(f"path {path!r}: key", key, known, hint=f"{side} is {boundary.kind}")
    return Change(path, boundary.coefficient, UNITS[key], convection={side: 1.0})


def _material(geometry: CrossSection, path: str, middle: Sequence[str]) -> Change:
    """material.NAME.property, or material.NAME.property.key for a key of its law."""
    used = {region: geometry.material_of(region) for region in geometry.region_names}
    names = {material.name: material for material in used.values()}
    split = 2 if len(middle) > 2 and middle[-2] in ("conductivity", "specific_heat") else 1
    name, keys = ".".join(middle[:-split]), middle[-split:]
    hint = "no layer or part is made of it" if name not in names else ""
    material = names[checks.choice(f"path {path!r}: material", name, names, hint=hint)]
    checks.choice(f"path {path!r}: property", keys[0], _MATERIAL)
    if keys[0] in ("index", "thermo_optic"):
        value = material.thermo_optic if keys[0] == "thermo_optic" else constant(material.index)
        if value is None:
            raise InputError(f"path {path!r} has no derivative: the index of {name!r} is no constant")
        return Change(path, value, UNITS.get(keys[0], ""), optical={name: {keys[0]: 1.0}})
    kind, key = keys[0], keys[1] if len(keys) > 1 else "value"
    T0 = geometry.ambient
    if kind == "density":
        share = material.specific_heat * float(material.specific_heat_law.factor(T0))
        return Change(path, material.density, UNITS[kind], heat_capacity={name: share})
    law: Law = getattr(material, f"{kind}_law")
    value, unit, factor, of_law = _law(path, material, law, kind, key, T0)
    if kind == "specific_heat":
        scale = material.density * (factor + material.specific_heat * of_law)
        return Change(path, value, unit, heat_capacity={name: scale})
    k_r = material.conductivity
    k_z = k_r if material.conductivity_z is None else material.conductivity_z
    along_r = 0.0 if key == "z" else factor
    along_z = factor if key == "z" or material.conductivity_z is None else 0.0
    return Change(path, value, unit, conductivity={name: np.array([along_r + k_r * of_law, along_z + k_z * of_law])})


def _law(path: str, material: Material, law: Law, kind: str, key: str, T0: float) -> tuple[float, str, float, float]:
    """Value and unit; d(value f)/d(key) = first + value * second, with f the law at the ambient temperature."""
    f = float(law.factor(T0))
    if key in ("value", "r"):
        return float(getattr(material, kind)), UNITS[kind], f, 0.0
    if key == "z" and kind == "conductivity" and material.conductivity_z is not None:
        return material.conductivity_z, UNITS[kind], f, 0.0
    if key == "exponent" and isinstance(law, PowerLaw):
        return law.exponent, UNITS[key], 0.0, f * math.log(T0 / law.reference)
    if key == "reference" and isinstance(law, PowerLaw):
        return law.reference, UNITS[key], 0.0, -law.exponent * f / law.reference
    rule = "value, r, z (where it is given) and, of a power law, exponent and reference have"
    raise InputError(f"path {path!r} has no derivative; {rule}")


def _ambient(geometry: CrossSection) -> Change:
    """Conductivities and heat capacities that depend on temperature change with the ambient one."""
    T0 = geometry.ambient

    def slope(law: Law) -> float:
        if isinstance(law, PowerLaw):
            return law.exponent * float(law.factor(T0)) / T0
        return float(law.factor(T0 + _STEP) - law.factor(T0 - _STEP)) / (2 * _STEP)

    conductivity, capacity = {}, {}
    for region in geometry.region_names:
        m = geometry.material_of(region)
        k_z = m.conductivity if m.conductivity_z is None else m.conductivity_z
        of_k, of_c = slope(m.conductivity_law), slope(m.specific_heat_law)
        conductivity[m.name], capacity[m.name] = of_k * np.array([m.conductivity, k_z]), m.heat_capacity * of_c
    return Change("ambient", T0, "K", conductivity=conductivity, heat_capacity=capacity)
