"""The geometry file: TOML text with units in, the fields of a `CrossSection` out, and back.

Each table of the file has its keys listed here once, with the unit that the value must have; an unknown key is an error
that suggests the nearest one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..data import files, quantity
from ..data.files import ANY, FLAG, TABLE, TABLES, TEXT, read_table
from ..materials.material_laws import fixed_index, read_index, write_index
from ..materials.material_library import LAW_KEYS, LIBRARY, PROPERTIES, Material, read_property, write_property
from . import section_parts
from .section_parts import Boundary, Bus, Guide, Interface, Layer, Part, Probe, ring

if TYPE_CHECKING:
    from .cross_section import CrossSection

# key -> the SI unit of its text, or what else it holds
_TOP = {
    "name": TEXT,
    "kind": TEXT,
    "outer_radius": "m",
    "length": "m",
    "half_width": "m",
    "ambient": "K",
    "layer": TABLES,
    "part": TABLES,
    "interface": TABLES,
    "probe": TABLES,
    "boundary": TABLE,
    "material": TABLE,
    "light": TABLE,
    "bus": TABLES,
    "plan": TABLE,
}
_SIZES = {"ring": ("outer_radius",), "straight": ("length", "half_width")}
_LAYER = {"name": TEXT, "material": TEXT, "thickness": "m", "datum": FLAG}
_PART = {
    "name": TEXT,
    "material": TEXT,
    "radius": "m",
    "width": "m",
    "inner_radius": "m",
    "outer_radius": "m",
    "x": "m",
    "bottom": "m",
    "height": "m",
    "sidewall_angle": "rad",
    "heated": FLAG,
    "resistance": "ohm",
    "tcr": "1/K",
}
_INTERFACE = {"part": TEXT, "resistance": "m^2*K/W"}
_PROBE = {"name": TEXT, "part": TEXT, "shell": "m", "distance": "m"}
_BOUNDARY = {"bottom": ANY, "top": ANY, "outer": ANY}
_LIGHT = {"wavelength": "m", "part": TEXT, "polarisation": TEXT, "loss": "1/m"}
_BUS = {"name": TEXT, "gap": "m", "straight": "m", "width": "m"}
_PLAN = {"straight": "m"}
_COEFFICIENT = {kind: law.unit for kind, law in Boundary.KINDS.items() if law.unit is not None}
_OPTICAL = {"thermo_optic": "1/K", "two_photon": "m/W", "kerr": "m^2/W"}
_SCALARS = {**_OPTICAL, "resistivity": "ohm*m"}  # of a material, where it has them
_MATERIAL = {"conductivity": ANY, "density": "kg/m^3", "specific_heat": ANY, "source": TEXT, "index": ANY, **_SCALARS}

UNITS = {
    key: unit
    for keys in (_TOP, _LAYER, _INTERFACE, _PART, _PROBE, _COEFFICIENT, _MATERIAL, _LIGHT, _BUS, _PLAN)
    for key, unit in keys.items()
    if unit in quantity.SI
} | {"conductivity": "W/m/K", "specific_heat": "J/kg/K", "exponent": "", "reference": "K"}
CONTACT = "interface"  # whose key "resistance" has another unit than that of a part


def as_text(path: str, value: Any) -> Any:
    """Write a value as a geometry file has it at a path: numbers in SI get their unit, anything else is unchanged."""
    scalar_array = type(value) is np.ndarray and value.ndim == 0  # no masked array
    if isinstance(value, np.generic) or scalar_array:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    number = checks.finite(path, value)
    unit = unit_of(path)
    return value if unit is None else quantity.write(number, unit)


def unit_of(path: str) -> str | None:
    """SI unit of the field at a path of a geometry file, such as "layer.0.thickness"; "" where it has no dimension.

    None where the field is no quantity with a fixed unit.
    """
    *before, key = path.split(".")
    if before[:1] == [CONTACT] and key in _INTERFACE:
        return _INTERFACE[key]
    if key in ("value", "r", "z") and before:
        key = before[-1]
    return UNITS.get(key)


def fields(text: str) -> dict[str, Any]:
    """The fields of the `CrossSection` that the text of a geometry file describes."""
    table = files.from_toml(text)
    if table.keys() & {"base", "loaded_q", "wavelength", "carriers"}:
        raise checks.InputError(
            "this describes the optics of a ring; a geometry has outer_radius, [[layer]] and [[part]]"
        )
    sizes = _SIZES.get(table.get("kind", "ring"), ("outer_radius",))
    of_other_kinds = set(sum(_SIZES.values(), ())) - set(sizes)
    keys = {key: unit for key, unit in _TOP.items() if key not in of_other_kinds}
    top = read_table(table, keys, "the file", required=(*sizes, "layer", "part"))
    boundary = read_table(top.get("boundary", {}), _BOUNDARY, "[boundary]")
    for number, bus in enumerate(top.get("bus", [])):
        bus.setdefault("name", section_parts.BUSES[min(number, 1)])
    values = {key: top[key] for key in ("kind", *sizes) if key in top}
    values["name"] = top.get("name", "cross-section")
    values["layers"] = _each(top, "layer", _LAYER, Layer, ("name", "material", "thickness"))
    values["parts"] = _each(top, "part", _PART, _part, ("name", "material", "bottom", "height"))
    values["interfaces"] = _each(top, "interface", _INTERFACE, Interface, ("part", "resistance"))
    values["probes"] = _each(top, "probe", _PROBE, Probe, ("name", "part"))
    values |= {side: _boundary(boundary, side) for side in _BOUNDARY}
    materials = top.get("material", {})
    values["materials"] = tuple(_material(name, item) for name, item in materials.items())
    values["ambient"] = top.get("ambient", 293.15)
    values["light"] = _light(top["light"], top["part"]) if "light" in top else None
    values["buses"] = _each(top, "bus", _BUS, Bus, ("gap",))
    values |= read_table(top.get("plan", {}), _PLAN, "[plan]")
    return values


def _each(
    top: dict[str, Any], kind: str, keys: dict[str, Any], make: Callable[..., Any], required: tuple[str, ...]
) -> tuple[Any, ...]:
    """Apply ``make`` to every table of the list ``kind``, with its keys checked."""
    made = []
    for k, table in enumerate(top.get(kind, []), 1):
        name = table.get("name", table.get("part"))
        where = f"{kind} {name!r}" if isinstance(name, str) else f"{kind} number {k}"
        values = read_table(table, keys, where, required=required)
        made.append(make(**values))
    return tuple(made)


def _part(**values: Any) -> Part:
    """Make a part from its radius and width, its inner and outer radius, or its x and width."""
    by_centre = {"radius", "width"} & set(values)
    by_edges = {"inner_radius", "outer_radius"} & set(values)
    if "x" in values and not by_edges and "radius" not in values:
        return Part(**values)
    where = f"part {values['name']!r}"
    if len(by_centre) == 2 and not by_edges:
        inner, outer = ring(values.pop("radius"), values.pop("width"), of=f"{where}: ")
        values |= {"inner_radius": inner, "outer_radius": outer}
    elif len(by_edges) != 2 or by_centre:
        given = ", ".join(sorted(by_centre | by_edges)) or "neither"
        raise checks.InputError(
            f"{where}: give radius and width, or inner_radius and outer_radius (given: {given}); "
            "of a straight section x and width"
        )
    return Part(**values)


def _light(table: dict[str, Any], parts: list[dict[str, Any]]) -> Guide:
    """Make the guide of [light]; its part defaults to "core", or else to the first heated one."""
    values = read_table(table, _LIGHT, "[light]", required=("wavelength",))
    names = [part.get("name") for part in parts]
    heated = [part.get("name") for part in parts if part.get("heated")]
    default = "core" if "core" in names or not heated else heated[0]
    return Guide(**{"part": default, **values})


def _boundary(table: dict[str, Any], side: str) -> Boundary:
    """Make the boundary of one side; by default the bottom is held and the others are insulated."""
    value = table.get(side, "isothermal" if side == "bottom" else "insulated")
    if isinstance(value, dict):
        values = read_table(value, _COEFFICIENT, f"boundary {side}")
        if len(values) != 1:
            raise checks.InputError(f"boundary {side}: give one of {', '.join(_COEFFICIENT)}")
        return Boundary(*values.popitem())
    hint = 'convection is written { convection = "1e4 W/m^2/K" }'
    kinds = Boundary.KINDS.keys() - _COEFFICIENT.keys()
    return Boundary(checks.choice(f"boundary {side}", value, kinds, hint=hint))


def _material(name: str, table: Any) -> Material:
    """A material of the file; a key left out keeps the value and the law of the library's material of that name."""
    where = f"[material.{name}]"
    required = () if name in LIBRARY else PROPERTIES
    values = read_table(table, _MATERIAL, where, required=required)
    for key in ("conductivity", "specific_heat"):
        if key in values:
            law = values.pop(key)
            if isinstance(law, dict):
                law = read_table(law, LAW_KEYS[key], f"{where} {key}")
            values |= read_property(key, law, UNITS[key], where)
    if "index" in values:
        values["index"] = read_index(values["index"], where)
    source = "geometry file"
    missing = [key for key in PROPERTIES if key not in values]
    if missing:
        source += f" ({', '.join(missing)}: {LIBRARY[name].source})"
    values = {"source": source, **values}
    return replace(LIBRARY[name], **values) if name in LIBRARY else Material(name=name, **values)


