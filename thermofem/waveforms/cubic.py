"""A smooth power through samples: cubic between them, with the slopes that the source gave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cubic:
    """P(t) through samples with given slopes (Hermite); a `waveforms.Waveform`, known between its ends only.

    The coupled integration hands its absorbed power over in this form: 4th order between its steps, where straight
    lines would lose 1e-3 of the energy of a pulse.

    Parameters
    ----------
    times : array, s
        increasing.
    power : array, W, same length
    slope : array, W/s, same length

    Raises
    ------
    InputError
        lengths that differ, fewer than two samples, or times that do not increase.
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

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W; outside the samples that of the nearest end."""
        times, t = self.times, np.asarray(t, dtype=float)
        k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 2)
        h = times[k + 1] - times[k]
        u = np.clip((t - times[k]) / h, 0.0, 1.0)
        rise, d0, d1 = self.power[k + 1] - self.power[k], h * self.slope[k], h * self.slope[k + 1]
        return np.asarray(self.power[k] + u * (d0 + u * (3 * rise - 2 * d0 - d1 + u * (d0 + d1 - 2 * rise))))

    before = __call__

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every sample strictly inside: P is one cubic between two of them."""
        times = np.asarray(self.times)
        return times[(times > start) & (times < stop)]

    def cubics(self, start: float, stop: float) -> tuple[Array, Array]:
        """Edges and coefficients over [start, stop], see `waveforms.cubic_pieces`."""
        from .pieces import Pieces

        times, h = np.asarray(self.times, dtype=float), np.diff(self.times)
        rise, d0, d1 = np.diff(self.power), self.slope[:-1], self.slope[1:]
        square, cube = 3 * rise / h**2 - (2 * d0 + d1) / h, -2 * rise / h**3 + (d0 + d1) / h**2
        whole = Pieces(times, np.stack([np.asarray(self.power)[:-1], d0, square, cube], axis=1))
        return whole.on(np.concatenate([[start], self.breakpoints(start, stop), [stop]]))

    def mean(self, start: float, stop: float) -> float:
        """Exact mean: Gauss points between the samples."""
        edges = np.concatenate([[start], self.breakpoints(start, stop), [stop]])
        h = np.diff(edges)
        ends = edges[:-1, None] + h[:, None] * (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3))
        return float(h @ self(ends).mean(axis=1)) / (stop - start)
