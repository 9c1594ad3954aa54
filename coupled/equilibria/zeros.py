"""Zeros of functions of one variable on a grid, and lines in a plane or in space."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import elementwise

from thermofem.arrays import Array, NDArray, runs_of

DEEP = 0.9  # a dip is followed where the parabola through it falls below this share of its lowest point
Curve = Callable[[Array], Array]  # of the parameter, shape (n,); coordinates, shape (m, n)


def zeros(f: Callable[[Array, NDArray[np.intp]], Array], grid: Array, count: int = 1) -> tuple[Array, NDArray[np.intp]]:
    """Return the zeros of ``count`` functions between points of an increasing grid, and which function each is of.

    ``f(x, k)`` evaluates function k at x, elementwise. Two zeros between neighbours of the grid leave a minimum of |f|
    without a change of sign, which is followed down to the change. Sorted by function, then by x.
    """
    k, i = np.mgrid[:count, : grid.size]
    values = f(grid[i], k)
    positive, size = values > 0, np.abs(values)
    left, right, of = grid[i[:, :-1]], grid[i[:, 1:]], k[:, 1:]
    changed = positive[:, 1:] != positive[:, :-1]
    brackets = [(left[changed], right[changed], of[changed])]
    alike = (positive[:, 1:-1] == positive[:, :-2]) & (positive[:, 1:-1] == positive[:, 2:])
    dip = alike & (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:]) & _deep(size)
    if dip.any():
        low, middle, high, which = left[:, :-1][dip], right[:, :-1][dip], right[:, 1:][dip], of[:, :-1][dip]
        sign = np.where(positive[:, 1:-1][dip], 1.0, -1.0)
        found = elementwise.find_minimum(lambda x, s, n: s * f(x, n), (low, middle, high), args=(sign, which))
        below = found.f_x < 0
        bottom = found.x[below]
        brackets += [(low[below], bottom, which[below]), (bottom, high[below], which[below])]
    a, b, n = (np.concatenate(part) for part in zip(*brackets, strict=True))
    x = elementwise.find_root(f, (a, b), args=(n,)).x if a.size else a
    order = np.lexsort([x, n])
    return x[order], n[order]


def _deep(size: Array) -> NDArray[np.bool_]:
    """Whether the parabola through three neighbours of an even grid falls below the share DEEP of their middle."""
    before, middle, after = size[:, :-2], size[:, 1:-1], size[:, 2:]
    return np.asarray((after - before) ** 2 > 8 * (1 - DEEP) * middle * (before - 2 * middle + after))


def intervals_in_window(curve: Curve, grid: Array) -> list[tuple[float, float]]:
    """Return the intervals of the parameter in which every coordinate lies in [0, 1], in increasing order.

    curve: its coordinates as fractions of the window.
    grid: of the parameter, fine enough that a coordinate turns at most once between two of its points.
    """
    rows = len(curve(grid[:1]))

    def distance(s: Array, k: NDArray[np.intp]) -> Array:
        return np.take_along_axis(curve(s.ravel()), k.ravel()[None] // 2, axis=0)[0].reshape(s.shape) - k % 2

    ends = np.unique(np.concatenate([grid[[0, -1]], zeros(distance, grid, 2 * rows)[0]]))
    middles = curve((ends[1:] + ends[:-1]) / 2)
    inside = np.all((middles >= 0) & (middles <= 1), axis=0)
    return [(float(ends[a]), float(ends[b])) for a, b in runs_of(inside)]


def distances(points: Array, line: Array) -> Array:
    """Return how far points are from a line through others; shapes (m, d) and (n, d) to (m,)."""
    start, side = line[:-1], np.diff(line, axis=0)
    off = points[:, None] - start
    share = np.clip((off * side).sum(axis=2) / np.maximum((side**2).sum(axis=1), 1e-30), 0, 1)
    return np.asarray(np.linalg.norm(off - share[..., None] * side, axis=2).min(axis=1, initial=np.inf))
