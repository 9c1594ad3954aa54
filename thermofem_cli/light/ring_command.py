"""``thermofem ring``: geometry in, ring file out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from thermofem.data import files, quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import check_outputs, ring_of, section_of
from ..console import note, say, working, wrote
from .modes_command import wavelength_of


def ring(
    geometry: options.Geometry = None,
    wavelength: options.Wavelength = None,
    loss: Annotated[
        str | None, typer.Option(help="Power loss of the guide, which heats; default: that of [light], or 2 dB/cm.")
    ] = None,
    gap: Annotated[
        str | None, typer.Option(help="Gap to each bus, e.g. '250 nm'; default: the [[bus]] tables of the geometry.")
    ] = None,
    coupling: Annotated[
        float | None, typer.Option(help="Power that a bus takes in one pass, instead of --gap.")
    ] = None,
    straight: Annotated[str, typer.Option(help="Length of each of two straight sections.")] = "0 um",
    buses: Annotated[
        int | None, typer.Option(min=1, max=2, help="Number of buses; default: 2, or that of [[bus]] tables.")
    ] = None,
    base: Annotated[str | None, typer.Option(help="Ring that gives carriers and sigmas; default: by material.")] = None,
    mode: Annotated[
        str | None, typer.Option(help="Guided mode, such as TM0; default: that of [light], or TE0.")
    ] = None,
    output: options.Output = Path("ring.toml"),
) -> dict[str, Any]:
    """Compute the ring of one geometry, and write its file with the origin beside every number.

    ``thermofem simulate --ring`` takes it.
    """
    import coupled

    section = section_of(geometry)
    check_outputs([output], inputs=[geometry])
    if gap is None and coupling is None and not section.buses:
        raise InputError("--gap or --coupling is missing; give one of them, or [[bus]] with its gap in the geometry")
    length = wavelength_of(section, wavelength)
    if loss is None and (section.light is None or section.light.loss is None):
        loss = "2 dB/cm"
    with working("solving"):
        made = coupled.ring_from(
            section,
            wavelength=length,
            loss=None if loss is None else quantity.parse(loss, "1/m", name="--loss"),
            gap=None if gap is None else quantity.parse(gap, "m", name="--gap"),
            coupling=coupling,
            straight=quantity.parse(straight, "m", name="--straight"),
            buses=buses,
            base=None if base is None else ring_of(base),
            mode=mode,
        )
    files.write_whole(output, lambda path: path.write_text(made.to_toml(), encoding="utf-8"))
    found, names = made.ring, made.mode.light.names  # type: ignore[union-attr]
    if len(names) > 1:
        note(f"the guide holds {', '.join(names)}; {made.mode.name} is taken, --mode picks another")
    say(
        f"{found.name}: Q {found.loaded_q:.4g}, intrinsic Q {found.intrinsic_q:.4g}, n_g {found.group_index:.5g}, "
        f"V_2 {found.tpa_volume * 1e18:.4g} um^3, {made.mode.thermo_optic * length / 1e-12:.3g} pm/K"
    )
    say(f"bus: {made.origins['bus_rate']}")
    wrote(output)
    origins = {name: {"value": o.value, "origin": o.origin, "error": o.error} for name, o in made.origins.items()}
    return {"loaded_q": found.loaded_q, "intrinsic_q": found.intrinsic_q, "origins": origins, "wrote": [output]}
