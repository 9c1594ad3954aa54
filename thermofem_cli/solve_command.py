"""``thermofem solve`` and ``campaign``: one geometry or many in, training data and pictures out."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from . import options
from .console import bar, note, say, settings, time_bar, working

FRAMES = 60  # fields for ParaView whose times are not given


def solve(
    context: typer.Context,
    geometry: options.Geometry = None,
    power: str = "2 mW",
    pulse: str | None = None,
    square: str | None = None,
    duty: float | None = None,
    periodic: bool = False,
    duration: options.Quantity = "40 us",
    samples: Annotated[int, typer.Option(min=2, max=1_000_000, help="Number of times in the result.")] = 801,
    heated: str | None = None,
    read: list[str] | None = None,
    accuracy: float = 1e-3,
    mesh: Path | None = None,
    rtol: float = 1e-4,
    figure: Path | None = None,
    preview: Path | None = None,
    no_solve: bool = False,
    field_times: list[str] | None = None,
    paraview: Path | None = None,
    output: options.Output = Path("heat.nc"),
) -> dict[str, Any]:
    """Solve the heat equation of one geometry and write training data (netCDF).

    Heating is a step of POWER unless --pulse or --square is given.

    Options
    -------
    power: Absorbed power.
    periodic: One period of the periodic state, not a start from rest.
    duration: [s > 0] Length of the transient.
    heated: Part that carries the power, or several that share it: 'inner, outer'; default: the first.
    read: Part or layer to read; may be repeated.
    preview: Draw cross-section and mesh into this image.
    no_solve: Only draw the --preview, preview.png by default.
    """
    import numpy as np

    import thermofem as th

    from .inputs.command_files import section_of
    from .inputs.drive_texts import heating, times_of
    from .results.heat_lines import draw_preview, draw_response, note_cut, say_each, say_heat, say_sheets, steady_rises

    if no_solve:
        why = "has no effect with --no-solve, which draws the --preview alone"
        solving = "power", "pulse", "square", "duty", "periodic", "duration", "samples", "heated", "read", "rtol"
        options.unused(context, why, *solving, "figure", "field_times", "paraview", "output")
        picture = preview or Path("preview.png")
        section = section_of(geometry)
        with working("meshing"):
            drawn = th.mesh.load(mesh) if mesh else th.mesh.mesh_for(section, accuracy)
        draw_preview(section, drawn, picture)
        say(f"{section.name}: {', '.join(drawn.region_names)}; {len(drawn.triangles)} triangles")
        return {"preview": picture}
    if periodic:
        why = "has no effect with --periodic: one period is solved, and no field is kept"
        options.unused(context, why, "duration", "field_times", "paraview")
    section = section_of(geometry)
    wave = heating(context, power, pulse, square, duty)
    files = [output, figure, preview, paraview]
    step = None if pulse or square else float(wave.mean(0.0, duration))
    parts = options.listed(heated)
    outputs = [name for text in read or () for name in options.listed(text)]
    if section.straight:
        from surrogate.reduction.racetrack_reduction import racetrack_sheets, solve_racetrack

        why = "has no effect on a racetrack, which has no mesh of its own"
        options.unused(context, why, "accuracy", "mesh", "rtol", "preview", "field_times", "paraview")
        times = th.waveforms.period_times(wave, samples) if periodic else np.linspace(0, duration, samples)
        with working("solving the section and the path of the racetrack"):
            data = solve_racetrack(section, wave, times, parts, outputs, periodic=periodic)
            of_heaters = racetrack_sheets(section)
        th.save(data, output)
        if figure:
            draw_response(data, figure)
        numbers = say_heat(data, step) | say_each(section, of_heaters)
        return {**numbers, "wrote": [path for path in (output, figure) if path]}
    instants = times_of(field_times)
    if paraview and not instants:
        instants = tuple(k * duration / FRAMES for k in range(1, FRAMES + 1))
    if paraview:
        th.fields.field_file(paraview, len(instants))

    with working("meshing and assembling"):
        heat = th.assemble(section, accuracy, mesh=mesh)
    if preview:
        draw_preview(section, heat.mesh, preview)
    if len(parts) > 1:
        heat = heat.heated_together(parts)
        note(f"the power is divided evenly between {heated}: 1/{len(parts)} in each")
        heated = heat.heated[-1]
        outputs = outputs or parts
    elif heated is None and len(heat.heated) > 1:
        note(f"{heat.heated[0]} alone carries the power; --heated {', '.join(heat.heated)!r} divides it between them")
    reading = outputs[0] if len(outputs) == 1 else tuple(outputs) or None
    settings: dict[str, Any] = {"heated": heated, "read": reading, "rtol": rtol}
    what = f"solving with {heat.unknowns} unknowns"
    if periodic:
        with working(what):
            data = th.solve_periodic(heat, wave, samples, **settings)
    else:
        times = np.linspace(0, duration, samples)
        with time_bar(what, duration) as progress:
            data = th.solve(heat, wave, times, field_times=instants, progress=progress, **settings)
    with working("writing"):
        th.save(data, output)
        if paraview:
            th.fields.write_fields(data, paraview)
        if figure:
            draw_response(data, figure)
    numbers = say_heat(data, step, steady_rises(heat, data, step))
    note_cut(data.attrs["domain_error"], accuracy)
    sheets = say_sheets(heat)
    numbers |= sheets
    numbers |= {"unknowns": heat.unknowns, "read": reading or numbers["heated"]}
    return {**numbers, "wrote": [path for path in files if path]}


def campaign(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).")],
    folder: options.Folder = Path("campaign"),
    workers: options.Workers = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
) -> dict[str, Any]:
    """Solve many geometries: one netCDF file for each, one index, one training collection.

    Started again, it goes on where it was, however it ended.

    Options
    -------
    retry_failed: Take geometries that failed again.
    """
    import thermofem as th
    from thermofem.campaign import Summary

    from .inputs.command_files import expect
    from .results.heat_lines import note_domain

    expect(file, "campaign")
    plan = th.Campaign.from_toml(file)
    count = workers if workers is not None or scheduler else settings.threads
    with options.executor_of(context, scheduler) as executor, bar("geometries") as progress:

        def report(summary: Summary) -> None:
            rate = f"{summary.finished / summary.seconds:.1f}/s" if summary.seconds else ""
            failed = f", {summary.failed} failed" if summary.failed else ""
            progress(summary.done, summary.total, f"{summary.done}/{summary.total} {rate}{failed}")

        summary = plan.run(folder, executor, workers=count, retry_failed=retry_failed, report=report)
    found = f"{summary.finished} finished in {summary.seconds:.0f} s, {summary.reused} were there already"
    say(f"{summary.total} geometries: {found}, {summary.failed} failed")
    with th.campaign.open_campaign(folder) as index:
        cut = note_domain(index["domain_error"], plan.accuracy)
    if summary.failed:
        say(f"reasons are in {folder / 'failures'} and in the index; --retry-failed takes them again")
    files = {"index": folder / "index.nc", "training": folder / "training.nc"}
    return {**asdict(summary), "domain_too_small": cut, **files}
