"""Piecewise cubics of time, and any function of time as one of them, with error control."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import checks
from .arrays import Array, ArrayLike
from .errors import InputError

MOST_PIECES = 200_000
SHORTEST = 1e-12  # of the whole interval: where a cell this short has no cubic that fits, the function jumps in it
NODES = np.array([0, 1 / 3, 2 / 3, 1])
CHECKED = np.array([0.1273, 0.4529, 0.5471, 0.8727])  # of a cell; not evenly spaced, so that they miss no harmonic
TO_COEFFICIENTS = np.linalg.inv(NODES[:, None] ** np.arange(4)).T  # values at the nodes @ this = coefficients of u^j


def cubic(coefficients: Array, u: Array) -> Array:
    """Evaluate cubics at ``u``; coefficients of rising powers stand along the last axis."""
    a = coefficients[..., 0]
    b = coefficients[..., 1]
    c = coefficients[..., 2]
    d = coefficients[..., 3]
    return np.asarray(a + u * (b + u * (c + u * d)))


class Pieces(NamedTuple):
    """A piecewise cubic: sum_j coefficients[k, j] (t - edges[k])^j between edges[k] and edges[k + 1].

    ``edges`` has shape (n + 1,), in s, increasing; ``coefficients`` has shape (n, 4).
    """

    edges: Array
    coefficients: Array

    @classmethod
    def constant(cls, start: float, stop: float, value: float) -> Pieces:
        """A constant value over [start, stop]."""
        return cls(np.array([start, stop]), np.array([[value, 0.0, 0.0, 0.0]]))

    @property
    def steady(self) -> bool:
        """Whether it is one constant."""
        return len(self.coefficients) == 1 and not self.coefficients[0, 1:].any()

    def __call__(self, t: ArrayLike, side: str = "right") -> Array:
        """Value at ``t``, continuous from that ``side``; the first and last cubic continue outside the edges."""
        times = np.asarray(t, dtype=float)
        if self.steady:
            return np.full(times.shape, self.coefficients[0, 0])
        k = np.clip(np.searchsorted(self.edges, times, side=side) - 1, 0, len(self.coefficients) - 1)  # type: ignore[call-overload]
        return cubic(self.coefficients[k], times - self.edges[k])

    def on(self, edges: Array) -> Pieces:
        """The same function on finer ``edges``, which include all present edges in their range."""
        if np.array_equal(edges, self.edges):
            return self
        k = np.clip(np.searchsorted(self.edges, (edges[:-1] + edges[1:]) / 2) - 1, 0, len(self.coefficients) - 1)
        u, (a, b, c, d) = edges[:-1] - self.edges[k], self.coefficients[k].T
        moved = [a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), c + 3 * u * d, d]
        return Pieces(edges, np.stack(moved, axis=1))

    def window(self, start: float, stop: float) -> Pieces:
        """The function on [start, stop]."""
        return self.on(np.concatenate([[start], inside(self.edges, start, stop), [stop]]))

    def repeated(self, start: float, stop: float) -> Pieces:
        """The function repeated periodically, over all periods that touch [start, stop]."""
        length = self.edges[-1] - self.edges[0]
        first = np.floor((start - self.edges[0]) / length)
        last = np.ceil((stop - self.edges[0]) / length)
        cycles = np.arange(first - 1, last + 1)
        edges = np.append((self.edges[:-1] + length * cycles[:, None]).ravel(), self.edges[0] + length * (last + 1))
        return Pieces(edges, np.tile(self.coefficients, (cycles.size, 1)))

    def times(self, factor: float) -> Pieces:
        """The function multiplied by a number."""
        return Pieces(self.edges, self.coefficients * factor)

    @property
    def ends(self) -> Array:
        """The value at the end of every piece, shape (n,)."""
        return cubic(self.coefficients, np.diff(self.edges))

    def integral(self) -> float:
        """Integral over all pieces."""
        a, b, c, d = self.coefficients.T
        u = np.diff(self.edges)
        return float(np.sum(u * (a + u * (b / 2 + u * (c / 3 + u * d / 4)))))


def inside(times: Array, start: float, stop: float) -> Array:
    """The times strictly inside (start, stop), up to round-off."""
    slack = 1e-12 * max(abs(start), abs(stop))
    return times[(times > start + slack) & (times < stop - slack)]


def hermite(times: Array, values: Array, first: Array, last: Array) -> Pieces:
    """Cubics through values, shape (n + 1,), with slopes at the start and the end of each piece, shape (n,)."""
    h = np.diff(times)
    mean = np.diff(values) / h
    square = (3 * mean - 2 * first - last) / h
    cube = (first + last - 2 * mean) / h**2
    return Pieces(times, np.stack([values[:-1], first, square, cube], axis=1))


def interpolated(function: Any, edges: Array) -> Pieces:
    """Cubics between ``edges`` through four values of ``function(times, side)`` each, those at both ends among them."""
    h = np.diff(edges)[:, None]
    values = function(edges[:-1, None] + h * NODES, "right")
    values[:, -1] = function(edges[1:], "left")
    return Pieces(edges, values @ TO_COEFFICIENTS / h ** np.arange(4))


def bounds(function: Pieces) -> tuple[float, float]:
    """Lowest and highest value of a piecewise cubic."""
    if function.steady:
        return (value := float(function.coefficients[0, 0])), value
    length, (_, b, c, d) = np.diff(function.edges), function.coefficients.T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -(c + np.copysign(np.sqrt(np.maximum(c * c - 3 * b * d, 0)), c))  # avoids cancellation
        turns = [far / (3 * d), b / far]  # zeros of b + 2 c u + 3 d u^2, also where b or d is 0
    within = [np.where((u > 0) & (u < length), u, 0.0) for u in turns]
    values = [cubic(function.coefficients, u) for u in (0 * length, length, *within)]
    return float(np.min(values)), float(np.max(values))


def fitted(function: Any, marks: Array, tolerance: float) -> Pieces:
    """Piecewise cubic within ``tolerance`` of the largest value of a `waveforms.Function` at all checked times.

    Each stretch between two marks is halved until the cubic through four points of a cell agrees with the function at
    every checked time in it. The checked times lie in 2^13 cells a stretch (or as many as ``time_scale`` needs), so a
    feature narrower than 1e-4 of the stretch may be missed unless a breakpoint or a time scale names it.

    marks [shape (m + 1,), s]: start, breakpoints, stop.
    Raises InputError: more than 200 000 pieces are needed.
    """
    levels = _levels(function, marks)
    stretches = list(zip(marks[:-1].tolist(), marks[1:].tolist(), levels, strict=True))
    samples = [_samples(function, a, b, 2**level) for a, b, level in stretches]
    peak = max(float(np.abs(values).max()) for _, values in samples)
    allowed = max(tolerance * peak, np.finfo(float).tiny)
    cells = [_stretch(function, *stretch, seen, allowed) for stretch, seen in zip(stretches, samples, strict=True)]
    return Pieces(np.append(np.concatenate([c[0] for c in cells]), marks[-1]), np.concatenate([c[1] for c in cells]))


def _levels(function: Any, marks: Array) -> list[int]:
    """For each stretch, how often it is halved down to the smallest cells that are checked."""
    lengths = np.diff(marks)
    # 13: a stretch without breakpoints is sampled in 2^13 cells: a pulse of 1e-4 of it is seen
    # 2**17: cells of all stretches together
    shared = int(np.clip(np.log2(2**17 / lengths.size), 6, 13))  # 6: where there are many stretches
    if function.time_scale is None:
        return [shared] * lengths.size
    # 22: 4 million cells take a second
    hint = "give breakpoints around the short features instead"
    checks.between("time_scale", function.time_scale, lengths.max() / 2**22, np.inf, unit="s", hint=hint)
    asked = np.ceil(np.log2(lengths / function.time_scale))
    return np.maximum(asked, shared).astype(int).tolist()


def _samples(function: Any, a: float, b: float, cells: int) -> tuple[Array, Array]:
    """Sorted checked times in all cells of [a, b], and the function's values there."""
    times = a + (b - a) * ((np.arange(cells)[:, None] + CHECKED) / cells).ravel()
    return times, function(times)


