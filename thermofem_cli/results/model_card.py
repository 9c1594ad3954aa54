"""The cards of a model (kind, R_th, rise times, poles, error bound, training) and of a family (ranges, errors)."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from surrogate.family import Family
from surrogate.studies.inverse_search import channel_steps
from thermofem.checks import between
from thermofem.data import quantity
from thermofem.errors import InputError
from thermofem.export.poles import poles_of

from ..console import parameter_unit, written

# name -> key in the provenance, and the largest value (in R_th, K, or the swing): beyond, the file is damaged
CLAIMS = {
    "error_bound": ("error_bound", 100.0),
    "residual": ("residual_K", 1e9),
    "relative_residual": ("relative_residual", 1e9),
}


def draw_layout(model: Any, provenance: dict[str, Any], figure: Path) -> None:
    """Draw the map of a layout."""
    from surrogate.plot import plot_layout
    from thermofem.plot import save_figure

    outlines = provenance.get("outlines")
    if not outlines:
        raise InputError("--figure draws the map of a layout, which `thermofem reduce` makes of [[shape]] tables")
    save_figure(plot_layout(model.outputs, outlines, np.asarray(model.gain)), figure)


def model_card(model: Any, provenance: dict[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Return the numbers on the card of a model, and its lines: a label and a text each."""
    numbers = _card_numbers(model, provenance)
    lines = [*_heat_lines(model, numbers), *_training_lines(numbers, provenance)]
    recorded = "recorded" if numbers["geometry"] else "not recorded"
    lines += [("trust it", numbers["trusted"]), ("geometry", recorded)]
    for name, row in zip(model.outputs, numbers.get("half_times", ()), strict=False):
        texts = ["above 10 s" if time is None else quantity.rounded(time, "s", 3) for time in row]
        lines.append((f"half time of {name}", ", ".join(texts)))
    return numbers, lines


def _card_numbers(model: Any, provenance: dict[str, Any]) -> dict[str, Any]:
    """Return what a model and its provenance state, in SI."""
    numbers: dict[str, Any] = {"kind": type(model).__name__}
    numbers["heated"] = list(model.inputs)
    numbers["read"] = list(model.outputs)
    numbers["states"] = getattr(model, "order", None)
    single = len(model.inputs) == len(model.outputs) == 1
    resistance = model.thermal_resistance if single else np.asarray(model.gain)
    numbers["thermal_resistance"] = float(resistance) if single else resistance.tolist()
    numbers["poles"] = _poles(model)
    steps = channel_steps(model)
    numbers["rise_times"] = None if steps is None else [row["rise_time"] for row in steps]
    for name, (key, most) in CLAIMS.items():
        numbers[name] = _number(key, provenance.get(key), most)
    numbers["parameters"] = _numbers_of(provenance, "parameters")
    sources = [provenance.get(key) for key in ("training", "source", "method")]
    numbers["training"] = next(filter(None, sources), None)
    numbers["largest_rise"] = getattr(model, "largest_rise", None)
    for name in ("assumed", "geometry", "ports"):
        numbers[name] = provenance.get(name)
    if "half_times" in provenance:
        numbers["half_times"] = provenance["half_times"]
    numbers["trusted"] = _trusted(numbers)
    return numbers


