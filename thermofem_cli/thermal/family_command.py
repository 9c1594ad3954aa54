"""``thermofem family``, ``calibrate`` and ``design``: one thermal model for many rings, and the ring that fits."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

import surrogate
import thermofem as th
from thermofem.data import quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import about, check_outputs, expect, kind_of
from ..console import note, say, working, written, wrote
from ..drive_texts import detuning_of
from .family_options import PulsingRange, Settled, fixed_of, optics_of, ring_for, units_of


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


def calibrate(
    file: options.Family,
    data: Annotated[list[Path], typer.Argument(help="Measured or simulated thermal traces (netCDF).")],
    noise: Annotated[
        str | None, typer.Option(help="Standard deviation of a sample, e.g. '10 mK'; a number alone is in K.")
    ] = None,
) -> dict[str, Any]:
    """Find the ring of a family that explains thermal traces best, with standard errors."""
    spread = None if noise is None else _noise(noise)
    found = surrogate.load_family(file)
    for path in data:
        if kind_of(path) == "table":
            raise InputError(
                f"{path} holds a table of numbers, not data (netCDF); convert it in Python: "
                f"thermofem.save(thermofem.read_trace({str(path)!r}, ...), {str(path.with_suffix('.nc'))!r})"
            )
        expect(path, "data")
    with working("fitting"), about(data):
        result = surrogate.calibrate(found, [th.load(path) for path in data], noise=spread)
    for name, unit in units_of(found).items():
        value, error = result.values[name], result.standard_errors[name]
        say(f"{name} = {written(value, unit, error)}" + (" (end of its range)" if name in result.active else ""))
    say(f"residual {result.residual:.3g} K rms, correlation of neighbouring residuals {result.correlation:.2f}")
    for text in result.unseen:
        say(f"not determined by the data: {text}")
    say(f"± contains the noise only; on its own mesh the family is off by {result.certified.error:.1e}")
    return {
        "values": result.values,
        "standard_errors": result.standard_errors,
        "residual": result.residual,
        "correlation": result.correlation,
        "error": result.certified.error,
        "unseen": list(result.unseen),
        "active": list(result.active),
    }


def _noise(text: str) -> float:
    """--noise in K: a quantity, or a number alone."""
    with contextlib.suppress(ValueError):
        text = f"{float(text)!r} K"
    return quantity.positive_rise(text, name="--noise")


def design(
    context: typer.Context,
    file: options.Family,
    resistance: Annotated[str | None, typer.Option(help="Thermal resistance, e.g. '9000 K/W'.")] = None,
    rise_time: Annotated[str | None, typer.Option(help="10 to 90 % after a step, e.g. '2 us'.")] = None,
    period: Annotated[str | None, typer.Option(help="Settled period of self-pulsing, e.g. '900 ns'.")] = None,
    swing: Annotated[str | None, typer.Option(help="Temperature swing of the settled cycle, e.g. '6 K'.")] = None,
    range_: Annotated[
        str | None, typer.Option("--range", help="Range of self-pulsing in detuning at --power, e.g. '30 GHz'.")
    ] = None,
    fix: options.Fix = None,
    optics: options.Optics = None,
    ring: options.FamilyRing = options.REFERENCE_RING,
    power: options.FamilyPower = "8 dBm",
    detuning: options.FamilyDetuning = "0 GHz",
    workers: options.Processes = 1,
    scheduler: options.Scheduler = None,
    seed: options.Seed = 0,
) -> dict[str, Any]:
    """Find the ring of a family with wanted properties; several that exclude each other give a Pareto front."""
    if not (period or swing or range_):
        options.unused(context, "goes with --period, --swing or --range", "power", "detuning", "optics", "ring")
    found = surrogate.load_family(file)
    resonator: Any = None
    drive: tuple[Any, ...] = ()
    if period or swing or range_:
        resonator = ring_for(found, ring)
        drive = resonator, quantity.parse(power, "W", name="--power"), detuning_of(detuning, resonator)
    asked: list[tuple[str, str | None, str, Callable[[], Any]]] = [
        ("--resistance", resistance, "K/W", lambda: "thermal_resistance"),
        ("--rise-time", rise_time, "s", lambda: "rise_time"),
        ("--period", period, "s", lambda: Settled("period", *drive)),
        ("--swing", swing, "K", lambda: Settled("swing", *drive)),
        ("--range", range_, "Hz", lambda: PulsingRange(*drive[:2])),
    ]
    target = {make(): _wanted(text, unit, option) for option, text, unit, make in asked if text is not None}
    if not target:
        raise InputError("nothing is wanted; add --resistance, --rise-time, --period, --swing or --range")
    fixed = fixed_of(found, fix)
    if set(fixed) == set(found.names):
        raise InputError("every parameter is fixed; remove one --fix")
    moving = optics_of(found, optics, resonator) if drive else None
    settings: dict[str, Any] = {"fixed": fixed, "optics": moving, "seed": seed}
    with options.executor_of(scheduler, workers if workers > 1 else None) as executor, working("searching"):
        result = surrogate.design(found, target=target, executor=executor, **settings)
    units = units_of(found) | dict(zip(result.achieved, (unit for _, text, unit, _ in asked if text), strict=True))
    say("reached" if result.reached else "no member that was looked at does that; the nearest one:")
    for name, wanted in zip(result.achieved, target.values(), strict=True):
        say(f"{name} = {written(result.achieved[name], units[name])}, wanted {written(wanted, units[name])}")
    for name in found.names:
        end = " (end of its range)" if name in result.active else ""
        say(f"{name} = {written(result.values[name], units[name])}{end}")
    free = [name for name in found.names if name not in fixed]
    for name, slopes in result.sensitivity.items():
        words = [
            f"{100 * slope * result.values[one] / result.achieved[name]:+.3g} % a % of {one}"
            for one, slope in slopes.items()
        ]
        say(f"{name} changes by {', '.join(words)}")
    if result.reached and len(target) < len(free):
        note(
            f"{len(target)} wanted, {len(free)} free: one solution of many, the nearest to the geometry of the family "
            f"in units of the ranges; --fix {free[-1]}=... picks another"
        )
    own = written(result.certified.thermal_resistance, "K/W")
    say(f"its own mesh: R_th = {own}, off by {result.certified.error:.1e}")
    front = None
    if result.front is not None:
        front = {str(name): column.values.tolist() for name, column in result.front.items()}
        count = result.front.sizes["member"]
        say(f"members that no other beats in all targets ({', '.join(result.achieved)}):")
        for k in sorted({round(k * (count - 1) / 8) for k in range(9)}):  # at most nine, ends included
            say("  ".join(f"{name} = {written(values[k], units[name])}" for name, values in front.items()))
    return {
        "values": result.values,
        "achieved": result.achieved,
        "reached": result.reached,
        "active": list(result.active),
        "sensitivity": result.sensitivity,
        "error": result.certified.error,
        "thermal_resistance": result.certified.thermal_resistance,
        "front": front,
    }


def _wanted(text: str, unit: str, option: str) -> float:
    """A target in SI; a swing is a difference of temperatures."""
    return quantity.positive_rise(text, name=option) if unit == "K" else quantity.positive(text, unit, name=option)
