"""The power of a column of a table as a waveform: straight between its rows, with jumps where the rows show edges."""

from __future__ import annotations

import logging

import numpy as np

from .. import checks
from ..arrays import Array
from ..waveforms import Sampled, Waveform

log = logging.getLogger("thermofem")

STEEP = 0.5  # of the range of the power: a change by more within `ROWS` intervals is an edge
FLANK = 0.1  # of the range, in one interval: less is noise beside an edge
ROWS = 3
EDGES = ("row", "middle")


def sampled_power(times: Array, power: Array, edges: str | None = None) -> Waveform:
    """The drive of a column, from t = 0 on with its first value.

    times [s], power [W]: of the rows.
    edges: None: a change between two rows is a ramp, and the log tells where that looks wrong; "row": an edge is a jump
        at the first row with the new power, as in tables of a simulation; "middle": a jump where it keeps the energy,
        as in traces of an oscilloscope.
    """
    steep = _edges(times, power)
    if edges is not None:
        checks.choice("edges", edges, EDGES)
        times, power = _with_jumps(times, power, steep, edges)
    elif steep:
        log.warning(
            "the power changes by more than half its range between rows, %d times, first at t = %g s; these are taken "
            'as ramps; where they are edges, give edges="row" or "middle"',
            len(steep),
            times[steep[0][0]],
        )
    if times[0] > 0:
        times, power = np.append(0.0, times), np.append(power[0], power)
    return Sampled(times, power)


def _edges(times: Array, power: Array) -> list[tuple[int, int]]:
    """First and last row of every change by more than `STEEP` of the range within at most `ROWS` intervals."""
    change, range_ = np.diff(power), float(np.ptp(power))
    found: list[tuple[int, int]] = []
    k = 0
    while k < change.size:
        stop = k + 1
        if abs(change[k]) > FLANK * range_:
            on = change * np.sign(change[k]) > FLANK * range_  # a product of powers may overflow
            while stop < min(change.size, k + ROWS) and on[stop]:
                stop += 1
            if abs(power[stop] - power[k]) > STEEP * range_ and times[stop] > times[k]:
                found.append((k, stop))
        k = stop
    return found


def _with_jumps(times: Array, power: Array, steep: list[tuple[int, int]], edges: str) -> tuple[Array, Array]:
    """Samples with every edge moved to one time: that of its last row, or the time that conserves the energy."""
    keep = np.ones(times.size, dtype=bool)
    jumps: list[tuple[float, float]] = []
    for a, b in steep:
        at = float(times[b])
        if edges == "middle":
            at -= float(np.trapezoid(power[a : b + 1] - power[a], times[a : b + 1]) / (power[b] - power[a]))
        keep[a + 1 : b + (edges == "row")] = False
        jumps += [(at, power[a]), (at, power[b])]
    t = np.concatenate([times[keep], [time for time, _ in jumps]])
    p = np.concatenate([power[keep], [watts for _, watts in jumps]])
    order = np.argsort(t, kind="stable")  # both sides of a jump stay in their order
    return t[order], p[order]
