"""The test whether a trace was clipped: whether its instrument ran out of range at one end.

In a settled trace, too, many rows hold the very same extreme value, where noise is below the resolution. So they count
as clipped only if the noise exceeds the resolution, or if the trace came to them so fast that a sum of decays could
not have stopped there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

FEWEST = 12  # rows at the extreme value
MORE = 3  # times the rows of the value next to it: noise leaves fewer at an end
TURNS = 0.25  # share of the steps that go back: of noise two thirds, of a smooth trace none
COARSE = 50  # resolutions of the swing, below which steps tell nothing of decays
SEEN = 8  # resolutions: a gain of so many rows that it shows how fast the trace decays
RATIO = 0.999  # of two gains, at most
LARGE = 4  # resolutions, and
SHARE = 0.01  # of the swing: what a trace must have had ahead when it stopped


def clipping(y: Array, unit: str = "K") -> str:
    """A sentence where the largest or the smallest of the values looks clipped; else no text.

    y [shape (n,), unit]
    """
    levels = np.unique(y)
    if levels.size < 3:
        return ""
    resolution = float(np.min(np.diff(levels)))
    for extreme, beside, end in ((levels[-1], levels[-2], "largest"), (levels[0], levels[1], "smallest")):
        at = y == extreme
        if _piled(y, at, int(np.sum(y == beside)), resolution) or _sudden(y, *_longest(at), resolution):
            return (
                f"{int(at.sum())} rows hold the {end} value, {extreme:.6g} {unit}: the trace looks clipped; if it is, "
                "what is fitted to it is wrong: take a wider range of the instrument"
            )
    return ""


def _piled(y: Array, at: NDArray[np.bool_], beside: int, resolution: float) -> bool:
    """Whether many rows stand at an end though noise exceeds the resolution: it would scatter them over values.

    at: which rows stand there.
    beside: how many rows have the value next to it.
    """
    if at.sum() < max(FEWEST, MORE * beside):
        return False
    steps = np.diff(y)[~(at[1:] | at[:-1])]
    if steps.size < FEWEST:
        return False
    turns = np.mean(steps[1:] * steps[:-1] < 0)
    return bool(turns > TURNS and np.median(np.abs(np.diff(steps))) / (0.6745 * np.sqrt(6)) > resolution)


def _longest(wanted: NDArray[np.bool_]) -> tuple[int, int]:
    """First row of the longest run of true values, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]])))
    starts, stops = edges[::2], edges[1::2]
    at = int(np.argmax(stops - starts))
    return int(starts[at]), int(stops[at])


def _sudden(y: Array, first: int, stop: int, resolution: float) -> bool:
    """Whether what the trace gained before a run, continued as a decay, leads further than the run is."""
    if stop - first < FEWEST or np.ptp(y) < COARSE * resolution:
        return False
    for rows in range(1, min((stop - first) // 2, (first - 1) // 3)):
        early, before, last = np.diff(y[first - 1 - 3 * rows : first : rows]) * np.sign(y[first] - y[first - 1])
        if last < SEEN * resolution:
            continue
        part = max(1, rows // 4)
        slow = abs(y[first - 1] - y[first - 1 - part]) + resolution < last * part / rows / 2
        off = 2 * resolution  # of a gain, at most
        ratio = float(min((last - off) / (max(before, 0.0) + off), (before - off) / (max(early, 0.0) + off), RATIO))
        ahead = last * ratio / (1 - ratio) - abs(y[first] - y[first - 1])
        return not slow and bool(ahead > max(LARGE * resolution, SHARE * float(np.ptp(y))))
    return False
