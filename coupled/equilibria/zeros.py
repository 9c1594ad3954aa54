"""Roots of functions of one variable on a grid, and distances from polylines."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from thermofem.arrays import Array, Indices, Mask, runs_of

Curve = Callable[[Array], Array]  # of the parameter, shape (n,); coordinates, shape (m, n)
Functions = Callable[[Array, Indices], Array]  # values of the functions of given numbers at x, elementwise


def newton(f: Callable[[Array], tuple[Array, Array]], low: Array, high: Array, first: Array, last: Array) -> Array:
    """Return the roots in brackets by Newton's method, with bisection where a step leaves the bracket or is too long.

    f(x): values and slopes, elementwise.
    low, high [shape (n,)]: ends of the brackets; first, last: f there, of opposite signs.
    """
    rises = last > 0
    step = high - low
    done = np.zeros(low.shape, dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        secant = low - first * step / (last - first)
        x = np.fmin(np.fmax(secant, low), high)
        for _ in range(200):
            value, slope = f(x)
            beyond = (value > 0) == rises
            low = np.where(beyond, low, x)
            high = np.where(beyond, x, high)
            following = x - value / slope
            inside = (low <= following) & (following <= high)
            halved = 2 * np.abs(following - x) <= np.abs(step)
            good = inside & halved
            following = np.where(good, following, (low + high) / 2)
            step = following - x
            x = np.where(done, x, following)
            converged = good & (np.abs(step) < 1e-9)
            closed = high - low <= 4e-16 * np.abs(x)
            done |= converged | closed
            if done.all():  # the error is the square of a step
                break
    return x


class Brackets(NamedTuple):
    """Intervals with one root each: ends, values there, and the number of the function."""

    low: Array
    high: Array
    first: Array
    last: Array
    number: Indices

    @classmethod
    def joined(cls, parts: Sequence[Sequence[Array | Indices]]) -> Self:
        """The intervals of all parts."""
        columns: Any = zip(*parts, strict=True)
        return cls(*map(np.concatenate, columns))


def zeros(f: Functions, grid: Array, count: int = 1, values: Array | None = None) -> tuple[Array, Indices]:
    """Return the roots of ``count`` functions within an increasing grid, and the index of the function of each root.

    ``f(x, k)`` evaluates function k at x, elementwise; ``values`` are those on the grid, shape (count, n), if known.
    Two roots between neighbouring points leave no change of sign, but a local minimum of |f|: the extremum of f is then
    computed and, where f has changed sign, splits the interval. Sorted by function, then by x.
    """
    k, i = np.mgrid[:count, : grid.size]
    y = f(grid[i], k) if values is None else values
    positive = y > 0
    changed = positive[:, 1:] != positive[:, :-1]
    row, column = np.nonzero(changed)
    signs = (grid[column], grid[column + 1], y[row, column], y[row, column + 1], row)
    low, high, first, last, number = Brackets.joined([signs, *_brackets_in_dips(f, grid, y, ~changed)])

    def value_and_slope(x: Array) -> tuple[Array, Array]:
        value, slope, _ = _differences(f, x, number, high - low)
        return value, slope

    root = newton(value_and_slope, low, high, first, last)
    order = np.lexsort([root, number])
    return root[order], number[order]


def _brackets_in_dips(f: Functions, grid: Array, y: Array, unchanged: Mask) -> list[list[Array | Indices]]:
    """Both halves of every interval around a local minimum of |f| whose extremum has the other sign."""
    size = np.abs(y)
    before = size[:, :-2]
    here = size[:, 1:-1]
    after = size[:, 2:]
    dip = unchanged[:, 1:] & unchanged[:, :-1]
    dip &= here < before
    dip &= here <= after
    curvature = before - 2 * here + after
    # a dip is followed where the parabola through it falls below 0.9 of its lowest point
    drop = 8 * (1 - 0.9) * here * curvature
    dip &= (after - before) ** 2 > drop  # by the parabola
    if not dip.any():
        return []
    row, column = np.nonzero(dip)
    low = grid[column]
    high = grid[column + 2]
    first, middle, last = y[row, column + np.arange(3)[:, None]]

    def slope_and_curvature(x: Array) -> tuple[Array, Array]:
        _, slope, bend = _differences(f, x, row, high - low)
        return slope, bend

    bottom = newton(slope_and_curvature, low, high, middle - first, last - middle)
    least = f(bottom, row)
    crossed = (least > 0) != (middle > 0)
    left = (low, bottom, first, least, row)
    right = (bottom, high, least, last, row)
    return [[column[crossed] for column in side] for side in (left, right)]


def _differences(f: Functions, x: Array, k: Indices, width: Array) -> tuple[Array, Array, Array]:
    """Values, first and second derivatives of functions k at x, by central differences with step 1e-5 ``width``."""
    h = 1e-5 * width
    points = np.array([x - h, x, x + h])
    before, here, after = f(points, np.array([k, k, k]))
    slope = (after - before) / (2 * h)
    curvature = (after - 2 * here + before) / h**2
    return here, slope, curvature


def intervals_in_window(curve: Curve, grid: Array) -> list[tuple[float, float]]:
    """Return the intervals of the curve's parameter in which all coordinates lie in [0, 1], in increasing order.

    curve: its coordinates as fractions of the window.
    grid: values of the parameter, so fine that a coordinate has at most one extremum between neighbours.
    """
    rows = len(curve(grid[:1]))

    def distance(s: Array, k: Indices) -> Array:
        """Distance of the coordinate k // 2 from 0 (even k) or from 1 (odd k)."""
        coordinates = curve(s.ravel())
        row = k.ravel()[None] // 2
        coordinate = np.take_along_axis(coordinates, row, axis=0)
        return coordinate.reshape(s.shape) - k % 2

    crossings, _ = zeros(distance, grid, 2 * rows)
    outer = grid[[0, -1]]
    ends = np.unique(np.concatenate([outer, crossings]))
    middles = curve((ends[1:] + ends[:-1]) / 2)
    in_window = (middles >= 0) & (middles <= 1)
    inside = np.all(in_window, axis=0)
    return [(float(ends[a]), float(ends[b])) for a, b in runs_of(inside)]


def distances(points: Array, line: Array) -> Array:
    """Return the distances (m,) of points (m, d) from the polyline through ``line`` (n, d); inf for n = 1."""
    start = line[:-1]
    side = np.diff(line, axis=0)
    off = points[:, None] - start
    lengths = np.maximum((side**2).sum(axis=1), 1e-30)
    share = np.clip((off * side).sum(axis=2) / lengths, 0, 1)
    from_line = np.linalg.norm(off - share[..., None] * side, axis=2)
    return from_line.min(axis=1, initial=np.inf)
