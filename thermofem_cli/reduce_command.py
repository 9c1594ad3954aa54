"""``thermofem reduce``: geometry in, certified reduced model out."""

from pathlib import Path
from typing import Any

import typer

from . import options
from .console import say, working, written


def reduce(
    context: typer.Context,
    geometry: options.Geometry = None,
    tolerance: float = 1e-4,
    accuracy: float = 1e-3,
    mesh: Path | None = None,
    heated: str | None = None,
    read: str | None = None,
    positions: Path | None = None,
    output: options.Output = Path("model.json"),
) -> dict[str, Any]:
    """Reduce the FEM of a geometry to a certified handful of poles and write them as JSON.

    Options
    -------
    tolerance: Error of Z(f) over R_th, kept at every frequency.
    heated: Inputs, the ring first: 'core, heater'; default: the ring.
    read: Outputs: 'core, neighbour', parts, probes, light; default: the first input, with [light] the light, too.
    positions: Centres of many such rings: a table 'x (um),y (um)'; makes an array.
    """
    import surrogate
    import thermofem as th
    from surrogate.studies.inverse_search import channel_steps
    from thermofem import checks
    from thermofem.geometry.section_parts import LIGHT

    from .inputs.command_files import kind_of, section_of
    from .results.heat_lines import note_cut
    from .results.racetracks import reduced_racetrack
    from .results.reductions import over_channels, reduced_array, reduced_layout

    if positions is not None:
        options.unused(context, "has no effect with --positions: every ring of an array is read", "read")
    if geometry is not None and kind_of(geometry) == "layout":
        why = "has no effect on a layout: its shapes are heated and read"
        options.unused(context, why, "heated", "read", "positions", "accuracy", "mesh")
        return reduced_layout(geometry, tolerance, output)
    section = section_of(geometry)
    if section.straight:
        options.unused(
            context, "has no effect on a racetrack, whose section gets a mesh for --tolerance", "accuracy", "mesh"
        )
        return reduced_racetrack(section, tolerance, options.listed(heated), options.listed(read), positions, output)
    with working("meshing, assembling and reducing"):
        heat = th.assemble(section, accuracy, mesh=mesh)
        names = options.listed(heated) or [heat.heated[0]]
        for name in names:
            checks.choice("--heated", name, heat.heated)
        light = [LIGHT] if LIGHT in heat.readable else []
        outputs = options.listed(read) or [*names[:1], *light]
        for name in outputs:
            checks.choice("--read", name, heat.readable)
        if positions is not None:
            return reduced_array(heat, positions, tolerance, names, output)
        rom = surrogate.reduce(heat.channels(names, outputs), tolerance=tolerance)
        domain_error = heat.domain_error(names[0])
    provenance = {**rom.provenance, "geometry": section.to_toml(), "mesh_accuracy": accuracy}
    surrogate.save_model(rom.model, output, provenance=provenance)
    say(f"{heat.unknowns} unknowns -> {rom.order} poles, error of Z(f) below {rom.error_bound:.1e} of R_th everywhere")
    rows = channel_steps(rom.model) or []
    for row in rows:
        of = "" if len(rows) == 1 else f" from {row['heated']} to {row['read']}"
        say(f"R_th = {row['thermal_resistance'] / 1e3:.4g} K/mW{of}, rise 10-90 % in {written(row['rise_time'], 's')}")
    note_cut(domain_error, accuracy)
    return {
        "unknowns": heat.unknowns,
        "poles": rom.order,
        "error_bound": rom.error_bound,
        "domain_error": domain_error,
        "heated": names,
        "read": outputs,
        "thermal_resistance": over_channels(rows, names, outputs, "thermal_resistance"),
        "rise_time": over_channels(rows, names, outputs, "rise_time"),
        "model": output,
    }
