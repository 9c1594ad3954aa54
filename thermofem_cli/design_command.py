"""``thermofem design`` and ``uncertainty``: the ring of a family that fits, and tolerances of its fabrication.

The quantities of --period and --map are those of `coupled.ring_family`.
"""

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options
from .console import note, say, working, written


def design(
    context: typer.Context,
    file: options.Family,
    resistance: options.Quantity = None,
    rise_time: options.Quantity = None,
    period: options.Quantity = None,
    fix: list[str] | None = None,
    ring: str = options.REFERENCE_RING,
    power: str = "8 dBm",
    detuning: str = "0 GHz",
    heated: str | None = None,
    read: str | None = None,
    workers: options.Processes = 1,
    scheduler: str | None = None,
    seed: options.Seed = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Also write the geometry of the ring (TOML).")
    ] = None,
) -> dict[str, Any]:
    """Find the ring of a family with wanted properties; several that exclude each other give a Pareto front.

    Options
    -------
    resistance: [K/W > 0] Thermal resistance, e.g. '9000 K/W'.
    rise_time: [s > 0] 10 to 90 % after a step, e.g. '2 us'.
    period: [s > 0] Settled period of self-pulsing, e.g. '900 ns'.
    """
    import surrogate
    from thermofem import InputError
    from thermofem.data import files

    from .inputs.command_files import expect
    from .inputs.family_members import channel_of, fixed_of, optics_of, ring_for, settled_of, units_of

    if not period:
        options.unused(context, "goes with --period", "power", "detuning", "ring")
    expect(file, "family")
    family = surrogate.load_family(file)
    channel = channel_of(family, heated, read)
    target: dict[Any, float] = {}
    moving: Any = None
    if period:
        resonator, channel = ring_for(family, channel, ring, read)
        settled = settled_of(resonator, power, detuning)
        moving = optics_of(family, resonator)
        target[settled] = period
    if resistance:
        target["thermal_resistance"] = resistance
    if rise_time:
        target["rise_time"] = rise_time
    if not target:
        raise InputError("nothing is wanted; add --resistance, --rise-time or --period")
    fixed = fixed_of(family, fix)
    ports = {"heated": channel.heated, "read": channel.read}
    settings: dict[str, Any] = {"fixed": fixed, "optics": moving, "seed": seed, **ports}
    with options.executor_of(context, scheduler, workers) as executor, working("searching"):
        result = surrogate.design(family, target=target, executor=executor, **settings)
    units = {**units_of(family), **dict.fromkeys(result.achieved, "s"), "thermal_resistance": "K/W"}
    say(f"{channel}: {'reached' if result.reached else 'no member that was looked at does that; the nearest one:'}")
    for name, value in zip(result.achieved, target.values(), strict=True):
        say(f"{channel}: {name} = {written(result.achieved[name], units[name])}, wanted {written(value, units[name])}")
    for name in family.names:
        end = " (end of its range)" if name in result.active else ""
        say(f"{channel}: {name} = {written(result.values[name], units[name])}{end}")
    free = [name for name in family.names if name not in fixed]
    for name, slopes in result.sensitivity.items():
        words = [
            f"{slope * result.values[parameter] / result.achieved[name]:+.3g} % for 1 % of {parameter}"
            for parameter, slope in slopes.items()
        ]
        say(f"{channel}: {name} changes by {', '.join(words)}")
    if result.reached and len(target) < len(free):
        note(
            f"{len(target)} wanted, {len(free)} free: one solution of many, the nearest to the geometry of the family "
            f"in units of the ranges; --fix {free[-1]}=... picks another"
        )
    resistance_of_mesh = written(result.thermal_resistance, "K/W")
    say(f"{channel}: on its own mesh R_th = {resistance_of_mesh}, off by {result.certified.error:.1e}")
    if output is not None:
        text = result.certified.heat.geometry.to_toml()
        files.write_whole(output, lambda path: path.write_text(text, encoding="utf-8"))
    front = None
    if result.front is not None:
        front = {str(name): column.values.tolist() for name, column in result.front.items()}
        count = result.front.sizes["member"]
        say(f"{channel}: members that no other beats in all targets ({', '.join(result.achieved)}):")
        for k in sorted({round(k * (count - 1) / 8) for k in range(9)}):  # at most nine, ends included
            row = "  ".join(f"{name} = {written(values[k], units[name])}" for name, values in front.items())
            say(f"{channel}: {row}")
    stated = ("values", "achieved", "reached", "active", "sensitivity", "thermal_resistance")
    return {
        **ports,
        **{name: getattr(result, name) for name in stated},
        "error": result.certified.error,
        "front": front,
        "geometry": output,
    }


