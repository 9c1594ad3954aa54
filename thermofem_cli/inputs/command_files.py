"""Files of a command: what an input file holds, whether outputs can be written, rings and models from files."""

from __future__ import annotations

import contextlib
import re
import shlex
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py

from thermofem import CrossSection, InputError, checks, strip_ring
from thermofem.data import files
from thermofem.data.number_table import has_rows
from thermofem.models import ThermalModel, load_model

from ..console import note
from ..options import REFERENCE_RING

if TYPE_CHECKING:
    from coupled import RingResonator

# kind -> what it is, and what takes it
KINDS = {
    "geometry": ("a geometry", "thermofem solve, reduce, validate, cosimulate and explore take it"),
    "layout": ("a layout", "thermofem reduce takes it"),
    "ring": ("the optics of a ring", "thermofem simulate, cosimulate, map, stability and explore take it with --ring"),
    "campaign": ("a campaign", "thermofem campaign and family take it"),
    "model": ("a thermal model", "thermofem simulate, map, stability, validate, explore, export and cite take it"),
    "family": (
        "a family of rings",
        "thermofem show, design, uncertainty, calibrate and explore take it; in Python family.model(...) is a member",
    ),
    "data": ("data (netCDF)", "thermofem fit and cite take it"),
    "result": ("a result (netCDF) that trains no model", "th.load and coupled.plot take it, in Python"),
    "table": ("a table of numbers", "thermofem fit takes it"),
    "text": ("a text without rows of numbers", "no command reads one"),
    "image": ("an image", "no command reads one: give the file that it was drawn from"),
}
# what is needed, what was given -> the command that makes the one of the other
MAKES = {
    ("model", "geometry"): "thermofem reduce {} -o model.json",
    ("model", "layout"): "thermofem reduce {} -o model.json",
    ("model", "data"): "thermofem fit {} -o model.json",
    ("model", "table"): "thermofem fit {} --power '1 mW' -o model.json",
    ("data", "geometry"): "thermofem solve {} -o heat.nc",
    ("data", "table"): "thermofem.save(thermofem.read_trace('{}', ...), 'data.nc')",
}
FAMILY_HEADER = "header.npy"  # in the archive of a family
# kind of a TOML file -> keys of which one is enough to tell it
TABLES = {
    "campaign": {"vary", "drive", "geometry"},
    "layout": {"shape", "gds"},
    "geometry": {"layer", "part", "outer_radius"},
    "ring": {"base", "wavelength", "frequency", "loaded_q", "intrinsic_q", "bus_rate", "carriers", "dispersion"},
}


def expect(path: Path | None, *wanted: str) -> None:
    """Raise InputError where a file is of another kind than ``wanted``; files of unknown kind pass."""
    found = kind_of(path) if path else None
    if path is None or found is None or found in wanted:
        return
    what, takes = KINDS[found]
    made = [MAKES[kind, found].format(path) for kind in wanted if (kind, found) in MAKES]
    hint = f"`{made[0]}` makes it from this" if made else takes
    needed = " or ".join(KINDS[kind][0] for kind in wanted if kind != "result")
    raise InputError(f"{path} holds {what}, not {needed}; {hint}")


def kind_of(path: Path) -> str | None:
    """Return the kind of a file, one of `KINDS`; None where it is unreadable, damaged or unknown."""
    ending = path.suffix.lower()
    if ending in files.IMAGES:
        return "image"
    try:
        with files.regular(path).open("rb") as file:
            first = file.read(1_000_000)  # a table begins there
        if first[:6] == b"\x89HDF\r\n":
            with h5py.File(path, "r") as tree:  # data are heat over time; runs with light, maps and indices are results
                return "data" if "time" in tree and "carriers" not in tree else "result"
        if ending == ".toml":
            keys = files.from_toml(files.read_text(path, "TOML")).keys()
            return next((kind for kind, own in TABLES.items() if keys & own), None)
        if first[:4] == b"PK\x03\x04" and FAMILY_HEADER in zipfile.ZipFile(path).namelist():
            return "family"
        if ending == ".json":
            loaded = files.read_json(path, "JSON")
            return "model" if isinstance(loaded, dict) and "format" in loaded else None
    except (OSError, InputError, zipfile.BadZipFile):
        return None
    if ending in (".msh", ".npz", ".nc", ".h5", ".vtu", ".gds", ".py"):
        return None
    return "table" if has_rows(first) else "text"


