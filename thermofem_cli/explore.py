"""``thermofem explore``: one HTML file that computes a ring in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import files

from . import drives, options
from .detuning import HELP as DETUNING
from .detuning import detuning_of
from .files import DEFAULT_RING, check_outputs, ring_of, say_ring, working
from .kinds import expect, kind_of
from .output import note, say

if TYPE_CHECKING:
    from thermofem.fem import HeatProblem
    from thermofem.models import ThermalModel

POLES = 5  # of the trained Foster network


def explore(
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL.json... | GEOMETRY.toml | FAMILY.json]", help="What heats; default: the reference strip."
        ),
    ] = None,
    ring: options.Ring = DEFAULT_RING,
    power: Annotated[str, typer.Option(help="Power in the bus waveguide when the page opens.")] = "8 dBm",
    detuning: Annotated[str, typer.Option(help=DETUNING)] = "0 GHz",
    channel: options.Channel = None,
    heated: options.Heated = None,
    read: options.Read = None,
    heater: options.Heater = None,
    accuracy: options.GeometryAccuracy = 1e-3,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write (HTML).")] = Path("ring.html"),
) -> dict[str, Any]:
    """Write a page that computes a ring: move the laser in a browser and see it pulse. One file, offline.

    A geometry is reduced, and Newton's law, the second-order equation and a Foster network are trained on it. Parts
    of a model that the light does not heat are heaters, each with a slider.
    """
    import coupled
    from thermofem.data import quantity

    given = list(inputs or [])
    check_outputs([output])
    if output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--output = {output} must end in .html, so that a browser opens it")
    family = _family(given)
    for path in given if family is None else []:
        expect(path, "model", "geometry")
    powers, (light, seen) = drives.steady_heaters(heater or []), drives.channel(channel, heated, read)
    at_power = quantity.parse(power, "W", name="--power")
    resonator = ring_of(ring)
    at_detuning = detuning_of(detuning, resonator)
    say_ring(resonator, ring)
    models, heat = _models(given, accuracy, light) if family is None else (_beside(family), None)
    for model in (models or {}).values() if family is None and heat is None else ():
        for option, name, names in (("--heated", light, model.inputs), ("--read", seen, model.outputs)):
            if name is not None:
                checks.choice(option, name, names)
    with working("writing the page"):
        page = coupled.explore(
            resonator, models, output, power=at_power, detuning=at_detuning, heat=heat, family=family, heaters=powers,
            heated=light, read=seen,
        )  # fmt: skip
    say(f"wrote {output} ({len(page.html) / 1e3:.0f} kB); open it in a browser")
    return {"page": output, "characters": len(page.html), "models": list(models or {}), "detuning": at_detuning}


def _family(given: list[Path]) -> Any:
    """The family of geometries that is given, or None."""
    import zipfile

    # families are archives of arrays, models are text
    if len(given) != 1 or not zipfile.is_zipfile(files.regular(given[0])):
        return None
    from surrogate import load_family

    return load_family(given[0])


def _models(
    given: list[Path], accuracy: float, heated: str | None
) -> tuple[dict[str, ThermalModel], HeatProblem | None]:
    """The models of the page by name, and the heat problem behind them where a geometry is given."""
    from thermofem.models import load_model

    if given and all(kind_of(path) != "geometry" for path in given):
        names = [path.stem for path in given]
        checks.unique("MODELS", names, hint="models are named after the files")
        return {name: load_model(path) for name, path in zip(names, given, strict=True)}, None
    if len(given) > 1:
        raise InputError("explore takes one geometry alone, or models alone")
    return models_of_geometry(given[0] if given else None, accuracy, heated)


def _beside(family: Any) -> dict[str, Any]:
    """The paper's two laws for a family, trained on the member in the middle of its box."""
    middle = dict(zip(family.names, (family.box.low + family.box.high) / 2, strict=True))
    found = trained(family.model(**middle))
    return {f"{name}, of the middle": found[name] for name in ("second order", "Newton's law")}


def trained(exact: Any) -> dict[str, Any]:
    """The usual models, trained on the answers of a precise one."""
    import surrogate
    from surrogate.judging.ladder import training_data

    periodic, rise = training_data(exact, 2e-3, 1 / 3)
    return {
        f"Foster, {POLES} poles": surrogate.fit_foster(rise, POLES).model,
        "second order": surrogate.fit_second_order(periodic).model,
        "Newton's law": surrogate.fit_newton(periodic).model,
    }


def models_of_geometry(
    path: Path | None, accuracy: float = 1e-3, heated: str | None = None
) -> tuple[dict[str, Any], HeatProblem]:
    """The certified reduction of a geometry, and the usual models trained on it; all from one reduction."""
    import surrogate
    from coupled.explore.contents import HEATERS
    from thermofem.fem import assemble
    from thermofem.geometry import CrossSection, strip_ring

    section = CrossSection.from_toml(path) if path else strip_ring()
    with working("meshing, assembling, reducing and training"):
        heat = assemble(section, accuracy)
        ring = checks.choice("--heated", heated or heat.heated[0], heat.heated)
        others = [name for name in heat.heated if name != ring]
        if len(others) > HEATERS:
            note(f"of the heated parts, {', '.join(others[HEATERS:])} get no slider: the page has room for {HEATERS}")
        rom = surrogate.reduce(heat.channels((ring, *others[:HEATERS]), ring), tolerance=1e-4)
        whole: Any = rom.model
        exact: Any = whole.channel(ring, ring).dynamics if others else whole
        models = {f"certified reduction, {rom.order} poles": rom, **trained(exact)}
    return models, heat
