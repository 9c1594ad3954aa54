"""``thermofem design``: the ring of a family with wanted properties."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from thermofem.data import quantity
from thermofem.errors import InputError

from .. import options
from ..console import note, say, working, written
from ..drive_texts import detuning_of
from .family_options import PulsingRange, Settled, fixed_of, optics_of, ring_for, units_of


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
    import surrogate

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
