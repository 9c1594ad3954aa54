"""Places in a geometry file by name: "part.core.width"."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .. import checks
from ..checks import InputError
from ..data import quantity
from ..materials.property_toml import with_value
from . import toml_schema

_NAMED = {"part": "name", "layer": "name", "probe": "name", "interface": "part"}  # lists of tables, and what names one
_TABLES = ("material", "boundary")
_LAWS = ("conductivity", "specific_heat")  # properties that may be tables themselves: "material.Si.conductivity.z"
_CENTRE, _EDGES = ("radius", "width"), ("inner_radius", "outer_radius")
_FORMS = f"{' and '.join(_CENTRE)}, or {' and '.join(_EDGES)}"
_HINT = 'write it as "part.core.width", "layer.box.thickness", "material.SiO2.conductivity" or "outer_radius"'


def change_values(table: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Set the values of some paths in a geometry file's table in place; numbers in SI, or text with units."""
    for path in values:
        if not isinstance(path, str):
            raise InputError(f"path {path!r} is no text; {_HINT}")
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
        place(table, path, toml_schema.as_text(path, value))


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
        if not one:
            raise InputError(f"part {item['name']!r} is a disc; take part.{item['name']}.outer_radius")
        sizes = ((one + two) / 2, two - one)
    else:
        sizes = (one - two / 2, one + two / 2)
    item |= {name: quantity.write(size, "m") for name, size in zip(wanted, sizes, strict=True)}


def place(table: dict[str, Any], path: str, text: Any) -> None:
    """Set one value of a geometry file's table in place; the reader of the geometry checks whether the key exists.

    Raises InputError: the path names a part, layer, interface or material that is not there.
    """
    kind, *middle = path.split(".")
    if not middle and kind in (*_NAMED, *_TABLES):
        raise InputError(f"path {path!r} names a table, and no value in it; {_HINT}")
    if not middle:
        table[kind] = text
        return
    key = middle.pop()
    name = ".".join(middle)  # names may hold dots
    if kind in _NAMED and name:
        items = {item.get(_NAMED[kind]): item for item in table.get(kind, [])}
        items[checks.choice(f"path {path!r}: {kind}", name, [str(k) for k in items])][key] = text
    elif kind == "boundary" and not name:
        table.setdefault(kind, {})[key] = text
    elif kind == "material" and middle[1:] and middle[-1] in _LAWS:
        material = table.setdefault(kind, {}).setdefault(".".join(middle[:-1]), {})
        given = material.get(middle[-1], {})
        law = given if isinstance(given, dict) else {"value": given}
        material[middle[-1]] = with_value(middle[-1], law, text) if key == "value" else {**law, key: text}
    elif kind in _TABLES and name:
        values = table.setdefault(kind, {})
        if kind == "boundary":
            values[name] = {key: text}
        elif isinstance(values.setdefault(name, {}).get(key), dict):
            values[name][key] = with_value(key, values[name][key], text)
        else:
            values[name][key] = text
    else:
        raise InputError(f"path {path!r} leads nowhere; {_HINT}")
