"""``thermofem family | design | uncertainty | calibrate``: one reduced basis for many rings, and its uses."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem.checks import InputError, choice
from thermofem.data import quantity

from . import options
from .files import about, check_outputs, ring_of, working
from .kinds import expect, kind_of
from .maps import grid
from .output import hold, note, say, written
from .quantities import cycle_property, optics_of, pulsing_points, pulsing_range
from .values import assigned

if TYPE_CHECKING:
    from surrogate import Family

MEMBERS = ("surrogate.family.solving",)  # what solves them in a worker process
FamilyFile = Annotated[Path, typer.Argument(metavar="FAMILY", help="Family file of thermofem family.")]
Fix = Annotated[list[str] | None, typer.Option(help="Keep a parameter, e.g. 'radius=7 um'; may be repeated.")]
Period = Annotated[str | None, typer.Option(help="Settled period of self-pulsing, e.g. '900 ns'.")]
Ring = Annotated[str, typer.Option(help="Ring file (TOML) or borghi2021, for the settled period.")]
Power = Annotated[str, typer.Option(help="Laser power in the waveguide, for self-pulsing.")]
Detuning = Annotated[str, typer.Option(help="Laser minus cold resonance (GHz or pm), for self-pulsing.")]
OpticsOption = Annotated[
    list[str] | None,
    typer.Option(help="d(optics)/d(parameter) in SI, e.g. 'bus_rate/width=-1e17' or 'detuning/width=1e20'."),
]


def family(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML) with ranges.")],
    output: options.Output = Path("family.json"),
    tolerance: Annotated[float, typer.Option(help="Wanted relative error of R_th and of every step.")] = 1e-3,
    folder: Annotated[
        Path | None, typer.Option(help="Keeps solved members; started again, training goes on from it.")
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes that solve members.", min=1, max=1024)] = 1,
    power: Annotated[
        str | None, typer.Option(help="Largest absorbed power, e.g. '2 mW'; for conductivities k(T).")
    ] = None,
) -> dict[str, Any]:
    """Train one thermal model for all rings in the ranges of a campaign."""
    import surrogate

    check_outputs([output])
    expect(file, "campaign")
    with contextlib.ExitStack() as stack:
        stack.enter_context(working("training"))
        pool = None
        if workers > 1:
            from thermofem.campaign.pool import Pool
            from thermofem.campaign.processes import begin
            from thermofem.campaign.work import follow_parent

            begin(MEMBERS)
            pool = stack.enter_context(Pool(workers, follow_parent, MEMBERS))
        hot = None if power is None else quantity.parse(power, "W", name="--power")
        found = surrogate.train_family(file, tolerance, executor=pool, folder=folder, power=hot)
    found.save(output)
    say(
        f"{found.size} functions ({found.engine}); error over {found.error.count} rings not seen: "
        f"worst {found.error.worst:.1e}, median {found.error.median:.1e}"
    )
    if found.bend is not None:
        say(f"k(T) up to {quantity.write(found.bend.power, 'W')}: error {found.bend.error:.1e}")
    say(f"wrote {output}")
    error = {"worst": found.error.worst, "median": found.error.median, "count": found.error.count}
    return {
        "family": output,
        "functions": found.size,
        "engine": found.engine,
        "error": error,
        "error_hot": None if found.bend is None else found.bend.error,
        **_ranges(found),
    }


def design(
    file: FamilyFile,
    resistance: Annotated[str | None, typer.Option(help="Thermal resistance, e.g. '9000 K/W'.")] = None,
    rise_time: Annotated[str | None, typer.Option(help="10 to 90 % after a step, e.g. '2 us'.")] = None,
    period: Period = None,
    swing: Annotated[str | None, typer.Option(help="Temperature swing of the settled cycle, e.g. '6 K'.")] = None,
    range_: Annotated[
        str | None, typer.Option("--range", help="Range of self-pulsing in detuning at --power, e.g. '30 GHz'.")
    ] = None,
    fix: Fix = None,
    optics: OpticsOption = None,
    seed: Annotated[int, typer.Option(help="Random seed of the starting points of the search.")] = 0,
    ring: Ring = "borghi2021",
    power: Power = "8 dBm",
    detuning: Detuning = "0 GHz",
) -> dict[str, Any]:
    """Find the ring of a family with wanted properties; several that exclude each other give a Pareto front."""
    import surrogate

    found, drive = surrogate.load_family(file), (ring, power, detuning)
    asked: list[tuple[str, str | None, str, Callable[[], Any]]] = [
        ("--resistance", resistance, "K/W", lambda: "thermal_resistance"),
        ("--rise-time", rise_time, "s", lambda: "rise_time"),
        ("--period", period, "s", lambda: cycle_property("period", *drive)),
        ("--swing", swing, "K", lambda: cycle_property("swing", *drive)),
        ("--range", range_, "Hz", lambda: pulsing_range(*drive)),
    ]
    target = {make(): _wanted(text, unit, option) for option, text, unit, make in asked if text is not None}
    if not target:
        raise InputError("nothing is wanted; add --resistance, --rise-time, --period, --swing or --range")
    fixed = _fixed(found, fix)
    if set(fixed) == set(found.names):
        raise InputError("every parameter is fixed; remove one --fix")
    with working("searching"):
        common: dict[str, Any] = {"fixed": fixed, "optics": optics_of(found, optics, ring), "seed": seed}
        result = surrogate.design(found, target=target, **common)
    of_target = {
        name: unit for name, (_, text, unit, _) in zip(result.achieved, (a for a in asked if a[1]), strict=True)
    }
    units = {**dict(zip(found.names, found.box.units, strict=True)), **of_target}
    say("reached" if result.reached else "no member that was looked at does that; the nearest one:")
    for name, wanted in zip(result.achieved, target.values(), strict=True):
        say(f"{name} = {written(result.achieved[name], units[name])}, wanted {written(wanted, units[name])}")
    for name in found.names:
        end = " (end of its range)" if name in result.active else ""
        say(f"{name} = {written(result.values[name], units[name])}{end}")
    own = written(result.certified.thermal_resistance, "K/W")
    say(f"its own mesh: R_th = {own}, off by {result.certified.error:.1e}")
    front = None
    if result.front is not None:
        front = {str(name): column.values.tolist() for name, column in result.front.items()}
        say(f"members that no other beats in all targets ({', '.join(result.achieved)}):")
        for k in _some(result.front.sizes["member"]):
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


def _some(count: int) -> list[int]:
    """At most nine places out of many, ends included."""
    return sorted({round(k * (count - 1) / 8) for k in range(9)})


def uncertainty(
    file: FamilyFile,
    spread: Annotated[list[str], typer.Option(help="Mean and standard deviation, e.g. 'width=450 nm,5 nm'.")],
    fix: Fix = None,
    period: Annotated[bool, typer.Option("--period", help="The settled period, not the thermal resistance.")] = False,
    map_: Annotated[
        Path | None, typer.Option("--map", help="Probability of self-pulsing over power and detuning, into this file.")
    ] = None,
    points: Annotated[str, typer.Option(help="Number of powers and of detunings of --map.")] = "15, 31",
    samples: Annotated[int, typer.Option(help="Base samples, a power of two.")] = 1024,
    interpolate: Annotated[
        int | None,
        typer.Option(help="Compute this number of members only and interpolate."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Random seed of the samples.")] = 0,
    optics: OpticsOption = None,
    ring: Ring = "borghi2021",
    power: Power = "8 dBm",
    detuning: Detuning = "0 GHz",
) -> dict[str, Any]:
    """Propagate normally distributed fabrication tolerances to R_th, the settled period or the self-pulsing map, with
    Sobol indices.

    For --map, --power and --detuning are pairs: '3 dBm, 10 dBm' and '-30 GHz, 30 GHz'.
    """
    import surrogate

    check_outputs([map_])
    found = surrogate.load_family(file)
    spreads = _spreads(found, spread)
    what: Any = "thermal_resistance"
    if map_:
        what = pulsing_points(ring, *grid(ring_of(ring), power, detuning, points))
    elif period:
        what = cycle_property("period", ring, power, detuning)
    common: dict[str, Any] = {
        "samples": samples,
        "fixed": _fixed(found, fix),
        "optics": optics_of(found, optics, ring),
    }
    both = next((name for name in common["fixed"] if name in spreads), None)
    if both is not None:
        raise InputError(f"--fix and --spread are both given for {both!r}; leave one of the two out")
    common["seed"] = seed
    held = {n: v for n, v in zip(found.names, found.box.middle, strict=True) if n not in spreads}
    held.update(common["fixed"])
    if held:
        units = dict(zip(found.names, found.box.units, strict=True))
        words = ", ".join(f"{name} = {written(float(value), units[name])}" for name, value in held.items())
        hold(f"held: {words}" + ("" if set(held) <= set(common["fixed"]) else "; --fix and --spread change that"))
    if period and interpolate is None:
        count = samples * (len(spreads) + 2)
        note(f"{count} settled cycles, some minutes; with --interpolate 150 only 150, interpolated, some seconds")
    with working("sampling"):
        data = surrogate.uncertainty(found, spreads, what, interpolate=interpolate, **common)
    if map_:
        from thermofem.data import dataset

        dataset.save(data, map_)
        unsure = float(((data["mean"] > 0.05) & (data["mean"] < 0.95)).mean())
        say(f"{unsure:.0%} of the points pulse with a probability between 5 and 95 %; wrote {map_}")
        return {"map": map_, "unsure": unsure, "probability": data["mean"].values.tolist()}
    unit = "s" if period else "K/W"
    mean, deviation, low, high = (
        written(data.attrs[name], unit) for name in ("mean", "standard_deviation", "quantile_05", "quantile_95")
    )
    say(f"mean {mean}, standard deviation {deviation}; 5 to 95 %: {low} .. {high}")
    for name in map(str, data.parameter.values):
        first, total = (_interval(data.sel(parameter=name), kind) for kind in ("first_order", "total_order"))
        say(f"{name}: first-order Sobol index {first}; total {total}")
    if interpolate:
        error = data.attrs["interpolation_error"]
        say(f"interpolated between {interpolate} members; rms error {error:.1e} over held-out ones")
    names = ("first_order", "total_order")
    kinds = [*names, *(f"{kind}_{end}" for kind in names for end in ("low", "high"))]  # of the 95 % intervals
    parameters = list(map(str, data.parameter.values))
    return {**data.attrs, **{kind: dict(zip(parameters, data[kind].values.tolist(), strict=True)) for kind in kinds}}


def _interval(row: Any, kind: str) -> str:
    """A Sobol index with the interval that holds it with a probability of 95 %."""
    return f"{row[kind].item():.3f} ({row[kind + '_low'].item():.3f} .. {row[kind + '_high'].item():.3f})"


def _spreads(found: Family, given: list[str]) -> dict[str, Any]:
    """Normal distributions from 'name=mean,deviation'."""
    from scipy import stats

    spreads = {}
    for name, (unit, text) in _of_parameters(found, "--spread", given, "width=450 nm,5 nm").items():
        mean, _, width = (part.strip() for part in text.partition(","))
        if not width:
            raise InputError(f"--spread '{name}={text}' needs a mean and a standard deviation: 'width=450 nm,5 nm'")
        centre = quantity.parse(mean, unit, name=f"--spread {name}")
        spreads[name] = stats.norm(centre, quantity.positive(width, unit, name=f"--spread {name}"))
    return spreads


def calibrate(
    file: FamilyFile,
    data: Annotated[list[Path], typer.Argument(help="Measured or simulated thermal traces (netCDF).")],
    noise: Annotated[
        str | None, typer.Option(help="Standard deviation of a sample, e.g. '10 mK'; a number alone is in K.")
    ] = None,
) -> dict[str, Any]:
    """Find the ring of a family that explains thermal traces best, with standard errors."""
    import surrogate
    from thermofem.data import dataset

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
        result = surrogate.calibrate(found, [dataset.load(path) for path in data], noise=spread)
    for name, unit in zip(found.names, found.box.units, strict=True):
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


def _ranges(found: Family) -> dict[str, Any]:
    box = found.box
    return {"ranges": {n: [float(a), float(b)] for n, a, b in zip(found.names, box.low, box.high, strict=True)}}


def _of_parameters(found: Family, option: str, given: list[str] | None, example: str) -> dict[str, tuple[str, str]]:
    """Unit and text of every parameter of a repeatable option 'PARAMETER=VALUE'."""
    units = dict(zip(found.names, found.box.units, strict=True))
    texts = assigned(option, given or [], example)
    return {choice(f"{option}: parameter", name, units): (units[name], text) for name, text in texts.items()}


def _fixed(found: Family, given: list[str] | None) -> dict[str, float]:
    texts = _of_parameters(found, "--fix", given, "radius=7 um")
    return {name: quantity.parse(text, unit, name=f"--fix {name}") for name, (unit, text) in texts.items()}
