"""Whether the cycles of a trace repeat: their heights and lengths from one to the next."""

from itertools import pairwise

import numpy as np

from thermofem.arrays import Array, NDArray

SETTLED = 0.02  # relative change of an amplitude, or of the carriers at the end, that counts as none
FAR = 0.1  # relative change of the period per cycle above which no period is given: seven such cycles double it
LONGEST_PATTERN = 4  # unequal pulses that repeat together


def miss(heights: Array, waits: Array, together: int) -> float:
    """Return the largest relative change of pulse heights and lengths from one group of cycles to the next.

    A group has ``together`` cycles. The last three groups are used, so that a drift is not taken for a pattern;
    infinity if there are fewer.
    """
    if heights.size < 3 * together:
        return np.inf
    pairs = [(x[-2 * together :], x[-3 * together : -together]) for x in (heights, waits)]
    return max(float(np.max(np.abs(new - old)) / max(new.max(), old.max())) for new, old in pairs)


def amplitude_limit(heights: Array) -> float:
    """Return the limit C of a sequence of amplitudes C + A r^k, from the means of three blocks of equal length.

    The blocks cover the last two thirds, so that the cold start has no influence. Returns the last amplitude where the
    loss is below 2 %, or too small to extrapolate; nan where the fall does not slow down, as after an unstable cycle:
    the trace may then end at rest or in a smaller cycle.
    """
    length = max(2 * heights.size // 9, 1)
    if heights.size < 3:
        return float(heights[-1]) if heights[-1] > (1 - SETTLED) * heights[0] else 0.0
    first, middle, last = heights[-3 * length :].reshape(3, length).mean(axis=1)
    if last > (1 - SETTLED) * first:
        return float(heights[-1])
    curvature = (last - middle) - (middle - first)
    limit = float(last - (last - middle) ** 2 / curvature) if curvature > 0 else -np.inf
    if limit > -last:
        return max(limit, 0.0)
    return float(heights[-1]) if last > 0.9 * first else float("nan")


def alternate(heights: Array, close: float = SETTLED) -> bool:
    """Whether the last large and small pulses differ alternately by more than ``close`` (relative) without decay."""
    steps = np.diff(heights[-4:])
    turned = steps.size >= 2 and bool(np.all(steps[1:] * steps[:-1] < 0))
    return turned and abs(steps[-1]) > close * heights[-1] and abs(steps[-1]) > 0.5 * abs(steps[-2])


def top_of(t: Array, N: Array, first: int, last: int) -> float:
    """Maximum of N(t) over the samples first to last - 1: the vertex of the parabola through the three highest.

    The largest sample alone misses a maximum between two steps, by up to a percent of a pulse and in turns.
    """
    k = first + int(np.argmax(N[first:last]))
    if not 0 < k < N.size - 1:
        return float(N[k])
    left, right = (N[k] - N[k - 1]) / (t[k] - t[k - 1]), (N[k + 1] - N[k]) / (t[k + 1] - t[k])
    bend = (right - left) / (t[k + 1] - t[k - 1])
    if not bend < 0:
        return float(N[k])
    slope = left + bend * (t[k] - t[k - 1])
    return float(N[k] - slope**2 / (4 * bend))


def blur(N: Array, edges: NDArray[np.int_], heights: Array) -> float:
    """Return the relative height difference of equal pulses that sampling can cause by missing their maxima.

    N: carriers. edges [shape (n + 1,)]: first samples of the cycles. heights [shape (n,)]: range of N in each.
    """
    tops = [i + int(np.argmax(N[i:j])) for i, j in pairwise(edges)][-2 * LONGEST_PATTERN :]
    beside = [min(N[k] - N[k - 1], N[k] - N[k + 1]) for k in tops if 0 < k < N.size - 1]
    return float(max(beside, default=0.0) / heights[-2 * LONGEST_PATTERN :].min())


def doubled(heights: Array, least: float) -> bool:
    """Whether large and small pulses have alternated by more than ``least`` (relative) for five cycles without decay.

    A decaying difference belongs to a cycle of one pulse; a decrease below 2 % per cycle does not count as decay.
    """
    steps = np.diff(heights[-5:])
    alternate = steps.size == 4 and bool(np.all(steps[1:] * steps[:-1] < 0))
    size = np.abs(steps)
    return alternate and size[-1] > least * heights[-1] and bool(np.all(size[1:] > (1 - SETTLED) * size[:-1]))
