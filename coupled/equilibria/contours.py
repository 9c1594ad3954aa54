"""Zeros of functions of one variable on a grid, and zero contours of functions of two on a lattice.

The lattice gets more lines where contours need them. A closed contour that is smaller than a cell changes no sign on
it: it lies where the function has an extremum that comes near zero. Of one that is a few cells wide the ends are cut
off. Where two contours cross, a lattice does not tell which of four ways belong together.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import contourpy
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import elementwise

from thermofem.arrays import Array, NDArray, runs_of

DEEP = 0.9  # a dip is followed where the parabola through it falls below this share of its lowest point
Curve = Callable[[Array], Array]  # of the parameter, shape (n,); coordinates, shape (m, n)
WIDE = 12  # cells: a contour that is as wide in both directions is resolved
LINES = 16  # through the place of a small one
FINEST = 1e-3  # distance of lines, in logarithms: a thousandth of U and w
MOST = 1200  # lines in either direction
Box = tuple[int, int, int, int]  # first and last line in either direction


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


def equidistant(curve: Curve, intervals: list[tuple[float, float]], count: int) -> list[Array]:
    """Return parameters of points at equal distances in the drawn plane, with the ends of each interval.

    At most ``count`` points in all.
    """
    fine = [np.linspace(low, high, count) for low, high in intervals]
    drawn = [curve(s) for s in fine]
    size = np.maximum(np.ptp(np.concatenate(drawn, axis=1), axis=1), 1e-300)[:, None]
    steps = [np.sqrt(np.sum((np.diff(points, axis=1) / size) ** 2, axis=0)) for points in drawn]
    lengths = [np.concatenate([[0], np.cumsum(step)]) for step in steps]
    total = max(sum(length[-1] for length in lengths), 1e-300)
    counts = [2 + int((count - 2 * len(intervals)) * length[-1] / total) for length in lengths]
    return [
        np.interp(np.linspace(0, length[-1], number), length, s)
        for s, length, number in zip(fine, lengths, counts, strict=True)
    ]


class Segment(NamedTuple):
    """A part of a curve, a point in each column."""

    points: Array
    cut: tuple[bool, bool]  # whether it was cut where it starts, and where it ends


def refined(values: Callable[[Array, Array], tuple[Array, Array, Array]], x: Array, y: Array) -> tuple[Array, Array]:
    """Insert lattice lines where contours are small, nearly touch or cross.

    values: the function whose contours are wanted, and two others; where all three vanish, two contours cross.
    """
    for _ in range(3):
        z, *both = values(x, y)
        boxes = [*_dips(z), *_small(z), *_crossings(z, both)]
        wider = _with_lines(x, [box[:2] for box in boxes]), _with_lines(y, [box[2:] for box in boxes])
        if wider[0].size + wider[1].size == x.size + y.size or max(map(len, wider)) > MOST:
            break
        x, y = wider
    return x, y


def one_sign(z: Array, points: int = 3) -> NDArray[np.bool_]:
    """Whether the values at each square of ``points`` have one sign."""
    square = sliding_window_view(z, (points, points))
    return np.asarray((square.min(axis=(2, 3)) > 0) | (square.max(axis=(2, 3)) < 0))


def _reach(z: Array) -> Array:
    """Bound on |z| at each inner point minus its minimum between lines, by parabolas through nine points."""
    nine = np.abs(sliding_window_view(z, (3, 3)))  # about every inner point
    total = np.abs(nine[..., 2, 2] - nine[..., 2, 0] - nine[..., 0, 2] + nine[..., 0, 0]) / 4
    for before, after in ((nine[..., 1, 0], nine[..., 1, 2]), (nine[..., 0, 1], nine[..., 2, 1])):
        bend = before - 2 * nine[..., 1, 1] + after
        total += np.where(bend > 0, (after - before) ** 2 / (8 * np.where(bend > 0, bend, 1.0)), 0.0)
    return np.asarray(total)


def _boxes(marked: NDArray[np.bool_]) -> Iterator[Box]:
    """The cells about the marked inner points."""
    for i, j in zip(*np.nonzero(marked), strict=True):
        yield int(j), int(j) + 2, int(i), int(i) + 2


def _dips(z: Array) -> Iterator[Box]:
    """Where a function of one sign comes near zero between lines."""
    lowest = np.abs(z[1:-1, 1:-1]) <= np.abs(sliding_window_view(z, (3, 3))).min(axis=(2, 3))
    yield from _boxes(lowest & one_sign(z) & (np.abs(z[1:-1, 1:-1]) <= 2 * _reach(z)))


def _crossings(z: Array, both: Sequence[Array]) -> Iterator[Box]:
    """Where two contours cross."""
    yield from _boxes(~one_sign(z) & ~one_sign(both[0]) & ~one_sign(both[1]))


def _small(z: Array) -> Iterator[Box]:
    """Boxes around closed contours that are less than `WIDE` cells wide, with a cell on either side."""
    for line in contourpy.contour_generator(z=z).lines(0.0):
        low, high = np.floor(np.min(line, axis=0)).astype(int), np.ceil(np.max(line, axis=0)).astype(int)
        if np.min(high - low) < WIDE and np.array_equal(line[0], line[-1]):
            (a, c), (b, d) = np.maximum(low - 1, 0), np.minimum(high + 1, np.array(z.shape)[::-1] - 1)
            yield int(a), int(b), int(c), int(d)


def _with_lines(x: Array, spans: Sequence[tuple[int, int]]) -> Array:
    """The lines x with `LINES` of them in each of the ``spans`` that has fewer."""
    new = [np.linspace(x[a], x[b], LINES) for a, b in set(spans) if b - a < LINES and x[b] - x[a] > FINEST * LINES]
    if not new:
        return x
    every = np.unique(np.concatenate([x, *new]))
    apart = np.append(True, np.diff(every) > FINEST / 2)
    return np.asarray(every[apart])


def joined(pieces: list[Segment], place: Callable[[Array], Array], farthest: float) -> list[Array]:
    """Join segments at their cut ends, the nearest pair first; ``place`` maps points to the space of the distances."""
    lines = list(pieces)
    while True:
        at = {(k, e): place(piece.points[:, -e]) for k, piece in enumerate(lines) for e in (0, 1) if piece.cut[e]}
        ends = list(at)
        pairs = [(float(np.linalg.norm(at[p] - at[q])), p, q) for i, p in enumerate(ends) for q in ends[i + 1 :]]
        distance, (k, e), (m, f) = min(pairs, default=(np.inf, (0, 0), (0, 0)))
        if distance > farthest:
            return [line.points for line in lines]
        first, second = lines[k], lines[m]
        if k == m:  # a closed curve
            lines[k] = Segment(np.column_stack([first.points, first.points[:, :1]]), (False, False))
            continue
        one = first.points if e == 1 else first.points[:, ::-1]
        two = second.points if f == 0 else second.points[:, ::-1]
        both = Segment(np.column_stack([one, two]), (first.cut[1 - e], second.cut[1 - f]))
        lines = [line for i, line in enumerate(lines) if i not in (k, m)] + [both]
