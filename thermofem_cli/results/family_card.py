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
    lines = [("kind", f"family of rings, {family.size} functions ({family.engine})")]
    lines.append(("heated", f"{', '.join(family.inputs)}; read: {', '.join(family.outputs)}"))
    for name, unit in zip(family.names, family.box.units, strict=True):
        low, high = family.ranges[name]
        lines.append((name, f"{quantity.rounded(low, unit, 6)} .. {quantity.rounded(high, unit, 6)}"))
    worst = f"worst {family.error.worst:.1e}, median {family.error.median:.1e}"
    lines.append(("error", f"over {family.error.count} rings not seen: {worst}; {family.tolerance:.1e} was asked for"))
    return lines + _further_errors(family)


def _further_errors(family: Family) -> list[tuple[str, str]]:
    """Lines on the errors of the output maps of k(T) and of the optical numbers, where the family has them."""
    lines = []
    maps = family.output_maps
    optics = family.optics
    if maps is not None:
        lines.append(("k(T)", f"up to {quantity.write(maps.power, 'W')}: error {maps.error:.1e}"))
    if optics is not None:
        lines.append(("light", f"of {optics.solved} rings; error over rings left out: {optics.words()}"))
    return lines
