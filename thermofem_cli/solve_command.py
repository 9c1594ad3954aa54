"""``thermofem solve`` and ``campaign``: one geometry or many in, training data and pictures out."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import xarray as xr

import thermofem as th
from thermofem import InputError
from thermofem.arrays import Array, ArrayLike
from thermofem.campaign import Summary
from thermofem.data import quantity
from thermofem.fem.domain_truncation import NOTABLE

from . import options
from .console import bar, note, say, settings, time_bar, working, written, wrote
from .inputs.command_files import check_outputs, expect, section_of
from .inputs.drive_texts import heating, times_of
from .results.heater_sheets import say_sheets

FRAMES = 60  # fields for ParaView whose times are not given
SAME = 1e-3  # relative difference from which R_th at a power is printed beside that at small power


def solve(
    context: typer.Context,
    geometry: options.Geometry = None,
    power: Annotated[str, typer.Option(help="Absorbed power.")] = "2 mW",
    pulse: options.Pulse = None,
    square: options.Square = None,
    duty: options.Duty = None,
    periodic: Annotated[
        bool, typer.Option("--periodic", help="One period of the periodic state, not a start from rest.")
    ] = False,
    duration: Annotated[str, typer.Option(help="Length of the transient.")] = "40 us",
    samples: Annotated[int, typer.Option(min=2, max=1_000_000, help="Number of times in the result.")] = 801,
    heated: Annotated[
        str | None,
        typer.Option(help="Part that carries the power, or several that share it: 'inner, outer'; default: the first."),
    ] = None,
    read: Annotated[list[str] | None, typer.Option(help="Part or layer to read; may be repeated.")] = None,
    accuracy: options.Accuracy = 1e-3,
    mesh: options.Mesh = None,
    rtol: options.Rtol = 1e-4,
    figure: options.Figure = None,
    preview: Annotated[Path | None, typer.Option(help="Draw cross-section and mesh into this image.")] = None,
    no_solve: Annotated[
        bool, typer.Option("--no-solve", help="Only draw the --preview, preview.png by default.")
    ] = False,
    field_times: options.FieldTimes = None,
    paraview: options.Paraview = None,
    output: options.Output = Path("heat.nc"),
) -> dict[str, Any]:
    """Solve the heat equation of one geometry and write training data (netCDF).

    Heating is a step of POWER unless --pulse or --square is given.
    """
    if no_solve:
        why = "has no effect with --no-solve, which draws the --preview alone"
        solving = "power", "pulse", "square", "duty", "periodic", "duration", "samples", "heated", "read", "rtol"
        options.unused(context, why, *solving, "figure", "field_times", "paraview", "output")
        picture = preview or Path("preview.png")
        check_outputs([picture], images=[picture], inputs=[geometry, mesh])
        section = section_of(geometry)
        with working("meshing"):
            drawn = th.mesh.load(mesh) if mesh else th.mesh.mesh_for(section, accuracy)
        _preview(section, drawn, picture)
        say(f"{section.name}: {', '.join(drawn.region_names)}; {len(drawn.triangles)} triangles")
        wrote(picture)
        return {"preview": picture}
    if periodic:
        why = "has no effect with --periodic: one period is solved, and no field is kept"
        options.unused(context, why, "duration", "field_times", "paraview")
    section = section_of(geometry)
    wave = heating(context, power, pulse, square, duty)
    files = [output, figure, preview, paraview]
    check_outputs(files, images=[figure, preview], inputs=[geometry, mesh])
    length = quantity.positive(duration, "s", name="--duration")
    kept = times_of(field_times)
    if paraview and not kept:
        kept = tuple(k * length / FRAMES for k in range(1, FRAMES + 1))
    if paraview:
        th.fields.field_file(paraview, len(kept))

    with working("meshing and assembling"):
        heat = th.assemble(section, accuracy, mesh=mesh)
    if preview:
        _preview(section, heat.mesh, preview)
    parts = [name.strip() for name in heated.split(",")] if heated else []
    outputs = [name.strip() for text in read or () for name in text.split(",")]
    if len(parts) > 1:
        heat = heat.heated_together(parts)
        note(f"the power is divided evenly between {heated}: 1/{len(parts)} in each")
        heated = heat.heated[-1]
        outputs = outputs or parts
    elif heated is None and len(heat.heated) > 1:
        note(f"{heat.heated[0]} alone carries the power; --heated {', '.join(heat.heated)!r} divides it between them")
    wanted = outputs[0] if len(outputs) == 1 else tuple(outputs) or None
    settings: dict[str, Any] = {"heated": heated, "read": wanted, "rtol": rtol}
    what = f"solving with {heat.unknowns} unknowns"
    if periodic:
        with working(what):
            data = th.solve_periodic(heat, wave, samples, **settings)
    else:
        times = np.linspace(0, length, samples)
        with time_bar(what, length) as progress:
            data = th.solve(heat, wave, times, field_times=kept, progress=progress, **settings)
    with working("writing"):
        th.save(data, output)
        if paraview:
            th.fields.write_fields(data, paraview)
        if figure:
            _draw(data, figure)
    step = None if pulse or square else float(wave.mean(0.0, length))
    numbers = _say(data, step, _steady_rises(heat, data, step))
    if data.attrs["domain_error"] <= NOTABLE:  # a larger one is reported by the log
        _note_domain([data.attrs["domain_error"]], accuracy)
    sheets = say_sheets(heat)
    wrote(*files)
    numbers |= sheets
    numbers |= {"unknowns": heat.unknowns, "read": wanted or numbers["heated"]}
    return {**numbers, "wrote": [path for path in files if path]}


def _steady_rises(heat: th.fem.HeatProblem, data: xr.Dataset, power: float | None) -> dict[str, float]:
    """Rise of every output in K that a step of ``power`` in W settles at, by k(T) at that power; nan where it fails."""
    rises: dict[str, float] = {}
    for name in data.attrs["read"].split(", ") if power else ():
        try:
            rises[name] = heat.steady_rise(power or 0.0, data.attrs["heated"], name)
        except InputError:
            rises[name] = float("nan")
    return rises


def _say(data: xr.Dataset, power: float | None, steady: dict[str, float]) -> dict[str, Any]:
    """Print and return R_th of every output and, for a step of ``power`` in W, its rise time from 10 to 90 %.

    steady: rise of every output at rest under the step, in K.
    """
    a = data.attrs
    times = data["time"].values
    source = a["heated"]
    names = a["read"].split(", ")
    resistances = dict(zip(names, np.atleast_1d(a.get("thermal_resistances", a["thermal_resistance"])), strict=True))
    rises = dict(zip(names, np.atleast_2d(data["delta_T"].transpose(..., "time")), strict=True))
    rise_times: dict[str, float | None] = {}
    for name, R in resistances.items():
        of = name if name == source else f"{name} heated by {source}"
        line = f"R_th of {of} = {R / 1e3:.4g} K/mW"
        if power:
            share = rises[name] / steady[name]
            settles = abs(steady[name] / (R * power) - 1) < SAME
            line += "" if settles else f" at small power, {steady[name] / power / 1e3:.4g} K/mW at this one"
            rise_times[name] = _rise_time(times, share)
            line += _progress(share, rise_times[name])
        say(line)
    largest = float(data["delta_T"].max())
    say(f"largest rise {largest:.4g} K, energy imbalance {a['heat_imbalance']:.0e}")
    return {
        "thermal_resistance": resistances[names[0]],
        "largest_rise": largest,
        "heat_imbalance": a["heat_imbalance"],
        "domain_error": a["domain_error"],
        "heated": source,
        **({"thermal_resistances": resistances} if len(names) > 1 else {}),
        **({"rise_time": rise_times, "steady_rise": steady} if power else {}),
    }


def _rise_time(times: Array, share: Array) -> float | None:
    """Time in s from 10 to 90 % of the steady rise; None where the run ends before."""
    if not share[-1] >= 0.9:
        return None
    low = float(np.interp(0.1, share, times))
    high = float(np.interp(0.9, share, times))
    return high - low


def _progress(share: Array, rise_time: float | None) -> str:
    """Words on the rise time, and on what is missing of the steady rise at the end of the run."""
    if np.isnan(share[-1]):
        return ", no steady state found at this power"
    words = "" if rise_time is None else f", rise 10-90 % in {written(rise_time, 's')}"
    return words + (f", {share[-1]:.0%} of the steady rise at the end of the run" if share[-1] < 0.99 else "")


def _note_domain(errors: ArrayLike, accuracy: float) -> int:
    """Return of how many geometries the domain's finite size changes R_th by more than ``accuracy``, and print it."""
    errors = np.asarray(errors)
    cut = int((errors > accuracy).sum())
    if cut:
        which = f"{cut} of {errors.size} geometries have a " if errors.size > 1 else ""
        note(
            f"{which}domain_error of up to {np.nanmax(errors):.1e}, above accuracy = {accuracy:g}: the bottom or outer "
            'side is too near: move it outwards, or make it "open" where the stack goes on'
        )
    return cut


