"""``thermofem family`` and ``calibrate``: one thermal model for many rings, and the ring that explains a trace."""

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

from . import options
from .console import bar, say, working, written


def family(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML) with ranges.")],
    output: options.Output = Path("family.npz"),
    tolerance: float = 1e-3,
    folder: Path | None = None,
    workers: options.Processes = 1,
    scheduler: str | None = None,
    power: options.Quantity = None,
    seed: options.Seed = 0,
) -> dict[str, Any]:
    """Train one thermal model for all rings in the ranges of a campaign.

    Options
    -------
    tolerance: Wanted relative error of R_th and of every step.
    folder: Keeps solved members; started again, training goes on from it.
    power: [W] Largest absorbed power, e.g. '2 mW'; for conductivities k(T).
    """
    import surrogate
    import thermofem as th

    from .inputs.command_files import expect
    from .results.heat_lines import note_cut
    from .results.model_card import family_lines, family_numbers

    expect(file, "campaign")
    with options.executor_of(context, scheduler, workers) as executor, bar("training") as progress:
        training: dict[str, Any] = {"seed": seed, "executor": executor, "folder": folder, "power": power}
        trained = surrogate.train_family(file, tolerance, **training, progress=progress)
    trained.save(output)
    for label, text in family_lines(trained):
        say(f"{label:>16} : {text}")
    with working("looking at the end of the domain"):
        middle = trained.box.geometry(trained.box.middle)
        domain_error = th.assemble(middle, tolerance).domain_error(trained.inputs[0])
    note_cut(domain_error, tolerance, "tolerance")
    return {"family": output, **family_numbers(trained), "domain_error": domain_error}


def calibrate(
    file: options.Family,
    data: Annotated[list[Path], typer.Argument(help="Measured or simulated thermal traces (netCDF).")],
    noise: str | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> dict[str, Any]:
    """Find the ring of a family that explains thermal traces best, with standard errors.

    Options
    -------
    noise: Standard deviation of a sample, e.g. '10 mK'; a number alone is in K.
    """
    import surrogate
    import thermofem as th
    from thermofem.data import quantity

    from .inputs.command_files import about, expect

    if noise is not None:
        with contextlib.suppress(ValueError):
            noise = f"{float(noise)!r} K"
    spread = None if noise is None else quantity.positive_rise(noise, name="--noise")
    expect(file, "family")
    trained = surrogate.load_family(file)
    for path in data:
        expect(path, "data")
    with working("fitting"), about(data):
        traces = [th.load(path) for path in data]
        result = surrogate.calibrate(trained, traces, noise=spread, heated=heated, read=read)
    channel = result.channel
    for name, unit in zip(trained.names, trained.box.units, strict=True):
        value, error = result.values[name], result.standard_errors[name]
        end = " (end of its range)" if name in result.active else ""
        say(f"{channel}: {name} = {written(value, unit, error)}{end}")
    noise = f"residual {result.residual:.3g} K rms, correlation of neighbouring residuals {result.correlation:.2f}"
    say(f"{channel}: {noise}")
    for text in result.unseen:
        say(f"{channel}: not determined by the data: {text}")
    say(f"{channel}: ± contains the noise only; on its own mesh the family is off by {result.certified.error:.1e}")
    return {
        "values": result.values,
        "standard_errors": result.standard_errors,
        "heated": channel.heated,
        "read": channel.read,
        "residual": result.residual,
        "correlation": result.correlation,
        "error": result.certified.error,
        "unseen": list(result.unseen),
        "active": list(result.active),
    }
