"""Zeros of functions in brackets, many at once, and all of one function on a grid.

SciPy has such a solver; it would load scipy.optimize and scipy.linalg, which `explore` does not need otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from thermofem.arrays import Array, NDArray

HALVINGS = 48  # to round-off
GOLDEN = 40  # steps of golden section: a minimum is flat to round-off within 1e-8 of its bracket


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


def crossings(f: Callable[[Array], Array], grid: Array) -> Array:
    """Every place on an increasing grid where ``f`` changes its sign, in increasing order.

    Two of them between neighbours of the grid leave a minimum of |f| without a change of sign, which is followed down
    to the change.
    """
    values = f(grid)
    size, positive = np.abs(np.pad(values, 1, constant_values=np.inf)), np.pad(values > 0, 1, mode="edge")
    alike = (positive[1:-1] == positive[:-2]) & (positive[1:-1] == positive[2:])
    k = np.flatnonzero(alike & (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]))
    sign = np.where(positive[k + 1], 1.0, -1.0)
    ends = grid[np.maximum(k - 1, 0)], grid[np.minimum(k + 1, grid.size - 1)]
    points = np.unique(np.concatenate([grid, _lowest(lambda x: sign * f(x), *ends)])) if k.size else grid
    above = f(points) > 0
    at = np.flatnonzero(above[1:] != above[:-1])
    width = points[at + 1] - points[at]
    return np.asarray(points[at] + width * roots(lambda t, which: f(points[at[which]] + t * width[which]), at.size))


def _lowest(f: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """The minima of functions between ``low`` and ``high`` by golden section, which ends where they are negative."""
    golden = (np.sqrt(5) - 1) / 2
    a, b = high - golden * (high - low), low + golden * (high - low)
    f_a, f_b = f(a), f(b)
    for _ in range(GOLDEN):
        left = f_a < f_b
        if np.all(np.minimum(f_a, f_b) < 0):
            break
        low, high = np.where(left, low, a), np.where(left, b, high)
        new = np.where(left, high - golden * (high - low), low + golden * (high - low))
        f_new = f(new)
        a, b = np.where(left, new, b), np.where(left, a, new)
        f_a, f_b = np.where(left, f_new, f_b), np.where(left, f_a, f_new)
    return np.where(f_a < f_b, a, b)