def table_of(geometry: CrossSection) -> dict[str, Any]:
    """The table of a geometry file, quantities as text; reading it back gives an equal CrossSection."""
    domain = {key: getattr(geometry, key) for key in _SIZES[geometry.kind]}
    kind = None if geometry.kind == "ring" else geometry.kind
    tables = _texts({"name": geometry.name, "kind": kind, **domain, "ambient": geometry.ambient})
    tables["layer"] = [_texts(asdict(layer)) for layer in geometry.layers]
    tables["part"] = [_texts(_part_values(part)) for part in geometry.parts]
    tables[CONTACT] = [_texts(asdict(interface), CONTACT) for interface in geometry.interfaces]
    tables["probe"] = [_texts(asdict(probe)) for probe in geometry.probes]
    tables["boundary"] = {side: _boundary_value(getattr(geometry, side)) for side in _BOUNDARY}
    tables["material"] = {m.name: _material_values(m) for m in geometry.materials}
    if geometry.light is not None:
        tables["light"] = _texts(asdict(geometry.light))
    tables["bus"] = [_texts(asdict(bus)) for bus in geometry.buses]
    tables["plan"] = _texts({"straight": geometry.straight or None})
    return {key: table for key, table in tables.items() if table}


def spelled_out(geometry: CrossSection) -> dict[str, Any]:
    """`table_of` with defaults written out: right angles, every material in use, constant indices as numbers."""
    table = {"material": {}, **table_of(geometry)}
    for part in table["part"]:
        part.setdefault("sidewall_angle", as_text("sidewall_angle", section_parts.VERTICAL))
    for m in map(geometry.material_of, geometry.region_names):
        material = {"thermo_optic": "0 1/K", **_material_values(m)}
        n = fixed_index(m.index)
        if n is not None:
            material["index"] = n
        table["material"][m.name] = material
    return table