def write_columns(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns of numbers under their names as a table (CSV), whole or not at all."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{number:.9g}" for number in row) for row in rows)]
    files.write_whole(path, lambda target: target.write_text("\n".join(lines) + "\n", encoding="utf-8"))


@contextlib.contextmanager
def about(paths: Sequence[Path]) -> Iterator[None]:
    """Put the file's name before an InputError that lacks it; of several, in place of ``data[0]``, ``data[1]``."""
    try:
        yield
    except InputError as error:
        said = error.for_text()
        if len(paths) > 1:
            said = re.sub(r"\bdata\[(\d+)\]", lambda k: str(paths[int(k[1])]), said)
        elif str(paths[0]) not in said and not said.startswith("--"):
            said = f"{paths[0]}: {said}"
        raise InputError(said) from None


def section_of(path: Path | None) -> CrossSection:
    """Return the geometry in a file, without one the reference strip."""
    expect(path, "geometry")
    return CrossSection.from_toml(path) if path else strip_ring()


def ring_of(given: str) -> RingResonator:
    """Return the ring in a file, or the published ring of that name."""
    from coupled import RingResonator
    from coupled.parameters import published_rings

    named = published_rings()
    if given in named:
        return named[given]
    if not Path(given).is_file():
        raise InputError(f"--ring = {given!r} is neither a file nor one of {', '.join(named)}")
    expect(Path(given), "ring")
    return RingResonator.from_toml(given)


def note_ring(ring: RingResonator, given: str) -> None:
    """Print which ring the optics and carriers are taken from, as a thermal model has none."""
    hint = "; --ring RING.toml takes those of yours" if given == REFERENCE_RING else ""
    note(f"light and carriers are those of the ring {ring.name!r}{hint}")


def kelvin_of(assumed: Any) -> str:
    """Unit that counts as kelvin in a model, by the lines ``assumed`` of its file: "V", "rad", or "K" itself."""
    lines = assumed if isinstance(assumed, list) else []
    found = re.search(r"1 (V|rad) counts as 1 K", " ".join(map(str, lines)))
    return found[1] if found else "K"


def check_channel(model: Any, heated: str | None, read: str | None) -> None:
    """Raise InputError where --heated or --read names no input or output of a model or a family."""
    for option, part, parts in (("--heated", heated, model.inputs), ("--read", read, model.outputs)):
        if part is not None:
            checks.choice(option, part, parts)


def model_of(
    path: Path, heated: str | None = None, read: str | None = None, heaters: Iterable[str] = ()
) -> tuple[ThermalModel, dict[str, Any]]:
    """Return the thermal model in a file, and the keywords ``heated`` and ``read`` that select its input and output.

    Raises InputError: no model; several inputs or outputs and no choice, or a name that is none of them.
    """
    expect(path, "model")
    model: ThermalModel = load_model(path)
    unit = kelvin_of((getattr(model, "origin", None) or {}).get("assumed"))
    if unit != "K":
        option = {"V": "--sensitivity", "rad": "--phase"}[unit]
        note(f"warning: {path} was trained on data in which 1 {unit} counts as 1 K; train it with `fit {option}`")
    check_channel(model, heated, read)
    parts = getattr(model, "heated", model.inputs)
    for name in heaters:
        checks.choice("--heater", name, parts, hint="reduce --heated 'core, heater' makes a model that takes both")
    if len(parts) > 1 and heated is None and not list(heaters):
        first = shlex.quote(model.inputs[0])
        other = shlex.quote(f"{model.inputs[-1]}=5 mW")
        raise InputError(
            f"{path} has several parts (inputs {', '.join(model.inputs)}; outputs {', '.join(model.outputs)}): pick "
            f"the one that the light heats with --heated {first}, and give others power with --heater {other}"
        )
    return model, {"heated": heated, "read": read}
