"""A random telegraph signal."""

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
        checks.plain(self)
        checks.power("power", self.power, zero=True)
        checks.positive("dwell", self.dwell, unit="s", at_most=10, hint=TIME_HINT)
        checks.positive("duration", self.duration, unit="s", at_most=1e6 * self.dwell, hint=TIME_HINT)
        checks.seed(self.seed)

    @property
    def words(self) -> str:
        """A short description."""
        return f"telegraph {self.power * 1e3:g} mW, {self.dwell * 1e6:.3g} us"

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Times of change in s."""
        draw = np.random.default_rng(self.seed)
        times = np.cumsum(draw.exponential(self.dwell, int(2 * self.duration / self.dwell) + 20))
        times = times[times < self.duration]
        return np.append(times, self.duration) if times.size % 2 == 0 else times
