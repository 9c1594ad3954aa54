"""``thermofem fit``: training data or a measured table in, a compact model out."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer
import xarray as xr

import surrogate
import thermofem as th
from thermofem import checks
from thermofem.data import files, quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import about, check_outputs, expect, in_volts, kind_of
from ..console import note, parameter_unit, say, working, written, wrote
from ..drive_texts import heating

KINDS = ("newton", "second-order", "foster", "spectrum", "sindy")
TRANSFER = "The table was measured on another part than the heated one (netCDF files already record this)."
TABLE = "a table of numbers"


def fit(
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
    start: Annotated[str | None, typer.Option(help="When the heating began; default: found in the trace.")] = None,
    columns: Annotated[str | None, typer.Option(help="Columns of time and temperature by number, e.g. 4,5.")] = None,
    units: Annotated[str | None, typer.Option(help="Units of the two columns, e.g. 'us,mV'.")] = None,
    fall: Annotated[
        bool, typer.Option("--fall", help="The rows fall after a long heating, or that of --pulse.")
    ] = False,
    transfer: Annotated[bool, typer.Option(help=TRANSFER)] = False,
    baseline: Annotated[str | None, typer.Option(help="Temperature at rest; default: the mean before.")] = None,
    heated: Annotated[str | None, typer.Option(help="Part that was heated.")] = None,
    read: Annotated[str | None, typer.Option(help="Part that was read; picks one of several.")] = None,
    readout: Annotated[
        str | None, typer.Option(help="mzi: the trace is light behind an interferometer; gives bias and visibility.")
    ] = None,
    phase: Annotated[
        str | None, typer.Option(help="Phase per kelvin of the interferometer, e.g. '0.05 rad/K'; default 1 rad/K.")
    ] = None,
    figure: options.Figure = None,
    output: options.Output = Path("model.json"),
) -> dict[str, Any]:
    """Train a compact model on heat data or on a measured trace and write it as JSON.

    For a table (thermofem fit scope.csv --pulse "4 us" --power "1.3 mW") --power, --pulse or --square say what was
    applied. The offset is subtracted, the start of the heating is found, and what was assumed is printed.
    """
    checks.choice("--kind", kind, KINDS)
    mzi = _interferometer(readout, phase)
    if mzi is not None:
        kind, order = "foster", order or "2"
        baseline, sensitivity = baseline or "0 K", sensitivity or "1 V/K"  # light has no rest to subtract
        if figure is not None:
            raise InputError("--figure shows temperatures; with --readout there are none in the data")
    if order is not None and kind != "foster":
        raise InputError(f"--order = {order} goes with --kind foster; {kind} has its own number of poles")
    check_outputs([output, figure], images=[figure], inputs=data)
    if figure is not None and len(data) > 1:
        raise InputError(f"--figure shows one file; {len(data)} are given")
    table: dict[str, Any] = {
        "columns": columns,
        "units": units,
        "time": time,
        "temperature": temperature,
        "sensitivity": sensitivity,
    }
    table |= {"start": start, "baseline": baseline, "fall": fall or None}
    drive = {"power": power, "pulse": pulse, "square": square, "duty": duty}
    training, assumed = _training(data, table, drive)
    with about(data):
        training = [_channel(path, one, heated, read, kind) for path, one in zip(data, training, strict=True)]
        if kind == "sindy":
            found = _sindy(training)
        else:
            with working("training"):
                found = _trained(kind, training, order, transfer or None, mzi)
    provenance = {**found.provenance, **({"assumed": assumed} if assumed else {})}
    surrogate.save_model(found.model, output, provenance=files.plain(provenance))
    _print(found, kind, "V" if in_volts(assumed) else "K")
    if figure is not None:
        _draw(found, training[0], figure)
    wrote(output, figure)
    return {
        "kind": kind,
        "parameters": dict(getattr(found, "parameters", {})),
        "standard_errors": dict(getattr(found, "standard_errors", {})),
        "thermal_resistance": found.model.thermal_resistance,
        "residual": found.residual,
        "relative_residual": found.relative_residual,
        "notes": list(getattr(found, "notes", ())),
        "assumed": assumed,
        "model": output,
    }


def _channel(path: Path, data: xr.Dataset, heated: str | None, read: str | None, kind: str) -> xr.Dataset:
    """Data of the part that --heated and --read name; a table, which names none, gets the names."""
    from thermofem.data import dataset

    if heated is None and read is None:
        return data
    if read is not None and kind == "sindy":
        raise InputError("--read picks one part; a SINDy network needs all that the file holds")
    if kind_of(path) == "table":
        return data.assign_attrs({k: v for k, v in (("heated", heated), ("read", read)) if v is not None})
    was = data.attrs.get("heated")
    if heated is not None and was is not None and heated != was:
        raise InputError(f"--heated = {heated!r}, but {path} says that {was!r} was heated")
    data = data if heated is None else data.assign_attrs(heated=heated)
    return data if read is None else dataset.at_probe(data, read)


def _draw(found: Any, data: xr.Dataset, path: Path) -> None:
    """Draw the trace, the model and their difference."""
    from surrogate.plot import plot_fit
    from thermofem.plot import save_figure

    save_figure(plot_fit(found, data.isel(probe=0) if "probe" in data.delta_T.dims else data)[0], path)


def _interferometer(readout: str | None, phase: str | None) -> th.MZI | None:
    """The read-out that --readout and --phase describe."""
    if readout is None:
        if phase is not None:
            raise InputError(f"--phase = {phase!r} goes with --readout mzi")
        return None
    checks.choice("--readout", readout, ("mzi",))
    return th.MZI(shift=1.0 if phase is None else quantity.parse(phase, "rad/K", name="--phase"))


def _trained(
    kind: str, training: list[Any], order: str | None, transfer: bool | None, readout: th.MZI | None = None
) -> Any:

    if kind == "newton":
        return surrogate.fit_newton(training)
    if kind == "second-order":
        return surrogate.fit_second_order(training, transfer=transfer)
    if kind == "spectrum":
        return surrogate.fit_spectrum(training)
    poles = int(order) if order is not None and order.isdigit() else order or "auto"
    return surrogate.fit_foster(training, order=poles, transfer=transfer, readout=readout)


def _sindy(training: list[xr.Dataset]) -> Any:
    """Identify a SINDy network of the core and the shells around it."""
    if len(training) > 1:
        raise InputError(f"{len(training)} files: a SINDy network is identified from one transient from rest")
    with working("training"):
        return surrogate.fit_sindy(training[0])


def _training(paths: list[Path], columns: dict[str, Any], drive: dict[str, Any]) -> tuple[list[xr.Dataset], list[str]]:
    """Training data of every file, and what was assumed for tables."""
    for path in paths:
        expect(files.regular(path), "data", "table")
    tables = [path for path in paths if kind_of(path) == "table"]
    given = [f"--{name}" for name, value in {**drive, **columns}.items() if value is not None]
    if given and not tables:
        raise InputError(f"{', '.join(given)}: netCDF data say themselves what was applied; this is for {TABLE}")
    if not tables:
        return [th.load(path) for path in paths], []
    if drive["power"] is None:
        raise InputError(
            f'{tables[0]} holds {TABLE}: say what was applied, --power "1.3 mW" with --pulse "4 us" or --square; '
            "with a column of power, thermofem.read_trace makes training data of it"
        )
    wave = heating(drive["power"], drive["pulse"], drive["square"], drive["duty"])
    training: list[xr.Dataset] = []
    assumed: list[str] = []
    for path in paths:
        if path not in tables:
            training.append(th.load(path))
            continue
        with working(f"reading {path.name}"):
            trace = th.read_trace(path, wave, **columns)
        lines = trace.attrs["assumed"].splitlines()
        for line in lines:
            note(f"{path.name}: {line}")
        assumed += [f"{path.name}: {line}" for line in lines]
        training.append(trace)
    return training, assumed


def _print(found: Any, kind: str, kelvin: str) -> None:
    """Print the equations of a network, or parameters with errors; R_th; the misfit; undetermined time constants.

    kelvin: "K", or "V" where volts count as kelvin.
    """
    from surrogate.studies.inverse_search import rise_time

    for equation in getattr(found, "equations", ()):
        say(equation)
    rows = []
    if kind == "spectrum":
        for r, tau in zip(found.model.R, found.model.tau, strict=True):
            rows.append(("R", f"{written(float(r), 'K/W')} at tau = {written(float(tau), 's')}"))
    elif kind != "sindy":
        errors = found.standard_errors
        rows += [(name, written(value, parameter_unit(name), errors[name])) for name, value in found.parameters.items()]
    rows.append(("R_th", written(found.model.thermal_resistance, "K/W")))
    noise = {True: ", noise", False: ", more than noise", None: ""}[getattr(found, "misfit_is_noise", None)]
    rows.append(("misfit", f"{found.residual:.3g} K rms, {100 * found.relative_residual:.2g} % of the swing{noise}"))
    if hasattr(found.model, "R"):
        rows.append(("rise time (10-90 %)", written(rise_time(found.model), "s")))
    for name, text in rows:
        say(f"{name:>22} = {re.sub(r'K(?![a-z])', kelvin, text)}")
    for line in getattr(found, "notes", ()):
        say(f"{'note':>22} : {line}")
