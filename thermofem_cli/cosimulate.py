"""``thermofem cosimulate``: a ring with the FEM of its cross-section in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem.checks import InputError

from . import options
from .bar import Bar
from .detuning import detuning_of
from .drives import HEATER, heaters
from .files import DEFAULT_RING, check_outputs, ring_of, say_ring, section_of, working
from .kinds import expect
from .models import pulsing_numbers, say_pulsing, verdict
from .output import say
from .solve_options import times_of

if TYPE_CHECKING:
    from thermofem.models import ThermalModel


def cosimulate(
    geometry: options.Geometry = None,
    power: options.Power = "8 dBm",
    detuning: options.Detuning = "0 GHz",
    duration: options.Duration = "20 us",
    ring: options.Ring = DEFAULT_RING,
    heater: Annotated[list[str] | None, typer.Option(help=HEATER)] = None,
    predictor: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Model (JSON) that predicts, or none; default: a reduction.")
    ] = None,
    max_discrepancy: Annotated[str, typer.Option(help="Discrepancy left between light and FEM.")] = "1 mK",
    accuracy: options.Accuracy = 1e-3,
    rtol: Annotated[float, typer.Option(help="Relative error of a step of the light.")] = 1e-6,
    field_times: options.FieldTimes = None,
    paraview: options.Paraview = None,
    figure: Annotated[Path | None, typer.Option(help="Also draw the traces into this image.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write (netCDF).")] = Path("cosimulation.nc"),
) -> dict[str, Any]:
    """Drive a ring with the FEM itself in the loop: traces, and whether and how it pulses."""
    import coupled
    from thermofem.data import dataset, quantity
    from thermofem.data.fields import files_of, write_fields
    from thermofem.fem import assemble

    model_file = Path(predictor) if predictor and predictor != "none" else None
    check_outputs([output, figure, paraview], images=[figure])
    expect(geometry, "geometry")
    expect(model_file, "model")
    resonator = ring_of(ring)
    length = quantity.positive(duration, "s", name="--duration")
    settings: dict[str, Any] = {
        "power": quantity.not_negative(power, "W", name="--power"),
        "detuning": detuning_of(detuning, resonator),
        "max_discrepancy": quantity.positive_rise(max_discrepancy, name="--max-discrepancy"),
        "heaters": heaters(heater or [], length),
        "field_times": times_of(field_times or []),
        "predictor": _predictor(predictor, model_file),
    }
    if paraview and not settings["field_times"]:
        raise InputError("--paraview writes the fields that are kept; say which with --field-times '1 us, 5 us'")
    if paraview:
        files_of(paraview, len(settings["field_times"]))
    with working("meshing and assembling"):
        heat = assemble(section_of(geometry), accuracy)
    say_ring(resonator, ring)
    with Bar(f"{heat.unknowns} temperatures in the loop", length, stays=True) as progress:
        run = coupled.cosimulate(resonator, heat, duration=length, rtol=rtol, progress=progress, **settings)
    with working(f"judging the run and writing {output}"):
        found = verdict(run, duration)
        dataset.save(run, output)
    if paraview:
        write_fields(run, paraview)
    if figure:
        from coupled.plot import plot_traces
        from thermofem.plot import save_figure

        save_figure(plot_traces(run), figure)
    numbers = _report(run, found)
    files = [path for path in (output, paraview, figure) if path]
    say("wrote " + ", ".join(map(str, files)))
    return {**numbers, "wrote": files}


def _predictor(given: str | None, path: Path | None) -> ThermalModel | None:
    import coupled
    import surrogate

    if given == "none":
        return coupled.NO_PREDICTOR
    return surrogate.load_model(path) if path else None


def _report(run: Any, found: Any) -> dict[str, Any]:
    """Regime, convergence and cost, in four lines."""
    a = run.attrs
    say_pulsing(found)
    say(
        f"{a['windows']} windows, {a['passes']} passes, largest discrepancy {a['largest_discrepancy'] * 1e3:.2g} mK, "
        f"heat imbalance {a['heat_imbalance']:.0e}"
    )
    seconds = a["cpu_optics"] + a["cpu_corrector"]
    say(f"{a['fem_solves']} solves with {a['fem_unknowns']} unknowns, {seconds:.2g} s of CPU time")
    costs = ("windows", "passes", "largest_discrepancy", "heat_imbalance", "fem_solves", "fem_unknowns")
    return {**pulsing_numbers(found), **{name: a[name] for name in costs}}
