"""``thermofem fit``: training data or a measured table in, a compact model out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .console import note, parameter_unit, say, say_row, working, written

if TYPE_CHECKING:
    import xarray as xr

    import thermofem as th
    from surrogate.fitting.fit_result import Fit

FIT_KINDS = ("newton", "second-order", "foster", "spectrum", "sindy")


def fit(
    context: typer.Context,
    data: Annotated[list[Path], typer.Argument(help="Training data (netCDF), or a table of numbers.")],
    kind: str = "second-order",
    order: str | None = None,
    power: str | None = None,
    pulse: str | None = None,
    square: str | None = None,
    duty: float | None = None,
    time: str | None = None,
    temperature: str | None = None,
    sensitivity: str | None = None,
    start: str | None = None,
    columns: str | None = None,
    units: str | None = None,
    fall: bool = False,
    baseline: str | None = None,
    heated: str | None = None,
    read: str | None = None,
    readout: str | None = None,
    phase: options.Quantity = None,
    figure: Path | None = None,
    output: options.Output = Path("model.json"),
) -> dict[str, Any]:
    """Train a compact model on heat data or on a measured trace and write it as JSON.

    For a table (thermofem fit scope.csv --pulse "4 us" --power "1.3 mW") --power, --pulse or --square say what was
    applied. The offset is subtracted, the start of the heating is fitted, and what was assumed is printed.

    Options
    -------
    kind: newton, second-order, foster, spectrum or sindy.
    order: Number of poles of a Foster network; default auto: what noise allows.
    power: Absorbed power while a table was measured.
    time: Column with the time, e.g. 'X (us)'; of two the first.
    temperature: Column with the temperature or its voltage.
    sensitivity: Reading per kelvin of the thermometer, e.g. '10 mV/K' or '75 pm/K'.
    start: When the heating began, or the column of the drive; default: fitted.
    columns: Columns of time and temperature by number, e.g. 4,5.
    units: Units of the two columns, e.g. 'us,mV'.
    fall: The rows fall after a long heating, or that of --pulse.
    baseline: Temperature at rest; default: the mean before.
    heated: Part that was heated.
    read: Part that was read; picks one of several, and says of a table what it shows.
    readout: mzi: the trace is light behind an interferometer; gives bias and visibility.
    phase: [rad/K] Phase per kelvin of the interferometer, e.g. '0.05 rad/K'; without it R is in rad/W.
    """
    import surrogate
    import thermofem as th
    from thermofem import checks
    from thermofem.data import files

    from .inputs.command_files import about, kelvin_of
    from .inputs.training_files import read_channel, training_of

    checks.choice("--kind", kind, FIT_KINDS)
    mzi: th.MZI | None = None
    if readout is None:
        options.unused(context, "goes with --readout mzi", "phase")
    else:
        checks.choice("--readout", readout, ("mzi",))
        options.unused(context, "shows temperatures; with --readout there are none in the data", "figure")
        mzi = th.MZI(shift=1.0 if phase is None else phase)
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
        "figure": figure,
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
