"""What exports of heat and of rings share: formats, checked arguments, and the header of every file."""

import re
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import loadmat

from thermofem import __version__, checks
from thermofem.data.files import check_target, lines_of, write_whole
from thermofem.models import HasModel, ThermalModel, bare

MARK = "Thermal model of thermofem"  # how the header of every export begins


class Format(NamedTuple):
    """A format of exported files.

    ending: the usual one of its files.
    write: of heat ``write(model, target)``, of a ring ``write(ring, model, target, run)``; returns the path.
    demonstration: ending of the file NAME_demo that runs an exported ring; "" where there is none.
    """

    ending: str
    write: Callable[..., Path]
    demonstration: str = ""


class Target(NamedTuple):
    """The file to write, and what every writer may need.

    header: lines about the model, its error and its geometry (`header`).
    fmi, platforms: version of FMI, 2 or 3, and names of `fmi_unit.PLATFORMS`.
    """

    path: Path
    header: list[str]
    fmi: int
    platforms: Sequence[str]


class Export(NamedTuple):
    """Checked arguments of an export: its format, the model itself, what is known of it, and the target."""

    format: Format
    model: Any
    provenance: Mapping[str, Any]
    target: Target


def header(model: ThermalModel, provenance: Mapping[str, Any]) -> list[str]:
    """Header lines of an exported file: kind of model and size, heated and read parts, error, units, geometry."""
    model = getattr(model, "without_ambient", model)
    name = type(model).__name__
    order = getattr(model, "order", None)
    lines = [
        f"{MARK} {__version__}: {name}" + (f" with {order} poles" if order else ""),
        f"heated: {', '.join(model.inputs)}; read: {', '.join(model.outputs)}; thermal resistance {_gain(model)} K/W",
        f"error: {_error(provenance)}",
        "units: power in W, temperature rise above ambient in K, time in s",
    ]
    geometry = provenance.get("geometry")
    if not geometry:
        lines.append("geometry: not recorded")
    else:
        lines += ["geometry:", *(f"    {line}" for line in str(geometry).splitlines() if line.strip())]
    return [piece for line in lines for piece in lines_of(line)]


def is_export(path: Path) -> bool:
    """Whether a file is one that `surrogate.export_model` or `coupled.export_ring` wrote: its header says so."""
    mark = MARK.encode()
    first = 4000  # bytes of a file, within which the header stands
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as unit, unit.open("modelDescription.xml") as file:
                return mark in file.read(first)
        if path.suffix == ".mat":
            return mark in str(loadmat(path, variable_names=["header"]).get("header")).encode()
        with path.open("rb") as file:
            return mark in file.read(first)
    except Exception:  # a file of any other program
        return False


def _gain(model: Any) -> str:
    """Static gain in K/W as text: one number, or for each read part a row over the heated parts."""
    if (len(model.inputs), len(model.outputs)) == (1, 1):
        return f"{model.thermal_resistance:.6g}"
    return "; ".join(", ".join(f"{value:.6g}" for value in row) for row in np.asarray(model.gain))


def _error(provenance: Mapping[str, Any]) -> str:
    """Error of a model as text: the proven bound of a reduction, the misfit of a fit, or "not recorded"."""
    bound = provenance.get("error_bound")
    residual = provenance.get("residual_K")
    if isinstance(bound, (int, float)):
        mesh = provenance.get("mesh_accuracy")
        of = f" of mesh accuracy {mesh:g}" if isinstance(mesh, (int, float)) else ""
        return f"below {bound:.1e} of the thermal resistance at every frequency, from the FEM{of}"
    if isinstance(residual, (int, float)):
        training = provenance.get("training", ())
        drives = ", ".join(map(str, training)) if isinstance(training, (list, tuple)) else str(training)
        return f"misfit {residual:.3g} K rms over {drives or 'its training data'}"
    return "not recorded"


def comment(lines: Iterable[str], mark: str) -> str:
    """Write lines as comments in plain ASCII, each behind ``mark``; a line with breaks becomes several comments."""
    return "".join(f"{mark} {piece}".rstrip() + "\n" for line in lines for piece in lines_of(line))


def write_texts(path: Path, text: str, deck: str, ending: str) -> Path:
    """Write an export and, unless ``deck`` is empty, the file NAME_demo beside it that runs it."""
    if deck:
        demo = path.with_name(f"{path.stem}_demo{ending}")
        write_whole(demo, lambda p: p.write_text(deck, encoding="utf-8"))
    return write_whole(path, lambda p: p.write_text(text, encoding="utf-8"))


def plain_name(name: str) -> str:
    """Return a file name that a SPICE deck can include; InputError unless it has only letters, digits and _ . + -."""
    if not re.fullmatch(r"\w[\w.+-]*", name, flags=re.ASCII):
        raise checks.InputError(f"path = {name!r} is included by a deck; take letters, digits and _ . + - for its name")
    return name


def identifiers(names: Iterable[str], *, taken: Iterable[str] = ()) -> list[str]:
    """Names that simulators accept: letters, digits and single underscores, all different without regard to case.

    Double underscores are left to the exporters' own nodes.
    """
    used = {name.lower() for name in taken}
    result = []
    for name in names:
        base = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_")
        base = base if base[:1].isalpha() else f"n_{base}"
        word = next(w for k in range(10_000) if (w := base if not k else f"{base}_{k}").lower() not in used)
        used.add(word.lower())
        result.append(word)
    return result


def checked(
    model: Any,
    path: str | Path,
    formats: Mapping[str, Format],
    to: str | None,
    *,
    provenance: Mapping[str, Any] | None,
    fmi: int,
    platforms: Sequence[str],
) -> Export:
    """Check the arguments of an export; without ``to`` the ending of the path names the format.

    Raises InputError: an unknown format, no thermal model, or a path that cannot be written.
    """
    path = Path(path)
    if to is None:
        endings = {format.ending: name for name, format in formats.items()}
        checks.choice("the ending of path", path.suffix, endings, hint="or give to, such as to='spice'")
        to = endings[path.suffix]
    checks.choice("to", to, formats)
    check_target(path)
    checks.has("model", model, "inputs", "outputs", hint="a thermal model is needed, such as thermofem.Foster or a fit")
    checks.integer("fmi", fmi, 2, 3)
    if provenance is None:
        provenance = model.provenance if isinstance(model, HasModel) else getattr(model, "origin", None)
    about = checks.mapping("provenance", provenance, hint="such as the .provenance of a fit")
    model = bare(model)
    return Export(formats[to], model, about, Target(path, header(model, about), fmi, platforms))
