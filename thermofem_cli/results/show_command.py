"""``thermofem show``: the card of a model file."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

from thermofem.checks import between
from thermofem.data import files, quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import expect, in_volts
from ..console import say

MOST = 40  # poles on a card
WIDEST = 100.0  # of an error bound, in R_th, and
LARGEST = 1e9  # of a misfit, in K or in the swing: beyond, the file is damaged


def show(
    model: options.Model,
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    seed: options.Seed = 0,
    threads: options.Threads = None,
) -> dict[str, Any]:
    """Print the card of a model: kind, poles, R_th, error bound, training, range of validity, hash."""
    import surrogate

    expect(model, "model")
    loaded, provenance = surrogate.load_model(model), surrogate.load_provenance(model)
    numbers = _numbers(loaded, provenance)
    numbers["sha256"] = hashlib.sha256(files.read_bytes(model, "model")).hexdigest()
    _say(model, numbers)
    return numbers


def _numbers(model: Any, provenance: dict[str, Any]) -> dict[str, Any]:
    """The numbers on the card."""
    numbers: dict[str, Any] = {
        "kind": type(model).__name__,
        "heated": list(model.inputs),
        "read": list(model.outputs),
        "states": getattr(model, "order", None),
        "thermal_resistance": _resistance(model),
        "poles": _poles(model),
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
    import numpy as np

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
    for pole in (numbers["poles"] or [])[:MOST]:
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
