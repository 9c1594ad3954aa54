"""``thermofem map | stability``: where a ring self-pulses, by integration or by linear stability."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem import checks

from . import drives, options
from .detuning import detuning_of
from .files import DEFAULT_RING, check_outputs, longer, model_of, ring_of, say_ring, working
from .kinds import expect
from .output import say, watched

if TYPE_CHECKING:
    from coupled import RingResonator
    from thermofem.models import ThermalModel

Power = Annotated[str, typer.Option(help="First and last power in the bus waveguide.")]
Detuning = Annotated[str, typer.Option(help="First and last laser minus cold resonance.")]


def map_(
    model: options.Model,
    ring: options.Ring = DEFAULT_RING,
    channel: options.Channel = None,
    heated: options.Heated = None,
    read: options.Read = None,
    heater: options.Heater = None,
    power: Power = "3 dBm, 10 dBm",
    detuning: Detuning = "-30 GHz, 30 GHz",
    points: options.Points = "20, 20",
    duration: Annotated[
        str | None,
        typer.Option(help="Length of a run from a cold ring; without it, settled cycles."),
    ] = None,
    follow: Annotated[
        str | None, typer.Option(help="up or down: step the laser through the detunings, without resetting the ring.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="File that fills up; started again, the map goes on from it.")
    ] = None,
    figure: options.Figure = None,
    output: options.NetCDF = Path("map.nc"),
) -> dict[str, Any]:
    """Map the self-pulsing over power and detuning: regime, period, duty cycle, swing."""
    import coupled
    from coupled.heaters import constant

    check_outputs([output, figure, resume], images=[figure])
    resonator, axes = _setting(model, ring, power, detuning, points)
    powers = drives.steady_heaters(heater or [])
    thermal, parts = model_of(model, *drives.channel(channel, heated, read), powers)
    length = None if duration is None else _quantity(duration, "s", "--duration")
    warmed = constant(thermal, powers, **parts)
    say_ring(resonator, ring)
    found = coupled.pulsing_map.record(
        resonator, thermal, *axes, heaters=powers, **parts, duration=length, follow=follow, file=resume,
        show_bar=watched(),
    )  # fmt: skip
    return _finish(found, figure, output, ("regime", "frequency", "duty"), resonator, warmed, powers)


def stability(
    model: options.Model,
    ring: options.Ring = DEFAULT_RING,
    channel: options.Channel = None,
    heated: options.Heated = None,
    read: options.Read = None,
    heater: options.Heater = None,
    power: Power = "3 dBm, 10 dBm",
    detuning: Detuning = "-30 GHz, 30 GHz",
    points: options.Points = "100, 100",
    figure: options.Figure = None,
    output: options.NetCDF = Path("stability.nc"),
) -> dict[str, Any]:
    """Classify every point of a map by linear stability, with Hopf and fold curves, of cycles too, in the figure."""
    import coupled
    from coupled.heaters import constant

    check_outputs([output, figure], images=[figure])
    resonator, axes = _setting(model, ring, power, detuning, points)
    powers = drives.steady_heaters(heater or [])
    thermal, parts = model_of(model, *drives.channel(channel, heated, read), powers)
    warmed = constant(thermal, powers, **parts)
    say_ring(resonator, ring)
    with working("finding fixed points and their eigenvalues; the first run on a machine compiles for some seconds"):
        found = coupled.stability_map.record(resonator, thermal, *axes, heaters=powers, **parts)
    return _finish(found, figure, output, ("regime",), resonator, warmed, powers)


def _setting(model: Path, ring: str, power: str, detuning: str, points: str) -> tuple[RingResonator, tuple[Any, Any]]:
    """Ring and axes."""
    expect(model, "model")
    resonator = ring_of(ring)
    return resonator, grid(resonator, power, detuning, points)


def grid(ring: RingResonator, power: str, detuning: str, points: str) -> tuple[Any, Any]:
    """Powers evenly spaced in dBm, and detunings."""
    import numpy as np

    low, high = _ends(power, "W", "--power")
    checks.positive("--power", low, unit="W")
    try:
        n, m = (int(part) for part in points.split(","))
    except ValueError:
        raise checks.InputError(f"--points = {points!r} must be two whole numbers, such as '20, 20'") from None
    if not (2 <= n <= 2000 and 2 <= m <= 2000):
        raise checks.InputError(f"--points = {points!r} must lie between 2 and 2000")
    parts = [detuning_of(part, ring) for part in _pair(detuning, "--detuning")]
    if parts[0] == parts[1]:
        raise checks.InputError(f"--detuning = {detuning!r}: the two are equal")
    return np.geomspace(low, high, n), np.linspace(min(parts), max(parts), m)


def _ends(text: str, unit: str, name: str) -> tuple[float, float]:
    """Two quantities, the first below the second."""
    low, high = (_quantity(part, unit, name) for part in _pair(text, name))
    if low >= high:
        raise checks.InputError(f"{name} = {text!r}: the first must be below the second")
    return low, high


def _pair(text: str, name: str) -> list[str]:
    """The two texts of 'first, last'."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise checks.InputError(f"{name} = {text!r} must be two quantities with a comma, such as '3 dBm, 10 dBm'")
    return parts


