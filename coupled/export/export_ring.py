"""A ring whole, with its light, carriers and heat, for other programs; `surrogate.export_model` has heat alone.

A format joins by a function ``write(ring, model, target, run)`` and one line in `FORMATS`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from thermofem import InputError, checks
from thermofem.export.export_header import Format, checked
from thermofem.export.fmi_unit import DURATION
from thermofem.models import ThermalModel
from thermofem.ring_temperature import GuidedMode, check_read

from ..circuit import Circuit
from ..resonator import RingResonator
from ..runs.pulsing import Regime, pulsing
from ..runs.simulate import simulate
from ..thermal import as_read, without_origin
from . import ring_fmu, ring_spice, ring_verilog_a
from .ring_ports import Demonstration, LitPart, demonstration, lit_channel, lit_part

FORMATS = {
    "spice": Format(".cir", ring_spice.write, ".cir"),
    "verilog-a": Format(".va", ring_verilog_a.write, ".sim"),
    "fmu": Format(".fmu", ring_fmu.write, ".py"),
}


def export_ring(
    ring: RingResonator | Circuit,
    model: ThermalModel,
    path: str | Path,
    *,
    to: str | None = None,
    power: float | Mapping[str, float] | None = None,
    detuning: float = 0.0,
    period: float | None = None,
    provenance: Mapping[str, Any] | None = None,
    fmi: int = 2,
    platforms: Sequence[str] = (),
) -> Path:
    """Write a ring with its light, carriers and heat for a circuit or system simulator.

    Parameters
    ----------
    ring : RingResonator or Circuit
        a circuit of one laser for "spice" alone.
    model : ThermalModel
        of independent poles, or a fit or reduction that holds one. Light heats its first input; of a circuit it is that
        of each ring, or has an input for each.
    path : str or Path
        SPICE and Verilog-A call the subcircuit or module after the file.
    to : str, optional
        "spice" (subcircuits), "verilog-a" (module) or "fmu" (FMI unit, model exchange and co-simulation); default by
        the ending of ``path``.
    power, detuning : float; W, Hz, optional
        of the laser of a run that is written beside the export: PATH_demo.cir for ngspice, PATH_demo.sim for VACASK,
        PATH_demo.py for FMPy, 100 us from cold. A mapping has the laser's name.
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
        an unknown format, a kind of model or ring that it cannot hold, a model that reads another temperature than the
        ring, or a file that cannot be written.
    MissingLibraryError
        an FMU for another platform, and ziglang is not installed.
    """
    export = checked(model, path, FORMATS, to, provenance=provenance, fmi=fmi, platforms=platforms)
    if isinstance(ring, Circuit) and export.format is not FORMATS["spice"]:
        raise checks.InputError(f"path = {export.target.path}: a circuit goes into spice, not into other formats")
    run = None if power is None else demonstration(power, detuning, period)
    _check_read(ring, export.model, export.provenance)
    if run is not None and run.period is None:
        run = replace(run, rests=_rests(ring, export.model, run))
    return export.format.write(ring, export.model, export.target, run)


def _rests(ring: RingResonator | Circuit, model: Any, run: Demonstration) -> bool:
    """Whether a demonstration is at rest at its end, with all its rings; False where `simulate` does not take it."""
    power: Any = run.power
    if isinstance(ring, Circuit):
        power = {laser.name: run.power for laser in ring.lasers}
    else:
        model = without_origin(lit_channel(model, ring.read))
        ring = as_read(ring, model)
    try:
        end = simulate(ring, model, power=power, detuning=run.detuning, duration=DURATION)
    except InputError:
        return False
    traces = [end.sel(ring=name) for name in ring.names] if isinstance(ring, Circuit) else [end]
    return all(pulsing(trace).regime == Regime.STABLE for trace in traces)


def _check_read(light: RingResonator | Circuit, model: Any, origin: Mapping[str, Any]) -> None:
    """Compare the temperature that each ring reads with the output of the model that the export connects to it."""
    geometry = str(origin.get("geometry", ""))
    mode = GuidedMode.of_origin(origin)
    rings = light.resonators if isinstance(light, Circuit) else (light,)
    array = len(rings) > 1 and len(model.outputs) == len(rings) <= len(model.inputs)
    for k, ring in enumerate(rings):
        checks.has("ring", ring, "read", "frequency", hint="a coupled.RingResonator is one")
        channel = LitPart(model.inputs[k], model.outputs[k]) if array else lit_part(model, ring.read)
        check_read(ring, geometry, channel.heated, channel.read, mode=mode)
