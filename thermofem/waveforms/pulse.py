"""One rectangular pulse."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, Array, stored
from .steps import Steps


@stored
@shown
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
        checks.plain(self)
        checks.power("power", self.power, zero=True)
        checks.positive("width", self.width, unit="s", at_most=10, hint=TIME_HINT)
        checks.between("start", self.start, 0, 1e3, unit="s", hint=TIME_HINT)

    @property
    def stop(self) -> float:
        """End of the pulse in s."""
        return self.start + self.width

    @property
    def words(self) -> str:
        """A short description."""
        return f"pulse {self.power * 1e3:g} mW, {self.width * 1e6:g} us"

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Start and end in s."""
        return np.array([self.start, self.stop])

    @cached_property
    def levels(self) -> Array:  # type: ignore[override]
        """Zero, the power in W, and zero."""
        return np.array([0.0, self.power, 0.0])
