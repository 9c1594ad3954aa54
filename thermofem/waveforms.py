"""Heating waveforms P(t): a waveform knows its own jumps and its exact mean.

Contract of a `Waveform` (anything that satisfies it can drive every model):

1. ``wave(t)`` is the power in W at time ``t`` in s (scalar or array), continuous from the right.
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
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks

Array = NDArray[np.float64]

_POWER_HINT = "powers are in W (did you mean 2e-3 for 2 mW?)"
MOST_PERIODS = 1e6  # that a call may span
_TIME_HINT = "times are in s (did you mean 1e-6 for 1 us?)"


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
    edges = np.concatenate([[start], wave.breakpoints(start, stop), [stop]])
    length = np.diff(edges)
    # read well inside each piece, where round-off hits no edge
    early, late = wave(edges[:-1] + length / 4), wave(edges[:-1] + 3 * length / 4)
    return edges, early - (late - early) / 2, late + (late - early) / 2


def period_times(wave: Waveform, samples: int) -> Array:
    """``samples`` times over one period, both ends included, the nearest ones moved onto the waveform's edges.

    Raises
    ------
    InputError
        the waveform has no period, or ``samples`` is too small to hold its edges.
    """
    period = wave.period
    if period is None:
        raise checks.InputError(f"{type(wave).__name__} has no period; a periodic state needs a periodic waveform")
    edges = wave.breakpoints(0.0, period)
    if samples < 3 + 2 * edges.size:
        raise checks.InputError(f"samples = {samples} is too few for a period with {edges.size} edges inside")
    times = np.linspace(0.0, period, samples)
    nearest = np.clip(np.rint(edges / period * (samples - 1)).astype(int), 1, samples - 2)
    if np.unique(nearest).size < edges.size:
        raise checks.InputError(f"samples = {samples} does not resolve the waveform's edges; take more")
    times[nearest] = edges
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
        checks.between("power", self.power, 0, 10, unit="W", hint=_POWER_HINT)

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W."""
        return np.full(np.shape(t), float(self.power))

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
        checks.between("power", self.power, 0, 10, unit="W", hint=_POWER_HINT)
        checks.positive("width", self.width, unit="s", at_most=10, hint=_TIME_HINT)
        checks.between("start", self.start, 0, 1e3, unit="s", hint=_TIME_HINT)

    @property
    def stop(self) -> float:
        """End of the pulse in s."""
        return self.start + self.width

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        t = np.asarray(t, dtype=float)
        return np.where((t >= self.start) & (t < self.stop), float(self.power), 0.0)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        t = np.asarray(t, dtype=float)
        return np.where((t > self.start) & (t <= self.stop), float(self.power), 0.0)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Both edges, where they lie inside."""
        return _inside(np.array([self.start, self.stop]), start, stop)

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
        checks.between("power", self.power, 0, 10, unit="W", hint=_POWER_HINT)
        checks.positive("period", self.period, unit="s", at_most=10, hint=_TIME_HINT)
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
        cycle = np.arange(np.floor(start / self.period) - 1, np.ceil(stop / self.period) + 2)
        return np.stack([cycle * self.period, cycle * self.period + self.on_time], axis=1).ravel()

    def _at(self, t: ArrayLike, side: str) -> Array:
        t = np.asarray(t, dtype=float)
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
        return _inside(self._edges(start, stop), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy delivered up to a time."""
        return (self._energy(stop) - self._energy(start)) / (stop - start)

    def _energy(self, t: float) -> float:
        cycle = np.floor(t / self.period)
        return float(self.power * (cycle * self.on_time + min(t - cycle * self.period, self.on_time)))


class _Switched:
    """A power that is on or off, from the times at which it changes; it begins on."""

    power: float
    edges: Array  # off, on, off, ...
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self.power * (np.searchsorted(self.edges, np.asarray(t, dtype=float), side="right") % 2 == 0)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self.power * (np.searchsorted(self.edges, np.asarray(t, dtype=float), side="left") % 2 == 0)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every change inside."""
        return _inside(self.edges, start, stop)

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy of every piece."""
        edges, after, before = linear_pieces(self, start, stop)
        return float(np.sum(np.diff(edges) * (after + before)) / 2 / (stop - start))


