"""Reductions of arrays and layouts, as ``reduce`` writes and prints them."""

from pathlib import Path
from typing import Any

import surrogate
import thermofem as th
from surrogate.reduction.array_reduction import ArrayReduction
from thermofem import InputError
from thermofem.data import files, quantity

from ..console import say, working

LEAST_TOLERANCE = 1e-3  # of layouts and racetracks: bends and neighbours, which they neglect, leave about that


def over_channels(
    rows: list[dict[str, Any]], inputs: list[str], outputs: list[str], name: str
) -> float | list[list[float]]:
    """Return the quantity ``name`` of all channels: a number if there is one, else a list (over inputs) per output."""
    values = [row[name] for row in rows]
    if len(values) == 1:
        return float(values[0])
    return [values[k * len(inputs) : (k + 1) * len(inputs)] for k in range(len(outputs))]


def reduced_array(
    heat: th.fem.HeatProblem, positions: Path, tolerance: float, heated: list[str], output: Path
) -> dict[str, Any]:
    """Reduce an array of equal rings at given positions: one input and output for each, further inputs for heaters."""
    places = _places(positions)
    array = surrogate.reduce_array(heat, places, tolerance, heated=heated[0], heaters=heated[1:])
    numbers = _written(array, output, f"{len(places)} rings, {array.poles} poles", "everywhere")
    return {"rings": len(places), **numbers}


def reduced_layout(path: Path, tolerance: float, output: Path) -> dict[str, Any]:
    """Reduce a layout: one input and output for each shape."""
    with working("solving the sections of the shapes and their paths"):
        layout = surrogate.reduce_layout(th.read_layout(path), max(tolerance, LEAST_TOLERANCE))
    count = len(layout.model.outputs)
    passive = "passive" if layout.passive else "not passive"
    numbers = _written(layout, output, f"{count} shapes, {layout.order} states, {passive}")
    half_times = layout.half_times.tolist()
    return {"shapes": count, **numbers, "half_times": half_times, "passive": layout.passive}


def _written(array: ArrayReduction, output: Path, size: str, where: str = "") -> dict[str, Any]:
    """Write a model of many rings or shapes; print and return its size, its error, and R_th of all of them."""
    surrogate.save_model(array.model, output, provenance=array.provenance)
    say(f"{size}, error of Z(f) below {array.error_bound:.1e} of R_th {where}".rstrip())
    for name, row in zip(array.model.outputs, array.crosstalk, strict=True):
        values = [f"{value / 1e3:.4g}" for value in row]
        say(f"R_th of {name} in K/mW: {', '.join(values)}")
    return {
        "poles": array.poles,
        "error_bound": array.error_bound,
        "heated": list(array.model.inputs),
        "read": list(array.model.outputs),
        "thermal_resistance": array.crosstalk.tolist(),
        "model": output,
    }


def _places(path: Path) -> list[tuple[float, float]]:
    """Return positions (x, y) in m from a table, with units in its header 'x (um),y (um)' or in each cell, '20 um'."""
    rows = [line.split(",") for line in files.read_text(path, "positions").splitlines() if line.strip()]
    units = ["", ""]
    if rows and not any(char.isdigit() for char in rows[0][0]):
        units = [cell.partition("(")[2].partition(")")[0].strip() for cell in rows.pop(0)]
    if not rows or any(len(row) != 2 for row in [*rows, units]):
        raise InputError(f"{path} must have two columns, such as 'x (um),y (um)' and a row for each ring")
    return [
        (quantity.parse(f"{x.strip()} {units[0]}", "m", name=f"{path} x"),
         quantity.parse(f"{y.strip()} {units[1]}", "m", name=f"{path} y"))
        for x, y in rows
    ]  # fmt: skip
