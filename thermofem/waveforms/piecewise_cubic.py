"""A smooth power as cubics between given times, with jumps where they do not meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .adaptive import cubic
from .contract import TIME_HINT, Array, Waveform, check_cycles, check_times, inside, known, seconds, stored, wrapped
from .pieces import Pieces, cubic_pieces


@stored
@shown
@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """P(t) = sum_j coefficients[k, j] (t - edges[k])^j between edges[k] and edges[k + 1].

    Files store a `Function` in this form.

    Parameters
    ----------
    edges : array, shape (n + 1,), s
        increasing.
    coefficients : array, shape (n, 4), W/s^j
    repeat : bool
        the pieces are one period, from edges[0] = 0, and repeat for ever.

    Outside the edges the power is not known: asking for it raises InputError (unless ``repeat``).
    """

    edges: ArrayLike
    coefficients: ArrayLike
    repeat: bool = False
    piecewise_linear: ClassVar[bool] = False

    def __post_init__(self) -> None:
        edges = check_times("edges", self.edges, TIME_HINT)
        coefficients = checks.numbers("coefficients", self.coefficients)
        if edges.size < 2 or coefficients.shape != (edges.size - 1, 4):
            raise checks.InputError(
                f"edges has {edges.size} times and coefficients the shape {coefficients.shape}; n + 1 times and a "
                "shape of (n, 4) are needed"
            )
        if np.any(np.diff(edges) <= 0):
            raise checks.InputError("edges must increase from one to the next")
        if checks.flag("repeat", self.repeat) and edges[0] != 0:
            raise checks.InputError(f"edges start at {edges[0]:g} s; one period must start at 0")
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def of(cls, wave: Waveform, start: float, stop: float, *, tolerance: float = 1e-7) -> PiecewiseCubic:
        """Any waveform over [start, stop] as cubics, within ``tolerance`` of its largest value; a period repeats.

        >>> import thermofem as th
        >>> wave = PiecewiseCubic.of(th.Function(lambda t: 1e-3 * np.sin(1e6 * t) ** 2), 0, 10e-6)
        >>> th.waveforms.from_json(th.waveforms.to_json(wave))(2e-6).round(9)
        np.float64(0.000826822)
        """
        start, stop = (checks.finite(name, t, unit="s") for name, t in (("start", start), ("stop", stop)))
        period = getattr(wave, "period", None)
        if period is not None:
            start, stop = 0.0, period
        if not start < stop:
            raise checks.InputError(f"start = {start!r} must be before stop = {stop!r}")
        return cls(*cubic_pieces(wave, start, stop, tolerance=tolerance), repeat=period is not None)

    @property
    def period(self) -> float | None:
        """Length of the pieces in s when they repeat."""
        return float(np.asarray(self.edges)[-1]) if self.repeat else None

    @property
    def peak(self) -> float:
        """Largest value at an edge, W."""
        pieces = Pieces(np.asarray(self.edges), np.asarray(self.coefficients))
        return max(float(np.abs(pieces.coefficients[:, 0]).max()), float(np.abs(pieces.ends).max()))

    def _at(self, t: ArrayLike, before: bool) -> Array:
        edges, u = np.asarray(self.edges), seconds(t)
        if self.repeat:
            u = wrapped(u, float(edges[-1]), before=before)
        u = known("power", u, edges[0], edges[-1])
        k = np.searchsorted(edges, u, side="left" if before else "right") - 1
        k = np.clip(k, 0, edges.size - 2)
        return cubic(np.asarray(self.coefficients)[k], u - edges[k])

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self._at(t, before=False)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self._at(t, before=True)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Times inside where the value jumps by more than 1e-6 of the largest; between them `knots` bound steps."""
        pieces = Pieces(np.asarray(self.edges), np.asarray(self.coefficients))
        before, after = pieces.ends, pieces.coefficients[:, 0]
        jumps = np.abs(np.roll(after, -1) - before) > 1e-6 * self.peak
        jumps[-1] &= self.repeat
        at = pieces.edges[1:][jumps]
        if self.repeat:
            length = pieces.edges[-1]
            check_cycles(start, stop, length, at.size)
            cycles = np.arange(np.floor(start / length) - 1, np.ceil(stop / length) + 1)
            at = np.unique(at + length * cycles[:, None])
        return inside(at, start, stop)

    def cubics(self, start: float, stop: float) -> Pieces:
        """The pieces over [start, stop]."""
        whole = Pieces(np.asarray(self.edges), np.asarray(self.coefficients))
        if self.repeat:
            whole = whole.repeated(start, stop)
        self(np.array([start, stop]))  # InputError outside
        return whole.on(np.concatenate([[start], inside(whole.edges, start, stop), [stop]]))

    def mean(self, start: float, stop: float) -> float:
        """Exact mean."""
        return self.cubics(start, stop).integral() / (stop - start)
