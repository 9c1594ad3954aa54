"""Waveforms that are on or off at irregular times: drives that no training saw. Contract: `thermofem.waveforms`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks

Array = NDArray[np.float64]

POWER_HINT = "powers are in W (did you mean 2e-3 for 2 mW?)"
TIME_HINT = "times are in s (did you mean 1e-6 for 1 us?)"


def inside(times: Array, start: float, stop: float) -> Array:
    """The times strictly inside (start, stop), with a hair of room against round-off."""
    slack = 1e-12 * max(abs(start), abs(stop))
    return times[(times > start + slack) & (times < stop - slack)]


def seconds(t: ArrayLike) -> Array:
    """The times that a waveform is asked for, as floats; InputError where they are none."""
    found = np.asarray(t)
    if found.dtype.kind not in "fiub":
        raise checks.InputError(f"t = {t!r} is not a number or an array of numbers; {TIME_HINT}")
    if not np.isfinite(found).all():
        raise checks.InputError(f"t holds {found[~np.isfinite(found)][0]}, which is no time")
    return np.asarray(found, dtype=float)


class Switched:
    """A power that is on or off, from the times at which it changes; it begins on."""

    power: float
    edges: Array  # off, on, off, ...
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self.power * (np.searchsorted(self.edges, seconds(t), side="right") % 2 == 0)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self.power * (np.searchsorted(self.edges, seconds(t), side="left") % 2 == 0)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every change inside."""
        return inside(self.edges, start, stop)

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy of every piece."""
        edges = np.concatenate([[start], self.breakpoints(start, stop), [stop]])
        return float(np.diff(edges) @ self((edges[:-1] + edges[1:]) / 2) / (stop - start))


@dataclass(frozen=True)
class Telegraph(Switched):
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
        checks.between("power", self.power, 0, 10, unit="W", hint=POWER_HINT)
        checks.positive("dwell", self.dwell, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * self.dwell, hint=TIME_HINT)
        if not isinstance(self.seed, int | np.integer) or self.seed < 0:
            raise checks.InputError(f"seed = {self.seed!r} must be a whole number from 0")

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Times of change in s."""
        draw = np.random.default_rng(self.seed)
        times = np.cumsum(draw.exponential(self.dwell, int(2 * self.duration / self.dwell) + 20))
        times = times[times < self.duration]
        return np.append(times, self.duration) if times.size % 2 == 0 else times


@dataclass(frozen=True)
class Chirp(Switched):
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
        checks.between("power", self.power, 0, 10, unit="W", hint=POWER_HINT)
        checks.positive("first", self.first, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("last", self.last, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * min(self.first, self.last), hint=TIME_HINT)
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