@dataclass(frozen=True)
class Telegraph(_Switched):
    """Random telegraph: on and off for exponentially distributed times; a drive that no training saw.

    Parameters
    ----------
    power : float, W
    dwell : float, s
        mean time between changes.
    duration : float, s
        off for good afterwards.
    seed : int
        the same seed gives the same waveform.
    """

    power: float
    dwell: float
    duration: float
    seed: int = 0

    def __post_init__(self) -> None:
        checks.between("power", self.power, 0, 10, unit="W", hint=_POWER_HINT)
        checks.positive("dwell", self.dwell, unit="s", at_most=10, hint=_TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * self.dwell, hint=_TIME_HINT)

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Times of change in s."""
        draw = np.random.default_rng(self.seed)
        times = np.cumsum(draw.exponential(self.dwell, int(2 * self.duration / self.dwell) + 20))
        times = times[times < self.duration]
        return np.append(times, self.duration) if times.size % 2 == 0 else times


@dataclass(frozen=True)
class Chirp(_Switched):
    """Square wave whose period goes from one value to another, each cycle by nearly the same factor.

    The frequency is f(t) = f_0 (f_1/f_0)^(t/duration), and the power is on while the fraction of the phase
    int f dt is below ``duty``.

    Parameters
    ----------
    power : float, W
    first, last : float, s
        period at the start and at the end; different.
    duration : float, s
        off for good afterwards.
    duty : float, 0 < duty < 1
    """

    power: float
    first: float
    last: float
    duration: float
    duty: float = 1 / 3

    def __post_init__(self) -> None:
        checks.between("power", self.power, 0, 10, unit="W", hint=_POWER_HINT)
        checks.positive("first", self.first, unit="s", at_most=10, hint=_TIME_HINT)
        checks.positive("last", self.last, unit="s", at_most=10, hint=_TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * min(self.first, self.last), hint=_TIME_HINT)
        checks.between("duty", self.duty, 1e-3, 0.999, hint="the duty cycle is the fraction of the period that is on")
        if self.first == self.last:
            raise checks.InputError("first and last period are equal; take a SquareWave")

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Times of change in s."""
        rate = np.log(self.first / self.last) / self.duration
        cycles = np.expm1(rate * self.duration) / (rate * self.first)
        phase = np.arange(np.ceil(cycles))[:, None] + [0.0, self.duty]
        phase = phase.ravel()[1:]
        times = np.log1p(phase[phase < cycles] * rate * self.first) / rate
        return np.append(times, self.duration) if times.size % 2 == 0 else times


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
        times = checks.array("times", self.times, increasing=True, hint=_TIME_HINT)
        power = checks.array("power", self.power, hint=_POWER_HINT)
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
        checks.between("power", power.max(), 0, 10, unit="W", hint=_POWER_HINT)
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
        u = self._wrap(np.asarray(t, dtype=float), before)
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
            return _inside(times, start, stop)
        length = times[-1] - times[0]
        cycles = np.arange(np.floor((start - times[0]) / length), np.ceil((stop - times[0]) / length) + 1)
        return _inside(np.unique(times[:-1] + length * cycles[:, None]), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """Trapezoids between the samples, which is exact."""
        edges, after, before = linear_pieces(self, start, stop)
        return float(np.sum(np.diff(edges) * (after + before)) / 2 / (stop - start))


def _inside(times: Array, start: float, stop: float) -> Array:
    """The times strictly inside (start, stop), with a hair of room against round-off."""
    slack = 1e-12 * max(abs(start), abs(stop))
    return times[(times > start + slack) & (times < stop - slack)]


KINDS: dict[str, type] = {kind.__name__: kind for kind in (Constant, Pulse, SquareWave, Telegraph, Chirp, Sampled)}


def to_json(wave: Waveform) -> str:
    """The waveform as JSON text, as stored with every dataset: its kind and its fields."""
    fields = {k: np.asarray(v).tolist() for k, v in asdict(wave).items()}  # type: ignore[call-overload]
    return json.dumps({"kind": type(wave).__name__, **fields})


def from_json(text: str) -> Any:
    """Rebuild a waveform from `to_json`; InputError when the text is not one."""
    try:
        fields = json.loads(text)
        kind = KINDS[checks.choice("waveform kind", fields.pop("kind"), KINDS)]
        return kind(**fields)
    except (json.JSONDecodeError, KeyError, TypeError, AttributeError) as error:
        raise checks.InputError(f"waveform {text[:60]!r} cannot be read: {error}") from None
