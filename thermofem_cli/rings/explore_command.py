"""``thermofem explore``: one HTML file that computes a ring in the browser."""

from pathlib import Path
from typing import Annotated, Any

import typer

import coupled
import surrogate
import thermofem as th
from coupled.explore import Page
from thermofem import InputError, checks
from thermofem.data import quantity
from thermofem.ring_temperature import CORE, detuning_output

from .. import options
from ..console import note, working, wrote
from ..inputs.command_files import check_outputs, expect, kind_of, note_ring, ring_of, section_of
from ..inputs.drive_texts import detuning_of, steady_heaters


def explore(
    context: typer.Context,
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL.json... | GEOMETRY.toml | FAMILY.json]", help="What heats; default: the reference strip."
        ),
    ] = None,
    ring: options.Ring = options.REFERENCE_RING,
    power: Annotated[
        str | None, typer.Option(help="Power in the bus waveguide; default: 8 dBm, or the end of the plane next to it.")
    ] = None,
    detuning: options.Detuning = "0 GHz",
    heated: options.Heated = None,
    read: options.Read = None,
    heater: options.Heater = None,
    accuracy: options.Accuracy = 1e-3,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write (HTML).")] = Path("ring.html"),
) -> dict[str, Any]:
    """Write a page that computes a ring: move the laser in a browser and see it pulse. One file, offline.

    A geometry is reduced, and Newton's law, the second-order equation and a Foster network are trained on it. Parts
    of a model that the light does not heat are heaters, each with a slider.
    """
    given = list(inputs or [])
    check_outputs([output], inputs=[*given, ring])
    if output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--output = {output} must end in .html, so that a browser opens it")
    resonator = ring_of(ring)
    settings: dict[str, Any] = {
        "power": None if power is None else quantity.parse(power, "W", name="--power"),
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
        models = _beside(settings["family"])
    elif not given or kinds == {"geometry"}:
        models, settings["heat"] = models_of_geometry(given[0] if given else None, accuracy, heated, resonator.read)
    else:
        models = _loaded(given, heated, read)
    with working("writing the page"):
        page: Page = coupled.explore(resonator, models, output, **settings)
    note_ring(resonator, ring)
    wrote(output)
    return {"page": output, "characters": len(page.html), "models": list(models), "detuning": settings["detuning"]}


def _loaded(paths: list[Path], heated: str | None, read: str | None) -> dict[str, th.models.ThermalModel]:
    """Return the thermal models in files, by file name."""
    for path in paths:
        expect(path, "model", "geometry")
    names = [path.stem for path in paths]
    checks.unique("MODELS", names, hint="models are named after the files")
    models = {name: surrogate.load_model(path) for name, path in zip(names, paths, strict=True)}
    for model in models.values():
        for option, part, parts in (("--heated", heated, model.inputs), ("--read", read, model.outputs)):
            if part is not None:
                checks.choice(option, part, parts)
    return models


def _beside(family: Any) -> dict[str, Any]:
    """Return the second-order model and Newton's law, trained on the family's member in the middle of its ranges."""
    from surrogate.judging.ladder import fit_usual

    middle = dict(zip(family.names, (family.box.low + family.box.high) / 2, strict=True))
    found = fit_usual(family.model(**middle))
    return {f"{name}, of the middle": found[name] for name in ("second order", "Newton's law")}


def models_of_geometry(
    path: Path | None, accuracy: float = 1e-3, heated: str | None = None, wanted: str = CORE
) -> tuple[dict[str, Any], th.fem.HeatProblem]:
    """Return the certified reduction of a geometry and models trained on it, by name, and the heat problem.

    wanted: the temperature that the ring reads, "core" or "light".
    """
    from coupled.explore.contents import HEATERS
    from surrogate.judging.ladder import fit_usual

    section = section_of(path)
    with working("meshing, assembling, reducing and training"):
        heat = th.assemble(section, accuracy)
        ring = checks.choice("--heated", heated or heat.heated[0], heat.heated)
        others = [name for name in heat.heated if name != ring]
        if len(others) > HEATERS:
            note(f"of the heated parts, {', '.join(others[HEATERS:])} get no slider: the page has room for {HEATERS}")
        read = detuning_output(wanted, ring, heat.system.outputs)
        rom = surrogate.reduce(heat.channels((ring, *others[:HEATERS]), read), tolerance=1e-4)
        whole: Any = rom.model
        exact: Any = whole.channel(ring, read).dynamics if others else whole
        models = {f"certified reduction, {rom.order} poles": rom, **fit_usual(exact)}
    return models, heat
