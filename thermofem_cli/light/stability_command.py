"""``thermofem stability``: where a ring self-pulses, by linear stability."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import thermofem as th

from .. import options
from ..command_files import channel_of, check_outputs, model_of, note_ring, ring_of
from ..console import working, wrote
from ..drive_texts import grid, steady_heaters
from .map_command import draw_map, say_regimes, say_thresholds, say_tuning


def stability(
    model: options.Model,
    ring: options.Ring = options.REFERENCE_RING,
    channel: options.Channel = None,
    heated: options.Heated = None,
    read: options.Read = None,
    heater: options.Heater = None,
    power: options.Powers = "3 dBm, 10 dBm",
    detuning: options.Detunings = "-30 GHz, 30 GHz",
    points: options.Points = "100, 100",
    figure: options.Figure = None,
    output: options.NetCDF = Path("stability.nc"),
) -> dict[str, Any]:
    """Classify every point of a map by linear stability; the figure adds Hopf curves and folds of states and cycles."""
    import coupled

    check_outputs([output, figure], images=[figure], inputs=[model, ring])
    resonator = ring_of(ring)
    axes = grid(resonator, power, detuning, points)
    powers = steady_heaters(heater)
    thermal, parts = model_of(model, *channel_of(channel, heated, read), powers)
    with working("finding fixed points and their eigenvalues"):
        found = coupled.stability_map(resonator, thermal, *axes, heaters=powers, **parts)
    th.save(found, output)
    note_ring(resonator, ring)
    counts = say_regimes(found)
    if figure:
        draw_map(found, figure, ("regime",), resonator, thermal, powers, parts)
    numbers = {"thresholds": say_thresholds(found), **say_tuning(resonator, thermal, **parts)}
    wrote(output, figure)
    return {"points": counts, **numbers, "map": output, "figure": figure}
