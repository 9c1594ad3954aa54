"""Numbers of a geometry by their paths: to set them, and what changes with them.

A path names the number as in a campaign: "part.core.radius", "layer.box.thickness", "material.SiO2.conductivity".
Several paths may form one parameter; they then change together, each by the same amount.

Derivatives of outlines, materials and surfaces by a parameter p are differences of second order with the step h,

    df/dp = (4 f(p + h) - f(p + 2 h) - 3 f(p))/(2 h),

of geometries that are read, but not checked as a whole: a step may leave a gap thinner than an atom.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array
from ..checks import InputError
from ..data import files, quantity
from ..materials.material_laws import fixed_index
from ..materials.material_library import find, with_value
from .geometry_file import as_text, fields, spelled_out, unit_of
from .regions import boxes, outlines
from .section_parts import BUSES, LIGHT, SAME_POINT, images

if TYPE_CHECKING:
    from ..materials.material_library import Material
    from .cross_section import CrossSection
    from .section_parts import Part

# lists of tables, and what names one
_NAMED = {"part": "name", "layer": "name", "probe": "name", "interface": "part", "bus": "name"}
_TABLES = ("material", "boundary", "light", "plan")
_LAWS = ("conductivity", "specific_heat")  # properties that may be tables themselves: "material.Si.conductivity.z"
_CENTRE = ("radius", "width")
_EDGES = ("inner_radius", "outer_radius")
_FORMS = f"{' and '.join(_CENTRE)}, or {' and '.join(_EDGES)}"
_HINT = 'write it as "part.core.width", "layer.box.thickness", "material.SiO2.conductivity" or "outer_radius"'
_STEP, _LEAST = 1e-4, 1e-9  # of the differences: relative, whose square is their error, and of a number that is 0


def change_values(table: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Set the values of some paths in a geometry file's table in place; numbers in SI, or text with units."""
    check_once(values)
    for path, value in values.items():
        place(table, path, as_text(path, value))


def check_once(paths: Iterable[str]) -> None:
    """Raise InputError where two paths set one value, or give the radii of a part in two forms."""
    # a side has one value, whatever its kind
    values = [path.removesuffix(".value") for path in paths]
    places = [re.sub(r"^(boundary\.\w+)\.\w+$", r"\1", path) for path in values]
    checks.unique("list of paths", places, hint="both set one value")
    sizes: dict[str, str] = {}
    for path in places:
        part, _, key = path.rpartition(".")
        if path.startswith("part.") and key in (*_CENTRE, *_EDGES):
            first = sizes.setdefault(part, key)
            if (first in _CENTRE) != (key in _CENTRE):
                name = part.removeprefix("part.")
                raise InputError(f"part {name!r}: {first} and {key} are of two forms; give two of one: {_FORMS}")


def place(table: dict[str, Any], path: str, text: Any) -> None:
    """Set one value in the table of a geometry file in place; the reader of the geometry checks whether the key exists.

    Raises InputError: the path names a part, layer, interface or material that is not there.
    """
    holder, key = _holder(table, path)
    law = holder.get(key)
    if key in _LAWS and isinstance(law, dict):
        text = with_value(key, law, text)
    holder[key] = text


def _holder(table: dict[str, Any], path: str) -> tuple[dict[str, Any], str]:
    """Table that contains the value of a path, and its key there."""
    kind, *middle, key = path.split(".") if "." in path else ("", path)
    name = ".".join(middle)  # names may hold dots
    for number, bus in enumerate(table.get("bus", [])):
        bus.setdefault("name", BUSES[min(number, 1)])
    if kind in _NAMED and name:
        named_by = _NAMED[kind]
        items = {str(item.get(named_by)): item for item in table.get(kind, [])}
        item = items[checks.choice(f"path {path!r}: {kind}", name, items)]
        if kind == "part" and key in (*_CENTRE, *_EDGES):
            _measure(item, key)
        return item, key
    if not kind and key not in (*_NAMED, *_TABLES):
        return table, key
    if kind in ("boundary", "light", "plan") and not name:
        return table.setdefault(kind, {}), key
    if kind == "boundary":
        sides = table.setdefault(kind, {})
        if not isinstance(sides.get(name), dict):
            sides[name] = {}
        return sides[name], key
    if kind != "material" or not name:
        raise InputError(f"path {path!r} leads nowhere; {_HINT}")
    *before, quality = middle
    materials = table.setdefault(kind, {})
    if not before or quality not in _LAWS:
        return materials.setdefault(name, {}), key
    material = materials.setdefault(".".join(before), {})
    if key in ("value", "r"):
        return material, quality
    law = material.get(quality, {})
    material[quality] = law if isinstance(law, dict) else {"value": law}
    return material[quality], key


