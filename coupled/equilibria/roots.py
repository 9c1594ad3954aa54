"""Zeros of functions in brackets, many at once.

SciPy has such a solver; it would load scipy.optimize and scipy.linalg, which `explore` does not need otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from thermofem.arrays import Array, NDArray

HALVINGS = 48  # to round-off


def roots(f: Callable[[Array, NDArray[np.intp]], Array], count: int) -> Array:
    """Where each of ``count`` functions changes its sign on [0, 1], to 2^-48.

    ``f(t, which)`` takes a point for each of the functions ``which``. Straight lines between the ends of a bracket,
    moved towards its middle: some ten steps where f is smooth, and never more than one beyond those of bisection.

    Source: I. F. D. Oliveira, R. H. C. Takahashi, ACM Trans. Math. Softw. 47, 5 (2020) (ITP; n_0 = 1, k_1 = 0.2,
    k_2 = 2).
    """
    every = np.arange(count)
    a, b = np.zeros(count), np.ones(count)
    first = f(a, every)
    sign = np.where(first > 0, -1.0, 1.0)  # so that f <= 0 at a
    f_a, f_b = sign * first, sign * f(b, every)
    for step in range(HALVINGS + 1):
        k = np.flatnonzero(b - a > 2.0**-HALVINGS)
        if k.size == 0:
            break
        width, middle = b[k] - a[k], (a[k] + b[k]) / 2
        with np.errstate(all="ignore"):
            line = a[k] - f_a[k] * width / (f_b[k] - f_a[k])
        line = np.where(np.isfinite(line), line, middle)
        off = middle - line
        shift = np.maximum(0.2 * width**2, 2.0 ** -(HALVINGS + 1))  # not less: both ends are to reach the zero
        moved = np.where(np.abs(off) > shift, line + np.copysign(shift, off), middle)
        reach = np.maximum(2.0 ** (-step) - width / 2, 0.0)  # 2^-49 2^(49 - step): what bisection may still halve
        t = np.clip(moved, middle - reach, middle + reach)
        found = sign[k] * f(t, k)
        left = ~(found > 0)
        a[k], f_a[k] = np.where(left, t, a[k]), np.where(left, found, f_a[k])
        b[k], f_b[k] = np.where(left, b[k], t), np.where(left, f_b[k], found)
    return np.asarray((a + b) / 2)
