"""Heating waveforms P(t): a waveform knows its own jumps and its exact mean.

Contract of a `Waveform` (anything that satisfies it can drive every model):

1. ``wave(t)`` is the power in W at time ``t`` in s (scalar or array), continuous from the right; those of this module
   raise InputError where ``t`` is text or not finite.
2. ``wave.before(t)`` is the limit from the left; it differs from ``wave(t)`` only at jumps.
3. ``wave.breakpoints(start, stop)`` are the sorted times strictly inside (start, stop) where P jumps or has a kink;
   every integrator lands on them.
4. ``wave.mean(start, stop)`` is the exact mean of P over [start, stop].
5. ``wave.period`` is the period in s, or None.
6. ``wave.piecewise_linear`` says whether P is a straight line between breakpoints; then linear models answer in
   closed form.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks, trees
from .switched import POWER_HINT, TIME_HINT, Chirp, Telegraph, inside, seconds

Array = NDArray[np.float64]

MOST_PERIODS = 1e6  # that a call may span
MOST_SAMPLES = 10_000_000  # of a periodic state; more would not fit into memory
_QUARTERS = np.array([[0.25], [0.75]])


class Waveform(Protocol):
    """Absorbed power against time; the numbered contract stands in the module's docstring."""

    piecewise_linear: ClassVar[bool]

    @property
    def period(self) -> float | None:
        """Period in s, or None when the waveform does not repeat."""

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""

    def breakpoints(self, start: float, stop: float) -> Array:
        """Times of jumps and kinks strictly inside (start, stop)."""

    def mean(self, start: float, stop: float) -> float:
        """Exact mean power in W over [start, stop]."""


def linear_pieces(wave: Waveform, start: float, stop: float) -> tuple[Array, Array, Array]:
    """Split a piecewise-linear waveform into straight pieces.

    Returns
    -------
    edges, after, before : arrays of shape (n + 1,), (n,), (n,)
        piece k runs from ``edges[k]`` at power ``after[k]`` to ``edges[k + 1]`` at power ``before[k]``.
    """
    if not wave.piecewise_linear:
        raise checks.InputError(f"{type(wave).__name__} is not piecewise linear; sample it with th.Sampled first")
    if isinstance(wave, SquareWave):
        return wave.pieces(start, stop)
    known = wave.breakpoints(start, stop)
    edges = np.empty(known.size + 2)
    edges[0], edges[1:-1], edges[-1] = start, known, stop
    left, length = edges[:-1], edges[1:] - edges[:-1]
    early, late = wave(left + _QUARTERS * length)  # well inside, where round-off hits no edge
    half = (late - early) / 2
    return edges, early - half, late + half


def period_times(wave: Waveform, samples: int) -> Array:
    """``samples`` times over one period, both ends included, the nearest ones moved onto the waveform's edges.

    Raises
    ------
    InputError
        the waveform has no period, or ``samples`` is too small to hold its edges.
    """
    period = getattr(wave, "period", None)
    if period is None:
        raise checks.InputError(f"{type(wave).__name__} has no period; a periodic state needs a periodic waveform")
    edges = wave.breakpoints(0.0, period)
    if not isinstance(samples, int | np.integer) or samples > MOST_SAMPLES:
        raise checks.InputError(f"samples = {samples!r} must be a whole number of times, up to {MOST_SAMPLES:g}")
    if samples < 3 + 2 * edges.size:
        raise checks.InputError(f"samples = {samples} is too few for a period with {edges.size} edges inside")
    times = np.arange(samples, dtype=float) * (period / (samples - 1))
    times[-1] = period
    nearest = {min(max(round(e / period * (samples - 1)), 1), samples - 2): e for e in edges.tolist()}
    if len(nearest) < edges.size:
        raise checks.InputError(f"samples = {samples} does not resolve the waveform's edges; take more")
    for k, edge in nearest.items():
        times[k] = edge
    return times


