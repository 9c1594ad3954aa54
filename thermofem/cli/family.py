"""``thermofem family | design | uncertainty | calibrate``: one reduced basis for many rings, and its uses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import dataset, quantity
from ..checks import InputError
from .detuning import detuning_of
from .files import check_outputs, ring_of, say_ring, working
from .kinds import expect
from .output import note, say

if TYPE_CHECKING:
    from surrogate import Family

FamilyFile = Annotated[Path, typer.Argument(metavar="FAMILY", help="Family file of thermofem family.")]
Fix = Annotated[list[str] | None, typer.Option(help="Keep a parameter, e.g. 'radius=7 um'; may be repeated.")]
Period = Annotated[str | None, typer.Option(help="Settled period of self-pulsing, e.g. '900 ns'.")]
Ring = Annotated[str, typer.Option(help="Ring file (TOML) or borghi2021, for the settled period.")]
Power = Annotated[str, typer.Option(help="Laser power in the waveguide, for the settled period.")]
Detuning = Annotated[str, typer.Option(help="Laser minus cold resonance (GHz or pm), for the settled period.")]


def family(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML) with ranges.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("family.json"),
    tolerance: Annotated[float, typer.Option(help="Wanted relative error of R_th and of every step.")] = 1e-3,
) -> dict[str, Any]:
    """Train one thermal model for all rings in the ranges of a campaign."""
    import surrogate

    check_outputs([output], inputs=[file])
    expect(file, "campaign")
    with working("training"):
        found = surrogate.train_family(file, tolerance)
    found.save(output)
    note(
        f"{found.size} functions ({found.engine}); error over {found.error.count} rings not seen: "
        f"worst {found.error.worst:.1e}, median {found.error.median:.1e}"
    )
    note(f"wrote {output}")
    error = {"worst": found.error.worst, "median": found.error.median, "count": found.error.count}
    return {"family": output, "functions": found.size, "engine": found.engine, "error": error, **_ranges(found)}


def design(
    file: FamilyFile,
    resistance: Annotated[str | None, typer.Option(help="Thermal resistance, e.g. '9000 K/W'.")] = None,
    rise_time: Annotated[str | None, typer.Option(help="10 to 90 % after a step, e.g. '2 us'.")] = None,
    period: Period = None,
    fix: Annotated[
        list[str] | None, typer.Option(help="Keep a parameter, e.g. 'radius=7 um'; may be repeated.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the starting points of the search.")] = 0,
    ring: Ring = "borghi2021",
    power: Power = "8 dBm",
    detuning: Detuning = "0 GHz",
) -> dict[str, Any]:
    """Find the ring of a family with a wanted thermal resistance, rise time or settled period."""
    import surrogate

    found = surrogate.load_family(file)
    target: dict[Any, float] = {}
    if resistance:
        target["thermal_resistance"] = quantity.parse(resistance, "K/W", name="--resistance")
    if rise_time:
        target["rise_time"] = quantity.parse(rise_time, "s", name="--rise-time")
    if period:
        target[settled_period(ring, power, detuning)] = quantity.parse(period, "s", name="--period")
    if not target:
        raise InputError("nothing is wanted; add --resistance, --rise-time or --period")
    with working("searching"):
        result = surrogate.design(found, target=target, fixed=_fixed(found, fix), seed=seed)
    say(result.message)
    for name, unit in zip(found.names, found.box.units, strict=True):
        say(f"{name} = {quantity.write(result.values[name], unit)}")
    say(f"its own mesh: R_th = {result.certified.thermal_resistance:.6g} K/W, off by {result.certified.error:.1e}")
    return {
        "values": result.values,
        "achieved": result.achieved,
        "reached": result.reached,
        "active": list(result.active),
        "sensitivity": result.sensitivity,
        "error": result.certified.error,
    }


def uncertainty(
    file: FamilyFile,
    spread: Annotated[list[str], typer.Option(help="Mean and standard deviation, e.g. 'width=450 nm,5 nm'.")],
    fix: Annotated[
        list[str] | None, typer.Option(help="Keep a parameter, e.g. 'radius=7 um'; may be repeated.")
    ] = None,
    period: Annotated[bool, typer.Option("--period", help="The settled period, not the thermal resistance.")] = False,
    samples: Annotated[int, typer.Option(help="Base samples, a power of two.")] = 1024,
    seed: Annotated[int, typer.Option(help="Of the samples.")] = 0,
    ring: Ring = "borghi2021",
    power: Power = "8 dBm",
    detuning: Detuning = "0 GHz",
) -> dict[str, Any]:
    """What normal fabrication tolerances make of R_th or of the settled period, and which of them matters."""
    from scipy import stats

    import surrogate

    found = surrogate.load_family(file)
    spreads = {}
    for text in spread:
        name, unit, value = _assigned(found, text, "--spread")
        mean, _, width = value.partition(",")
        if not width:
            raise InputError(f"--spread {text!r} needs a mean and a standard deviation: 'width=450 nm,5 nm'")
        centre = quantity.parse(mean.strip(), unit, name=f"--spread {name}")
        spreads[name] = stats.norm(centre, quantity.parse(width.strip(), unit, name=f"--spread {name}"))
    what: Any = settled_period(ring, power, detuning) if period else "thermal_resistance"
    with working("sampling"):
        data = surrogate.uncertainty(found, spreads, what, samples=samples, fixed=_fixed(found, fix), seed=seed)
    unit = "s" if period else "K/W"
    say(f"mean {data.attrs['mean']:.6g} {unit}")
    say(
        f"standard deviation {data.attrs['standard_deviation']:.3g} {unit}; 5 to 95 %: "
        f"{data.attrs['quantile_05']:.6g} .. {data.attrs['quantile_95']:.6g} {unit}"
    )
    for name, first, total in zip(data.parameter.values, data.first_order.values, data.total_order.values, strict=True):
        say(f"{name}: first-order Sobol index {first:.3f}, total {total:.3f}")
    indices = {str(n): float(v) for n, v in zip(data.parameter.values, data.first_order.values, strict=True)}
    return {**data.attrs, "first_order": indices}


def calibrate(
    file: FamilyFile,
    data: Annotated[list[Path], typer.Argument(help="Measured or simulated thermal traces (netCDF).")],
    noise: Annotated[float | None, typer.Option(help="Standard deviation of a sample in K.")] = None,
) -> dict[str, Any]:
    """Find the ring of a family that explains thermal traces best, with standard errors."""
    import surrogate

    found = surrogate.load_family(file)
    for path in data:
        expect(path, "data")
    with working("fitting"):
        result = surrogate.calibrate(found, [dataset.load(path) for path in data], noise=noise)
    for name, unit in zip(found.names, found.box.units, strict=True):
        value, error = result.values[name], result.standard_errors[name]
        say(f"{name} = {value:.5g} +- {error:.2g} {unit}" + (" (end of its range)" if name in result.active else ""))
    say(f"residual {result.residual:.3g} K rms")
    for text in result.unseen:
        say(f"not determined by the data: {text}")
    return {
        "values": result.values,
        "standard_errors": result.standard_errors,
        "residual": result.residual,
        "unseen": list(result.unseen),
        "active": list(result.active),
    }


def settled_period(ring: str, power: str, detuning: str) -> Callable[[Any], float]:
    """The period of self-pulsing as a function of a thermal model."""
    import coupled

    resonator = ring_of(ring)
    say_ring(resonator, ring)
    watts = quantity.parse(power, "W", name="--power")
    hertz = detuning_of(detuning, resonator)

    def period(model: Any) -> float:
        return float(coupled.limit_cycle(resonator, model, power=watts, detuning=hertz).attrs["period"])

    return period


def _ranges(found: Family) -> dict[str, Any]:
    box = found.box
    return {"ranges": {n: [float(a), float(b)] for n, a, b in zip(found.names, box.low, box.high, strict=True)}}


def _assigned(found: Family, text: str, option: str) -> tuple[str, str, str]:
    """Name, unit and text of 'name=value'."""
    from ..checks import choice

    name, sign, value = text.partition("=")
    if not sign:
        raise InputError(f"{option} {text!r} must be written name=value")
    name = choice(f"{option}: parameter", name.strip(), found.names)
    return name, found.box.units[found.names.index(name)], value.strip()


def _fixed(found: Family, given: list[str] | None) -> dict[str, float]:
    fixed = {}
    for text in given or []:
        name, unit, value = _assigned(found, text, "--fix")
        fixed[name] = quantity.parse(value, unit, name=f"--fix {name}")
    return fixed
