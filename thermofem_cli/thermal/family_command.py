"""``thermofem family``: one thermal model for many rings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from thermofem.data import quantity

from .. import options
from ..command_files import check_outputs, expect
from ..console import say, working, wrote


def family(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML) with ranges.")],
    output: options.Output = Path("family.json"),
    tolerance: Annotated[float, typer.Option(help="Wanted relative error of R_th and of every step.")] = 1e-3,
    folder: Annotated[
        Path | None, typer.Option(help="Keeps solved members; started again, training goes on from it.")
    ] = None,
    workers: options.Processes = 1,
    scheduler: options.Scheduler = None,
    power: Annotated[
        str | None, typer.Option(help="Largest absorbed power, e.g. '2 mW'; for conductivities k(T).")
    ] = None,
    seed: options.Seed = 0,
) -> dict[str, Any]:
    """Train one thermal model for all rings in the ranges of a campaign."""
    import surrogate

    check_outputs([output], inputs=[file])
    expect(file, "campaign")
    hot = None if power is None else quantity.parse(power, "W", name="--power")
    with options.executor_of(scheduler, workers if workers > 1 else None) as executor, working("training"):
        found = surrogate.train_family(file, tolerance, seed=seed, executor=executor, folder=folder, power=hot)
    found.save(output)
    error = {"worst": found.error.worst, "median": found.error.median, "count": found.error.count}
    say(
        f"{found.size} functions ({found.engine}); error over {error['count']} rings not seen: "
        f"worst {error['worst']:.1e}, median {error['median']:.1e}"
    )
    if found.output_maps is not None:
        say(f"k(T) up to {quantity.write(found.output_maps.power, 'W')}: error {found.output_maps.error:.1e}")
    own = found.optics
    if own is not None:
        say(f"light of {own.solved} rings; error over rings left out: {own.words()}")
    wrote(output)
    return {
        "family": output,
        "functions": found.size,
        "engine": found.engine,
        "error": error,
        "error_hot": None if found.output_maps is None else found.output_maps.error,
        "error_optics": None if own is None else own.error,
        "ranges": {name: list(map(float, ends)) for name, ends in found.ranges.items()},
    }
