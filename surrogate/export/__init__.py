"""Heat for circuit and system simulators, and its matrices; `coupled.export` has rings whole.

A format is a `Format` in `FORMATS`: the ending of its files and a function ``write(model, target)``. The command and
the checks take it from there. Model files of this project are `thermofem.models.model_files`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thermofem.export.export_header import Format, checked
from thermofem.models import ThermalModel

from .heat_files import write_csv, write_fmu, write_mat, write_spice, write_verilog_a

FORMATS = {
    "spice": Format(".cir", write_spice),
    "verilog-a": Format(".va", write_verilog_a),
    "fmu": Format(".fmu", write_fmu),
    "mat": Format(".mat", write_mat),
    "csv": Format(".csv", write_csv),
}


def export_model(
    model: ThermalModel,
    path: str | Path,
    *,
    to: str | None = None,
    provenance: Mapping[str, Any] | None = None,
    fmi: int = 2,
    platforms: Sequence[str] = (),
) -> Path:
    """Write a thermal model for a circuit or system simulator; `coupled.export_ring` adds the light and carriers.

    Parameters
    ----------
    model : ThermalModel
        of a kind that the format can hold ("mat" holds all), or a fit or reduction that holds one.
    path : str or Path
        SPICE and Verilog-A call the subcircuit or module after the file.
    to : str, optional
        "spice" (subcircuit), "verilog-a" (module), "fmu" (FMI unit in C, model exchange and co-simulation), "mat"
        (matrices for SciPy, MATLAB, pyMOR) or "csv" (poles); default by the ending of ``path``.
    provenance : mapping
        `load_provenance` of the model's file, for the header; default the ``.provenance`` of a fit or
        reduction, or the ``.origin`` of a model.
    fmi : 2 or 3
        version of FMI, for "fmu".
    platforms : sequence of str
        libraries in an FMU: "linux", "windows", "macos", "macos-arm", "linux-arm"; default this platform.

    Returns
    -------
    Path
        the file written, whole or not at all.

    Raises
    ------
    InputError
        an unknown format, a kind of model that it cannot hold, or a file that cannot be written.
    MissingLibraryError
        an FMU for another platform, and ziglang is not installed.
    """
    export = checked(model, path, FORMATS, to, provenance=provenance, fmi=fmi, platforms=platforms)
    return export.format.write(export.model, export.target)
