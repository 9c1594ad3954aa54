"""``thermofem show``: the card of a model file."""

import hashlib
import re
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.constants import c

import coupled
import surrogate
import thermofem as th
from thermofem.checks import between
from thermofem.data import files, quantity
from thermofem.errors import InputError

from .command_files import expect, in_volts, kind_of
from .console import say

# what follows from the fields of a ring -> its SI unit
DERIVED = {
    "loaded_q": "",
    "intrinsic_q": "",
    "thermal_shift": "rad/s/K",
    "kerr_shift": "rad/s/J",
    "eta_fca": "m^3/s",
    "eta_tpa": "1/s/J",
    "g_tpa": "1/m^3/s/J^2",
}
WIDEST = 100.0  # of an error bound, in R_th, and
LARGEST = 1e9  # of a misfit, in K or in the swing: beyond, the file is damaged


def show(
    file: Annotated[Path, typer.Argument(help="Thermal model (JSON), ring or geometry (TOML).")],
) -> dict[str, Any]:
    """Print the card of a model (kind, R_th, rise time, all poles, error bound, training), or the numbers of a ring.

    A ring's numbers stand with their units, derived ones too; a geometry is printed whole.
    """
    kind = kind_of(file)
    if kind == "ring":
        return _ring(file)
    if kind == "geometry":
        section = th.CrossSection.from_toml(file)
        for line in filter(None, section.to_toml().splitlines()):
            say(line)
        return {"geometry": section.to_toml()}
    expect(file, "model")
    loaded, provenance = surrogate.load_model(file), th.models.model_files.load_provenance(file)
    numbers = _numbers(loaded, provenance)
    numbers["sha256"] = hashlib.sha256(files.read_bytes(file, "model")).hexdigest()
    _say(file, numbers)
    return numbers


def _ring(path: Path) -> dict[str, Any]:
    """Print every number of a ring file with its unit: given, by default, and derived."""
    from coupled.ring_toml import UNITS

    ring = coupled.RingResonator.from_toml(path)
    numbers: dict[str, Any] = {field.name: getattr(ring, field.name) for field in fields(ring)}
    carriers = numbers.pop("carriers")
    numbers |= {"carriers": type(carriers).__name__} | {
        one.name: getattr(carriers, one.name) for one in fields(carriers)
    }
    units = {**UNITS, **DERIVED}
    numbers |= {name: getattr(ring, name) for name in DERIVED}
    numbers |= {"wavelength": c / ring.frequency, "shift_per_kelvin": ring.shift_per_kelvin}
    origins = _origins(path)
    for name, value in numbers.items():
        unit = units.get(name, "m" if name == "wavelength" else "")
        if name == "shift_per_kelvin":
            text = f"{value * 1e12:.4g} pm/K"
        elif unit in ("Hz", "s", "m") and isinstance(value, float):
            text = quantity.rounded(value, unit, 6)
        else:
            text = f"{value:.6g} {unit}" if isinstance(value, float) else str(value)
        origin = origins.get(name, "")
        say(f"{name.replace('_', ' '):>20} : {text}" + (f"   ({origin})" if origin else ""))
    return numbers | {"origins": origins}


def _origins(path: Path) -> dict[str, str]:
    """Comments beside the numbers of a ring file, as `thermofem ring` writes them."""
    lines = re.findall(r"^(\w+) = [^#\n]*?\s+# (.+)$", files.read_text(path, "ring"), re.MULTILINE)
    return {name: comment.strip() for name, comment in lines}


