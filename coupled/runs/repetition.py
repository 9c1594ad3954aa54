"""Whether the cycles of a trace repeat: their heights and lengths from one to the next."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.errors import InputError

SMALL_CHANGE = 0.02  # relative change of an amplitude, or of the carriers at the end, that counts as none
FAR = 0.1  # relative change of the period per cycle above which no period is given: seven such cycles double it
LONGEST_PATTERN = 4  # unequal pulses that repeat together
LONGER_CYCLE = 1.5  # times the longest of the cycles before: one that lasts longer ends the oscillation
FEWEST_SAMPLES = 12  # that a cycle needs


class Train(NamedTuple):
    """Complete cycles of a trace that oscillates until its end."""

    rises: Array
    """Times at which the carriers rise through the middle of their range, s: one more than there are cycles."""
    waits: Array
    """Lengths of the cycles, s."""
    heights: Array
    """Range of the carriers in each cycle."""
    samples: float
    """In a cycle, the median; infinity for the accepted steps of an integration."""
    missed: float
    """Relative difference of equal heights that the sampling can cause."""

    @property
    def close(self) -> float:
        """Relative change of heights and lengths that counts as none."""
        return max(SMALL_CHANGE, self.missed, 0.5 / self.samples)

    def pattern(self) -> int:
        """Return the fewest cycles after which heights and lengths return; 1 if there are none.

        What settles looks like a pattern of close ones, too.
        """
        for together in range(1, LONGEST_PATTERN + 1):
            if miss(self.heights, self.waits, together) <= self.close:
                return together
        return 1

    def drifts(self, pattern: int) -> tuple[float, float]:
        """Return the last two relative changes of the length of whole patterns; 0 where there are fewer."""
        lengths = -np.diff(self.rises[::-pattern])[::-1]  # the last one at the end
        changes = lengths[1:] / lengths[:-1] - 1
        earlier, last = np.append([0.0, 0.0], changes)[-2:]
        return float(earlier), float(last)

    def largest_drift(self, earlier: float, drift: float, pattern: int) -> float:
        """Return the relative change of the length of a pattern up to which the pulses go on.

        While heat settles, the change gets smaller from cycle to cycle; one that grows may end the pulses.
        """
        unclear = 1 / self.samples
        if self.heights.size <= 2 * pattern:
            return max(unclear, SMALL_CHANGE)
        if earlier * drift > 0:
            return max(unclear, SMALL_CHANGE, min(FAR, abs(earlier)))
        return max(unclear, FAR)


def goes_on(rises: Array, end: float) -> bool:
    """Whether an oscillation with these rises lasts until the ``end`` in s, without a cycle that takes much longer."""
    waits = np.diff(rises, append=end)  # the last one is still running
    if rises.size < 3:
        return False
    completed = waits[-2] <= LONGER_CYCLE * waits[-6:-2].max()
    running = waits[-1] <= LONGER_CYCLE * waits[-6:-1].max()
    return bool(completed and running)


def train_of(t: Array, N: Array, rises: Array, every_step: bool) -> Train:
    """Return the cycles between ``rises``. Raises InputError: the samples are too far apart."""
    edges = np.searchsorted(t, rises)
    samples = np.inf if every_step else float(np.median(np.diff(edges)))
    if samples < FEWEST_SAMPLES:
        raise InputError(f"a cycle has {samples:.0f} samples; the sampling is too coarse, {FEWEST_SAMPLES} are needed")
    heights = np.array([top_of(t, N, i, j) - N[i:j].min() for i, j in pairwise(edges)])
    missed = 0.0 if every_step else blur(N, edges, heights)
    return Train(rises, np.diff(rises), heights, samples, missed)


def tops_of(heights: Array, pattern: int) -> Array:
    """Return the largest height of every pattern, the last one at the end."""
    return heights[heights.size % pattern :].reshape(-1, pattern).max(axis=1)


def miss(heights: Array, waits: Array, together: int) -> float:
    """Return the largest relative change of pulse heights and lengths from one group of cycles to the next.

    A group has ``together`` cycles. The last three groups are used, so that a drift is not taken for a pattern;
    infinity if there are fewer.
    """
    if heights.size < 3 * together:
        return np.inf
    return max(_largest_change(heights, together), _largest_change(waits, together))


def _largest_change(x: Array, together: int) -> float:
    new = x[-2 * together :]
    old = x[-3 * together : -together]
    return float(np.max(np.abs(new - old)) / max(new.max(), old.max()))


def amplitude_limit(heights: Array) -> float:
    """Return the limit C of a sequence of amplitudes C + A r^k, from the means of three blocks of equal length.

    The blocks cover the last two thirds, so that the cold start has no influence. Returns the last amplitude where the
    loss is below 2 %, or too small to extrapolate; nan where the fall does not slow down, as after an unstable cycle:
    the trace may then end at rest or in a smaller cycle.
    """
    if heights.size < 3:
        falls = heights[-1] <= (1 - SMALL_CHANGE) * heights[0]
        return 0.0 if falls else float(heights[-1])
    length = max(2 * heights.size // 9, 1)
    first, middle, last = heights[-3 * length :].reshape(3, length).mean(axis=1)
    if last > (1 - SMALL_CHANGE) * first:
        return float(heights[-1])
    curvature = (last - middle) - (middle - first)
    limit = float(last - (last - middle) ** 2 / curvature) if curvature > 0 else -np.inf
    if limit > -last:
        return max(limit, 0.0)
    return float(heights[-1]) if last > 0.9 * first else float("nan")


def alternate(heights: Array, close: float = SMALL_CHANGE) -> bool:
    """Whether the last large and small pulses differ alternately by more than ``close`` (relative) without decay."""
    steps = np.diff(heights[-4:])
    if steps.size < 2 or not _take_turns(steps):
        return False
    last = abs(steps[-1])
    return bool(last > close * heights[-1] and last > 0.5 * abs(steps[-2]))


def _take_turns(steps: Array) -> bool:
    """Whether changes alternate in sign."""
    return bool(np.all(steps[1:] * steps[:-1] < 0))


def top_of(t: Array, N: Array, first: int, last: int) -> float:
    """Maximum of N(t) over the samples first to last - 1: the vertex of the parabola through the three highest.

    The largest sample alone misses a maximum between two steps, by up to a percent of a pulse and in turns.
    """
    k = first + int(np.argmax(N[first:last]))
    if not 0 < k < N.size - 1:
        return float(N[k])
    t0, t1, t2 = t[k - 1 : k + 2]
    N0, N1, N2 = N[k - 1 : k + 2]
    left = (N1 - N0) / (t1 - t0)
    right = (N2 - N1) / (t2 - t1)
    bend = (right - left) / (t2 - t0)
    if not bend < 0:
        return float(N1)
    slope = left + bend * (t1 - t0)
    return float(N1 - slope**2 / (4 * bend))


def blur(N: Array, edges: NDArray[np.int_], heights: Array) -> float:
    """Return the relative height difference of equal pulses that sampling can cause by missing their maxima.

    N: carriers. edges [shape (n + 1,)]: first samples of the cycles. heights [shape (n,)]: range of N in each.
    """
    ends = edges[-2 * LONGEST_PATTERN - 1 :]
    tops = [i + int(np.argmax(N[i:j])) for i, j in pairwise(ends)]
    inner = [k for k in tops if 0 < k < N.size - 1]
    largest = max((min(N[k] - N[k - 1], N[k] - N[k + 1]) for k in inner), default=0.0)
    return float(largest / heights[-2 * LONGEST_PATTERN :].min())


def doubled(heights: Array, least: float) -> bool:
    """Whether large and small pulses have alternated by more than ``least`` (relative) for five cycles without decay.

    A decaying difference belongs to a cycle of one pulse; a decrease below 2 % per cycle does not count as decay.
    """
    steps = np.diff(heights[-5:])
    if steps.size != 4 or not _take_turns(steps):
        return False
    sizes = np.abs(steps)
    lasts = np.all(sizes[1:] > (1 - SMALL_CHANGE) * sizes[:-1])
    return bool(lasts and sizes[-1] > least * heights[-1])
