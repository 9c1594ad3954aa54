"""``thermofem show``: the card of a model file."""

import hashlib
import math
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.constants import c

import coupled
import surrogate
import thermofem as th
from coupled.ring_toml import RATES, UNITS
from surrogate.studies.inverse_search import channel_steps
from thermofem.checks import between
from thermofem.data import files, quantity
from thermofem.errors import InputError
from thermofem.export.poles import poles_of

from .console import parameter_unit, say, working, written
from .inputs.command_files import check_outputs, expect, in_volts, kind_of
from .results.heater_sheets import say_sheets

# what follows from the fields of a ring -> its SI unit
DERIVED = {
    "loaded_q": "",
    "intrinsic_q": "",
    "thermal_shift": "rad/s/K",
    "kerr_shift": "rad/s/J",
    "eta_fca": "m^3/s",
    "eta_tpa": "1/s/J",
    "g_tpa": "1/m^3/s/J^2",
    "shift_per_kelvin": "m/K",
}
# name -> key in the provenance, and the largest value (in R_th, K, or the swing): beyond, the file is damaged
CLAIMS = {
    "error_bound": ("error_bound", 100.0),
    "residual": ("residual_K", 1e9),
    "relative_residual": ("relative_residual", 1e9),
}


def show(
    file: Annotated[Path, typer.Argument(help="Thermal model (JSON), ring or geometry (TOML).")],
    figure: Annotated[Path | None, typer.Option(help="Map of the model of a layout, as an image.")] = None,
) -> dict[str, Any]:
    """Print the card of a model (kind, R_th, rise time, all poles, error bound, training), or the numbers of a ring.

    A ring's numbers stand with their units, derived ones too; a geometry is printed whole, with the data sheet of its
    heaters where it has [light].
    """
    kind = kind_of(file)
    if kind == "ring":
        return _ring(file)
    if kind == "geometry":
        section = th.CrossSection.from_toml(file)
        for line in filter(None, section.to_toml().splitlines()):
            say(line)
        if section.light is None or len(section.heated) < 2 or section.straight:
            return {"geometry": section.to_toml()}
        with working("solving light and heat"):
            heat = th.assemble(section)
            heat.lit  # noqa: B018 - the mode is solved for here
        return {"geometry": section.to_toml(), **say_sheets(heat)}
    expect(file, "model")
    if kind is None and file.is_file() and file.suffix.lower() != ".json":
        raise InputError(f"{file} is nothing that show knows: a thermal model (JSON), or a ring or geometry (TOML)")
    loaded = surrogate.load_model(file)
    provenance = th.models.model_files.load_provenance(file)
    numbers, lines = _card(loaded, provenance)
    if "half_times" in provenance:
        for name, row in zip(loaded.outputs, provenance["half_times"], strict=True):
            texts = ["above 10 s" if time is None else quantity.rounded(time, "s", 3) for time in row]
            lines.append((f"half time of {name}", ", ".join(texts)))
    if figure is not None:
        _map(loaded, provenance, figure)
        numbers["figure"] = figure
    numbers["sha256"] = hashlib.sha256(files.read_bytes(file, "model")).hexdigest()
    volts = in_volts(numbers["assumed"])
    for name, text in [*lines, ("sha256", numbers["sha256"]), ("file", str(file))]:
        say(f"{name:>16} : {re.sub(r'K(?=/mW| rms)', 'V', text) if volts else text}")
    return numbers


def _map(model: Any, provenance: dict[str, Any], figure: Path) -> None:
    """Draw the map of a layout."""
    from surrogate.plot import plot_layout
    from thermofem.plot import save_figure

    outlines = provenance.get("outlines")
    if not outlines:
        raise InputError("--figure draws the map of a layout, which `thermofem reduce` makes of [[shape]] tables")
    check_outputs([figure], images=[figure])
    save_figure(plot_layout(model.outputs, outlines, np.asarray(model.gain)), figure)


