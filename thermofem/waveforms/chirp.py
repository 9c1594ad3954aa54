"""A square wave whose period changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, Array, stored
from .steps import Switched


@stored
@shown
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
        checks.plain(self)
        checks.power("power", self.power, zero=True)
        checks.positive("first", self.first, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("last", self.last, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * min(self.first, self.last), hint=TIME_HINT)
        checks.between("duty", self.duty, 1e-3, 0.999, hint="the duty cycle is the fraction of the period that is on")
        if self.first == self.last:
            raise checks.InputError("first and last period are equal; take a SquareWave")

    @property
    def words(self) -> str:
        """A short description."""
        return f"chirp {self.power * 1e3:g} mW, {self.first * 1e6:.3g} to {self.last * 1e6:.3g} us"

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Times of change in s."""
        rate = np.log(self.first / self.last) / self.duration
        cycles = np.expm1(rate * self.duration) / (rate * self.first)
        phase = np.arange(np.ceil(cycles))[:, None] + [0.0, self.duty]
        phase = phase.ravel()[1:]
        times = np.log1p(phase[phase < cycles] * rate * self.first) / rate
        return np.append(times, self.duration) if times.size % 2 == 0 else times
