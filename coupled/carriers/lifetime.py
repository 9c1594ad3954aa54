"""Free-carrier recombination with one lifetime at every density."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import checks

SHORTEST = 1e-15  # s: faster than any recombination, and its inverse is far from overflow


@dataclass(frozen=True)
class ConstantLifetime:
    """dN/dt = -N/tau: the usual model, accurate at low carrier density and where carriers are swept out.

    Parameters
    ----------
    tau : float, s

    >>> float(ConstantLifetime(10e-9).lifetime(1e23))
    1e-08
    """

    tau: float
    a: ClassVar[float] = 0.0
    b: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "lifetimes are in s (did you mean 10e-9 for 10 ns?)"
        checks.positive("tau", self.tau, unit="s", at_most=0.1, hint=hint)
        checks.between("tau", self.tau, SHORTEST, 0.1, unit="s", hint=hint)

    @property
    def tau0(self) -> float:
        """The lifetime in s."""
        return self.tau

    def lifetime(self, density: ArrayLike) -> NDArray[np.float64]:
        """Tau in s, shape of ``density``."""
        return np.full(checks.numbers("density", density).shape, float(self.tau))