def _ring(path: Path) -> dict[str, Any]:
    """Print every number of a ring file with its unit: given, by default, and derived."""
    ring = coupled.RingResonator.from_toml(path)
    numbers = {name: value for name, value in vars(ring).items() if name != "carriers"}
    numbers |= {"carriers": type(ring.carriers).__name__, **vars(ring.carriers)}
    numbers |= {name: getattr(ring, name) for name in DERIVED} | {"wavelength": c / ring.frequency}
    units = {**UNITS, **DERIVED, "wavelength": "m"}
    # comments beside the numbers of a ring file, as `thermofem ring` writes them
    comments = re.findall(r"^(\w+) = [^#\n]*?\s+# (.+)$", files.read_text(path, "ring"), re.MULTILINE)
    origins = {name: comment.strip() for name, comment in comments}
    for name, value in numbers.items():
        unit = units.get(name, "")
        if name == "fcd":
            text = " ".join(f"{coefficient:+.4g} N^{power:g}" for coefficient, power in value) + ", N in 1/m^3"
        elif name == "rates":
            text = ", ".join(f"{key} {rate:.6g} {RATES[key]}" for key, rate in value) or "none is given"
        elif name == "shift_per_kelvin":
            text = f"{value * 1e12:.4g} pm/K"
        elif unit in ("Hz", "s", "m") and isinstance(value, float):
            text = quantity.rounded(value, unit, 6)
        else:
            text = f"{value:.6g} {unit}" if isinstance(value, float) else str(value)
        say(f"{name.replace('_', ' '):>20} : {text}" + (f"   ({origins[name]})" if name in origins else ""))
    return numbers | {"origins": origins}


def _card(model: Any, provenance: dict[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Return the numbers on the card of a model, and its lines: a label and a text each."""
    single = len(model.inputs) == len(model.outputs) == 1
    gain = [[float(model.thermal_resistance)]] if single else np.asarray(model.gain).tolist()
    steps = channel_steps(model)
    poles = _poles(model)
    numbers: dict[str, Any] = {
        "kind": type(model).__name__,
        "heated": list(model.inputs),
        "read": list(model.outputs),
        "states": getattr(model, "order", None),
        "thermal_resistance": gain[0][0] if single else gain,
        "poles": poles,
        "rise_times": None if steps is None else [row["rise_time"] for row in steps],
        **{name: _number(key, provenance.get(key), most) for name, (key, most) in CLAIMS.items()},
        "parameters": _numbers_of(provenance, "parameters"),
        "training": provenance.get("training") or provenance.get("source") or provenance.get("method"),
        "assumed": provenance.get("assumed"),
        "largest_rise": getattr(model, "largest_rise", None),
        "geometry": provenance.get("geometry"),
        "ports": provenance.get("ports"),
    }
    if "half_times" in provenance:
        numbers["half_times"] = provenance["half_times"]
    numbers["trusted"] = _trusted(numbers)
    states = f", {numbers['states']} states" if numbers["states"] else ""
    lines = [("kind", numbers["kind"] + states)]
    lines.append(("heated", f"{', '.join(model.inputs)}; read: {', '.join(model.outputs)}"))
    for name, row in zip(model.outputs, gain, strict=True):
        of = "R_th" if len(gain) == 1 else f"R_th of {name}"
        lines.append((of, f"{', '.join(f'{value / 1e3:.5g}' for value in row)} K/mW"))
    if steps:
        lines.append(("rise 10-90 %", ", ".join(quantity.rounded(row["rise_time"], "s", 4) for row in steps)))
    errors = _numbers_of(provenance, "standard_errors")
    for name, value in numbers["parameters"].items():
        if not name.startswith(("R", "tau")):  # those are its poles
            lines.append((name, written(value, parameter_unit(name), errors.get(name))))
    for pole in poles or []:
        R = f", R = {pole['R'] / 1e3:.4g} K/mW" if "R" in pole else ""
        lines.append(("pole", f"tau = {quantity.rounded(pole['tau'], 's', 4)}{R}"))
    if numbers["error_bound"] is not None:
        lines.append(("error bound", f"{numbers['error_bound']:.2e} of R_th, at every frequency"))
    if numbers["residual"] is not None:
        share = numbers["relative_residual"]
        of = "" if share is None else f", {share:.2%} of the swing"
        lines.append(("misfit", f"{numbers['residual']:.3g} K rms{of}"))
    for label, found in (("trained on", numbers["training"] or "not recorded"), ("assumed", numbers["assumed"] or [])):
        lines += [(label, str(line)) for line in (found if isinstance(found, list) else [found])]
    lines.append(("trust it", numbers["trusted"]))
    return numbers, [*lines, ("geometry", "recorded" if numbers["geometry"] else "not recorded")]


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
