"""A transient, part after part, until the ring pulses or rests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernel.tableaus import Tableau
from .collocation import Ring
from .compiling import merged
from .control import DONE
from .equations import Array
from .orbit_measure import digest
from .orbit_return import integrated

FIRST, LONGEST_PART = 4e3, 1e5  # ns
LONGEST_SEEN = 1e6  # ns, of a part after one that moves without three pulses: a period may be a quarter of that
REST = 5e-3  # relative distance from a stable fixed point, and range of the carriers, from which a ring goes to rest
FALLING = 0.95  # of its amplitude, from one quarter of a part to the next, an oscillation that dies away
FLAT = 1e-5  # relative range of the carriers below which an orbit is a fixed point
AGAIN = 100.0  # ns, the longest first step of a part that goes on: longer ones rest on an unstable fixed point


class Transient(NamedTuple):
    """Where a transient is, and what its last part shows; internal units."""

    y: Array
    passed: float = 0.0  # ns
    duration: float = FIRST  # ns, of the next part
    first: float = 0.0  # ns, the first step of the next part
    low: float = 0.0  # carriers in the second half of the part
    high: float = 0.0
    turn: float = 0.0  # ns between two pulses, the longest in the part; 0 where there are too few, or they die away
    rest: int = -1  # number of the stable fixed point at which it rests
    reached: float = 0.0  # ns, in the part
    ended: int = DONE  # how the integration did


@merged
def proceed(
    begun: Transient, points: Array, longest: float, ring: Ring, floor: Array, method: Tableau, rtol: float,
    watch: Array,
) -> Transient:  # fmt: skip
    """Go on with a transient until it pulses, rests or has taken ``longest`` ns.

    Each part is up to twice as long as the last, and longer than `LONGEST_PART` where that moves without three pulses.
    ``points`` are the stable fixed points as of `spectrum.stable`: rows (U, N, dT), then rows of nan.
    """
    y, passed, duration, h = begun.y, begun.passed, begun.duration, begun.first
    low, high, turn, rest, reached, ended = 0.0, 0.0, 0.0, -1, 0.0, DONE
    while passed < longest and turn == 0.0 and rest < 0 and ended == DONE:
        rows, y, reached, h, _, counts = integrated(
            y, duration, np.inf, ring, floor, method, rtol, min(h, AGAIN), watch
        )
        ended = counts[2]
        if ended == DONE:
            passed += duration
            low, high, third, fourth, ups, between, moved = digest(rows, duration)
            falls = points[0, 0] > 0.0 and fourth < FALLING * third  # to rest, or to where it is soon
            if ups >= 3 and high - low > FLAT * high and not falls:
                turn = between
            if high - low <= REST * high and fourth <= third + FLAT * high:
                last = rows[rows.shape[0] - 1]
                U = last[1] * last[1] + last[2] * last[2]
                for k in range(points.shape[0]):
                    at = points[k]
                    off = max(abs(U - at[0]) / at[0], abs(last[3] - at[1]) / at[1], abs(last[4] - at[2]) / at[2])
                    if at[0] > 0.0 and off <= REST and rest < 0:
                        rest = k
            most = max(LONGEST_PART, min(LONGEST_SEEN, longest)) if ups < 3.0 and moved > REST else LONGEST_PART
            duration = min(2.0 * duration, most)
    return Transient(y, passed, duration, h, low, high, turn, rest, reached, ended)
