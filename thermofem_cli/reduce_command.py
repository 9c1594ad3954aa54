"""``thermofem reduce``: geometry in, certified reduced model out."""

from pathlib import Path
from typing import Any

import typer

from . import options
from .console import working


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
    from thermofem import InputError, checks
    from thermofem.geometry.section_parts import LIGHT

    from .inputs.command_files import kind_of, section_of
    from .results.heat_lines import note_cut
    from .results.reductions import reduced_array, reduced_layout, reduced_racetrack, written_channels

    if positions is not None:
        options.unused(context, "has no effect with --positions: every ring of an array is read", "read")
    if geometry is not None and kind_of(geometry) == "layout":
        why = "has no effect on a layout: its shapes are heated and read"
        options.unused(context, why, "heated", "read", "positions", "accuracy", "mesh")
        return reduced_layout(geometry, tolerance, output)
    section = section_of(geometry)
    names = options.listed(heated) or [section.heated[0]]
    light = [] if section.light is None else [LIGHT]
    outputs = options.listed(read) or [*names[:1], *light]
    if section.straight:
        why = "has no effect on a racetrack, whose section gets a mesh for --tolerance"
        options.unused(context, why, "accuracy", "mesh")
        if positions is not None:
            hint = "an array of racetracks is a layout, with a table [[shape]] for each"
            raise InputError(f"--positions: {section.name!r} is a racetrack", hint)
        return reduced_racetrack(section, tolerance, names, outputs, output)
    with working("meshing, assembling and reducing"):
        heat = th.assemble(section, accuracy, mesh=mesh)
        for name in names:
            checks.choice("--heated", name, heat.heated)
        for name in outputs:
            checks.choice("--read", name, heat.readable)
        if positions is not None:
            return reduced_array(heat, positions, tolerance, names, output)
        rom = surrogate.reduce(heat.channels(names, outputs), tolerance=tolerance)
        domain_error = heat.domain_error(names[0])
    numbers = written_channels(rom.model, f"{heat.unknowns} unknowns -> {rom.order} poles", output)
    note_cut(domain_error, accuracy)
    return {"unknowns": heat.unknowns, "domain_error": domain_error, **numbers}
