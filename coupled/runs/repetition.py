"""Whether the cycles of a trace repeat: their heights and lengths from one to the next."""

from itertools import pairwise

import numpy as np

from thermofem.arrays import Array, NDArray

SETTLED = 0.02  # relative change of an amplitude, or of the carriers at the end, that counts as none
FAR = 0.1  # relative change of the period per cycle above which no period is given: seven such cycles double it
LONGEST_PATTERN = 4  # unequal pulses that repeat together


def miss(heights: Array, waits: Array, together: int) -> float:
    """Largest relative change of heights and lengths over ``together`` cycles; infinity where there are too few.

    Three repetitions are needed, so that a drift is no pattern.
    """
    if heights.size < 3 * together:
        return np.inf
    pairs = [(x[-2 * together :], x[-3 * together : -together]) for x in (heights, waits)]
    return max(float(np.max(np.abs(new - old)) / max(new.max(), old.max())) for new, old in pairs)


def amplitude_limit(heights: Array) -> float:
    """Where a sequence of amplitudes is heading: C for ``C + A r^k``, from the means of three blocks of equal length.

    The blocks cover the last two thirds, so the cold start does not count. The last amplitude where nothing is lost, or
    so little that it says nothing about the end; nan where the fall does not slow down as one towards rest does, which
    is so past an unstable cycle, and may end at rest or in a smaller cycle.
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
    """Whether large and small pulses alternate at the end with a difference above ``close`` that does not decay."""
    steps = np.diff(heights[-4:])
    turned = steps.size >= 2 and bool(np.all(steps[1:] * steps[:-1] < 0))
    return turned and abs(steps[-1]) > close * heights[-1] and abs(steps[-1]) > 0.5 * abs(steps[-2])


def blur(N: Array, edges: NDArray[np.int_], heights: Array) -> float:
    """Relative difference of equal pulses that samples may show: what a sample beside the top of a pulse misses of it.

    edges [shape (n + 1,)]: first samples of the cycles.
    """
    tops = [i + int(np.argmax(N[i:j])) for i, j in pairwise(edges)][-2 * LONGEST_PATTERN :]
    beside = [min(N[k] - N[k - 1], N[k] - N[k + 1]) for k in tops if 0 < k < N.size - 1]
    return float(max(beside, default=0.0) / heights[-2 * LONGEST_PATTERN :].min())


def doubled(heights: Array, least: float) -> bool:
    """Whether large and small pulses have alternated by more than ``least`` for five cycles without decay.

    A difference that decays belongs to a cycle of one pulse; within 2 % from cycle to cycle it stays or grows.
    """
    steps = np.diff(heights[-5:])
    alternate = steps.size == 4 and bool(np.all(steps[1:] * steps[:-1] < 0))
    size = np.abs(steps)
    return alternate and size[-1] > least * heights[-1] and bool(np.all(size[1:] > (1 - SETTLED) * size[:-1]))


def longest_change(earlier: float, drift: float, enough: bool) -> float:
    """Largest relative change of the period of a cycle that goes on; ``enough`` cycles prove more than the fewest.

    Heat that settles moves the period less from cycle to cycle; a change that grows may end the pulses.
    """
    if not enough:
        return SETTLED
    return max(SETTLED, min(FAR, abs(earlier))) if earlier * drift > 0 else FAR
