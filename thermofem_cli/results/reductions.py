"""Reductions of arrays and layouts, as ``reduce`` writes and prints them."""

from pathlib import Path
from typing import Any

import surrogate
import thermofem as th
from surrogate.reduction.array_reduction import ArrayReduction
from surrogate.studies.inverse_search import channel_steps
from thermofem import InputError
from thermofem.data import files, quantity

from ..console import say, working, written

LEAST_TOLERANCE = 1e-3  # of layouts and racetracks: bends and neighbours, which they neglect, leave about that


def written_channels(model: Any, what: str, output: Path) -> dict[str, Any]:
    """Write a reduced model of one ring, print and return the numbers of its channels; ``what`` it was made of."""
    surrogate.save_model(model, output)
    error_bound = model.origin["error_bound"]
    say(f"{what}, error of Z(f) below {error_bound:.1e} of R_th everywhere")
    rows = channel_steps(model) or []
    for row in rows:
        of = "" if len(rows) == 1 else f" from {row['heated']} to {row['read']}"
        say(f"R_th = {row['thermal_resistance'] / 1e3:.4g} K/mW{of}, rise 10-90 % in {written(row['rise_time'], 's')}")
    return {
        "poles": model.order,
        "error_bound": error_bound,
        "heated": list(model.inputs),
        "read": list(model.outputs),
        "thermal_resistance": _over_channels(rows, len(model.inputs), "thermal_resistance"),
        "rise_time": _over_channels(rows, len(model.inputs), "rise_time"),
        "model": output,
    }


def _over_channels(rows: list[dict[str, Any]], inputs: int, name: str) -> float | list[list[float]]:
    """Return the quantity ``name`` of all channels: a number if there is one, else a list (over inputs) per output."""
    values = [row[name] for row in rows]
    if len(values) == 1:
        return float(values[0])
    return [values[k : k + inputs] for k in range(0, len(values), inputs)]


def reduced_array(
    heat: th.fem.HeatProblem, positions: Path, tolerance: float, heated: list[str], output: Path
) -> dict[str, Any]:
    """Reduce an array of equal rings at given positions: one input and output for each, further inputs for heaters."""
    places = _places(positions)
    array = surrogate.reduce_array(heat, places, tolerance, heated=heated[0], heaters=heated[1:])
    return {"rings": len(places), **_written_array(array, f"{len(places)} rings", output)}


def reduced_layout(path: Path, tolerance: float, output: Path) -> dict[str, Any]:
    """Reduce a layout: one input and output for each shape."""
    with working("solving the sections of the shapes and their paths"):
        shapes = th.read_layout(path)
        layout = surrogate.reduce_layout(shapes, max(tolerance, LEAST_TOLERANCE))
    return {"shapes": len(shapes), **_written_array(layout, f"{len(shapes)} shapes", output)}


def _written_array(array: ArrayReduction, what: str, output: Path) -> dict[str, Any]:
    """Write the model of an array or layout, print and return its numbers; ``what`` it was made of."""
    surrogate.save_model(array, output)
    passive = "passive" if array.passive else "not passive"
    say(f"{what}, {array.order} states, {passive}, error of Z(f) below {array.error_bound:.1e} of R_th everywhere")
    names = list(array.model.outputs)
    for name, row in zip(names, array.crosstalk, strict=True):
        say(f"R_th of {name} in K/mW: {', '.join(f'{value / 1e3:.4g}' for value in row)}")
    return {
        "poles": array.poles,
        "error_bound": array.error_bound,
        "heated": list(array.model.inputs),
        "read": names,
        "thermal_resistance": array.crosstalk.tolist(),
        "half_times": array.half_times.tolist(),
        "passive": array.passive,
        "model": output,
    }


def reduced_racetrack(
    section: th.CrossSection, tolerance: float, heated: list[str], read: list[str], output: Path
) -> dict[str, Any]:
    """Reduce a ring with [plan] straight: inputs its heated parts, outputs the same and the light."""
    from surrogate.reduction.racetrack_reduction import reduce_racetrack

    with working("solving the section and the path of the racetrack"):
        model = reduce_racetrack(section, max(tolerance, LEAST_TOLERANCE), heated, read)
    length = quantity.rounded(section.path_length(section.first_heated.centre), "m", 5)
    return written_channels(model, f"racetrack of {length}: {model.order} states", output)


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
