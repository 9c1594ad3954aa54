"""Thermal models of the page that ``explore`` writes: from files, from a family, from a geometry."""

from pathlib import Path
from typing import Any

import surrogate
import thermofem as th
from thermofem import checks
from thermofem.ring_temperature import CORE, detuning_output

from ..console import note, working
from .command_files import check_channel, expect, section_of


def loaded_models(paths: list[Path], heated: str | None, read: str | None) -> dict[str, th.models.ThermalModel]:
    """Return the thermal models in files, by file name."""
    for path in paths:
        expect(path, "model", "geometry")
    names = [path.stem for path in paths]
    checks.unique("MODELS", names, hint="models are named after the files")
    models = {name: surrogate.load_model(path) for name, path in zip(names, paths, strict=True)}
    for model in models.values():
        check_channel(model, heated, read)
    return models


def models_of_family(family: Any) -> dict[str, Any]:
    """Return the second-order model and Newton's law, trained on the family's member in the middle of its ranges."""
    from surrogate.judging.ladder import fit_usual

    middle = family.box.named((family.box.low + family.box.high) / 2)
    models = fit_usual(family.model(**middle))
    return {f"{name}, of the middle": models[name] for name in ("second order", "Newton's law")}


def models_of_geometry(
    path: Path | None, accuracy: float = 1e-3, heated: str | None = None, wanted: str = CORE
) -> tuple[dict[str, Any], th.fem.HeatProblem]:
    """Return the certified reduction of a geometry and models trained on it, by name, and the heat problem.

    wanted: the temperature that the ring reads, "core" or "light".
    """
    from coupled.explore.contents import MOST_HEATERS
    from surrogate.judging.ladder import fit_usual

    section = section_of(path)
    with working("meshing, assembling, reducing and training"):
        heat = th.assemble(section, accuracy)
        ring = checks.choice("--heated", heated or heat.heated[0], heat.heated)
        others = [name for name in heat.heated if name != ring]
        if len(others) > MOST_HEATERS:
            hidden = ", ".join(others[MOST_HEATERS:])
            note(f"of the heated parts, {hidden} get no slider: the page has room for {MOST_HEATERS}")
        read = detuning_output(wanted, ring, heat.system.outputs)
        rom = surrogate.reduce(heat.channels((ring, *others[:MOST_HEATERS]), read), tolerance=1e-4)
        whole: Any = rom.model
        exact: Any = whole.channel(ring, read).dynamics if others else whole
        models = {f"certified reduction, {rom.order} poles": rom, **fit_usual(exact)}
    return models, heat
