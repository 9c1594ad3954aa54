"""Models for other programs. Model files of this project are `thermofem.models.files`.

A format joins by one file with a function ``write(model, path, header)`` and one line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thermofem import checks

if TYPE_CHECKING:
    from thermofem import ThermalModel

# name -> module here, usual ending of the file
FORMATS = {
    "spice": ("spice", ".cir"),
    "verilog-a": ("verilog_a", ".va"),
    "fmu": ("fmu", ".fmu"),
    "mat": ("mat", ".mat"),
    "csv": ("csv", ".csv"),
}


def export_model(
    model: ThermalModel, path: str | Path, *, to: str, provenance: Mapping[str, Any] | None = None, fmi: int = 2
) -> Path:
    """Write a model for a circuit or system simulator, or as matrices or a table.

    Parameters
    ----------
    model : ThermalModel
        of a kind that the format can hold ("mat" holds all), or a fit or reduction that holds one.
    path : str or Path
        SPICE and Verilog-A call the subcircuit or module after the file.
    to : str
        "spice" (subcircuit), "verilog-a" (module), "fmu" (FMI co-simulation; needs pythonfmu or pythonfmu3), "mat"
        (matrices for SciPy, MATLAB, pyMOR) or "csv" (poles).
    provenance : mapping
        `load_provenance` of the model's file, for the header; default the ``.provenance`` of a fit or
        reduction, or the ``.origin`` of a model.
    fmi : 2 or 3
        version of FMI, for "fmu".

    Returns
    -------
    Path
        the file written, whole or not at all.

    Raises
    ------
    InputError
        an unknown format, a kind of model that it cannot hold, or a file that cannot be written.
    MissingLibraryError
        ``to="fmu"``, and the library that builds it is not installed.
    """
    from thermofem.data.files import check_target
    from thermofem.models import HasModel, bare

    from .header import header

    name, _ = FORMATS[checks.choice("to", to, FORMATS)]
    check_target(path)
    checks.has("model", model, "inputs", "outputs", hint="a thermal model is needed, such as thermofem.Foster or a fit")
    if provenance is None:
        provenance = model.provenance if isinstance(model, HasModel) else getattr(model, "origin", None)
    if not isinstance(fmi, int):
        raise checks.InputError(f"fmi = {checks.shown(fmi)} must be 2 or 3")
    lines = header(bare(model), checks.mapping("provenance", provenance, hint="such as the .provenance of a fit"))
    model = bare(model)
    if to == "fmu":
        from .fmu import write

        return write(model, Path(path), lines, fmi=fmi)
    if fmi != 2:
        raise checks.InputError(f'fmi = {fmi!r} goes with to = "fmu"; {to!r} has no such versions')
    written: Path = import_module(f".{name}", __name__).write(model, Path(path), lines)
    return written
