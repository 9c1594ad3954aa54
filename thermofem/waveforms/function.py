"""A power given by any function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, Array, check_cycles, inside, seconds, spans, wrapped
from .pieces import cubic_pieces


@spans
@shown
@dataclass(frozen=True, eq=False, init=False)
class Function:
    """P(t) = f(t): any function of time; W as a power, Hz as a detuning.

    Closed forms and compiled integrators see it as a piecewise cubic, fitted with error control (`adaptive.fitted`).
    A feature narrower than 1e-4 of the stretch between two breakpoints may be missed unless ``breakpoints`` or
    ``time_scale`` names it.

    Parameters
    ----------
    f : callable
        of the time in s; it may take an array of times, or one time only.
    breakpoints : sequence of float, s
        increasing: where f jumps or has a kink, within one period where ``period`` is given.
    period : float, s, optional
        f is taken on [0, period) and repeats.
    time_scale : float, s, optional
        the shortest time in which f changes.

    Raises
    ------
    InputError
        f is not callable, fails, or returns what is not a finite number; breakpoints that do not increase.

    >>> wave = Function(lambda t: 2e-3 * np.exp(-(((t - 5e-6) / 1e-6) ** 2)))
    >>> float(wave(5e-6)), round(wave.mean(0, 10e-6) * 1e3, 4)
    (0.002, 0.3545)
    """

    f: Callable[[Any], Any]
    edges: Array
    period: float | None
    time_scale: float | None
    piecewise_linear: ClassVar[bool] = False

    def __init__(
        self,
        f: Callable[[Any], Any],
        breakpoints: ArrayLike = (),
        *,
        period: float | None = None,
        time_scale: float | None = None,
    ) -> None:
        if not callable(f):
            raise checks.InputError(f"f = {f!r} is no function of time; e.g. th.Function(lambda t: 1e-3 * (t < 1e-6))")
        edges = np.unique(checks.array("breakpoints", breakpoints, increasing=True, empty=True, hint=TIME_HINT))
        for name, value in (("period", period), ("time_scale", time_scale)):
            if value is not None:
                value = checks.positive(name, value, unit="s", at_most=10, hint=TIME_HINT)
            object.__setattr__(self, name, value)
        if self.period is not None and edges.size and (edges[0] < 0 or edges[-1] > self.period):
            raise checks.InputError(
                f"breakpoints from {edges[0]:g} to {edges[-1]:g} s; they must lie within one period, 0 to {period:g} s"
            )
        object.__setattr__(self, "f", f)
        object.__setattr__(self, "edges", edges)

    def _at(self, t: ArrayLike, side: int) -> Array:
        """Evaluate f; times at a breakpoint are shifted by two units in the last place to its right or left side."""
        u = seconds(t)
        edges = self.edges
        if self.period is not None:
            edges = np.unique(np.concatenate([[0.0], edges, [self.period]]))
            u = wrapped(u, self.period, before=side < 0)
        if edges.size and u.size:
            nearest = edges[np.clip(np.searchsorted((edges[1:] + edges[:-1]) / 2, u), 0, edges.size - 1)]
            hair = 4 * np.spacing(np.abs(nearest))
            u = np.where(np.abs(u - nearest) <= hair, nearest + 2 * side * hair, u)
        return self._values(u)

    def _values(self, t: Array) -> Array:
        try:
            found = np.asarray(self.f(t))
            if found.shape != t.shape:
                found = np.broadcast_to(found, t.shape) if found.size == 1 and t.size == 1 else self._one_by_one(t)
        except (
            TypeError,
            ValueError,
            LookupError,
            ArithmeticError,
            AttributeError,
        ):  # of a function that takes one time only
            found = self._one_by_one(t)
        if found.dtype.kind not in "fiub":
            raise checks.InputError(f"f returns {found.dtype} values; a real number is needed for every time")
        if not np.isfinite(found).all():
            at = ~np.isfinite(found)
            raise checks.InputError(f"f({t[at].flat[0]:g} s) = {found[at].flat[0]}, which is not finite")
        return np.array(found, dtype=float)

    def _one_by_one(self, t: Array) -> Array:
        try:
            return np.array([self.f(float(one)) for one in t.ravel()]).reshape(t.shape)
        except Exception as error:
            raise checks.InputError(
                f"f fails between {t.min():g} and {t.max():g} s: {type(error).__name__}: "
                f"{' '.join(str(error).split())}; it must return a number for every time in s"
            ) from error

    def __call__(self, t: ArrayLike) -> Array:
        """The value at ``t``, continuous from the right."""
        return self._at(t, 1)

    def before(self, t: ArrayLike) -> Array:
        """The value just before ``t``."""
        return self._at(t, -1)

    def breakpoints(self, start: float, stop: float) -> Array:
        """The named breakpoints inside, and the ends of every period."""
        if self.period is None:
            return inside(self.edges, start, stop)
        check_cycles(start, stop, self.period)
        cycles = np.arange(np.floor(start / self.period) - 1, np.ceil(stop / self.period) + 1)
        edges = np.unique(np.concatenate([[0.0], self.edges[self.edges < self.period]]))
        return inside((edges + self.period * cycles[:, None]).ravel(), start, stop)

    def mean(self, start: float, stop: float) -> float:
        """Mean over [start, stop], within 1e-8 of the largest value."""
        return cubic_pieces(self, start, stop).integral() / (stop - start)
