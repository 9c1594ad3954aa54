"""Straight lines between samples: a sampled power, and a detuning that sweeps."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from .contract import Array, check_cycles, check_times, inside, known, seconds
from .pieces import linear_pieces


class Lines:
    """Straight lines between samples; two samples at one time make a jump.

    A class that derives from it has ``times`` (s), ``values`` at them, and ``what`` they are, for messages.
    """

    times: ArrayLike
    values: ArrayLike
    what: ClassVar[str]
    repeat: bool = False
    piecewise_linear: ClassVar[bool] = True

    def check_samples(self, values: Array, hint: str = "") -> None:
        """Keep ``times`` as an array; InputError for times that do not increase or do not belong to ``values``."""
        checks.flag("repeat", self.repeat)
        times = check_times("times", self.times, hint)
        if times.size != values.size or times.size < 2:
            raise checks.InputError(
                f"times has {times.size} samples, {self.what} {values.size}; both need the same, at least 2"
            )
        if np.any(times[2:] == times[:-2]):
            raise checks.InputError(f"times holds {times[2:][times[2:] == times[:-2]][0]:g} s more than twice")
        if times[0] == times[1] or times[-1] == times[-2]:
            raise checks.InputError("times begins or ends with a jump; the first and last interval need a length")
        object.__setattr__(self, "times", times)

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
        or_repeat = ", or repeat=True" if self.what == "power" else ""
        return known(self.what, t, first, last, f"give samples that cover the run{or_repeat}")

    def _at(self, t: ArrayLike, before: bool) -> Array:
        times, values = np.asarray(self.times), np.asarray(self.values)
        u = self._wrap(seconds(t), before)
        k = np.clip(np.searchsorted(times, u, side="left" if before else "right") - 1, 0, times.size - 2)
        step = times[k + 1] - times[k]
        share = np.where(step > 0, (u - times[k]) / np.where(step > 0, step, 1.0), 1.0 - before)
        return np.asarray(values[k] + share * (values[k + 1] - values[k]))

    def __call__(self, t: ArrayLike) -> Array:
        """The value at ``t``, continuous from the right."""
        return self._at(t, before=False)

    def before(self, t: ArrayLike) -> Array:
        """The value just before ``t``."""
        return self._at(t, before=True)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every sample inside."""
        times = np.unique(np.asarray(self.times))
        if not self.repeat:
            return inside(times, start, stop)
        length = times[-1] - times[0]
        check_cycles(start, stop, length, times.size)
        cycles = np.arange(np.floor((start - times[0]) / length), np.ceil((stop - times[0]) / length) + 1)
        return inside(np.unique(times[:-1] + length * cycles[:, None]), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """Trapezoids between the samples, which is exact."""
        edges, after, before = linear_pieces(self, start, stop)
        return float(np.sum(np.diff(edges) * (after + before)) / 2 / (stop - start))
