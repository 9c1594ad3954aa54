"""Any function of time as a waveform: as a piecewise cubic, fitted with error control."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval

from . import checks
from .arrays import Array, ArrayLike
from .errors import InputError
from .piecewise import NODES, TO_COEFFICIENTS, Pieces, inside
from .waveforms import TIME_HINT, TOLERANCE, Waveform, check_time

MOST_PIECES = 200_000
SHORTEST = 1e-12  # of the whole interval: where a cell this short has no cubic that fits, the function jumps in it
CHECKED = np.array([0.1273, 0.4529, 0.5471, 0.8727])  # of a cell; not evenly spaced, so that they miss no harmonic


@dataclass(frozen=True, eq=False, init=False)
class Function(Waveform, stored=False):
    """P(t) = f(t): any function of time; W as a power, Hz as a detuning.

    Models see it as a piecewise cubic, fitted with error control (`fitted`). A feature narrower than 1e-4 of
    the stretch between two breakpoints may be missed unless ``breakpoints`` or ``time_scale`` names it.

    Parameters
    ----------
    f : callable
        of the time in s; it takes an array of times, or one time only.
    breakpoints : sequence of float, s
        increasing: where f jumps or has a kink, within one period where ``period`` is given.
    period : float, s, optional
        f is taken on [0, period) and repeats.
    time_scale : float, s, optional
        the shortest time in which f changes.

    Raises
    ------
    InputError
        f fails, or returns what is not a finite number; breakpoints that do not increase.

    >>> wave = Function(lambda t: 2e-3 * np.exp(-(((t - 5e-6) / 1e-6) ** 2)))
    >>> float(wave(5e-6)), round(wave.mean(0, 10e-6) * 1e3, 4)
    (0.002, 0.3545)
    """

    f: Callable[[Any], Any]
    edges: Array
    period: float | None
    time_scale: float | None
    piecewise_linear: ClassVar[bool] = False

    def __init__(
        self,
        f: Callable[[Any], Any],
        breakpoints: ArrayLike = (),
        *,
        period: float | None = None,
        time_scale: float | None = None,
    ) -> None:
        edges = np.unique(checks.array("breakpoints", breakpoints, increasing=True, empty=True, hint=TIME_HINT))
        for name, value in (("period", period), ("time_scale", time_scale)):
            if value is not None:
                check_time(name, value)
        if period is not None:
            for edge in edges:
                checks.between("breakpoints", edge, 0, period, unit="s", hint="they lie within one period")
        for name, given in {"f": f, "edges": edges, "period": period, "time_scale": time_scale}.items():
            object.__setattr__(self, name, given)

    def _at(self, t: ArrayLike, side: str) -> Array:
        """Evaluate f at ``t`` in s; a time at a breakpoint is shifted by round-off to its ``side``."""
        u = np.asarray(t, dtype=float)
        edges = self.edges
        towards = 1 if side == "right" else -1
        if self.period is not None:
            edges = self._marks(self.period)
            shift = 4 * np.spacing(np.abs(u)) + 4 * np.spacing(self.period)
            u = np.mod(u, self.period)
            on_end = (u <= shift) | (self.period - u <= shift)
            end = 0.0 if towards > 0 else self.period
            u = np.where(on_end, end, u)
        if edges.size and u.size:
            middles = (edges[1:] + edges[:-1]) / 2
            nearest = edges[np.searchsorted(middles, u)]
            shift = 4 * np.spacing(np.abs(nearest))
            beside = nearest + 2 * towards * shift
            u = np.where(np.abs(u - nearest) <= shift, beside, u)
        return self._values(u)

    def _marks(self, period: float) -> Array:
        """Breakpoints in s within one period, and its ends."""
        return np.unique(np.concatenate([[0.0], self.edges, [period]]))

    def _values(self, t: Array) -> Array:
        values: Array | None = None
        with suppress(TypeError, ValueError, LookupError, ArithmeticError, AttributeError):  # f takes one time only
            values = np.asarray(self.f(t), dtype=float)
        if values is None or values.shape != t.shape:
            try:
                numbers = [float(self.f(float(time))) for time in t.ravel()]
            except Exception as error:
                raise InputError(f"f fails: {error!r}", "it must return a number for every time in s") from error
            values = np.array(numbers).reshape(t.shape)
        if values.size:
            largest = int(np.abs(values).argmax())  # or the first nan
            checks.finite(f"f({t.flat[largest]:g} s)", values.flat[largest])
        return values

    def breakpoints(self, start: float, stop: float) -> Array:
        """Given breakpoints in s inside (start, stop), and the ends of every period."""
        if self.period is None:
            return inside(self.edges, start, stop)
        marks = self._marks(self.period)
        one_period = Pieces(marks, np.zeros((marks.size - 1, 4)))
        return inside(one_period.repeated(start, stop).edges, start, stop)

    def pieces(self, start: float, stop: float, *, tolerance: float = TOLERANCE) -> Pieces:
        """Cubics within ``tolerance`` of the largest value; of a periodic function one period, repeated."""
        first, last = (start, stop) if self.period is None else (0.0, self.period)
        marks = np.concatenate([[first], self.breakpoints(first, last), [last]])
        whole = fitted(self, marks, tolerance)
        return whole if self.period is None else whole.repeated(start, stop).window(start, stop)


def fitted(function: Function, marks: Array, tolerance: float) -> Pieces:
    """Piecewise cubic within ``tolerance`` of the largest value of a `Function` at all checked times.

    Each cell, at first a stretch between two marks, is halved until the cubic through four points of it agrees with the
    function at every checked time in it. The checked times lie in 2^13 cells a stretch (or as many as ``time_scale``
    needs), so a feature narrower than 1e-4 of the stretch may be missed unless a breakpoint or a time scale names it.

    marks [shape (m + 1,), s]: start, breakpoints, stop.
    Raises InputError: more than 200 000 pieces are needed.
    """
    times = _checked_times(marks, function.time_scale)
    samples = function(times)
    allowed = max(tolerance * float(np.abs(samples).max()), np.finfo(float).tiny)
    begin = marks[:-1]
    end = marks[1:]
    shortest = SHORTEST * np.diff(marks)
    edges: list[Array] = []
    coefficients: list[Array] = []
    while begin.size:
        h = end - begin
        values = function(begin[:, None] + h[:, None] * NODES)
        values[:, -1] = function.before(end)
        scaled = values @ TO_COEFFICIENTS  # of (t - begin)/h
        inside_cells = begin[:, None] + h[:, None] * CHECKED
        times = np.append(times, inside_cells)
        samples = np.append(samples, function(inside_cells))
        cell = np.searchsorted(begin, times, side="right") - 1
        u = (times - begin[cell]) / h[cell]
        error = np.abs(polyval(u, scaled[cell].T, tensor=False) - samples)
        bad = np.zeros(begin.size, dtype=bool)
        bad[cell[error > allowed]] = True
        jump = bad & (h <= shortest)  # constant up to the end of the cell, where a cubic would overshoot
        scaled[jump] = values[jump, :1] * [1.0, 0.0, 0.0, 0.0]
        bad &= ~jump
        edges.append(begin[~bad])
        coefficients.append(scaled[~bad] / h[~bad, None] ** np.arange(4))
        pieces = sum(part.size for part in edges) + 2 * bad.sum()
        if pieces > MOST_PIECES:
            raise InputError(
                f"the Function needs more than {MOST_PIECES} cubics between {marks[0]:g} and {marks[-1]:g} s",
                "is it noise? give samples of it (th.Sampled), or breakpoints where it jumps",
            )
        times = times[bad[cell]]
        samples = samples[bad[cell]]
        middle = begin[bad] + h[bad] / 2
        begin = np.column_stack([begin[bad], middle]).ravel()
        end = np.column_stack([middle, end[bad]]).ravel()
        shortest = np.repeat(shortest[bad], 2)
    starts = np.concatenate(edges)
    order = np.argsort(starts)
    return Pieces(np.append(starts[order], marks[-1]), np.concatenate(coefficients)[order])


def _checked_times(marks: Array, time_scale: float | None) -> Array:
    """Times in the smallest cells that are checked: stretches between ``marks``, halved equally often or as needed."""
    lengths = np.diff(marks)
    # 13: a stretch without breakpoints is sampled in 2^13 cells: a pulse of 1e-4 of it is seen
    # 2**17: cells of all stretches together
    shared = int(np.clip(np.log2(2**17 / lengths.size), 6, 13))  # 6: where there are many stretches
    levels = np.full(lengths.size, shared)
    if time_scale is not None:
        # 22: 4 million cells take a second
        hint = "give breakpoints around the short features instead"
        checks.between("time_scale", time_scale, lengths.max() / 2**22, np.inf, unit="s", hint=hint)
        asked = np.ceil(np.log2(lengths / time_scale))
        levels = np.maximum(asked, shared).astype(int)
    times = []
    for start, length, cells in zip(marks, lengths, 2**levels, strict=False):
        share = (np.arange(cells)[:, None] + CHECKED) / cells
        times.append(start + length * share.ravel())
    return np.concatenate(times)
