"""``thermofem explore``: one HTML file that computes a ring in the browser."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options
from ..console import working


def explore(
    context: typer.Context,
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL.json... | GEOMETRY.toml | FAMILY.npz]", help="What heats; default: the reference strip."
        ),
    ] = None,
    ring: str = options.REFERENCE_RING,
    power: options.Quantity = None,
    detuning: str = "0 GHz",
    heated: str | None = None,
    read: str | None = None,
    heater: list[str] | None = None,
    accuracy: float = 1e-3,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write (HTML).")] = Path("ring.html"),
) -> dict[str, Any]:
    """Write a page that computes a ring: move the laser in a browser and see it pulse. One file, offline.

    A geometry is reduced, and Newton's law, the second-order equation and a Foster network are trained on it. Parts
    of a model that the light does not heat are heaters, each with a slider.

    Options
    -------
    power: [W] Power in the bus waveguide; default: 8 dBm, or the end of the plane next to it.
    """
    import coupled
    import surrogate
    from coupled.explore import Page
    from thermofem import InputError

    from ..inputs.command_files import kind_of, note_ring, ring_of
    from ..inputs.page_models import loaded_models, models_of_family, models_of_geometry
    from ..inputs.ring_drives import detuning_of, steady_heaters

    given = list(inputs or [])
    if output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--output = {output} must end in .html, so that a browser opens it")
    resonator = ring_of(ring)
    settings: dict[str, Any] = {
        "power": power,
        "detuning": detuning_of(detuning, resonator),
        "heaters": steady_heaters(heater),
        "heated": heated,
        "read": read,
    }
    kinds = {kind_of(path) for path in given}
    if len(given) > 1 and kinds & {"geometry", "family"}:
        raise InputError("explore takes one geometry or family alone, or models alone")
    if kinds & {"model", "family"}:
        options.unused(context, "is that of a geometry's mesh; models have none", "accuracy")
    if kinds == {"family"}:
        settings["family"] = surrogate.load_family(given[0])
        models = models_of_family(settings["family"])
    elif not given or kinds == {"geometry"}:
        models, settings["heat"] = models_of_geometry(given[0] if given else None, accuracy, heated, resonator.read)
    else:
        models = loaded_models(given, heated, read)
    with working("writing the page"):
        page: Page = coupled.explore(resonator, models, output, **settings)
    note_ring(resonator, ring)
    return {"page": output, "characters": len(page.html), "models": list(models), "detuning": settings["detuning"]}
