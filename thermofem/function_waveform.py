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


def _levels(function: Function, marks: Array) -> list[int]:
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


def _samples(function: Function, a: float, b: float, cells: int) -> tuple[Array, Array]:
    """Sorted checked times in all cells of [a, b], and the function's values there."""
    share = (np.arange(cells)[:, None] + CHECKED) / cells
    times = a + (b - a) * share.ravel()
    return times, function(times)


def _stretch(
    function: Function, a: float, b: float, level: int, samples: tuple[Array, Array], allowed: float
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
        cubics = polyval((times - t0) / h, scaled.T[:, :, None], tensor=False)
        error = np.abs(cubics - checked)
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
