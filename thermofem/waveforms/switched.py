"""A power that is on or off, from the times at which it changes: shared by the random telegraph and the chirp."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .contract import Array, inside, seconds


class Switched:
    """A power that is on or off, from the times at which it changes; it begins on."""

    power: float
    edges: Array  # off, on, off, ...
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""
        return self.power * (np.searchsorted(self.edges, seconds(t), side="right") % 2 == 0)

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""
        return self.power * (np.searchsorted(self.edges, seconds(t), side="left") % 2 == 0)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every change inside."""
        return inside(self.edges, start, stop)

    def mean(self, start: float, stop: float) -> float:
        """From the exact energy of every piece."""
        edges = np.concatenate([[start], self.breakpoints(start, stop), [stop]])
        return float(np.diff(edges) @ self((edges[:-1] + edges[1:]) / 2) / (stop - start))