def _quantity(text: str, unit: str, name: str) -> float:
    from thermofem.data import quantity

    return float(quantity.parse(text, unit, name=name))


def _finish(
    found: Any,
    figure: Path | None,
    output: Path,
    show: tuple[str, ...],
    ring: RingResonator,
    warmed: Any,
    powers: dict[str, float],
) -> dict[str, Any]:
    """Write the map and its figure, and print the number of points of each regime."""
    import numpy as np

    import coupled
    from thermofem.data import dataset

    dataset.save(found, output)
    names, counts = np.unique(found["regime"].values, return_counts=True)
    say(", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True)))
    if "suggested_duration" in found.attrs:
        slow = dict(zip(names, counts, strict=True))["slow transient"]
        say(f"{slow} points still move when their run ends; {longer(found.attrs['suggested_duration'])}")
    if figure:
        from coupled.plot import plot_maps
        from thermofem.plot import save_figure

        turned = warmed.turned(ring)
        axes = found["power"].values, found["detuning"].values + turned
        linear, model = not hasattr(warmed.model, "H"), warmed.model
        with working("following the Hopf curves, the folds of fixed points and those of cycles"):
            hopf = {ring.name: coupled.hopf_curves(ring, model, *axes) if linear else []}
            folds = {ring.name: _folds(ring, model, axes) if linear else []}
            for curve in (*hopf[ring.name], *folds[ring.name]):
                curve["detuning"] = curve["detuning"].copy(data=curve["detuning"].values - turned)
            title = ", ".join([ring.name, _thermal(warmed.model), *_heating(powers)])
            over = {"hopf": {title: hopf[ring.name]}, "folds": {title: folds[ring.name]}}
            save_figure(plot_maps({title: found}, show=show, **over)[0, 0], figure)
    say(f"wrote {output}" + (f" and {figure}" if figure else ""))
    return {"points": {str(k): int(v) for k, v in zip(names, counts, strict=True)}, "map": output, "figure": figure}


def _thermal(model: Any) -> str:
    """A thermal model in a few words."""
    poles = getattr(model, "order", None)
    size = f" with {poles} states" if isinstance(poles, int) else ""
    return f"{type(model).__name__}{size}, R_th = {model.thermal_resistance / 1e3:.4g} K/mW"


def _heating(powers: dict[str, float]) -> list[str]:
    """The powers of the heaters in words."""
    from thermofem.data import quantity

    return [f"{name} at {quantity.write(power, 'W')}" for name, power in powers.items()]


def _folds(ring: RingResonator, model: ThermalModel, axes: tuple[Any, Any]) -> list[Any]:
    """The folds of fixed points and those of cycles."""
    import coupled

    return [*coupled.fold_curves(ring, model, *axes), *coupled.cycle_fold_curves(ring, model, *axes)]
