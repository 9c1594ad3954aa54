"""A smooth power through samples: cubic between them, with the slopes that the source gave."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from .contract import Array, inside
from .pieces import Pieces, hermite


@dataclass(frozen=True, eq=False)
class Cubic:
    """P(t) through samples with given slopes (Hermite); a `waveforms.Waveform`, known between its ends only.

    The coupled integration hands its absorbed power over in this form: 4th order between its steps, where straight
    lines would lose 1e-3 of the energy of a pulse.

    times [s]: increasing.
    power [W, same length]
    slope [W/s, same length]
    Raises InputError: lengths that differ, fewer than two samples, or times that do not increase.
    """

    times: Array
    power: Array
    slope: Array
    piecewise_linear: ClassVar[bool] = False
    period: ClassVar[None] = None

    def __post_init__(self) -> None:
        sizes = [np.size(v) for v in (self.times, self.power, self.slope)]
        if sizes[0] < 2 or len(set(sizes)) > 1:
            raise checks.InputError(f"times, power and slope have {sizes} samples; they need the same, at least 2")
        if np.any(np.diff(self.times) <= 0):
            raise checks.InputError("times must increase from sample to sample")

    @cached_property
    def whole(self) -> Pieces:
        """All pieces; between two samples the cubic with their values and slopes."""
        return hermite(np.asarray(self.times, dtype=float), self.power, self.slope[:-1], self.slope[1:])

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W; outside the samples that of the nearest end."""
        return self.whole(np.clip(t, self.times[0], self.times[-1]))

    before = __call__

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every sample strictly inside: P is one cubic between two of them."""
        return inside(np.asarray(self.times), start, stop)

    def cubics(self, start: float, stop: float) -> Pieces:
        """The pieces over [start, stop]."""
        return self.whole.on(np.concatenate([[start], self.breakpoints(start, stop), [stop]]))

    def mean(self, start: float, stop: float) -> float:
        """Exact mean."""
        return self.cubics(start, stop).integral() / (stop - start)
