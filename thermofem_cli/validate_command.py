"""``thermofem validate``: over which periods, and up to which power, models of a ring can be trusted."""

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options


def validate(
    context: typer.Context,
    inputs: Annotated[list[Path], typer.Argument(metavar="GEOMETRY.toml | MODELS.json...", help="What to judge.")],
    reference: Path | None = None,
    power: options.Quantity = "2 mW",
    duty: float = 1 / 3,
    shortest: options.Quantity = "0.1 us",
    longest: options.Quantity = "10 us",
    accuracy: float = 1e-3,
    heated: str | None = None,
    read: str | None = None,
    ring: Annotated[str | None, typer.Option(help=f"Adds the periods of this ring: {options.RING}")] = None,
    figure: Path | None = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Curves (.nc) or the figure (.png).")] = None,
) -> dict[str, Any]:
    """Judge models by their period error (Section 6 of the paper): over which periods can each be trusted?

    Given a geometry, the usual kinds of model are trained on it and judged by its FEM, with k(T) at the power asked;
    given models, those. The square wave knows nothing of a ring's Q; with --ring the ring itself is solved with the
    reference and with each model, and its periods join the curve (Fig. 7).

    Options
    -------
    reference: What models are judged by: a model (JSON).
    power: [W > 0] Power of the square wave.
    duty: Its duty cycle.
    shortest: [s > 0] Shortest period.
    longest: [s > 0] Longest period.
    """
    import numpy as np
    import xarray as xr

    import thermofem as th
    from thermofem import InputError, checks
    from thermofem.data.files import IMAGES

    from .inputs.command_files import ring_of
    from .results.period_errors import (
        draw_errors,
        judged_geometry,
        judged_models,
        model_numbers,
        point_numbers,
        ring_points,
        with_points,
    )

    checks.ordered("--shortest", shortest, "--longest", longest, unit="s")
    wave = {"periods": np.geomspace(shortest, longest, 41), "power": power, "duty": duty}
    image = output is not None and output.suffix.lower() in IMAGES
    figures = [path for path in (figure, output if image else None) if path]
    curves = None if image else output
    geometry = any(path.suffix.lower() == ".toml" for path in inputs)
    if geometry and (len(inputs) > 1 or reference):
        raise InputError("validate takes one geometry alone; models with --reference, without a geometry")
    if geometry and not (figures or curves):
        figures = [Path("period_error.png")]
    if not geometry:
        options.unused(context, "is that of a geometry's mesh; models have none", "accuracy")
        curves = curves if output else Path("period_error.nc")
    resonator = None if ring is None else ring_of(ring)
    more: dict[str, Any] = {}
    title = ""
    if geometry:
        judged, title, more = judged_geometry(inputs[0], accuracy, heated, read, wave)
    else:
        judged = judged_models(inputs, reference, heated, read, wave)
    found = judged.curves
    points = {} if resonator is None else ring_points(resonator, judged)
    for picture in figures:
        draw_errors(found, points, picture, title)
    if curves:
        joined = xr.concat(list(found.values()), dim="model", combine_attrs="drop_conflicts")
        joined = joined.assign_coords(model=list(found))
        th.save(with_points(joined, points) if points else joined, curves)
    if resonator is not None:
        more |= {"ring": {name: point_numbers(each) for name, each in points.items()}}
    return {
        "models": {name: model_numbers(curve) for name, curve in found.items()},
        **more,
        "figures": figures,
        "curves": curves,
    }
