"""The test whether a trace was clipped: whether its instrument ran out of range at one end.

In a settled trace, too, many rows hold the very same extreme value, where noise is below the resolution. So they count
as clipped only if the noise exceeds the resolution, or if the trace came to them so fast that a sum of decays could
not have stopped there. Differences by round-off are none: a solver's last digits are neither noise nor resolution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, runs_of

FEWEST = 12  # rows at the extreme value
MORE = 3  # times the rows of the value next to it: noise leaves fewer at an end
TURNS = 0.25  # share of the steps that go back: of noise two thirds, of a smooth trace none
COARSE = 50  # resolutions of the swing, below which steps tell nothing of decays
SEEN = 8  # resolutions: a gain of so many rows that it shows how fast the trace decays
RATIO = 0.999  # of two gains, at most
LARGE = 4  # resolutions, and
SHARE = 0.01  # of the swing: what a trace must have had ahead when it stopped
SCALES = 60  # lengths of the gains that are looked at
DIGITS = 9  # of the swing, to which values are told apart
UNEVEN = 0.1  # differences of the steps in time, over their mean: larger ones bend what is a decay
DRIVEN = 0.3  # change of the power over that of the trace, both of their swing, from which the power made the gain


def clipping(y: Array, unit: str = "K", *, times: Array | None = None, power: Array | None = None) -> str:
    """A sentence where the largest or the smallest of the values looks clipped; else no text.

    y [shape (n,), unit]
    times, power [shape (n,)]: of the rows, and what drove them; without, rows are even and the power is constant.
    """
    swing = float(np.ptp(y)) if y.size else 0.0
    if swing <= 0:
        return ""
    y = np.round(y / swing, DIGITS)
    levels = np.unique(y)
    if levels.size < 3:
        return ""
    step = np.ones(y.size - 1) if times is None else np.diff(times)
    power = np.zeros_like(y) if power is None else power / (float(np.ptp(power)) or 1.0)
    resolution = float(np.min(np.diff(levels)))
    for extreme, beside, end in ((levels[-1], levels[-2], "largest"), (levels[0], levels[1], "smallest")):
        at = y == extreme
        piled = _piled(y, power, at, int(np.sum(y == beside)), resolution)
        if piled or _sudden(y, step, power, *_longest(at), resolution):
            return (
                f"{int(at.sum())} rows hold the {end} value, {extreme * swing:.6g} {unit}: the trace looks clipped; if "
                "it is, what is fitted to it is wrong: take a wider range of the instrument"
            )
    return ""


def _piled(y: Array, power: Array, at: NDArray[np.bool_], beside: int, resolution: float) -> bool:
    """Whether many rows stand at an end though noise exceeds the resolution: it would scatter them over values.

    at: which rows stand there.
    beside: how many rows have the value next to it.
    """
    if at.sum() < max(FEWEST, MORE * beside):
        return False
    step, free = np.diff(y), ~at[1:] & ~at[:-1] & (np.abs(np.diff(power)) <= DRIVEN)
    each = free[1:] & free[:-1]  # neighbouring steps, of which neither is made by an edge of the power
    if each.sum() < FEWEST:
        return False
    turns = np.mean(step[1:][each] * step[:-1][each] < 0)
    return bool(turns > TURNS and np.median(np.abs(np.diff(step)[each])) / (0.6745 * np.sqrt(6)) > resolution)


def _longest(wanted: NDArray[np.bool_]) -> tuple[int, int]:
    """First row of the longest run of true values, and the row after its last."""
    return max(runs_of(wanted), key=lambda run: run[1] - run[0])


def _sudden(y: Array, step: Array, power: Array, first: int, stop: int, resolution: float) -> bool:
    """Whether what the trace gained before a run, continued as a decay, leads further than the run is.

    Gains that the power made by its own change tell nothing, nor do those between uneven rows.
    """
    most = min((stop - first) // 2, (first - 1) // 3) - 1
    if stop - first < FEWEST or COARSE * resolution > 1 or most < 1:
        return False
    for rows in np.unique(np.geomspace(1, most, SCALES).astype(int)).tolist():
        begin = first - 1 - 3 * rows
        early, before, last = np.diff(y[begin:first:rows]) * np.sign(y[first] - y[first - 1])
        if last < SEEN * resolution or np.ptp(power[begin : first + 1]) > DRIVEN * last:
            continue
        if np.ptp(step[begin:first]) > UNEVEN * np.mean(step[begin:first]):
            continue
        part = max(1, rows // 4)
        slow = abs(y[first - 1] - y[first - 1 - part]) + resolution < last * part / rows / 2
        off = 2 * resolution  # of a gain, at most
        ratio = float(min((last - off) / (max(before, 0.0) + off), (before - off) / (max(early, 0.0) + off), RATIO))
        ahead = last * ratio / (1 - ratio) - abs(y[first] - y[first - 1])
        return not slow and bool(ahead > max(LARGE * resolution, SHARE))
    return False
