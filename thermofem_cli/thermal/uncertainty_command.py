"""``thermofem uncertainty``: tolerances of fabrication, propagated through a family."""

from pathlib import Path
from typing import Annotated, Any

import typer

import surrogate
import thermofem as th
from thermofem.data import quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import check_outputs
from ..console import note, say, working, written, wrote
from ..drive_texts import detuning_of, grid
from .family_options import Pulsing, Settled, fixed_of, optics_of, ring_for, spreads_of, units_of


def uncertainty(
    context: typer.Context,
    file: options.Family,
    spread: Annotated[list[str], typer.Option(help="Mean and standard deviation, e.g. 'width=450 nm,5 nm'.")],
    fix: options.Fix = None,
    period: Annotated[bool, typer.Option("--period", help="The settled period, not the thermal resistance.")] = False,
    map_: Annotated[
        Path | None, typer.Option("--map", help="Probability of self-pulsing over power and detuning, into this file.")
    ] = None,
    points: options.Points = "15, 31",
    samples: Annotated[int, typer.Option(help="Base samples, a power of two.")] = 1024,
    interpolate: Annotated[
        int | None, typer.Option(help="Compute this number of members only and interpolate.")
    ] = None,
    optics: options.Optics = None,
    ring: options.FamilyRing = options.REFERENCE_RING,
    power: options.FamilyPower = "8 dBm",
    detuning: options.FamilyDetuning = "0 GHz",
    workers: options.Processes = 1,
    scheduler: options.Scheduler = None,
    seed: options.Seed = 0,
) -> dict[str, Any]:
    """Propagate normally distributed fabrication tolerances to R_th, the settled period or the self-pulsing map, with
    Sobol indices.

    For --map, --power and --detuning are pairs: '3 dBm, 10 dBm' and '-30 GHz, 30 GHz'.
    """
    if map_ and period:
        raise InputError("--period and --map exclude each other; leave it out")
    if not map_:
        options.unused(context, "goes with --map", "points")
    if not (map_ or period):
        options.unused(context, "goes with --period or --map", "power", "detuning", "optics", "ring")
    check_outputs([map_], inputs=[file, ring])
    found = surrogate.load_family(file)
    spreads, fixed = spreads_of(found, spread), fixed_of(found, fix)
    what: Any = "thermal_resistance"
    slopes = None
    if map_ or period:
        resonator = ring_for(found, ring)
        if map_:
            what = Pulsing(resonator, *grid(resonator, power, detuning, points))
        else:
            watts = quantity.parse(power, "W", name="--power")
            what = Settled("period", resonator, watts, detuning_of(detuning, resonator))
        slopes = optics_of(found, optics, resonator)
    both = next((name for name in fixed if name in spreads), None)
    if both is not None:
        raise InputError(f"--fix and --spread are both given for {both!r}; leave one of the two out")
    held = {n: v for n, v in zip(found.names, found.box.middle, strict=True) if n not in spreads} | fixed
    if held:
        units = units_of(found)
        words = ", ".join(f"{name} = {written(float(value), units[name])}" for name, value in held.items())
        note(f"held: {words}" + ("" if set(held) <= set(fixed) else "; --fix and --spread change that"))
    if period and interpolate is None:
        count = samples * (len(spreads) + 2)
        note(f"{count} settled cycles, some minutes; with --interpolate 150 only 150, interpolated, some seconds")
    settings: dict[str, Any] = {"samples": samples, "fixed": fixed, "optics": slopes, "seed": seed}
    with options.executor_of(scheduler, workers if workers > 1 else None) as executor, working("sampling"):
        settings["executor"] = executor
        data = surrogate.uncertainty(found, spreads, what, interpolate=interpolate, **settings)
    if map_:
        th.save(data, map_)
        unsure = float(((data["mean"] > 0.05) & (data["mean"] < 0.95)).mean())
        say(f"{unsure:.0%} of the points pulse with a probability between 5 and 95 %")
        wrote(map_)
        return {"map": map_, "unsure": unsure, "probability": data["mean"].values.tolist()}
    return _say(data, "s" if period else "K/W", interpolate)


def _say(data: Any, unit: str, interpolate: int | None) -> dict[str, Any]:
    """Print mean, quantiles and Sobol indices with the intervals that hold them with a probability of 95 %."""
    names = ("mean", "standard_deviation", "quantile_05", "quantile_95")
    mean, deviation, low, high = (written(data.attrs[name], unit) for name in names)
    say(f"mean {mean}, standard deviation {deviation}; 5 to 95 %: {low} .. {high}")
    parameters = list(map(str, data.parameter.values))
    for name in parameters:
        row = data.sel(parameter=name)
        first, total = (
            f"{row[kind].item():.3f} ({row[kind + '_low'].item():.3f} .. {row[kind + '_high'].item():.3f})"
            for kind in ("first_order", "total_order")
        )
        say(f"{name}: first-order Sobol index {first}; total {total}")
        say(f"{name}: {_change(row, unit)} for one standard deviation")
    if interpolate:
        error = data.attrs["interpolation_error"]
        say(f"interpolated between {interpolate} members; rms error {error:.1e} over held-out ones")
    kinds = [f"{kind}{end}" for kind in ("first_order", "total_order") for end in ("", "_low", "_high")]
    kinds += [kind for kind in ("per_deviation", "per_deviation_heat") if kind in data]
    return {**data.attrs, **{kind: dict(zip(parameters, data[kind].values.tolist(), strict=True)) for kind in kinds}}


def _change(row: Any, unit: str) -> str:
    """Change of the quantity by one standard deviation of a parameter, and what of it is light and heat."""
    whole = row["per_deviation"].item()
    if "per_deviation_heat" not in row:
        return written(whole, unit)
    heat = row["per_deviation_heat"].item()
    return f"{written(whole, unit)}, {written(heat, unit)} by heat and {written(whole - heat, unit)} by light"