def _measure(item: dict[str, Any], key: str) -> None:
    """Convert the radii of a part in place to the form that ``key`` belongs to: centre and width, or both edges."""
    by_centre = key in _CENTRE
    old = _EDGES if by_centre else _CENTRE
    if key in item or "x" in item or not set(old) <= item.keys():
        return
    first = quantity.parse(item.pop(old[0]), "m")
    second = quantity.parse(item.pop(old[1]), "m")
    if not by_centre:
        item["inner_radius"] = quantity.write(first - second / 2, "m")
        item["outer_radius"] = quantity.write(first + second / 2, "m")
        return
    if not first:
        raise InputError(f"part {item['name']!r} is a disc; take part.{item['name']}.outer_radius")
    item["radius"] = quantity.write((first + second) / 2, "m")
    item["width"] = quantity.write(second - first, "m")


@dataclass(frozen=True, eq=False)
class Change:
    """Derivatives with respect to one parameter; what does not change is left out.

    name: of the parameter.
    value: of the parameter, SI (of its first path).
    outlines [dict from layer or part to array, shape (4, 2)]: velocity of its corners, in m per unit.
    conductivity, heat_capacity [dict from material to array (2,) or float]: of (k_r, k_z) in W/(m K) and of rho c_p
        in J/(m^3 K) at the ambient temperature, per unit.
    contact, exchange, shell [dict from part, side or probe to float]: of the contact resistance, the heat transfer
        coefficient and the thickness, per unit.
    optical [dict from (material, bus or "light", key) to float]: of index, thermo_optic, gap, straight, loss and
        wavelength, per unit.
    """

    name: str
    value: float
    unit: str
    outlines: dict[str, Array] = field(default_factory=dict)
    conductivity: dict[str, Array] = field(default_factory=dict)
    heat_capacity: dict[str, float] = field(default_factory=dict)
    contact: dict[str, float] = field(default_factory=dict)
    exchange: dict[str, float] = field(default_factory=dict)
    shell: dict[str, float] = field(default_factory=dict)
    optical: dict[tuple[str, str], float] = field(default_factory=dict)

    @property
    def moves(self) -> bool:
        """Whether any outline moves."""
        return bool(self.outlines)

    def corners(self, name: str) -> Array:
        """Velocities of the corners of a layer or part, shape (4, 2), in m per unit; zero where it does not move."""
        return self.outlines.get(name, np.zeros((4, 2)))

    def of_optics(self, owner: str, key: str) -> float:
        """Slope of a number of ``optical``; 0 where it does not change."""
        return self.optical.get((owner, key), 0.0)


def change(geometry: CrossSection, parameter: str | Sequence[str]) -> Change:
    """Derivatives of outlines and coefficients with respect to a parameter.

    parameter [str, or several paths that change together by the same amount]
    Raises InputError: a path that leads nowhere, or to what has no derivative.
    """
    paths = (parameter,) if isinstance(parameter, str) else tuple(parameter)
    check_once(paths)
    table = spelled_out(geometry)
    values = [_value(geometry, table, path) for path in paths]
    units = sorted({unit_of(path) or "" for path in paths})
    if len(units) > 1:
        raise InputError(f"parameter {' + '.join(paths)}: the paths have different units ({', '.join(units)})")
    step = _STEP * abs(values[0]) or _LEAST

    def after(steps: int) -> dict[str, dict[Any, Any]]:
        new = copy.deepcopy(table)
        for path, value in zip(paths, values, strict=True):
            place(new, path, as_text(path, value + steps * step))
        return _numbers(geometry, fields(files.to_toml(new)))

    now = after(0)
    one_step = after(1)
    two_steps = after(2)
    ten_digits = np.vectorize(lambda x: float(f"{x:.10g}"))  # beyond is round-off of the numbers, 1e-16, over the step
    slopes: dict[str, dict[Any, Any]] = {kind: {} for kind in now}
    for kind, numbers in now.items():
        for key, f0 in numbers.items():
            f1 = one_step[kind][key]
            f2 = two_steps[kind][key]
            slope = ten_digits((4 * f1 - f2 - 3 * f0) / (2 * step))[()]
            if np.any(slope):
                slopes[kind][key] = slope
    if not any(slopes.values()):
        raise InputError(f"path {' + '.join(paths)!r} has no derivative")
    return Change(" + ".join(paths), values[0], units[0], **slopes)


def changes_of(geometry: CrossSection, parameters: Any) -> list[Change]:
    """The `Change` of every parameter of a list; one path stands for a list of one."""
    several = [parameters] if isinstance(parameters, str) else parameters
    checked = checks.instances("parameters", several, str, tuple, list)
    return [change(geometry, parameter) for parameter in checked]