def uncertainty(
    context: typer.Context,
    file: options.Family,
    spread: Annotated[list[str], typer.Option(help="Mean and standard deviation, e.g. 'width=450 nm,5 nm'.")],
    fix: list[str] | None = None,
    period: bool = False,
    map_: Path | None = None,
    points: str = "15, 31",
    samples: int = 1024,
    interpolate: int | None = None,
    ring: str = options.REFERENCE_RING,
    power: str = "8 dBm",
    detuning: str = "0 GHz",
    heated: str | None = None,
    read: str | None = None,
    workers: options.Processes = 1,
    scheduler: str | None = None,
    seed: options.Seed = 0,
) -> dict[str, Any]:
    """Propagate normally distributed fabrication tolerances to R_th, the settled period or the self-pulsing map, with
    Sobol indices.

    For --map, --power and --detuning are pairs: '3 dBm, 10 dBm' and '-30 GHz, 30 GHz'.

    Options
    -------
    period: The settled period, not the thermal resistance.
    map_: Probability of self-pulsing over power and detuning, into this file.
    samples: Base samples, a power of two.
    interpolate: Compute this number of members only and interpolate.
    """
    import surrogate
    import thermofem as th
    from coupled.ring_family import PulsingMap

    from .inputs.command_files import expect
    from .inputs.family_members import channel_of, fixed_of, optics_of, ring_for, settled_of, spreads_of, units_of
    from .inputs.ring_drives import grid

    options.unused(context, *(("and --map exclude each other", "period") if map_ else ("goes with --map", "points")))
    if not (map_ or period):
        options.unused(context, "goes with --period or --map", "power", "detuning", "ring")
    expect(file, "family")
    family = surrogate.load_family(file)
    channel = channel_of(family, heated, read)
    spreads = spreads_of(family, spread)
    fixed = fixed_of(family, fix)
    what: Any = "thermal_resistance"
    moving = None
    if map_ or period:
        resonator, channel = ring_for(family, channel, ring, read)
        if map_:
            what = PulsingMap(resonator, *grid(resonator, power, detuning, points))
        else:
            what = settled_of(resonator, power, detuning)
        moving = optics_of(family, resonator)
    held = {n: v for n, v in zip(family.names, family.box.middle, strict=True) if n not in spreads} | fixed
    if held:
        units = units_of(family)
        words = ", ".join(f"{name} = {written(float(value), units[name])}" for name, value in held.items())
        note(f"held: {words}" + ("" if set(held) <= set(fixed) else "; --fix and --spread change that"))
    if period and interpolate is None:
        count = samples * (len(spreads) + 2)
        note(f"{count} settled cycles, some minutes; with --interpolate 150 only 150, interpolated, some seconds")
    ports = {"heated": channel.heated, "read": channel.read}
    settings: dict[str, Any] = {"samples": samples, "fixed": fixed, "optics": moving, "seed": seed, **ports}
    with options.executor_of(context, scheduler, workers) as executor, working("sampling"):
        data = surrogate.uncertainty(family, spreads, what, interpolate=interpolate, executor=executor, **settings)
    if map_:
        th.save(data, map_)
        unsure = float(((data["mean"] > 0.05) & (data["mean"] < 0.95)).mean())
        say(f"{channel}: {unsure:.0%} of the points pulse with a probability between 5 and 95 %")
        return {**ports, "map": map_, "unsure": unsure, "probability": data["mean"].values.tolist()}
    return _say(data, "s" if period else "K/W", interpolate)


def _say(data: Any, unit: str, interpolate: int | None) -> dict[str, Any]:
    """Print and return mean, quantiles, and Sobol indices with their intervals of 95 % probability."""
    channel = f"{data.attrs['heated']} to {data.attrs['read']}"
    mean = written(data.attrs["mean"], unit)
    deviation = written(data.attrs["standard_deviation"], unit)
    low = written(data.attrs["quantile_05"], unit)
    high = written(data.attrs["quantile_95"], unit)
    say(f"{channel}: mean {mean}, standard deviation {deviation}; 5 to 95 %: {low} .. {high}")
    parameters = list(map(str, data.parameter.values))
    for name in parameters:
        row = data.sel(parameter=name)
        first = _with_range(row, "first_order")
        total = _with_range(row, "total_order")
        say(f"{channel}: {name}: first-order Sobol index {first}; total {total}")
        say(f"{channel}: {name}: {_change(row, unit)} for one standard deviation")
    if interpolate:
        error = data.attrs["interpolation_error"]
        say(f"{channel}: interpolated between {interpolate} members; rms error {error:.1e} over held-out ones")
    kinds = [f"{kind}{end}" for kind in ("first_order", "total_order") for end in ("", "_low", "_high")]
    kinds += [kind for kind in ("per_deviation", "per_deviation_heat") if kind in data]
    return {**data.attrs, **{kind: dict(zip(parameters, data[kind].values.tolist(), strict=True)) for kind in kinds}}


def _change(row: Any, unit: str) -> str:
    """Return, as text, the change per standard deviation of a parameter, and its thermal and optical parts."""
    whole = row["per_deviation"].item()
    if "per_deviation_heat" not in row:
        return written(whole, unit)
    heat = row["per_deviation_heat"].item()
    return f"{written(whole, unit)}, {written(heat, unit)} by heat and {written(whole - heat, unit)} by light"


def _with_range(row: Any, kind: str) -> str:
    """A Sobol index with its interval of 95 % probability."""
    low = row[f"{kind}_low"].item()
    high = row[f"{kind}_high"].item()
    return f"{row[kind].item():.3f} ({low:.3f} .. {high:.3f})"
