"""``thermofem solve``: geometry and drive in, netCDF and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import quantity

from . import options
from .bar import Bar
from .files import check_outputs, section_of
from .kinds import expect
from .output import console as terminal
from .output import say, working
from .solve_options import note_unseen_end, times_of, waveform

if TYPE_CHECKING:
    from thermofem.data.record import Record
    from thermofem.geometry import CrossSection
    from thermofem.mesh import Mesh

FRAMES = 60  # of an animation whose times are not given


def solve(
    geometry: options.Geometry = None,
    power: Annotated[str, typer.Option(help="Absorbed power.")] = "2 mW",
    pulse: Annotated[str | None, typer.Option(help="Heat for this long, e.g. '20 us'.")] = None,
    square: Annotated[str | None, typer.Option(help="Square wave of this period, e.g. '1 us'.")] = None,
    duty: options.Duty = None,
    periodic: Annotated[bool, typer.Option(help="One period of the periodic state, not a start from rest.")] = False,
    duration: Annotated[str, typer.Option(help="Length of the transient.")] = "40 us",
    samples: Annotated[int, typer.Option(help="Number of times in the result.")] = 801,
    heated: Annotated[str | None, typer.Option(help="Part that carries the power; default: the first heated.")] = None,
    read: Annotated[list[str] | None, typer.Option(help="Part or layer to read; may be repeated.")] = None,
    accuracy: options.Accuracy = 1e-3,
    rtol: Annotated[float, typer.Option(help="Relative error of the time integration.")] = 1e-4,
    figure: Annotated[Path | None, typer.Option(help="Also draw the response into this image.")] = None,
    preview: Annotated[Path | None, typer.Option(help="Draw cross-section and mesh into this image.")] = None,
    no_solve: Annotated[bool, typer.Option("--no-solve", help="Only draw the --preview.")] = False,
    field_times: options.FieldTimes = None,
    paraview: options.Paraview = None,
    animation: Annotated[Path | None, typer.Option(help="Write the field as a film (.gif, .mp4).")] = None,
    output: options.NetCDF = Path("heat.nc"),
) -> dict[str, Any]:
    """Solve the heat equation of one geometry and write training data (netCDF).

    Heating is a step of POWER unless --pulse or --square is given.
    """
    if no_solve:
        return _preview(geometry, accuracy, preview)
    expect(geometry, "geometry")
    section = section_of(geometry)
    wave = waveform(power, pulse, square, duty)
    checks.between("--samples", samples, 2, 1_000_000)
    files = [output, figure, preview, paraview, animation]
    check_outputs(files, images=[figure, preview])
    if animation:
        from thermofem.plot import check_film

        check_film(animation)
    length = quantity.positive(duration, "s", name="--duration")
    if not periodic:
        note_unseen_end(pulse, square, wave, length)
    kept = _field_times(field_times or [], length, wanted=bool(paraview or animation), periodic=periodic)
    if paraview:
        from thermofem.data.fields import files_of

        files_of(paraview, len(kept))
    import numpy as np

    from thermofem.data import dataset
    from thermofem.fem import assemble
    from thermofem.solving import solve as transient
    from thermofem.solving import solve_periodic

    with working("meshing and assembling"):
        heat = assemble(section, accuracy)
    if preview:
        _draw_preview(section, heat.mesh, preview)
    wanted = read[0] if read and len(read) == 1 else tuple(read or ()) or None
    settings: dict[str, Any] = {"heated": heated, "read": wanted, "rtol": rtol}
    span = wave.period if periodic and wave.period else length
    with Bar(f"solving with {heat.unknowns} unknowns", span, periodic=periodic) as progress:
        if periodic:
            data = solve_periodic(heat, wave, samples, progress=progress, **settings)
        else:
            times = np.linspace(0, length, samples)
            data = transient.record(heat, wave, times, field_times=kept, progress=progress, **settings)
    with working(f"writing {output}"):
        dataset.save(data, output)
    with working("drawing"):
        _draw(data, figure, paraview)
    if animation:
        _film(data, animation)
    source = data.attrs["heated"]
    pair = f"{wanted} heated by {source}" if isinstance(wanted, str) and wanted != source else source
    pair = f"{source} (heated and read there)" if isinstance(wanted, tuple) else pair
    a, largest = data.attrs, float(data["delta_T"].values.max())
    say(
        f"R_th of {pair} = {a['thermal_resistance'] / 1e3:.4g} K/mW, largest rise {largest:.4g} K, "
        f"energy imbalance {a['heat_imbalance']:.0e}"
    )
    for path in files:
        if path:
            say(f"wrote {path}")
    return {
        "thermal_resistance": float(a["thermal_resistance"]),
        "largest_rise": largest,
        "unknowns": heat.unknowns,
        "heat_imbalance": a["heat_imbalance"],
        "heated": source,
        "read": wanted or source,
        "wrote": [path for path in files if path],
    }


def _preview(geometry: Path | None, accuracy: float, path: Path | None) -> dict[str, Any]:
    """Draw cross-section and mesh, and solve nothing."""
    if path is None:
        raise InputError("--no-solve needs an image to draw; add --preview mesh.png")
    expect(geometry, "geometry")
    section = section_of(geometry)
    check_outputs([path], images=[path])
    from thermofem.mesh import mesh_for

    with working("meshing"):
        mesh = mesh_for(section, accuracy)
    _draw_preview(section, mesh, path)
    say(f"{section.name}: {', '.join(mesh.region_names)}; {len(mesh.triangles)} triangles; wrote {path}")
    return {"preview": path}


def _field_times(texts: list[str], duration: float, *, wanted: bool, periodic: bool) -> tuple[float, ...]:
    """Times at which the field is kept: those given ("1 us, 5 us"), or evenly spread ones where a film wants them."""
    given = times_of(texts)
    if periodic and (given or wanted):
        raise InputError("--periodic keeps no fields; leave out --field-times, --paraview and --animation, or it")
    return tuple(k * duration / FRAMES for k in range(1, FRAMES + 1)) if wanted and not given else given


def _draw_preview(section: CrossSection, mesh: Mesh, path: Path) -> None:
    from thermofem import plot

    plot.save_figure(plot.plot_preview(section, mesh), path)


def _draw(data: Record, figure: Path | None, paraview: Path | None) -> None:
    """Write the picture and the field file that are wanted."""
    if paraview:
        from thermofem.data.fields import write_fields

        write_fields(data, paraview)
    if figure:
        from thermofem import plot

        ax = plot.plot_response(data)
        ax.set_title(_title(data), fontsize="small", loc="left")
        plot.save_figure(ax, figure)


def _title(data: Record) -> str:
    """What was heated, and read where that is one other part; how; and whether this is a periodic state."""
    from thermofem import waveforms

    a = data.attrs
    of = "" if "," in a["read"] or a["read"] == a["heated"] else f"{a['read']}, "
    part = a["heated"] if a["read"] == a["heated"] else f"{of}{a['heated']} heated"
    drive = waveforms.from_json(a["waveform"]).words.replace(" us", " µs")
    return f"{part}: {drive}" + (", one period of the periodic state" if a["kind"] == "periodic" else ", from rest")


def _film(data: Record, path: Path) -> None:
    """Write the field as a film, with a bar over its frames."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from thermofem import plot

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=terminal()) as progress:
        bar = progress.add_task(f"drawing {path.name}")
        plot.animate_field(data, path, on_frame=lambda at, total: progress.update(bar, completed=at + 1, total=total))
