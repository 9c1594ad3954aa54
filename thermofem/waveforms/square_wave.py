"""A square wave."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, Array, check_cycles, inside, seconds, stored


@stored
@shown
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
        checks.plain(self)
        checks.power("power", self.power, zero=True)
        checks.positive("period", self.period, unit="s", at_most=10, hint=TIME_HINT)
        checks.between("duty", self.duty, 0, 1, hint="the duty cycle is the fraction of the period that is on")
        if not 1e-6 <= self.duty <= 1 - 1e-6:
            raise checks.InputError(f"duty = {self.duty:g} leaves no edge; use Constant for a steady power")

    @property
    def words(self) -> str:
        """A short description."""
        return f"square wave {self.power * 1e3:g} mW, {self.period * 1e6:g} us, duty {self.duty:.3g}"

    @property
    def on_time(self) -> float:
        """Time on in each period, s."""
        return self.duty * self.period

    def _edges(self, start: float, stop: float) -> Array:
        check_cycles(start, stop, self.period)
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
