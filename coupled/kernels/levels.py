"""Where a sampled trace rises through a level, compiled."""

from __future__ import annotations

import numpy as np

from .compiling import compiled
from .equations import Array


@compiled
def rises(t: Array, x: Array, level: float, sign: float) -> Array:
    """Return when sign x rises through sign level, on the cubic through the four samples around each, by bisection."""
    out, n = np.empty(16), 0
    for at in range(t.size - 1):
        if not (sign * x[at] < sign * level and sign * x[at + 1] >= sign * level):
            continue
        i = min(max(at - 1, 0), t.size - 4)
        s0, s1, s2, s3 = t[i], t[i + 1], t[i + 2], t[i + 3]
        v0, v1, v2, v3 = x[i] - level, x[i + 1] - level, x[i + 2] - level, x[i + 3] - level
        a, b, c = (v1 - v0) / (s1 - s0), (v2 - v1) / (s2 - s1), (v3 - v2) / (s3 - s2)  # divided differences
        ab, bc = (b - a) / (s2 - s0), (c - b) / (s3 - s1)
        abc = (bc - ab) / (s3 - s0)
        left, right = t[at], t[at + 1]
        for _ in range(32):  # to 2e-10 of a step
            middle = 0.5 * (left + right)
            value = v0 + (middle - s0) * (a + (middle - s1) * (ab + (middle - s2) * abc))
            if sign * value < 0:
                left = middle
            else:
                right = middle
        if n == out.size:
            longer = np.empty(2 * n)
            for k in range(n):
                longer[k] = out[k]
            out = longer
        out[n] = 0.5 * (left + right)
        n += 1
    return out[:n]