def _value(geometry: CrossSection, table: dict[str, Any], path: str) -> float:
    """The number at a path, in SI."""
    holder, key = _holder(table, path)
    kind, *middle = path.split(".")
    why = {
        "material": "no layer or part is made of it",
        "boundary": f"{'.'.join(middle[:-1])} is insulated or isothermal",
    }
    hint = _HINT if holder else why.get(kind, _HINT)
    checks.choice(f"path {path!r} leads nowhere: key", key, holder, hint=hint)
    unit = "" if key == "index" else unit_of(path)
    value = holder[key]
    if isinstance(value, dict):
        value = value.get("value")
    if unit is None or not isinstance(value, str | float):
        raise InputError(f"path {path!r} has no derivative: {key} is no number")
    if kind == "bus" and key == "straight" and geometry.straight:
        raise InputError(
            f"path {path!r} has no derivative: the bus of a racetrack runs along it, and [plan] straight is its length"
        )
    parts = geometry.parts if kind == "part" else ()
    for part in parts:
        disc = key == "inner_radius" and not (part.inner_radius or part.straight)
        if part.name == holder["name"] and (disc or not part.height):
            raise InputError(f"path {path!r} has no derivative: part {part.name!r} has height 0, or is a disc")
    return value if isinstance(value, float) else quantity.parse(value, unit, name=path)


def _numbers(geometry: CrossSection, changed: Mapping[str, Any]) -> dict[str, dict[Any, Any]]:
    """All numbers that a parameter can change, by the fields of `Change`, in a geometry next to this one."""
    end = changed.get("half_width") or changed["outer_radius"]
    begin = -end if geometry.inner_end < 0 else 0.0
    shapes = boxes(changed["layers"], begin, end)
    for old, new in zip(geometry.parts, changed["parts"], strict=True):
        name, outline = _meshed(geometry, old, new.outline())
        shapes[name] = shapes.get(name, 0.0) + outline
    names = {geometry.material_of(region).name for region in geometry.region_names}
    materials = [find(name, changed["materials"]) for name in names]
    conductivity = {}
    heat_capacity = {}
    for m in materials:
        k_z = m.conductivity if m.conductivity_z is None else m.conductivity_z
        k = np.array([m.conductivity, k_z])
        conductivity[m.name] = k * m.conductivity_law.factor(changed["ambient"])
        heat_capacity[m.name] = m.heat_capacity * float(m.specific_heat_law.factor(changed["ambient"]))
    return {
        "outlines": shapes,
        "conductivity": conductivity,
        "heat_capacity": heat_capacity,
        "contact": {interface.part: interface.resistance for interface in changed["interfaces"]},
        "exchange": {side: changed[side].exchange for side in ("bottom", "top", "outer")},
        "shell": {probe.name: probe.shell or 0.0 for probe in changed["probes"]},
        "optical": _optical_numbers(materials, changed),
    }


def _optical_numbers(materials: Iterable[Material], changed: Mapping[str, Any]) -> dict[tuple[str, str], float]:
    """Numbers of materials, buses and light that the mode depends on, as in `Change.optical`."""
    optical: dict[tuple[str, str], float] = {}
    for material in materials:
        optical[material.name, "index"] = fixed_index(material.index) or 0.0
        optical[material.name, "thermo_optic"] = material.thermo_optic or 0.0
    for bus in changed["buses"]:
        optical[bus.name, "gap"] = bus.gap
        optical[bus.name, "straight"] = bus.straight
    light = changed["light"]
    if light is not None:
        optical[LIGHT, "wavelength"] = light.wavelength
        optical[LIGHT, "loss"] = light.loss or 0.0
    return optical


def _meshed(geometry: CrossSection, part: Part, outline: Array) -> tuple[str, Array]:
    """Name of the part of the solved half that moves with ``part``, and the corners (4, 2) in m that move it.

    In a mirrored section only the half x >= 0 is solved. The response is even in x, so that moving a part alone has
    half of the effect of moving it with its image: the solved half moves by the mean of both.
    """
    if not geometry.mirrored:
        return part.name, outline
    image = outline[[1, 0, 3, 2]] * [-1, 1]
    if abs(2 * part.centre) <= SAME_POINT:  # its own image: corners on the mirror plane stay there
        moves = [[0, 1], [1, 1], [1, 1], [0, 1]]
        return part.name, (outline + image) / 2 * moves
    if part.name in outlines(geometry):
        return part.name, outline / 2
    number = geometry.parts.index(part)
    beside = geometry.parts[max(number - 1, 0) : number + 2]
    twin = next(other for other in beside if images(part, other))
    return twin.name, image / 2
