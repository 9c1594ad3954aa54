"""``thermofem cosimulate``: a ring with the FEM of its cross-section in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import thermofem as th
from coupled.loop.cosimulate import NO_PREDICTOR
from thermofem.data import quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import check_outputs, expect, note_ring, ring_of, section_of
from ..console import say, time_bar, working, wrote
from ..drive_texts import detuning_of, heater_powers, times_of
from .simulate_command import say_pulsing, verdict


def cosimulate(
    geometry: options.Geometry = None,
    power: options.Power = "8 dBm",
    detuning: options.Detuning = "0 GHz",
    duration: options.Duration = "20 us",
    ring: options.Ring = options.REFERENCE_RING,
    heater: options.VaryingHeater = None,
    predictor: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Model (JSON) that predicts, or none; default: a reduction.")
    ] = None,
    max_discrepancy: Annotated[str, typer.Option(help="Discrepancy left between light and FEM.")] = "1 mK",
    accuracy: options.Accuracy = 1e-3,
    rtol: options.Rtol = 1e-6,
    field_times: options.FieldTimes = None,
    paraview: options.Paraview = None,
    figure: options.Figure = None,
    output: options.NetCDF = Path("cosimulation.nc"),
) -> dict[str, Any]:
    """Drive a ring with the FEM itself in the loop: traces, and whether and how it pulses."""
    import coupled

    check_outputs([output, figure, paraview], images=[figure], inputs=[geometry, ring, predictor])
    resonator = ring_of(ring)
    length = quantity.positive(duration, "s", name="--duration")
    settings: dict[str, Any] = {
        "power": quantity.not_negative(power, "W", name="--power"),
        "detuning": detuning_of(detuning, resonator),
        "max_discrepancy": quantity.positive_rise(max_discrepancy, name="--max-discrepancy"),
        "heaters": heater_powers(heater, length),
        "field_times": times_of(field_times),
        "predictor": _predictor(predictor),
    }
    if paraview and not settings["field_times"]:
        raise InputError("--paraview writes the fields that are kept; say which with --field-times '1 us, 5 us'")
    if paraview:
        from thermofem.data.fields import files_of

        files_of(paraview, len(settings["field_times"]))
    section = section_of(geometry)
    with working("meshing and assembling"):
        heat = th.assemble(section, accuracy)
    with time_bar(f"{heat.unknowns} temperatures in the loop", length) as progress:
        run = coupled.cosimulate(resonator, heat, duration=length, rtol=rtol, progress=progress, **settings)
    with working("judging and writing the run"):
        found = verdict(run, duration)
        th.save(run, output)
    if paraview:
        th.data.fields.write_fields(run, paraview)
    if figure:
        from coupled.plot import plot_traces
        from thermofem.plot import save_figure

        save_figure(plot_traces(run), figure)
    note_ring(resonator, ring)
    numbers = say_pulsing(found)
    a = run.attrs
    say(
        f"{a['windows']} windows, {a['passes']} passes, largest discrepancy {a['largest_discrepancy'] * 1e3:.2g} mK, "
        f"heat imbalance {a['heat_imbalance']:.0e}"
    )
    seconds = a["cpu_optics"] + a["cpu_corrector"]
    say(f"{a['fem_solves']} solves with {a['fem_unknowns']} unknowns, {seconds:.2g} s of CPU time")
    files = [path for path in (output, paraview, figure) if path]
    wrote(*files)
    costs = ("windows", "passes", "largest_discrepancy", "heat_imbalance", "fem_solves", "fem_unknowns")
    return {**numbers, **{name: a[name] for name in costs}, "wrote": files}


def _predictor(given: str | None) -> th.models.ThermalModel | None:
    import surrogate

    if given is None:
        return None
    if given == "none":
        return NO_PREDICTOR
    expect(Path(given), "model")
    return surrogate.load_model(given)
