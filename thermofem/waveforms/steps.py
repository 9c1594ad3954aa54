"""Powers that are constant between times of change: a pulse, a stream of symbols, a random telegraph, a chirp."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .contract import Array, inside, seconds


class Steps:
    """A power ``levels[k]`` in W, shape (n + 1,), between ``edges[k - 1]`` and ``edges[k]`` in s, shape (n,)."""

    edges: Array
    levels: Array
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return np.asarray(self.levels[np.searchsorted(self.edges, seconds(t), side="right")])

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return np.asarray(self.levels[np.searchsorted(self.edges, seconds(t), side="left")])

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every change inside."""
        return inside(self.edges, start, stop)

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy of every piece."""
        edges = np.concatenate([[start], self.breakpoints(start, stop), [stop]])
        return float(np.diff(edges) @ self((edges[:-1] + edges[1:]) / 2) / (stop - start))


class Switched(Steps):
    """A power that is on or off; it begins on."""

    power: float

    @cached_property
    def levels(self) -> Array:  # type: ignore[override]
        """The power and zero in turn, W."""
        return self.power * (np.arange(self.edges.size + 1) % 2 == 0)