def _preview(section: th.CrossSection, mesh: th.mesh.Mesh, path: Path) -> None:
    """Draw cross-section and mesh."""
    from thermofem import plot

    plot.save_figure(plot.plot_preview(section, mesh), path)


def _draw(data: xr.Dataset, path: Path) -> None:
    """Draw the response; its title says what was heated and read, by which drive, and from which start."""
    from thermofem import plot, waveforms

    a = data.attrs
    of = "" if "," in a["read"] or a["read"] == a["heated"] else f"{a['read']}, "
    part = a["heated"] if a["read"] == a["heated"] else f"{of}{a['heated']} heated"
    drive = waveforms.from_json(a["waveform"]).words.replace(" us", " µs")
    begun = ", one period of the periodic state" if a["kind"] == "periodic" else ", from rest"
    ax = plot.plot_response(data)
    ax.set_title(f"{part}: {drive}{begun}", fontsize="small", loc="left")
    plot.save_figure(ax, path)


def campaign(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).")],
    output: options.Folder = Path("campaign"),
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Take geometries that failed again.")] = False,
) -> dict[str, Any]:
    """Solve many geometries: one netCDF file for each, one index, one training collection.

    Started again, it goes on where it was, however it ended.
    """
    expect(file, "campaign")
    plan = th.Campaign.from_toml(file)
    count = workers if workers is not None or scheduler else settings.threads
    with options.executor_of(context, scheduler) as executor, bar("geometries") as progress:

        def report(summary: Summary) -> None:
            rate = f"{summary.finished / summary.seconds:.1f}/s" if summary.seconds else ""
            failed = f", {summary.failed} failed" if summary.failed else ""
            progress(summary.done, summary.total, f"{summary.done}/{summary.total} {rate}{failed}")

        summary = plan.run(output, executor, workers=count, retry_failed=retry_failed, report=report)
    found = f"{summary.finished} finished in {summary.seconds:.0f} s, {summary.reused} were there already"
    say(f"{summary.total} geometries: {found}, {summary.failed} failed")
    with th.campaign.open_campaign(output) as index:
        cut = _note_domain(index["domain_error"], plan.accuracy)
    if summary.failed:
        say(f"reasons are in {output / 'failures'} and in the index; --retry-failed takes them again")
    files = {"index": output / "index.nc", "training": output / "training.nc"}
    wrote(*files.values())
    return {**asdict(summary), "domain_too_small": cut, **files}