def _texts(values: dict[str, Any], table: str = "") -> dict[str, Any]:
    """Quantities of a ``table`` as text; flags that are false and values that are None are left out."""
    before = f"{table}." if table else ""
    texts = {}
    for key, value in values.items():
        if value is not None and value is not False:
            texts[key] = as_text(f"{before}{key}", value)
    return texts


def _boundary_value(boundary: Boundary) -> Any:
    if boundary.kind not in _COEFFICIENT:
        return boundary.kind
    return _texts({boundary.kind: boundary.coefficient})


def _material_values(m: Material) -> dict[str, Any]:
    conductivity = write_property(m, "conductivity", UNITS["conductivity"])
    specific_heat = write_property(m, "specific_heat", UNITS["specific_heat"])
    density = as_text("density", m.density)
    scalars = {key: getattr(m, key) or None for key in _SCALARS}
    optical = _texts(scalars | {"thermo_optic": m.thermo_optic})
    if m.index is not None:
        optical["index"] = write_index(m.index)
    heat = {"conductivity": conductivity, "density": density, "specific_heat": specific_heat}
    return {**heat, **optical, "source": m.source}


def _part_values(part: Part) -> dict[str, Any]:
    """Fields of a part in a file: radius and width where they give exactly the same edges, else both radii."""
    inner, outer = part.inner_radius, part.outer_radius
    radius = float(f"{(inner + outer) / 2:.12g}")
    width = float(f"{outer - inner:.12g}")
    if part.straight:
        sizes = {"x": part.x, "width": part.width}
    elif inner and radius - width / 2 == inner and radius + width / 2 == outer:
        sizes = {"radius": radius, "width": width}
    else:
        sizes = {"inner_radius": inner, "outer_radius": outer}
    angle = None if part.sidewall_angle == section_parts.VERTICAL else part.sidewall_angle
    upright = {"bottom": part.bottom, "height": part.height, "sidewall_angle": angle}
    electric = {"heated": part.heated, "resistance": part.resistance, "tcr": part.tcr or None}
    return {"name": part.name, "material": part.material, **sizes, **upright, **electric}
