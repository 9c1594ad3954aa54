"""Waveforms: powers over time, as cubics between breakpoints.

A waveform heats a part or is the power of a laser (W); `coupled` takes it as a detuning (Hz), too. Every one is a
`Waveform`, so that every model takes it:

1. ``wave(t)`` is the value at ``t`` in s, continuous from the right; ``wave.before(t)`` is the limit from the left.
2. ``wave.breakpoints(start, stop)`` are the times strictly inside where it jumps or has a kink; every integrator ends a
   step there.
3. ``wave.pieces(start, stop)`` is the waveform as cubics (`piecewise.Pieces`), exact but for a `Function`.
4. ``wave.mean(start, stop)`` is the mean, exact for the same kinds.
5. ``wave.period`` in s, or None; ``wave.piecewise_linear``; ``wave.words`` describe it.

To add a waveform, write a dataclass of numbers and arrays here that has ``whole``, its pieces, and joins `Waveform`
(or `Steps`, for a power that is constant between times); a file then holds it by its name. One instance goes into
tests/test_every_waveform.py, which drives every model with it.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from . import checks
from .arrays import Array, ArrayLike
from .errors import Hint, InputError
from .piecewise import Pieces, bounds, inside

TIME_HINT = Hint("times are in s (did you mean 1e-6 for 1 us?)")
ENDLESS = 1e12  # s: where a power that is held before its first and after its last change ends
MOST_CYCLES = 1e6  # periods that a call may span
TOLERANCE = 1e-8  # of a cubic fit, relative to the largest value: far below the default rtol of every model
STORED = 1e-7  # of a function by the cubics that a file keeps
KINDS: dict[str, type[Waveform]] = {}  # waveforms that a file can hold, by name


class Waveform:
    """A power over time; the module's docstring lists what holds for every waveform."""

    piecewise_linear: ClassVar[bool] = True
    period: float | None = None  # s
    whole: Pieces  # all pieces, or those of one period

    def __init_subclass__(cls, *, stored: bool = True) -> None:
        """Register a subclass under its name, by which files refer to it, unless ``stored`` is False."""
        if stored:
            KINDS[cls.__name__] = cls

    @property
    def words(self) -> str:
        """A short description for labels and tables."""
        return type(self).__name__.lower()

    def _unrolled(self, start: float, stop: float) -> Pieces:
        """Cubic pieces of the waveform; of a periodic one those of every period that touches [start, stop]."""
        if self.period is None:
            return self.whole
        hint = "take a shorter run, or solve_periodic for settled heat"
        periods = (stop - start) / self.period
        checks.between(f"periods of {self.period:g} s", periods, 0, MOST_CYCLES, hint=hint)
        return self.whole.repeated(start, stop)

    def _covering(self, start: float, stop: float) -> Pieces:
        """Cubic pieces that cover [start, stop] in s; InputError where the waveform does not reach that far."""
        return covering(type(self).__name__, self._unrolled(start, stop), start, stop)

    def _at(self, t: ArrayLike, side: str) -> Array:
        times = np.asarray(t, dtype=float)
        if not times.size:
            return np.zeros(times.shape)
        pieces = self._covering(times.min(), times.max())
        return np.asarray(pieces(times)) if side == "right" else pieces.before(times)

    def __call__(self, t: ArrayLike) -> Array:
        """The value at ``t`` in s, continuous from the right."""
        return self._at(t, "right")

    def before(self, t: ArrayLike) -> Array:
        """The limit from the left at ``t`` in s."""
        return self._at(t, "left")

    def pieces(self, start: float, stop: float, *, tolerance: float = TOLERANCE) -> Pieces:
        """The waveform as cubics over [start, stop] in s; ``tolerance`` bounds the error of a fitted function."""
        return self._covering(start, stop).window(start, stop)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Times strictly inside (start, stop) in s where the value jumps or has a kink."""
        return inside(self._unrolled(start, stop).edges, start, stop)

    def mean(self, start: float, stop: float) -> float:
        """Mean value over [start, stop] in s."""
        return float(self.pieces(start, stop).integrate(start, stop)) / (stop - start)


def covering(name: str, whole: Pieces, start: float, stop: float) -> Pieces:
    """The pieces of an input called ``name``; InputError where they do not cover [start, stop] in s."""
    first, last = whole.edges[[0, -1]]
    slack = 1e-9 * (last - first)
    early = start < first - slack
    if early or stop > last + slack:
        unknown = start if early else stop
        raise InputError(
            f"{name} is asked at t = {unknown:g} s, known from {first:g} to {last:g} s",
            "give samples that cover the run, or repeat=True",
        )
    return whole


def check_time(name: str, value: float, most: float = 10.0) -> None:
    """Raise InputError unless a length of time in s is positive and at most ``most``."""
    checks.positive(name, value, unit="s", at_most=most, hint=TIME_HINT)


class Steps(Waveform, ABC, stored=False):
    """A power that is constant between times of change."""

    @property
    @abstractmethod
    def steps(self) -> tuple[Array, Array]:
        """Times of change in s, shape (n,), and power in W before, between and after them, shape (n + 1,)."""

    @cached_property
    def whole(self) -> Pieces:  # type: ignore[override]
        """Constant pieces; the first begins at -`ENDLESS`, and the last ends at `ENDLESS`."""
        changes, levels = self.steps
        edges = np.concatenate([[-ENDLESS], changes, [ENDLESS]])
        return Pieces(edges, np.multiply.outer(levels, [1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True)
class Constant(Steps):
    """Heating step: P(t) = power; a run begins at t = 0.

    Parameters
    ----------
    power : float, W
    """

    power: float

    def __post_init__(self) -> None:
        checks.power("power", self.power, zero=True)

    @property
    def words(self) -> str:
        """Text with the kind, the power and the times of the waveform."""
        return f"step {self.power * 1e3:g} mW"

    @property
    def steps(self) -> tuple[Array, Array]:
        """No time of change, shape (0,), and the power in W, shape (1,)."""
        return np.empty(0), np.array([self.power])


@dataclass(frozen=True)
class Pulse(Steps):
    """P(t) = power for start <= t < start + width, else 0.

    Parameters
    ----------
    power : float, W
    width, start : float, s

    >>> Pulse(power=2e-3, width=20e-6).breakpoints(0, 1e-3)
    array([2.e-05])
    """

    power: float
    width: float
    start: float = 0.0

    def __post_init__(self) -> None:
        checks.power("power", self.power, zero=True)
        check_time("width", self.width)
        checks.between("start", self.start, 0, 1e3, unit="s", hint=TIME_HINT)

    @property
    def stop(self) -> float:
        """End of the pulse in s."""
        return self.start + self.width

    @property
    def words(self) -> str:
        """Text with the kind, the power and the times of the waveform."""
        return f"pulse {self.power * 1e3:g} mW, {self.width * 1e6:g} us"

    @property
    def steps(self) -> tuple[Array, Array]:
        """Times of change in s and power in W before, between and after them."""
        return np.array([self.start, self.stop]), np.array([0.0, self.power, 0.0])


@dataclass(frozen=True)
class SquareWave(Waveform):
    """P(t) = power during the first ``duty`` of every ``period``, else 0.

    Parameters
    ----------
    power : float, W
    period : float, s
    duty : float, 0 < duty < 1
    """

    power: float
    period: float = field()  # the base's None is no default
    duty: float = field()

    def __post_init__(self) -> None:
        checks.power("power", self.power, zero=True)
        check_time("period", self.period)
        checks.between("duty", self.duty, 1e-6, 1 - 1e-6, hint="it is the fraction of the period that is on")

    @property
    def words(self) -> str:
        """Text with the kind, the power and the times of the waveform."""
        return f"square wave {self.power * 1e3:g} mW, {self.period * 1e6:g} us, duty {self.duty:.3g}"

    @cached_property
    def whole(self) -> Pieces:  # type: ignore[override]
        """The pieces of one period: on, then off."""
        edges = np.array([0.0, self.duty * self.period, self.period])
        return Pieces(edges, np.array([[self.power, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]))


class Samples(Waveform, stored=False):
    """Straight lines through samples ``values`` at ``times`` (s); two samples at one time make a jump."""

    times: ArrayLike
    values: ArrayLike
    repeat: bool = False

    def _check(self, values: Array) -> None:
        """Set ``times`` as an array; InputError where they do not increase or do not match ``values``."""
        times = checks.array("times", self.times, increasing=True, hint=TIME_HINT)
        checks.shape("values at times", values, times.shape)
        checks.enough("times", np.unique(times).size, 2, "different times")
        object.__setattr__(self, "times", times)

    @property
    def period(self) -> float | None:  # type: ignore[override]
        """Length of the record in s where it repeats."""
        times = np.asarray(self.times)
        return float(times[-1] - times[0]) if self.repeat else None

    @cached_property
    def whole(self) -> Pieces:  # type: ignore[override]
        """A straight line between each two samples at different times."""
        times = np.asarray(self.times)
        values = np.asarray(self.values)
        length = np.diff(times)
        long = length > 0
        a = values[:-1][long]
        slope = np.diff(values)[long] / length[long]
        return Pieces(np.unique(times), np.stack([a, slope, 0 * a, 0 * a], axis=1))


@dataclass(frozen=True, eq=False)
class Sampled(Samples):
    """P(t) through given samples, straight between them; two samples at one time make a jump.

    Parameters
    ----------
    times : array, s
        increasing; a time may stand twice.
    power : array, W, same length
    repeat : bool
        the samples are one period and repeat for ever.

    Outside the samples the power is not known: asking for it raises InputError (unless ``repeat``).
    """

    times: ArrayLike
    power: ArrayLike
    repeat: bool = False

    def __post_init__(self) -> None:
        power = checks.array("power", self.power, hint=checks.POWER_HINT)
        self._check(power)
        for end in (power.min(), power.max()):
            checks.power("power", end, zero=True)
        object.__setattr__(self, "power", power)

    @property
    def values(self) -> ArrayLike:  # type: ignore[override]
        """The power in W at ``times``."""
        return self.power


@dataclass(frozen=True, eq=False)
class PiecewiseCubic(Waveform):
    """P(t) = sum_j coefficients[k, j] (t - edges[k])^j between edges[k] and edges[k + 1].

    Files store a `Function` in this form.

    Parameters
    ----------
    edges : array, shape (n + 1,), s
        increasing.
    coefficients : array, shape (n, 4), W/s^j
    repeat : bool
        the pieces are one period and repeat for ever.

    Outside the edges the power is not known: asking for it raises InputError (unless ``repeat``).
    """

    edges: ArrayLike
    coefficients: ArrayLike
    repeat: bool = False
    piecewise_linear: ClassVar[bool] = False

    def __post_init__(self) -> None:
        edges = checks.array("edges", self.edges, increasing=True, hint=TIME_HINT)
        coefficients = checks.numbers("coefficients", self.coefficients)
        checks.shape("coefficients", coefficients, (edges.size - 1, 4))
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def of(cls, wave: Waveform, start: float, stop: float, *, tolerance: float = STORED) -> PiecewiseCubic:
        """Any waveform over [start, stop] as cubics, within ``tolerance`` of its largest value; a period repeats.

        >>> import thermofem as th
        >>> wave = PiecewiseCubic.of(th.Function(lambda t: 1e-3 * np.sin(1e6 * t) ** 2), 0, 10e-6)
        >>> th.waveforms.from_json(th.waveforms.to_json(wave))(2e-6).round(9)
        np.float64(0.000826822)
        """
        repeat = wave.period is not None
        first, last = (0.0, wave.period) if wave.period else (start, stop)
        found = wave.pieces(first, last, tolerance=tolerance)
        return cls(found.edges, found.coefficients, repeat)

    @classmethod
    def of_spline(cls, spline: Any) -> PiecewiseCubic:
        """A cubic spline of SciPy (`CubicSpline`, `CubicHermiteSpline`) of the power in W over the time in s."""
        return cls(spline.x, np.ascontiguousarray(spline.c[::-1].T))

    @property
    def period(self) -> float | None:  # type: ignore[override]
        """Length of the pieces in s where they repeat."""
        edges = np.asarray(self.edges)
        return float(edges[-1] - edges[0]) if self.repeat else None

    @cached_property
    def whole(self) -> Pieces:  # type: ignore[override]
        """The pieces as they are given."""
        return Pieces(np.asarray(self.edges), np.asarray(self.coefficients))

    @property
    def peak(self) -> float:
        """Largest value at an edge, W."""
        values = [self.whole.c[-1], self.whole.ends]
        return float(np.abs(values).max())

    def breakpoints(self, start: float, stop: float) -> Array:
        """Times in s inside (start, stop) where the value jumps by more than 1e-6 of the largest."""
        pieces = self._unrolled(start, stop)
        heights = np.abs(pieces.c[-1, 1:] - pieces.ends[:-1])
        jumps = heights > 1e-6 * self.peak
        return inside(pieces.edges[1:-1][jumps], start, stop)


def check_wave(name: str, value: Any) -> None:
    """Raise InputError unless ``value`` is a Waveform."""
    checks.instance(name, value, Waveform, hint="a waveform is needed, such as th.SquareWave(1e-3, 1e-6, 0.3)")


def heating_pieces(wave: Waveform, start: float, stop: float, *, tolerance: float = TOLERANCE) -> Pieces:
    """`Waveform.pieces` of an absorbed power.

    Raises InputError: a smooth power that is negative or above 10 W somewhere (other waveforms check that at once).
    """
    check_wave("power", wave)
    pieces = wave.pieces(start, stop, tolerance=tolerance)
    if not wave.piecewise_linear:
        low, high = bounds(pieces)
        largest = max(abs(low), abs(high), getattr(wave, "peak", 0.0))
        # what a cubic fit may fall below zero where the power is zero; 1e-6 of the largest power is no cooling
        if low < -max(1e-6, 2 * tolerance) * largest:
            raise InputError(f"the power of the {type(wave).__name__} falls to {low:g} W", "absorbed power heats")
        checks.power("power", max(high, 0.0), zero=True)
    return pieces


def check_heating(wave: Waveform, stop: float | None) -> None:
    """Raise InputError for a smooth power that is negative or too large before ``stop`` in s."""
    if stop and not wave.piecewise_linear:
        heating_pieces(wave, 0.0, stop, tolerance=1e-4)  # 1e-4: enough for the sign of a power


def period_times(wave: Waveform, samples: int) -> Array:
    """``samples`` times in s over one period, both ends included, the nearest ones moved onto the breakpoints.

    Raises InputError: the waveform has no period, or ``samples`` is too small to hold its breakpoints.
    """
    check_wave("wave", wave)
    period = wave.period
    if period is None:
        raise InputError(f"{type(wave).__name__} has no period", "a periodic state needs a periodic waveform")
    breakpoints = wave.breakpoints(0.0, period)
    # 10_000_000 of a periodic state; more would not fit into memory
    samples = checks.integer("samples", samples, 3, 10_000_000)
    times = np.arange(samples, dtype=float) * (period / (samples - 1))
    times[-1] = period
    nearest = np.rint(breakpoints / period * (samples - 1)).clip(1, samples - 2).astype(int)
    count = breakpoints.size
    if samples < 3 + 2 * count or np.unique(nearest).size < count:
        raise InputError(f"samples = {samples} is too few for a period with {count} breakpoints inside")
    times[nearest] = breakpoints
    return times


def to_json(wave: Waveform, duration: float | None = None) -> str:
    """The waveform as JSON text: its kind and its fields.

    duration [s]: a `Function`, or another kind that no file can describe, is written as cubics over [0, duration].
    Raises InputError: such a kind without a duration.
    """
    if duration is not None and type(wave).__name__ not in KINDS:
        wave = PiecewiseCubic.of(wave, 0.0, duration)
    hint = "of another kind, write the cubics over the run, th.waveforms.PiecewiseCubic.of(wave, 0, duration)"
    checks.choice("kind of a waveform in a file", type(wave).__name__, KINDS, hint=hint)
    fields = {k: np.asarray(v).tolist() for k, v in asdict(wave).items()}  # type: ignore[call-overload]
    return json.dumps({"kind": type(wave).__name__, **fields})


def from_json(text: str) -> Waveform:
    """Rebuild a waveform from the text of `to_json`; InputError for any other text."""
    try:
        fields = json.loads(text)
        return KINDS[checks.choice("waveform kind", fields.pop("kind"), KINDS)](**fields)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"waveform {checks.shown(text)} cannot be read: {error}") from None
