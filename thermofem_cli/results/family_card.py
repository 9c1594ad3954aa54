"""The card of a family: ranges of its parameters, parts, errors, how it was trained."""

from typing import Any

from surrogate.family import Family
from thermofem.data import quantity


def family_numbers(family: Family) -> dict[str, Any]:
    """Return what a family states, in SI."""
    optics = family.optics
    maps = family.output_maps
    error = family.error
    return {
        "kind": "Family",
        "heated": list(family.inputs),
        "read": list(family.outputs),
        "ranges": {name: list(ends) for name, ends in family.ranges.items()},
        "tolerance": family.tolerance,
        "error": {"worst": error.worst, "median": error.median, "count": error.count},
        "functions": family.size,
        "engine": family.engine,
        "largest_power": None if maps is None else maps.power,
        "error_hot": None if maps is None else maps.error,
        "error_optics": None if optics is None else optics.error,
    }


def family_lines(family: Family) -> list[tuple[str, str]]:
    """Return the lines of the card: a label and a text each."""
    kind = f"family of rings, {family.size} functions ({family.engine})"
    heated = ", ".join(family.inputs)
    read = ", ".join(family.outputs)
    lines = [("kind", kind), ("heated", f"{heated}; read: {read}")]
    return lines + _ranges(family) + _errors(family)


def _ranges(family: Family) -> list[tuple[str, str]]:
    """Lines on the range of every parameter."""
    lines = []
    for (name, (low, high)), unit in zip(family.ranges.items(), family.box.units, strict=True):
        first = quantity.rounded(low, unit, 6)
        last = quantity.rounded(high, unit, 6)
        lines.append((name, f"{first} .. {last}"))
    return lines


def _errors(family: Family) -> list[tuple[str, str]]:
    """Lines on the errors of heat and, where the family has them, of the output maps of k(T) and of optical numbers."""
    worst = f"worst {family.error.worst:.1e}, median {family.error.median:.1e}"
    lines = [("error", f"over {family.error.count} rings not seen: {worst}; {family.tolerance:.1e} was asked for")]
    maps = family.output_maps
    optics = family.optics
    if maps is not None:
        lines.append(("k(T)", f"up to {quantity.write(maps.power, 'W')}: error {maps.error:.1e}"))
    if optics is not None:
        lines.append(("light", f"of {optics.solved} rings; error over rings left out: {optics.words()}"))
    return lines
