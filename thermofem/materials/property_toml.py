"""Material properties in the geometry file: a plain value, or a table with a law of temperature.

    conductivity = "130 W/m/K"
    conductivity = { value = "130 W/m/K", exponent = -1.3, reference = "300 K" }
    conductivity = { value = "1.38 W/m/K", polynomial = [1.3e-3, -1e-6], reference = "300 K" }
    conductivity = { temperature = ["300 K", "400 K"], values = ["148 W/m/K", "98.9 W/m/K"] }
    conductivity = { r = "60 W/m/K", z = "30 W/m/K" }
    specific_heat = { value = "700 J/kg/K", exponent = 0.5 }

``value`` holds along and across the layers; ``r`` and ``z``, given together, along and across them. The polynomial
begins with its coefficient in 1/K. A table has the value of its curve at ``reference``; a value beside it must be that.
"""

from __future__ import annotations

import math
from typing import Any

from .. import checks
from ..checks import InputError, finite
from ..data import quantity
from .laws import CONSTANT, Law, Polynomial, PowerLaw, Table
from .library import Material

SAME = 1e-9  # relative; a value beside a table is that of its curve within round-off
PROPERTIES = ("conductivity", "density", "specific_heat")
_COMMON = {"exponent": "", "reference": "K", "polynomial": "anything", "temperature": "anything", "values": "anything"}
LAW_KEYS = {
    "conductivity": {"value": "W/m/K", "r": "W/m/K", "z": "W/m/K", **_COMMON},
    "specific_heat": {"value": "J/kg/K", **_COMMON},
}


def read_property(key: str, given: Any, unit: str, where: str) -> dict[str, Any]:
    """Fields of a Material from one property: text with a unit, or a table whose plain values are in SI already.

    Raises InputError: a value is missing, or given twice with different numbers; two laws at once.
    """
    if not isinstance(given, dict):
        return {key: quantity.parse(given, unit, name=f"{where} {key}")}
    of = f"{where} {key}"
    if {"value", "r"} <= given.keys():
        raise InputError(f"{of}: value and r are the same; give one of them")
    try:
        law = _law(given, unit, of)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(of) else f"{of}: {error}") from None
    if "r" in given and "z" not in given:
        raise InputError(f"{of}: z is missing; r is along the layers alone: add z, or call r value to have it in both")
    value = given.get("value", given.get("r"))
    if isinstance(law, Table):
        value = _of_table(law, value, unit, f"{of}: {'r' if 'r' in given else 'value'}")
    if value is None:
        name = "r" if "z" in given else "value"
        raise InputError(f'{of}: {name} is missing; add {name} = "..."')
    return {key: value, f"{key}_law": law} | ({"conductivity_z": given["z"]} if "z" in given else {})


def _of_table(law: Table, value: float | None, unit: str, name: str) -> float:
    """The value of a property with a table; InputError where the one that is given is another one."""
    own = float(law.value(law.reference))
    if value is None or math.isclose(value, own, rel_tol=SAME):
        return own if value is None else value
    said, there = quantity.write(value, unit), quantity.rounded(own, unit, 6)
    raise InputError(f"{name} = {said}, but the table has {there} at {law.reference:g} K; leave it out")


def with_value(key: str, given: dict[str, Any], text: str) -> dict[str, Any]:
    """A property's table, in texts, with another value; the law stays, so that a table of temperatures is scaled."""
    rest = {name: one for name, one in given.items() if name not in ("value", "r")}
    if "values" not in rest:
        return {**rest, "value": text}
    unit = LAW_KEYS[key]["value"]
    reference = {"reference": quantity.parse(rest["reference"], "K", name=key)} if "reference" in rest else {}
    law = _law({**rest, **reference}, unit, key)
    return {**rest, "value": text, "values": _written(law, quantity.parse(text, unit, name=key), unit)}


def _written(law: Any, value: float, unit: str) -> list[str]:
    """The values of a table as text, scaled to have a value at the reference where they have another one."""
    own = float(law.value(law.reference))
    scale = 1.0 if math.isclose(value, own, rel_tol=SAME) else value / own
    return [quantity.write(v * scale, unit) for v in law.values]


def _law(given: dict[str, Any], unit: str, of: str) -> Law:
    kinds = {"exponent", "polynomial", "temperature", "values"} & given.keys()
    reference = {"reference": given["reference"]} if "reference" in given else {}
    if kinds == {"temperature", "values"}:
        T = _list(given["temperature"], "K", f"{of}: temperature")
        return Table(T, _list(given["values"], unit, f"{of}: values"), **reference)
    if kinds == {"polynomial"}:
        return Polynomial(_list(given["polynomial"], None, f"{of}: polynomial"), **reference)
    if kinds <= {"exponent"}:
        law = PowerLaw(given.get("exponent", 0.0), **reference)
        return law if kinds else CONSTANT
    raise InputError(
        f"{of}: give exponent, or polynomial, or temperature with values (given: {', '.join(sorted(kinds))})"
    )


def _list(given: Any, unit: str | None, name: str) -> tuple[float, ...]:
    checks.instance(name, given, list, hint="a list is needed")
    if unit is None:
        return tuple(finite(name, item) for item in given)
    return tuple(quantity.parse(item, unit, name=name) for item in given)


def write_property(material: Material, key: str, unit: str) -> str | dict[str, Any]:
    """One property as the file's text or table; reading it back gives exactly the same property.

    A `Table` whose values are not those of the property, but proportional to them, is read back in the property's.
    """
    value, law = getattr(material, key), getattr(material, f"{key}_law")
    items: dict[str, Any] = {"value": quantity.write(value, unit)}
    if key == "conductivity" and material.conductivity_z is not None:
        items["z"] = quantity.write(material.conductivity_z, unit)
    if isinstance(law, PowerLaw) and law != CONSTANT:
        items["exponent"] = law.exponent
    elif isinstance(law, Polynomial):
        items["polynomial"] = list(law.coefficients)
    elif isinstance(law, Table):
        items["temperature"] = [quantity.write(T, "K") for T in law.temperatures]
        items["values"] = _written(law, value, unit)
    return items["value"] if len(items) == 1 else {**items, "reference": quantity.write(law.reference, "K")}
