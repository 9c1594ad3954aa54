"""Piecewise polynomials of time."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import PPoly

from .arrays import Array, ArrayLike

Evaluated: TypeAlias = Callable[[Array], Array]
NODES = np.array([0, 1 / 3, 2 / 3, 1])
TO_COEFFICIENTS = np.linalg.inv(NODES[:, None] ** np.arange(4)).T  # values at the nodes @ this = coefficients of u^j


class Pieces(PPoly):
    """A piecewise polynomial: sum_j coefficients[k, j] (t - edges[k])^j between edges[k] and edges[k + 1].

    SciPy's `PPoly` evaluates, integrates and differentiates it; its ``x`` are the edges, its ``c`` the coefficients,
    highest power first. The first and the last polynomial continue outside the edges. Several functions on common edges
    have coefficients of shape (n, functions, terms), and values of shape (times, functions).

    edges [shape (n + 1,), s]: increasing.
    coefficients [shape (n, 4)]
    """

    def __init__(self, edges: Array, coefficients: Array) -> None:
        super().__init__(np.moveaxis(coefficients, -1, 0)[::-1], edges)

    @classmethod
    def constant(cls, start: float, stop: float, value: ArrayLike) -> Pieces:
        """A constant value over [start, stop]; of several functions, values of shape (functions,)."""
        c = np.zeros((4, 1, *np.shape(value)))
        c[-1] = value
        return cls.construct_fast(c, np.array([start, stop], dtype=float))

    @cached_property
    def edges(self) -> Array:
        """Ends of the pieces in s, shape (n + 1,)."""
        return np.asarray(self.x)

    @property
    def coefficients(self) -> Array:
        """Coefficients of rising powers, shape (n, terms)."""
        return np.asarray(self.c[::-1].T)

    @property
    def steady(self) -> bool:
        """Whether it is one constant."""
        c = self.c
        return c.shape[1] == 1 and not c[:-1].any()

    def before(self, t: ArrayLike) -> Array:
        """Limit from the left at ``t``, up to the slope times round-off of ``t``; a call gives that from the right."""
        return np.asarray(self(np.nextafter(t, -np.inf)))

    def on(self, edges: Array) -> Pieces:
        """The same cubics on finer ``edges``, which include all present edges in their range."""
        if np.array_equal(edges, self.edges):
            return self
        middles = (edges[:-1] + edges[1:]) / 2
        k = np.searchsorted(self.edges[1:-1], middles)
        u = edges[:-1] - self.edges[k]
        d, c, b, a = self.c[:, k]
        value = a + u * (b + u * (c + u * d))
        slope = b + u * (2 * c + 3 * u * d)
        return self.construct_fast(np.stack([d, c + 3 * u * d, slope, value]), edges)

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
        return self.construct_fast(np.tile(self.c, (1, cycles.size)), edges)

    def times(self, factor: float) -> Pieces:
        """The function multiplied by a number."""
        return self.construct_fast(self.c * factor, self.edges)

    @property
    def ends(self) -> Array:
        """The value at the end of every piece, shape (n,)."""
        return self.before(self.edges[1:])


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


def interpolated(function: Evaluated, before: Evaluated, edges: Array) -> Pieces:
    """Cubics between ``edges`` through four values of a ``function`` each, the last one its limit from ``before``."""
    h = np.diff(edges)[:, None]
    values = function(edges[:-1, None] + h * NODES)
    values[:, -1] = before(edges[1:])
    return Pieces(edges, values @ TO_COEFFICIENTS / h ** np.arange(4))


def bounds(function: Pieces) -> tuple[float, float]:
    """Lowest and highest value of a piecewise cubic."""
    if function.steady:
        value = float(function.c[-1, 0])
        return value, value
    turns = function.derivative().roots(discontinuity=False, extrapolate=False)  # nan where a piece is constant
    extremes = function(turns[np.isfinite(turns)])
    values = np.concatenate([function.c[-1], function.ends, extremes])
    return float(values.min()), float(values.max())
