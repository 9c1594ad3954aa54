"""What a map keeps of a closed orbit and of a transient, compiled: a few microseconds each."""

from __future__ import annotations

import numpy as np

from . import equations, kinds, levels
from .collocation import Scheme
from .compiling import compiled, forget_if_older, inner
from .equations import Array
from .kinds import read, rise_of

BETWEEN = 4  # points for every stage
BISECTIONS = 30


@inner
def _weights(x: float, c: Array, out: Array) -> None:
    """Write the weights of the beginning and the stages in the polynomial of an interval at ``x``."""
    s = c.size
    for j in range(s + 1):
        node, out[j] = 0.0 if j == 0 else c[j - 1], 1.0
        for i in range(s + 1):
            if i != j:
                other = 0.0 if i == 0 else c[i - 1]
                out[j] *= (x - other) / (node - other)


@inner
def _energy(values: Array, k: int, w: Array) -> float:
    """Return U in the interval ``k`` for weights ``w``."""
    ar, ai = 0.0, 0.0
    for j in range(w.size):
        ar += w[j] * values[k, j, 0]
        ai += w[j] * values[k, j, 1]
    return ar * ar + ai * ai


@inner
def _extreme(x: Array, i: int, count: int) -> float:
    """Return the extreme next to the largest or lowest value ``i`` of a period, by parabolas of one interval."""
    total, best = x.size - 1, x[i]
    middle = i % count > 0
    for way in (1, -1):
        first = i - way if middle else i + (total if i == 0 and way < 0 else 0)
        a, b, c = x[first], x[first + way], x[first + 2 * way]
        slope, bend = 3.0 * a - 4.0 * b + c, a - 2.0 * b + c
        if bend != 0.0 and 0.0 < slope / bend < 4.0:
            value = a - slope * slope / (8.0 * bend)
            best = max(best, value) if bend < 0.0 else min(best, value)
    return best


@compiled
def measured(start: Array, Y: Array, tau: Array, thermal: object, scheme: Scheme, level: float) -> Array:
    """Return the duty cycle above ``level`` of the range of U, the swing in K, and the lowest and highest U."""
    number, s = Y.shape[:2]
    count = BETWEEN * s
    values, grid = np.empty((number, s + 1, 3)), np.empty((count, s + 1))
    for k in range(number):
        for j in range(s + 1):
            y = (start if k == 0 else Y[k - 1, s - 1]) if j == 0 else Y[k, j - 1]
            values[k, j, 0], values[k, j, 1], values[k, j, 2] = y[0], y[1], read(y, thermal)
    for i in range(count):
        _weights(i / count, scheme.c, grid[i])
    total = number * count
    U, z = np.empty(total + 1), np.empty(total + 1)
    for k in range(number):
        for i in range(count):
            U[k * count + i] = _energy(values, k, grid[i])
            heat = 0.0
            for j in range(s + 1):
                heat += grid[i, j] * values[k, j, 2]
            z[k * count + i] = heat
    U[total], z[total] = U[0], z[0]
    ends = np.empty(4)
    for q in range(4):
        x = U if q < 2 else z
        ends[q] = _extreme(x, x[:total].argmin() if q % 2 == 0 else x[:total].argmax(), count)
    cut = ends[0] + level * (ends[1] - ends[0])
    above, w = 0.0, np.empty(s + 1)
    for i in range(total):
        k = i // count
        h = (tau[k + 1] - tau[k]) / count
        if (U[i] > cut) == (U[i + 1] > cut):
            above += h if U[i] > cut else 0.0
            continue
        low, high = float(i - k * count), float(i - k * count + 1)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            _weights(middle / count, scheme.c, w)
            if (_energy(values, k, w) > cut) == (U[i] > cut):
                low = middle
            else:
                high = middle
        share = low - (i - k * count)
        above += h * (share if U[i] > cut else 1.0 - share)
    swing = rise_of(ends[3], thermal)[0] - rise_of(ends[2], thermal)[0]
    return np.array([above, swing, ends[0], ends[1]])


@compiled
def digest(rows: Array, duration: float) -> Array:
    """Return measures of the carriers late in a transient, from rows (t, Re a, Im a, N, dT).

    Lowest and highest in the second half, their range in the third and in the fourth quarter, how often they rise
    through the middle after the first quarter, the longest time between two rises, and the relative range in the whole.
    """
    low, high, lowest, highest = np.inf, -np.inf, np.inf, -np.inf
    range_low, range_high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(rows.shape[0]):
        t, N = rows[i, 0], rows[i, 3]
        lowest, highest = min(lowest, N), max(highest, N)
        if t < duration / 2:
            continue
        low, high = min(low, N), max(high, N)
        part = 0 if t < 0.75 * duration else 1
        range_low[part], range_high[part] = min(range_low[part], N), max(range_high[part], N)
    ups, longest = 0.0, 0.0
    if rows.shape[0] >= 4:
        found = levels.rises(rows[:, 0].copy(), rows[:, 3].copy(), 0.5 * (low + high), 1.0)
        for i in range(found.size):
            if found[i] >= duration / 4:
                ups += 1.0
                longest = max(longest, found[i] - found[i - 1]) if i > 0 else longest
    third, fourth = max(range_high[0] - range_low[0], 0.0), max(range_high[1] - range_low[1], 0.0)
    moved = (highest - lowest) / max(highest, 1e-300)
    return np.array([low, high, third, fourth, ups, longest, moved])


for module in (equations, kinds, levels):
    forget_if_older(measured, str(module.__file__))
