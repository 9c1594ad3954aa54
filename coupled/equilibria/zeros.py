"""Roots of functions of one variable on a grid, and distances from polylines."""

from collections.abc import Callable

import numpy as np

from thermofem.arrays import Array, NDArray, runs_of

DEEP = 0.9  # a dip is followed where the parabola through it falls below this share of its lowest point
Curve = Callable[[Array], Array]  # of the parameter, shape (n,); coordinates, shape (m, n)


def newton(f: Callable[[Array], tuple[Array, Array]], ends: Array, values: Array) -> Array:
    """Return the roots in brackets by Newton's method, with bisection where a step leaves the bracket or is too long.

    f(x): values and slopes, elementwise.
    ends, values [shape (2, n)]: ends of the brackets, and f there, of opposite signs.
    """
    low, high = ends
    rises = values[1] > 0
    step = ends[1] - ends[0]
    done = np.zeros(low.shape, dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        secant = low - values[0] * step / (values[1] - values[0])
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


def zeros(
    f: Callable[[Array, NDArray[np.intp]], Array], grid: Array, count: int = 1, values: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Return the roots of ``count`` functions within an increasing grid, and the index of the function of each root.

    ``f(x, k)`` evaluates function k at x, elementwise; ``values`` are those on the grid, shape (count, n), if known.
    Two roots between neighbouring points leave no change of sign, but a local minimum of |f|: the extremum of f is then
    computed and, where f has changed sign, splits the interval. Sorted by function, then by x.
    """
    k, i = np.mgrid[:count, : grid.size]
    x, y = grid[i], f(grid[i], k) if values is None else values
    changed = (y[:, 1:] > 0) != (y[:, :-1] > 0)
    brackets = [[v[changed] for v in (x[:, :-1], x[:, 1:], y[:, :-1], y[:, 1:], k[:, 1:])]]
    before = np.abs(y[:, slice(-2)])
    here = np.abs(y[:, slice(1, -1)])
    after = np.abs(y[:, slice(2, None)])
    dip = ~changed[:, 1:] & ~changed[:, :-1] & (here < before) & (here <= after)
    dip &= (after - before) ** 2 > 8 * (1 - DEEP) * here * (before - 2 * here + after)  # by the parabola
    if dip.any():
        low, high, n = x[:, :-2][dip], x[:, 2:][dip], k[:, 1:-1][dip]
        first, middle, last = y[:, :-2][dip], y[:, 1:-1][dip], y[:, 2:][dip]
        turns = np.array([middle - first, last - middle])
        bottom = newton(lambda x: _differences(f, x, n, high - low)[1:], np.array([low, high]), turns)
        least = f(bottom, n)
        crossed = (least > 0) != (middle > 0)
        for one in ((low, bottom, first, least, n), (bottom, high, least, last, n)):
            brackets.append([v[crossed] for v in one])
    low, high, first, last, n = (np.concatenate(part) for part in zip(*brackets, strict=True))
    root = newton(lambda x: _differences(f, x, n, high - low)[:2], np.array([low, high]), np.array([first, last]))
    order = np.lexsort([root, n])
    return root[order], n[order]


def _differences(
    f: Callable[[Array, NDArray[np.intp]], Array], x: Array, k: NDArray[np.intp], width: Array
) -> tuple[Array, Array, Array]:
    """Values, first and second derivatives of functions k at x, by central differences with step 1e-5 ``width``."""
    h = 1e-5 * width
    before, here, after = f(np.array([x - h, x, x + h]), np.array([k, k, k]))
    return here, (after - before) / (2 * h), (after - 2 * here + before) / h**2


def intervals_in_window(curve: Curve, grid: Array) -> list[tuple[float, float]]:
    """Return the intervals of the curve's parameter in which all coordinates lie in [0, 1], in increasing order.

    curve: its coordinates as fractions of the window.
    grid: values of the parameter, so fine that a coordinate has at most one extremum between neighbours.
    """
    rows = len(curve(grid[:1]))

    def distance(s: Array, k: NDArray[np.intp]) -> Array:
        """Distance of the coordinate k // 2 from 0 (even k) or from 1 (odd k)."""
        coordinate = np.take_along_axis(curve(s.ravel()), k.ravel()[None] // 2, axis=0)[0]
        return coordinate.reshape(s.shape) - k % 2

    crossings, _ = zeros(distance, grid, 2 * rows)
    ends = np.unique(np.concatenate([grid[[0, -1]], crossings]))
    middles = curve((ends[1:] + ends[:-1]) / 2)
    inside = np.all((middles >= 0) & (middles <= 1), axis=0)
    return [(float(ends[a]), float(ends[b])) for a, b in runs_of(inside)]


def distances(points: Array, line: Array) -> Array:
    """Return the distances (m,) of points (m, d) from the polyline through ``line`` (n, d); inf for n = 1."""
    start, side = line[:-1], np.diff(line, axis=0)
    off = points[:, None] - start
    lengths = np.maximum((side**2).sum(axis=1), 1e-30)
    share = np.clip((off * side).sum(axis=2) / lengths, 0, 1)
    from_line = np.linalg.norm(off - share[..., None] * side, axis=2)
    return np.asarray(from_line.min(axis=1, initial=np.inf))
