"""``thermofem show``: the card of a model file."""

import hashlib
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from .console import say, working

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


def show(
    file: Annotated[Path, typer.Argument(help="Thermal model (JSON), family, ring or geometry (TOML).")],
    figure: Path | None = None,
) -> dict[str, Any]:
    """Print the card of a model (kind, R_th, rise time, poles, error bound, training), of a family or of a ring.

    A family's card has its ranges, parts and errors. A ring's numbers stand with their units, derived ones too; a
    geometry is printed whole, with the data sheet of its heaters where it has [light].

    Options
    -------
    figure: Map of the model of a layout, as an image.
    """
    import surrogate
    import thermofem as th
    from coupled.parameters import published_rings
    from surrogate.reduction.racetrack_reduction import racetrack_sheets
    from thermofem.data import files
    from thermofem.errors import InputError

    from .inputs.command_files import expect, kelvin_of, kind_of
    from .results.heat_lines import say_each, say_sheets
    from .results.model_card import draw_layout, family_lines, family_numbers, model_card

    kind = kind_of(file)
    if kind == "ring" or str(file) in published_rings():
        return _ring(file)
    if kind == "geometry":
        section = th.CrossSection.from_toml(file)
        for line in filter(None, section.to_toml().splitlines()):
            say(line)
        if section.straight:
            with working("solving light and heat"):
                sheets = racetrack_sheets(section)
            return {"geometry": section.to_toml(), **say_each(section, sheets)}
        if section.light is None or len(section.heated) < 2:
            return {"geometry": section.to_toml()}
        with working("solving light and heat"):
            heat = th.assemble(section)
            heat.lit  # noqa: B018 - the mode is solved for here
        return {"geometry": section.to_toml(), **say_sheets(heat)}
    if kind is None and file.is_file() and file.suffix.lower() != ".json":
        raise InputError(
            f"{file} is nothing that show knows: a thermal model (JSON), a family, or a ring or geometry (TOML)"
        )
    if kind == "family":
        family = surrogate.load_family(file)
        numbers = family_numbers(family)
        lines = family_lines(family)
    else:
        expect(file, "model")
        loaded = surrogate.load_model(file)
        provenance = th.models.model_files.load_provenance(file)
        numbers, lines = model_card(loaded, provenance)
        if figure is not None:
            draw_layout(loaded, provenance, figure)
            numbers["figure"] = figure
    numbers["sha256"] = hashlib.sha256(files.read_bytes(file, "model")).hexdigest()
    unit = kelvin_of(numbers.get("assumed"))
    for name, text in [*lines, ("sha256", numbers["sha256"]), ("file", str(file))]:
        say(f"{name:>16} : {re.sub(r'K(?=/mW| rms)', unit, text)}")
    return numbers


def _ring(path: Path) -> dict[str, Any]:
    """Print every number of a ring file, or of a published ring, with its unit: given, by default, and derived."""
    from scipy.constants import c

    from coupled.ring_toml import RATES, UNITS
    from thermofem.data import files, quantity

    from .inputs.command_files import ring_of

    ring = ring_of(str(path))
    numbers = {name: value for name, value in vars(ring).items() if name != "carriers"}
    numbers |= {"carriers": type(ring.carriers).__name__, **vars(ring.carriers)}
    numbers |= {name: getattr(ring, name) for name in DERIVED} | {"wavelength": c / ring.frequency}
    units = {**UNITS, **DERIVED, "wavelength": "m"}
    # comments beside the numbers of a ring file, as `thermofem ring` writes them
    text = files.read_text(path, "ring") if path.is_file() else ""
    comments = re.findall(r"^(\w+) = [^#\n]*?\s+# (.+)$", text, re.MULTILINE)
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
