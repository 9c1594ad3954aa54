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
        after = np.searchsorted(self.edges, times, side=side)  # type: ignore[call-overload]
        k = np.clip(after - 1, 0, len(self.coefficients) - 1)
        return cubic(self.coefficients[k], times - self.edges[k])

    def on(self, edges: Array) -> Pieces:
        """The same function on finer ``edges``, which include all present edges in their range."""
        if np.array_equal(edges, self.edges):
            return self
        middles = (edges[:-1] + edges[1:]) / 2
        after = np.searchsorted(self.edges, middles)
        k = np.clip(after - 1, 0, len(self.coefficients) - 1)
        u = edges[:-1] - self.edges[k]
        a, b, c, d = self.coefficients[k].T
        value = a + u * (b + u * (c + u * d))
        slope = b + u * (2 * c + 3 * u * d)
        return Pieces(edges, np.stack([value, slope, c + 3 * u * d, d], axis=1))

    def window(self, start: float, stop: float) -> Pieces:
        """The function on [start, stop]."""
        return self.on(np.concatenate([[start], inside(self.edges, start, stop), [stop]]))

    def repeated(self, start: float, stop: float) -> Pieces:
        """The function repeated periodically, over all periods that touch [start, stop]."""
        begin = self.edges[0]
        length = self.edges[-1] - begin
        first = np.floor((start - begin) / length)
        last = np.ceil((stop - begin) / length)
        cycles = np.arange(first - 1, last + 1)
        starts = self.edges[:-1] + length * cycles[:, None]
        edges = np.append(starts.ravel(), begin + length * (last + 1))
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
        value = float(function.coefficients[0, 0])
        return value, value
    length = np.diff(function.edges)
    _, b, c, d = function.coefficients.T
    root = np.sqrt(np.maximum(c * c - 3 * b * d, 0))
    q = -(c + np.copysign(root, c))  # avoids cancellation
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = [q / (3 * d), b / q]  # zeros of b + 2 c u + 3 d u^2, also where b or d is 0
    values = [cubic(function.coefficients, 0 * length), function.ends]
    for u in turns:
        inner = np.where((u > 0) & (u < length), u, 0.0)
        values.append(cubic(function.coefficients, inner))
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
    edges = []
    coefficients = []
    for stretch, checked in zip(stretches, samples, strict=True):
        begins, cubics = _stretch(function, *stretch, checked, allowed)
        edges.append(begins)
        coefficients.append(cubics)
    return Pieces(np.concatenate([*edges, marks[-1:]]), np.concatenate(coefficients))


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
    share = (np.arange(cells)[:, None] + CHECKED) / cells
    times = a + (b - a) * share.ravel()
    return times, function(times)


def _stretch(
    function: Any, a: float, b: float, level: int, samples: tuple[Array, Array], allowed: float
) -> tuple[Array, Array]:
    """Edges (all but the last) and coefficients of the cubics over [a, b], which has no breakpoints inside."""
    begin = np.array([a])
    length = b - a
    depth = 0
    done: list[Array] = []
    coefficients: list[Array] = []
    while begin.size:
        size = length / 2**depth
        end = np.minimum(begin + size, b)
        h = (end - begin)[:, None]
        t0 = begin[:, None]
        values = function(t0 + h * NODES)
        values[:, -1] = function.before(end)
        scaled = values @ TO_COEFFICIENTS
        if depth < level:
            count = CHECKED.size * 2 ** (level - depth)  # checked times in each cell
            cell = np.rint((begin - a) / size)[:, None]
            index = (cell * count + np.arange(count)).astype(np.intp)
            times = samples[0][index]
            checked = samples[1][index]
        else:
            times = t0 + h * CHECKED
            checked = function(times)
        error = np.abs(cubic(scaled[:, None], (times - t0) / h) - checked)
        bad = np.any(error > allowed, axis=1)
        if size <= SHORTEST * length:  # a jump: constant up to the end of the cell, where a cubic would overshoot
            scaled[bad] = values[bad, :1] * [1.0, 0.0, 0.0, 0.0]
            bad[:] = False
        good = ~bad
        done.append(begin[good])
        coefficients.append(scaled[good] / h[good] ** np.arange(4))
        pieces = sum(edges.size for edges in done) + 2 * bad.sum()
        if pieces > MOST_PIECES:
            raise InputError(
                f"the Function needs more than {MOST_PIECES} cubics between {a:g} and {b:g} s",
                "is it noise? give samples of it (th.Sampled), or breakpoints where it jumps",
            )
        halved = begin[bad]
        begin = np.sort(np.concatenate([halved, halved + size / 2]))
        depth += 1
    edges = np.concatenate(done)
    order = np.argsort(edges)
    return edges[order], np.concatenate(coefficients)[order]
