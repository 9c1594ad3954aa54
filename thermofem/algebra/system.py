"""The linear equations that the algebra and the integrators take, whatever class holds them."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

SHORTEST, LONGEST = 1e-20, 1e12  # s, of a time constant: beyond them rates and charges overflow in other programs


class LinearSystem(Protocol):
    """E dx/dt = A x + B P, y = C x, with E and -A symmetric positive definite, sparse or dense."""

    @property
    def E(self) -> Any:
        """Heat capacity, shape (n, n), J/K."""

    @property
    def A(self) -> Any:
        """Minus the heat conduction, shape (n, n), W/K."""

    @property
    def B(self) -> NDArray[np.float64]:
        """Heat that enters each state per watt, shape (n, inputs)."""

    @property
    def C(self) -> NDArray[np.float64]:
        """Weight of each state in each output, shape (outputs, n)."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""

    @property
    def order(self) -> int:
        """Number of states."""