@dataclass(frozen=True)
class Constant:
    """P(t) = power from the start on: the heating step.

    Parameters
    ----------
    power : float, W
    """

    power: float
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __post_init__(self) -> None:
        checks.between("power", self.power, 0, 10, unit="W", hint=POWER_HINT)

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W."""
        return np.full(seconds(t).shape, float(self.power))

    before = __call__

    def breakpoints(self, start: float, stop: float) -> Array:
        """None."""
        return np.empty(0)

    def mean(self, start: float, stop: float) -> float:
        """The power itself."""
        return self.power


@dataclass(frozen=True)
class Pulse:
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
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __post_init__(self) -> None:
        checks.between("power", self.power, 0, 10, unit="W", hint=POWER_HINT)
        checks.positive("width", self.width, unit="s", at_most=10, hint=TIME_HINT)
        checks.between("start", self.start, 0, 1e3, unit="s", hint=TIME_HINT)

    @property
    def stop(self) -> float:
        """End of the pulse in s."""
        return self.start + self.width

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        t = seconds(t)
        return np.where((t >= self.start) & (t < self.stop), float(self.power), 0.0)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        t = seconds(t)
        return np.where((t > self.start) & (t <= self.stop), float(self.power), 0.0)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Both edges, where they lie inside."""
        return inside(np.array([self.start, self.stop]), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """power x overlap / length."""
        overlap = max(0.0, min(stop, self.stop) - max(start, self.start))
        return self.power * overlap / (stop - start)


@dataclass(frozen=True)
class SquareWave:
    """P(t) = power during the first ``duty`` of every ``period``, else 0.

    Parameters
    ----------
    power : float, W
    period : float, s
    duty : float, 0 < duty < 1
    """

    power: float
    period: float
    duty: float
    piecewise_linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        checks.between("power", self.power, 0, 10, unit="W", hint=POWER_HINT)
        checks.positive("period", self.period, unit="s", at_most=10, hint=TIME_HINT)
        checks.between("duty", self.duty, 0, 1, hint="the duty cycle is the fraction of the period that is on")
        if not 1e-6 <= self.duty <= 1 - 1e-6:
            raise checks.InputError(f"duty = {self.duty:g} leaves no edge; use Constant for a steady power")

    @property
    def on_time(self) -> float:
        """Time on in each period, s."""
        return self.duty * self.period

    def _edges(self, start: float, stop: float) -> Array:
        if (stop - start) / self.period > MOST_PERIODS:
            raise checks.InputError(
                f"{(stop - start) / self.period:.2g} periods of {self.period:g} s are asked for at once, more than "
                f"{MOST_PERIODS:g}; take solve_periodic for the settled state, or a shorter run"
            )
        cycle = np.arange(math.floor(start / self.period) - 1, math.ceil(stop / self.period) + 2)
        edges = np.empty((cycle.size, 2))
        edges[:, 0] = cycle * self.period
        edges[:, 1] = edges[:, 0] + self.on_time
        return edges.ravel()

    def _at(self, t: ArrayLike, side: str) -> Array:
        t = seconds(t)
        if t.size == 0:
            return np.zeros(t.shape)
        edges = self._edges(float(t.min()), float(t.max()))
        return self.power * (np.searchsorted(edges, t, side=side) % 2 == 1)  # type: ignore[call-overload]

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self._at(t, "right")

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self._at(t, "left")

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every rising and falling edge inside."""
        return inside(self._edges(start, stop), start, stop)

    def pieces(self, start: float, stop: float) -> tuple[Array, Array, Array]:
        """`linear_pieces` without asking for the power: the edges alternate, and the first of all switches on."""
        known = self._edges(start, stop)
        slack = 1e-12 * max(abs(start), abs(stop))
        first, last = known.searchsorted((start + slack, stop - slack)).tolist()
        edges = known[first - 1 : last + 1]
        edges[0], edges[-1] = start, stop
        power = self.power * (np.arange(first, last + 1) % 2)
        return edges, power, power

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy delivered up to a time."""
        return (self._energy(stop) - self._energy(start)) / (stop - start)

    def _energy(self, t: float) -> float:
        cycle = np.floor(t / self.period)
        return float(self.power * (cycle * self.on_time + min(t - cycle * self.period, self.on_time)))


@dataclass(frozen=True, eq=False)
class Sampled:
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
    piecewise_linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        times = checks.array("times", self.times, increasing=True, hint=TIME_HINT)
        power = checks.array("power", self.power, hint=POWER_HINT)
        if times.size != power.size or times.size < 2:
            raise checks.InputError(
                f"times has {times.size} samples, power {power.size}; both need the same, at least 2"
            )
        if np.any(times[2:] == times[:-2]):
            raise checks.InputError(f"times holds {times[2:][times[2:] == times[:-2]][0]:g} s more than twice")
        if times[0] == times[1] or times[-1] == times[-2]:
            raise checks.InputError("times begins or ends with a jump; the first and last interval need a length")
        if np.any(power < 0):
            raise checks.InputError(f"power[{np.argmin(power)}] = {power.min():g} W is negative; absorbed power heats")
        checks.between("power", power.max(), 0, 10, unit="W", hint=POWER_HINT)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "power", power)

    @property
    def period(self) -> float | None:
        """Length of the record in s when it repeats."""
        times = np.asarray(self.times)
        return float(times[-1] - times[0]) if self.repeat else None

    def _wrap(self, t: Array, before: bool) -> Array:
        times = np.asarray(self.times)
        first, last = times[0], times[-1]
        if self.repeat:
            u = first + np.mod(t - first, last - first)
            return np.where(before & (u == first), last, u)
        slack = 1e-9 * (last - first)
        outside = (t < first - slack) | (t > last + slack)
        if np.any(outside):
            raise checks.InputError(
                f"power asked at t = {np.atleast_1d(t)[np.atleast_1d(outside)][0]:g} s, sampled "
                f"from {first:g} to {last:g} s; give samples that cover the run, or repeat=True"
            )
        return np.clip(t, first, last)

    def _at(self, t: ArrayLike, before: bool) -> Array:
        times, power = np.asarray(self.times), np.asarray(self.power)
        u = self._wrap(seconds(t), before)
        k = np.clip(np.searchsorted(times, u, side="left" if before else "right") - 1, 0, times.size - 2)
        step = times[k + 1] - times[k]
        share = np.where(step > 0, (u - times[k]) / np.where(step > 0, step, 1.0), 1.0 - before)
        return power[k] + share * (power[k + 1] - power[k])

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self._at(t, before=False)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self._at(t, before=True)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every sample inside."""
        times = np.unique(np.asarray(self.times))
        if not self.repeat:
            return inside(times, start, stop)
        length = times[-1] - times[0]
        cycles = np.arange(np.floor((start - times[0]) / length), np.ceil((stop - times[0]) / length) + 1)
        return inside(np.unique(times[:-1] + length * cycles[:, None]), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """Trapezoids between the samples, which is exact."""
        edges, after, before = linear_pieces(self, start, stop)
        return float(np.sum(np.diff(edges) * (after + before)) / 2 / (stop - start))


KINDS: dict[str, type] = {kind.__name__: kind for kind in (Constant, Pulse, SquareWave, Telegraph, Chirp, Sampled)}


def to_json(wave: Waveform) -> str:
    """The waveform as JSON text, as stored with every dataset: its kind and its fields."""
    fields = {k: np.asarray(v).tolist() for k, v in asdict(wave).items()}  # type: ignore[call-overload]
    return json.dumps({"kind": type(wave).__name__, **fields})


def from_json(text: str) -> Any:
    """Rebuild a waveform from `to_json`; InputError when the text is not one."""
    try:
        fields = trees.from_json(text)
        kind = KINDS[checks.choice("waveform kind", fields.pop("kind"), KINDS)]
        return kind(**fields)
    except (KeyError, TypeError, AttributeError) as error:
        raise checks.InputError(f"waveform {checks.shown(text)} cannot be read: {error}") from None
