"""``thermofem solve``: geometry and drive in, netCDF and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, dataset, quantity
from ..checks import InputError
from ..fields import write_fields
from ..geometry import CrossSection, strip_ring
from ..heat import assemble
from ..mesh import Mesh, mesh_for
from ..record import Record
from ..solve import solve, solve_periodic
from .bar import Bar
from .files import check_outputs
from .kinds import expect
from .output import console as terminal
from .output import note, working
from .solve_options import waveform

Drive = tuple[str, str | None, str | None, float | None]
Files = tuple[Path | None, Path | None, Path | None, Path | None]  # figure, preview, ParaView, animation

FRAMES = 60  # of an animation whose times are not given


def run(
    geometry: Path | None,
    *,
    drive: Drive,
    sampling: tuple[bool, str, int],
    probes: tuple[str | None, tuple[str, ...]],
    errors: tuple[float, float],
    fields: tuple[str, ...],
    files: tuple[Path, *Files],
) -> dict[str, Any]:
    """Check everything that can be checked, then solve and write."""
    expect(geometry, "geometry")
    section = CrossSection.from_toml(geometry) if geometry else strip_ring()
    periodic, duration, samples = sampling
    wave = waveform(*drive)
    checks.between("--samples", samples, 2, 1_000_000)
    output, figure, preview_file, paraview, animation = files
    check_outputs(files, inputs=[geometry], images=[figure, preview_file])
    length = quantity.positive(duration, "s", name="--duration")
    field_times = _field_times(fields, length, wanted=bool(paraview or animation), periodic=periodic)
    heated, read = probes
    with working("meshing and assembling"):
        heat = assemble(section, errors[0])
    if preview_file:
        _draw_preview(section, heat.mesh, preview_file)
    wanted = read[0] if len(read) == 1 else read or None
    settings: dict[str, Any] = {"heated": heated, "read": wanted, "rtol": errors[1]}
    span = wave.period if periodic and wave.period else length
    with Bar(f"solving with {heat.unknowns} unknowns", span, periodic=periodic) as progress:
        if periodic:
            data = solve_periodic.record(heat, wave, samples, progress=progress, **settings)
        else:
            times = np.linspace(0, length, samples)
            data = solve.record(heat, wave, times, field_times=field_times, progress=progress, **settings)
    dataset.save(data, output)
    with working("drawing"):
        _draw(data, figure, paraview)
    if animation:
        _film(data, animation)
    source = data.attrs["heated"]
    pair = f"{wanted} heated by {source}" if isinstance(wanted, str) and wanted != source else source
    a, largest = data.attrs, float(data["delta_T"].values.max())
    note(
        f"R_th of {pair} = {a['thermal_resistance'] / 1e3:.4g} K/mW, largest rise {largest:.4g} K, "
        f"energy imbalance {a['heat_imbalance']:.0e}"
    )
    for path in files:
        if path:
            note(f"wrote {path}")
    return {
        "thermal_resistance": float(a["thermal_resistance"]),
        "largest_rise": largest,
        "unknowns": heat.unknowns,
        "heat_imbalance": a["heat_imbalance"],
        "heated": source,
        "read": wanted or source,
        "wrote": [path for path in files if path],
    }


def preview(geometry: Path | None, accuracy: float, path: Path) -> None:
    """Draw cross-section and mesh, and solve nothing."""
    expect(geometry, "geometry")
    section = CrossSection.from_toml(geometry) if geometry else strip_ring()
    check_outputs([path], inputs=[geometry], images=[path])
    with working("meshing"):
        mesh = mesh_for(section, accuracy)
    _draw_preview(section, mesh, path)
    note(f"{section.name}: {', '.join(mesh.region_names)}; {len(mesh.triangles)} triangles; wrote {path}")


def _field_times(texts: tuple[str, ...], duration: float, *, wanted: bool, periodic: bool) -> tuple[float, ...]:
    """Times at which the field is kept: those given ("1 us, 5 us"), or evenly spread ones where a film wants them."""
    given = [part.strip() for text in texts for part in text.split(",") if part.strip()]
    if periodic and (given or wanted):
        raise InputError("--periodic keeps no fields; leave out --field-times, --paraview and --animation, or it")
    if not given:
        return tuple(map(float, np.linspace(0, duration, FRAMES + 1)[1:])) if wanted else ()
    return tuple(sorted(quantity.parse(text, "s", name="--field-times") for text in given))


def _draw_preview(section: CrossSection, mesh: Mesh, path: Path) -> None:
    from .. import plot

    plot.save_figure(plot.plot_preview(section, mesh), path)


def _draw(data: Record, figure: Path | None, paraview: Path | None) -> None:
    """Write the picture and the field file that are wanted."""
    if paraview:
        write_fields(data.dataset(), paraview)
    if figure:
        from .. import plot

        plot.save_figure(plot.plot_response(data.dataset()), figure)


def _film(data: Record, path: Path) -> None:
    """Write the field as a film, with a bar over its frames."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from .. import plot

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=terminal()) as progress:
        bar = progress.add_task(f"drawing {path.name}")
        plot.animate_field(
            data.dataset(), path, on_frame=lambda at, total: progress.update(bar, completed=at + 1, total=total)
        )
