"""``thermofem map`` and ``stability``: where a ring self-pulses, by integration or by linear stability."""

from pathlib import Path
from typing import Any

import typer

from .. import options
from ..console import say, watched, working


def map_(
    context: typer.Context,
    model: options.Model,
    ring: str = options.REFERENCE_RING,
    heated: str | None = None,
    read: str | None = None,
    heater: list[str] | None = None,
    power: str = options.PAPER_PLANE.power,
    detuning: str = options.PAPER_PLANE.detuning,
    points: str = "20, 20",
    duration: options.Quantity = None,
    follow: str | None = None,
    resume: Path | None = None,
    scheduler: str | None = None,
    figure: Path | None = None,
    output: options.Output = Path("map.nc"),
) -> dict[str, Any]:
    """Map the self-pulsing over power and detuning: regime, period, duty cycle, swing.

    Options
    -------
    duration: [s] Length of a run from a cold ring; without it, settled cycles.
    follow: up or down: step the laser through the detunings, without resetting the ring.
    resume: File that fills up; started again, the map goes on from it.
    power: First and last power in the bus waveguide.
    detuning: First and last laser minus cold resonance.
    """
    import coupled
    from thermofem.data import quantity

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.ring_drives import grid, steady_heaters
    from ..results.map_lines import draw_map, note_options, shows_threshold, threshold_axes, write_map

    resonator = ring_of(ring)
    over = grid(resonator, power, detuning, points)
    powers = steady_heaters(heater)
    thermal, parts = model_of(model, heated, read, powers)
    settings: dict[str, Any] = {"duration": duration, "follow": follow, "file": resume, "show_bar": watched(), **parts}
    with options.executor_of(context, scheduler) as executor:
        found = coupled.pulsing_map(resonator, thermal, over[0], over[1], heaters=powers, **settings, executor=executor)
    note_ring(resonator, ring)
    if "suggested_duration" in found.attrs:
        longer = quantity.write(found.attrs["suggested_duration"], "s")
        say(
            f'some points still move when their run ends; try --duration "{longer}": ten times what a step of this '
            "heat takes to 95 %"
        )
    if figure:
        draw_map(found, figure, ("regime", "frequency", "duty"), resonator, thermal, powers, parts)
    if not shows_threshold(found):
        note_options(threshold_axes(resonator, thermal, powers, parts))
    return write_map(found, output, figure, resonator, thermal, parts)


def stability(
    model: options.Model,
    ring: str = options.REFERENCE_RING,
    heated: str | None = None,
    read: str | None = None,
    heater: list[str] | None = None,
    power: str | None = None,
    detuning: str | None = None,
    points: str = "100, 100",
    figure: Path | None = None,
    output: options.Output = Path("stability.nc"),
) -> dict[str, Any]:
    """Classify every point of a map by linear stability; the figure adds Hopf curves and folds of states and cycles.

    Options
    -------
    power: First and last power; default: from half the lowest one of the Hopf curve to 5 times.
    detuning: First and last laser minus cold resonance; default: those of the Hopf curve.
    """
    import coupled

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.ring_drives import grid, steady_heaters
    from ..results.map_lines import draw_map, note_options, shows_threshold, threshold_axes, write_map

    resonator = ring_of(ring)
    powers = steady_heaters(heater)
    thermal, parts = model_of(model, heated, read, powers)
    paper = options.PAPER_PLANE
    ends = (power or paper.power, detuning or paper.detuning)
    grid(resonator, *ends, points)  # so that what is wrong with them is said first
    plane = None
    if power is None or detuning is None:
        with working("following the Hopf curve"):
            plane = threshold_axes(resonator, thermal, powers, parts)
        default = plane or paper
        ends = (power or default.power, detuning or default.detuning)
    axes = grid(resonator, *ends, points)
    with working("finding fixed points and their eigenvalues"):
        found = coupled.stability_map(resonator, thermal, *axes, heaters=powers, **parts)
    note_ring(resonator, ring)
    if figure:
        draw_map(found, figure, ("regime",), resonator, thermal, powers, parts)
    if (power or detuning) and not shows_threshold(found):
        if power and detuning:
            plane = threshold_axes(resonator, thermal, powers, parts)
        note_options(plane)
    return write_map(found, output, figure, resonator, thermal, parts)
