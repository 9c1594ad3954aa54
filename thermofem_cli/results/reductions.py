"""Reductions of racetracks, arrays and layouts, as ``reduce`` writes and prints them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import surrogate
import thermofem as th
from surrogate.reduction.racetrack_reduction import reduce_racetrack
from surrogate.studies.inverse_search import channel_steps
from thermofem import InputError, checks
from thermofem.data import files, quantity
from thermofem.geometry.section_parts import LIGHT

from ..console import say, working, written, wrote
from ..options import listed


def reduced_racetrack(
    section: th.CrossSection,
    tolerance: float,
    heated: str | None,
    read: str | None,
    positions: Path | None,
    output: Path,
) -> dict[str, Any]:
    """Reduce a ring with [plan] straight: inputs its heated parts, outputs the same and the light."""
    if positions is not None:
        raise InputError(
            f"--positions: {section.name!r} is a racetrack",
            "an array of racetracks is a layout, with a table [[shape]] for each",
        )
    with working("solving the section and the path of the racetrack"):
        made = reduce_racetrack(section, tolerance)
    whole = made.model
    names = listed(heated) or [whole.inputs[0]]
    for name in names:
        checks.choice("--heated", name, whole.inputs)
    light = [LIGHT] if LIGHT in whole.outputs else []
    outputs = listed(read) or [*names[:1], *light]
    for name in outputs:
        checks.choice("--read", name, whole.outputs, hint="a racetrack has its heated parts, and light")
    rows = [whole.outputs.index(name) for name in outputs]
    columns = [whole.inputs.index(name) for name in names]
    model = replace(whole, B=whole.B[:, columns], C=whole.C[rows], inputs=tuple(names), outputs=tuple(outputs))
    bound = float(made.channel_bounds[np.ix_(rows, columns)].max())
    provenance = {
        "method": "racetrack reduction",
        "tolerance": tolerance,
        "error_bound": bound,
        "geometry": section.to_toml(),
        "ports": names,
    }
    surrogate.save_model(model, output, provenance=provenance)
    length = quantity.rounded(section.path_length(_radius(section, whole.inputs[0])), "m", 5)
    say(f"racetrack of {length}: {model.order} states, error of Z(f) below {bound:.1e} of R_th")
    steps = channel_steps(model) or []
    for row in steps:
        channel = f" from {row['heated']} to {row['read']}"
        rise = written(row["rise_time"], "s")
        say(f"R_th = {row['thermal_resistance'] / 1e3:.4g} K/mW{channel}, rise 10-90 % in {rise}")
    wrote(output)
    return {
        "poles": model.order,
        "error_bound": bound,
        "heated": names,
        "read": outputs,
        "thermal_resistance": over_channels(steps, names, outputs, "thermal_resistance"),
        "rise_time": over_channels(steps, names, outputs, "rise_time"),
        "model": output,
    }


def _radius(section: th.CrossSection, name: str) -> float:
    part = next(part for part in section.parts if part.name == name)
    return (part.inner_radius + part.outer_radius) / 2


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
    surrogate.save_model(array.model, output, provenance=array.provenance)
    say(f"{len(places)} rings, {array.poles} poles, error of Z(f) below {array.error_bound:.1e} of R_th everywhere")
    outputs, crosstalk = array.model.outputs, array.crosstalk
    for to, row in zip(outputs, crosstalk, strict=True):
        say(f"R_th of {to} in K/mW: {', '.join(f'{value / 1e3:.4g}' for value in row)}")
    wrote(output)
    return {
        "rings": len(places),
        "poles": array.poles,
        "error_bound": array.error_bound,
        "heated": list(array.model.inputs),
        "read": list(outputs),
        "thermal_resistance": crosstalk.tolist(),
        "model": output,
    }


def reduced_layout(path: Path, tolerance: float, output: Path) -> dict[str, Any]:
    """Reduce a layout: one input and output for each shape."""
    with working("solving the sections of the shapes and their paths"):
        layout = surrogate.reduce_layout(th.read_layout(path), tolerance)
        surrogate.save_model(layout.model, output, provenance=layout.provenance)
    names = list(layout.model.outputs)
    passive = "passive" if layout.passive else "not passive"
    say(f"{len(names)} shapes, {layout.order} states, {passive}, error of Z(f) below {layout.error_bound:.1e} of R_th")
    for name, row in zip(names, layout.crosstalk, strict=True):
        say(f"R_th of {name} in K/mW: {', '.join(f'{value / 1e3:.4g}' for value in row)}")
    wrote(output)
    return {
        "shapes": len(names),
        "poles": layout.poles,
        "error_bound": layout.error_bound,
        "heated": names,
        "read": names,
        "thermal_resistance": layout.crosstalk.tolist(),
        "half_times": layout.half_times.tolist(),
        "passive": layout.passive,
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
