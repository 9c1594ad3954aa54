"""``thermofem fit``: training data or a measured table in, a compact model out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .console import note, parameter_unit, say, say_row, working, written, wrote

if TYPE_CHECKING:
    import xarray as xr

    import thermofem as th
    from surrogate.fitting.fit_result import Fit

FIT_KINDS = ("newton", "second-order", "foster", "spectrum", "sindy")


def fit(
    context: typer.Context,
    data: Annotated[list[Path], typer.Argument(help="Training data (netCDF), or a table of numbers.")],
    kind: Annotated[str, typer.Option(help="newton, second-order, foster, spectrum or sindy.")] = "second-order",
    order: Annotated[
        str | None, typer.Option(help="Number of poles of a Foster network; default auto: what noise allows.")
    ] = None,
    power: Annotated[str | None, typer.Option(help="Absorbed power while a table was measured.")] = None,
    pulse: options.Pulse = None,
    square: options.Square = None,
    duty: options.Duty = None,
    time: Annotated[str | None, typer.Option(help="Column with the time, e.g. 'X (us)'; of two the first.")] = None,
    temperature: Annotated[str | None, typer.Option(help="Column with the temperature or its voltage.")] = None,
    sensitivity: Annotated[
        str | None, typer.Option(help="Reading per kelvin of the thermometer, e.g. '10 mV/K' or '75 pm/K'.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="When the heating began, or the column of the drive; default: fitted.")
    ] = None,
    columns: Annotated[str | None, typer.Option(help="Columns of time and temperature by number, e.g. 4,5.")] = None,
    units: Annotated[str | None, typer.Option(help="Units of the two columns, e.g. 'us,mV'.")] = None,
    fall: Annotated[
        bool, typer.Option("--fall", help="The rows fall after a long heating, or that of --pulse.")
    ] = False,
    baseline: Annotated[str | None, typer.Option(help="Temperature at rest; default: the mean before.")] = None,
    heated: Annotated[str | None, typer.Option(help="Part that was heated.")] = None,
    read: Annotated[
        str | None, typer.Option(help="Part that was read; picks one of several, and says of a table what it shows.")
    ] = None,
    readout: Annotated[
        str | None, typer.Option(help="mzi: the trace is light behind an interferometer; gives bias and visibility.")
    ] = None,
    phase: Annotated[
        str | None,
        typer.Option(help="Phase per kelvin of the interferometer, e.g. '0.05 rad/K'; without it R is in rad/W."),
    ] = None,
    figure: options.Figure = None,
    output: options.Output = Path("model.json"),
) -> dict[str, Any]:
    """Train a compact model on heat data or on a measured trace and write it as JSON.

    For a table (thermofem fit scope.csv --pulse "4 us" --power "1.3 mW") --power, --pulse or --square say what was
    applied. The offset is subtracted, the start of the heating is fitted, and what was assumed is printed.
    """
    import surrogate
    import thermofem as th
    from thermofem import checks
    from thermofem.data import files, quantity

    from .inputs.command_files import about, check_outputs, kelvin_of
    from .inputs.training_files import read_channel, training_of

    checks.choice("--kind", kind, FIT_KINDS)
    mzi: th.MZI | None = None
    if readout is None:
        options.unused(context, "goes with --readout mzi", "phase")
    else:
        checks.choice("--readout", readout, ("mzi",))
        options.unused(context, "shows temperatures; with --readout there are none in the data", "figure")
        mzi = th.MZI(shift=1.0 if phase is None else quantity.parse(phase, "rad/K", name="--phase"))
        options.unused(context, "is of temperatures; with --readout the trace is light", "baseline", "sensitivity")
        kind = "foster"
    if kind != "foster":
        options.unused(context, f"goes with --kind foster; {kind} has its own number of poles", "order")
    if kind == "sindy":
        options.unused(context, "picks one part; a SINDy network needs all that the file holds", "read")
    if len(data) > 1:
        if kind == "sindy":
            options.unused(context, f"takes one transient from rest, not {len(data)} files", "kind")
        options.unused(context, f"shows one file; {len(data)} are given", "figure")
    check_outputs([output, figure], images=[figure], inputs=data)
    read_as: dict[str, Any] = {"columns": columns, "units": units, "time": time, "temperature": temperature}
    read_as |= {"sensitivity": sensitivity, "start": start, "baseline": baseline, "fall": fall}
    read_as |= {"heated": heated, "read": read, "light": mzi is not None}
    training, assumed = training_of(context, data, read_as)
    if mzi is not None and phase is None:
        assumed.append("no --phase is given: 1 rad counts as 1 K, so R and R_th are in rad/W")
        note(f"warning: {assumed[-1]}")
    with about(data):
        training = [read_channel(path, dataset, heated, read) for path, dataset in zip(data, training, strict=True)]
        with working("training"):
            fitted = _trained(kind, training, order, mzi)
    provenance = {**fitted.provenance, **({"assumed": assumed} if assumed else {})}
    surrogate.save_model(fitted.model, output, provenance=files.plain(provenance))
    _print(fitted, kind, kelvin_of(assumed))
    if figure is not None:
        _draw(fitted, training[0], figure)
    wrote(output, figure)
    return {
        "kind": kind,
        "parameters": fitted.parameters,
        "standard_errors": fitted.standard_errors,
        "thermal_resistance": fitted.model.thermal_resistance,
        "thermal_resistance_deviation": fitted.thermal_resistance_deviation,
        "residual": fitted.residual,
        "relative_residual": fitted.relative_residual,
        "notes": fitted.notes,
        "assumed": assumed,
        "model": output,
    }


def _draw(fitted: Any, data: xr.Dataset, path: Path) -> None:
    """Draw the trace, the model and their difference."""
    from surrogate.plot import plot_fit
    from thermofem.plot import save_figure

    save_figure(plot_fit(fitted, data.isel(probe=0) if "probe" in data.delta_T.dims else data)[0], path)


def _trained(kind: str, training: list[Any], order: str | None, readout: th.MZI | None) -> Any:
    """Return the fit of a kind of model; "sindy" gives a network of the core and the shells around it."""
    import surrogate

    if kind == "newton":
        return surrogate.fit_newton(training)
    if kind == "second-order":
        return surrogate.fit_second_order(training)
    if kind == "spectrum":
        return surrogate.fit_spectrum(training)
    if kind == "sindy":
        return surrogate.fit_sindy(training[0])
    poles = int(order) if order is not None and order.isdigit() else order or "auto"
    return surrogate.fit_foster(training, order=poles, readout=readout)


def _print(fitted: Fit, kind: str, kelvin: str) -> None:
    """Print the equations of a network, or parameters with errors; R_th; the misfit; undetermined time constants.

    kelvin: "K", or the unit that counts as kelvin, "V" or "rad".
    """
    from surrogate.studies.inverse_search import rise_time

    for equation in fitted.equations:
        say(equation)
    rows = []
    model: Any = fitted.model
    if kind == "spectrum":
        for r, tau in zip(model.R, model.tau, strict=True):
            rows.append(("R", f"{written(float(r), 'K/W')} at tau = {written(float(tau), 's')}"))
    elif not fitted.equations:
        errors = fitted.standard_errors
        units = {name: parameter_unit(name) for name in fitted.parameters}
        units |= {"half_power": fitted.residual_unit, "bias": "rad"}
        rows += [(name, written(value, units[name], errors[name])) for name, value in fitted.parameters.items()]
    rows.append(("R_th", written(model.thermal_resistance, "K/W", fitted.thermal_resistance_deviation)))
    noise = {True: ", noise", False: ", systematic", None: ""}[fitted.misfit_is_noise]
    size = f"{fitted.residual:.3g} {fitted.residual_unit}".rstrip()
    rows.append(("misfit", f"{size} rms, {100 * fitted.relative_residual:.2g} % of the swing{noise}"))
    if not fitted.equations:
        rows.append(("rise time (10-90 %)", written(rise_time(model), "s")))
    for name, text in rows:
        say_row(name, re.sub(r"K(?![a-z])", kelvin, text))
    for line in fitted.notes:
        say_row("note", line, ":")
