"""Models for other programs. Model files of this project are `thermofem.models.model_files`.

A format joins by a function ``write(model, path, header, ...)`` and one line in `FORMATS`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thermofem import checks
from thermofem.data.files import check_target
from thermofem.models import HasModel, ThermalModel, bare
from thermofem.ring_temperature import check_read

from . import fmu, poles, spice, verilog_a
from .export_header import header
from .poles import LitPart, lit_part
from .ring_rates import demonstration

FORMATS = {"spice": ".cir", "verilog-a": ".va", "fmu": ".fmu", "mat": ".mat", "csv": ".csv"}  # usual endings
DEMONSTRATIONS = {"spice": ".cir", "verilog-a": ".sim", "fmu": ".py"}  # of a ring: endings of PATH_demo


def export_model(
    model: ThermalModel,
    path: str | Path,
    *,
    to: str | None = None,
    ring: Any = None,
    power: Any = None,
    detuning: float = 0.0,
    period: float | None = None,
    provenance: Mapping[str, Any] | None = None,
    fmi: int = 2,
    platforms: Sequence[str] = (),
) -> Path:
    """Write a thermal model, or a whole ring with its light and carriers, for a circuit or system simulator.

    Parameters
    ----------
    model : ThermalModel
        of a kind that the format can hold ("mat" holds all), or a fit or reduction that holds one. With a ring, its
        light heats the first input.
    path : str or Path
        SPICE and Verilog-A call the subcircuit or module after the file.
    to : str, optional
        "spice" (subcircuit), "verilog-a" (module), "fmu" (FMI unit in C, model exchange and co-simulation), "mat"
        (matrices for SciPy, MATLAB, pyMOR) or "csv" (poles); default by the ending of ``path``.
    ring : RingResonator or Circuit, optional
        light and carriers, for "spice", "verilog-a" and "fmu"; a `coupled.Circuit` for "spice".
    power, detuning : float; W, Hz, optional
        of the laser of a run that is written beside the export: PATH_demo.cir for ngspice, PATH_demo.sim for VACASK,
        PATH_demo.py for FMPy, 100 us from cold.
    period : float, s, optional
        settled period of that run (`coupled.limit_cycle`): the largest step is a 400th of it.
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
        an unknown format, a kind of model or ring that it cannot hold, or a file that cannot be written.
    MissingLibraryError
        an FMU for another platform, and ziglang is not installed.
    """
    path = Path(path)
    if to is None:
        endings = {ending: name for name, ending in FORMATS.items()}
        checks.choice("the ending of path", path.suffix, endings, hint="or give to, such as to='spice'")
        to = endings[path.suffix]
    checks.choice("to", to, FORMATS)
    check_target(path)
    checks.has("model", model, "inputs", "outputs", hint="a thermal model is needed, such as thermofem.Foster or a fit")
    checks.integer("fmi", fmi, 2, 3)
    if ring is not None:
        checks.choice("to of a ring", to, DEMONSTRATIONS, hint="the others hold the heat only")
    if hasattr(ring, "rings"):
        checks.choice("to of a Circuit", to, ("spice",))
    if ring is None and power is not None:
        raise checks.InputError("power is that of a ring's laser; give ring, too")
    run = None if power is None else demonstration(power, detuning, period)
    if provenance is None:
        provenance = model.provenance if isinstance(model, HasModel) else getattr(model, "origin", None)
    model = bare(model)
    if ring is not None:
        _check_rings(ring, model, str((provenance or {}).get("geometry", "")))
    lines = header(model, checks.mapping("provenance", provenance, hint="such as the .provenance of a fit"))
    options: dict[str, Any] = {"fmi": fmi, "platforms": platforms} if to == "fmu" else {}
    light = () if to not in DEMONSTRATIONS else (ring, run)
    write = {"spice": spice.write, "verilog-a": verilog_a.write, "fmu": fmu.write, "mat": poles.write_mat}
    return write.get(to, poles.write_csv)(model, path, lines, *light, **options)


def _check_rings(light: Any, model: Any, geometry: str) -> None:
    """Compare the temperature that each ring reads with the output of the model that the export connects to it."""
    rings = getattr(light, "resonators", (light,))
    array = len(rings) > 1 and len(model.outputs) == len(rings) <= len(model.inputs)
    for k, ring in enumerate(rings):
        checks.has("ring", ring, "read", "frequency", hint="a coupled.RingResonator is one")
        channel = LitPart(model.inputs[k], model.outputs[k]) if array else lit_part(model, ring.read)
        check_read(ring, geometry, channel.heated, channel.read)