def _stretch(
    function: Any, a: float, b: float, level: int, seen: tuple[Array, Array], allowed: float
) -> tuple[Array, Array]:
    """Edges (all but the last) and coefficients of the cubics over [a, b], which has no breakpoints inside."""
    left = np.array([a])
    length = b - a
    depth = 0
    done: list[tuple[Array, Array]] = []
    while left.size:
        size = length / 2**depth
        last = np.minimum(left + size, b)
        values = function(left[:, None] + (last - left)[:, None] * NODES)
        values[:, -1] = function.before(last)
        scaled = values @ TO_COEFFICIENTS
        if depth < level:
            count = CHECKED.size * 2 ** (level - depth)  # checked times in each cell
            index = (np.rint((left - a) / size)[:, None] * count + np.arange(count)).astype(np.intp)
            times, checked = seen[0][index], seen[1][index]
        else:
            times = left[:, None] + (last - left)[:, None] * CHECKED
            checked = function(times)
        u = (times - left[:, None]) / (last - left)[:, None]
        bad = np.any(np.abs(cubic(scaled[:, None], u) - checked) > allowed, axis=1)
        if size <= SHORTEST * length:  # a jump: constant up to the end of the cell, where a cubic would overshoot
            scaled[bad] = values[bad, :1] * [1.0, 0.0, 0.0, 0.0]
            bad[:] = False
        h = (last - left)[~bad, None]
        done.append((left[~bad], scaled[~bad] / h ** np.arange(4)))
        if sum(d[0].size for d in done) + 2 * bad.sum() > MOST_PIECES:
            raise InputError(
                f"the Function needs more than {MOST_PIECES} cubics between {a:g} and {b:g} s",
                "is it noise? give samples of it (th.Sampled), or breakpoints where it jumps",
            )
        left = np.sort(np.concatenate([left[bad], left[bad] + size / 2]))
        depth += 1
    edges = np.concatenate([d[0] for d in done])
    order = np.argsort(edges)
    return edges[order], np.concatenate([d[1] for d in done])[order]