def _numbers(model: Any, provenance: dict[str, Any]) -> dict[str, Any]:
    """The numbers on the card."""
    from surrogate.studies.inverse_search import channel_steps

    numbers: dict[str, Any] = {
        "kind": type(model).__name__,
        "heated": list(model.inputs),
        "read": list(model.outputs),
        "states": getattr(model, "order", None),
        "thermal_resistance": _resistance(model),
        "poles": _poles(model),
        "rise_times": None if (rows := channel_steps(model)) is None else [row["rise_time"] for row in rows],
        "error_bound": _number("error_bound", provenance.get("error_bound"), WIDEST),
        "residual": _number("residual_K", provenance.get("residual_K"), LARGEST),
        "relative_residual": _number("relative_residual", provenance.get("relative_residual"), LARGEST),
        "training": provenance.get("training") or provenance.get("source") or provenance.get("method"),
        "assumed": provenance.get("assumed"),
        "largest_rise": getattr(model, "largest_rise", None),
        "geometry": provenance.get("geometry"),
        "ports": provenance.get("ports"),
    }
    return numbers | {"trusted": _trusted(numbers)}


def _poles(model: Any) -> list[dict[str, float]] | None:
    """R and tau of each pole; of a model of several ports tau alone; None where the model has no independent poles."""
    from surrogate.export.poles import poles_of

    try:
        found = poles_of(getattr(model, "linear", model))
    except InputError:
        return None
    if found.B.shape[1] == found.C.shape[0] == 1:
        R = found.B[:, 0] * found.C[0] / found.rate
        return [{"R": float(r), "tau": float(1 / k)} for r, k in zip(R, found.rate, strict=True)]
    return [{"tau": float(1 / k)} for k in found.rate]


def _resistance(model: Any) -> float | list[list[float]]:
    if (len(model.inputs), len(model.outputs)) == (1, 1):
        return float(model.thermal_resistance)

    gains: list[list[float]] = np.asarray(model.gain).tolist()
    return gains


def _number(name: str, value: Any, most: float) -> float | None:
    """A number of the provenance; InputError where it is out of range, None where it is no number."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return between(f"provenance.{name}", value, 0, most, hint="the model file is damaged")


def _trusted(numbers: dict[str, Any]) -> str:
    """Where the model may be trusted, in words."""
    if numbers["error_bound"] is not None:
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


def _say(path: Path, numbers: dict[str, Any]) -> None:
    """The card as lines."""
    volts = in_volts(numbers["assumed"])
    for name, text in _lines(numbers):
        say(f"{name:>16} : {re.sub(r'K(?=/mW| rms)', 'V', text) if volts else text}")
    say(f"{'file':>16} : {path}")


def _lines(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    states, resistance = numbers["states"], numbers["thermal_resistance"]
    lines = [("kind", numbers["kind"] + (f", {states} states" if states else ""))]
    lines.append(("heated", f"{', '.join(numbers['heated'])}; read: {', '.join(numbers['read'])}"))
    rows = [[resistance]] if isinstance(resistance, float) else resistance
    for name, row in zip(numbers["read"], rows, strict=True):
        of = "R_th" if len(rows) == 1 else f"R_th of {name}"
        lines.append((of, f"{', '.join(f'{value / 1e3:.5g}' for value in row)} K/mW"))
    rise_times = numbers["rise_times"] or []
    if rise_times:
        lines.append(("rise 10-90 %", ", ".join(quantity.rounded(value, "s", 4) for value in rise_times)))
    for pole in numbers["poles"] or []:
        tau = quantity.rounded(pole["tau"], "s", 4)
        lines.append(("pole", f"tau = {tau}" + (f", R = {pole['R'] / 1e3:.4g} K/mW" if "R" in pole else "")))
    if numbers["error_bound"] is not None:
        lines.append(("error bound", f"{numbers['error_bound']:.2e} of R_th, at every frequency"))
    if numbers["residual"] is not None:
        share = numbers["relative_residual"]
        of = "" if share is None else f", {share:.2%} of the swing"
        lines.append(("misfit", f"{numbers['residual']:.3g} K rms{of}"))
    training = numbers["training"] or "not recorded"
    lines += [("trained on", str(line)) for line in (training if isinstance(training, list) else [training])]
    assumed = numbers["assumed"]
    lines += [("assumed", str(line)) for line in (assumed if isinstance(assumed, list) else [])]
    lines.append(("trust it", numbers["trusted"]))
    lines.append(("geometry", "recorded" if numbers["geometry"] else "not recorded"))
    return [*lines, ("sha256", numbers["sha256"])]
