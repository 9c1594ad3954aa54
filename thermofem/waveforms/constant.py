"""A constant power: the heating step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .contract import Array, seconds, stored


@stored
@shown
@dataclass(frozen=True)
class Constant:
    """Heating step: P(t) = power; a run begins at t = 0.

    Parameters
    ----------
    power : float, W
    """

    power: float
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.power("power", self.power, zero=True)

    @property
    def words(self) -> str:
        """A short description."""
        return f"step {self.power * 1e3:g} mW"

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
