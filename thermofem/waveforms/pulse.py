"""One rectangular pulse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..display import shown
from .contract import POWER_HINT, TIME_HINT, Array, inside, seconds, stored


@stored
@shown
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