def _heat_lines(model: Any, numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Lines on kind, parts, R_th and rise times of a model."""
    states = f", {numbers['states']} states" if numbers["states"] else ""
    heated = ", ".join(model.inputs)
    lines = [("kind", numbers["kind"] + states)]
    lines.append(("heated", f"{heated}; read: {', '.join(model.outputs)}"))
    resistances = np.atleast_2d(numbers["thermal_resistance"])
    for output, row in zip(model.outputs, resistances, strict=True):
        label = "R_th" if len(resistances) == 1 else f"R_th of {output}"
        texts = [f"{value / 1e3:.5g}" for value in row]
        lines.append((label, f"{', '.join(texts)} K/mW"))
    if numbers["rise_times"]:
        texts = [quantity.rounded(time, "s", 4) for time in numbers["rise_times"]]
        lines.append(("rise 10-90 %", ", ".join(texts)))
    return lines


def _training_lines(numbers: dict[str, Any], provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Lines on fitted parameters, poles, errors, and what the model was trained on."""
    lines = []
    errors = _numbers_of(provenance, "standard_errors")
    for name, value in numbers["parameters"].items():
        if not name.startswith(("R", "tau")):  # those are its poles
            lines.append((name, written(value, parameter_unit(name), errors.get(name))))
    for pole in numbers["poles"] or []:
        R = f", R = {pole['R'] / 1e3:.4g} K/mW" if "R" in pole else ""
        lines.append(("pole", f"tau = {quantity.rounded(pole['tau'], 's', 4)}{R}"))
    if numbers["error_bound"] is not None:
        lines.append(("error bound", f"{numbers['error_bound']:.2e} of R_th, at every frequency"))
    if numbers["residual"] is not None:
        share = numbers["relative_residual"]
        swing = "" if share is None else f", {share:.2%} of the swing"
        lines.append(("misfit", f"{numbers['residual']:.3g} K rms{swing}"))
    lines += _texts("trained on", numbers["training"] or "not recorded")
    return lines + _texts("assumed", numbers["assumed"] or [])


def _texts(label: str, stated: Any) -> list[tuple[str, str]]:
    """Lines of one label for a text, or for each text of a list."""
    texts = stated if isinstance(stated, list) else [stated]
    return [(label, str(text)) for text in texts]


def _poles(model: Any) -> list[dict[str, float]] | None:
    """Return R (K/W) and tau (s) of each pole, tau alone for several ports; None without independent poles."""
    try:
        found = poles_of(getattr(model, "linear", model))
    except InputError:
        return None
    tau = 1 / found.rate
    if found.B.shape[1] == found.C.shape[0] == 1:
        return [{"R": float(r), "tau": float(t)} for r, t in zip(found.B[:, 0] * found.C[0] * tau, tau, strict=True)]
    return [{"tau": float(t)} for t in tau]


def _numbers_of(provenance: dict[str, Any], key: str) -> dict[str, float]:
    """Return the finite numbers in the table ``key`` of the provenance, by name."""
    table = provenance.get(key)
    items = table.items() if isinstance(table, dict) else ()
    return {name: value for name, value in items if isinstance(value, float) and math.isfinite(value)}


def _number(key: str, value: Any, most: float) -> float | None:
    """Return a number of the provenance, None where it is none. Raises InputError outside 0 to ``most``."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return between(f"provenance.{key}", value, 0, most, hint="the model file is damaged")


def _trusted(numbers: dict[str, Any]) -> str:
    """Return in words for which frequencies, rises or drives the model is valid."""
    if numbers["error_bound"] is not None:
        if "half_times" in numbers:
            return f"at every frequency, within {numbers['error_bound']:.1e} of R_th (a sum of estimates, of a layout)"
        ports = numbers["ports"]  # of the reduction, of which this model may be one channel
        one = len({*numbers["heated"], *numbers["read"]}) == 1 and not (isinstance(ports, list) and len(ports) > 1)
        how = "proven" if one else "proven at sampled frequencies, with a margin between them"
        return f"at every frequency, within {numbers['error_bound']:.1e} of R_th ({how}; against its FEM)"
    words = []
    if numbers["largest_rise"] is not None:
        words.append(f"up to a rise of {numbers['largest_rise']:.3g} K")
    if numbers["residual"] is not None:
        words.append("on drives like those of its training; `thermofem validate` tells the periods")
    return "; ".join(words) or "not recorded; `thermofem validate` tells the periods"


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
    return [*lines, *family.box.range_words.items(), *_errors(family)]


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
