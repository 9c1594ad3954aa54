"""Formats of exports, and the arguments that exports of heat and of rings have in common."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from thermofem import checks
from thermofem.data.files import check_target
from thermofem.models import HasModel, bare

from .export_header import header


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

    header: lines about the model, its error and its geometry (`export_header.header`).
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
