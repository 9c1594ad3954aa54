"""The rational Krylov space of a reduction: grown one shift at a time, with what its certificate needs.

Sources: A. Ruhe, Linear Algebra Appl. 58, 391 (1984); A. C. Antoulas, Approximation of Large-Scale Dynamical Systems
(SIAM, 2005), ch. 11.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import checks
from thermofem.factor import factorize
from thermofem.transient.krylov import orthonormal, symmetric_part

from .certificate import Projection

Array = NDArray[np.float64]

ROOM = 32  # columns that the basis has room for at first


class Space:
    """A rational Krylov space that grows one shift at a time, M-orthonormal."""

    def __init__(self, K: Any, M: Any, ports: Array, tolerance: float) -> None:
        from scipy.sparse import triu

        self.K, self.M, self.ports, self.solves = K, M, ports, 0
        self.order, self.stiffness = 0, np.empty((0, 0))
        self._V, self._MV = (np.empty((ports.shape[0], ROOM), order="F") for _ in range(2))
        self.projection: Projection | None = None
        self.remainder = ports
        self.turn = 0
        upper_K, upper_M = triu(K, format="csc"), triu(M, format="csc")
        static = factorize(upper_K, upper=True)
        self.shifts = _shifts(M, static, ports, tolerance)
        self.factors = [static, *(factorize(upper_K + s * upper_M, upper=True) for s in self.shifts[1:])]

    @property
    def V(self) -> Array:
        """The basis."""
        return self._V[:, : self.order]

    @property
    def MV(self) -> Array:
        """M times the basis."""
        return self._MV[:, : self.order]

    @property
    def defect(self) -> Array:
        """K V Z - M V Z diag(rate) of the projection."""
        assert self.projection is not None
        Z, rate = self.projection.vectors, self.projection.rate
        return np.asarray(self.K @ (self.V @ Z) - (self.MV @ Z) * rate)

    def solve(self, j: int) -> Array:
        """(K + s_j M)^-1 times what the basis leaves of the ports."""
        self.solves += self.remainder.shape[1]
        return np.column_stack([self.factors[j](column) for column in self.remainder.T])

    def solve_next(self) -> tuple[int, Array]:
        """The solve with the next shift in turn: it extends the basis and also certifies the one so far."""
        j = self.turn % self.shifts.size
        self.turn += 1
        return j, self.solve(j)

    def extend(self, W: Array) -> bool:
        """Add the columns of W; False when the space holds them already, or everything."""
        room = self.M.shape[0] - self.order
        if room == 0:
            return False
        W = orthonormal(W, self.M, self.V, self.MV, most=room, smallest=1e-20)
        if W.shape[1] == 0:
            return False
        KW = self.K @ W
        across, corner = self.V.T @ KW, W.T @ KW
        self._append(W, self.M @ W)
        self.stiffness = np.block([[self.stiffness, across], [across.T, symmetric_part(corner)]])
        rate, Z = np.linalg.eigh(self.stiffness)
        if rate[0] <= 0:
            raise checks.InputError(
                f"-A is not positive definite (a mode grows at {-rate[0]:g} 1/s); is a boundary held?"
            )
        inside = self.V.T @ self.ports
        self.remainder = self.ports - self.MV @ inside
        self.projection = Projection(rate, Z.T @ inside, self.remainder, self.MV, Z)
        return True

    def _append(self, W: Array, MW: Array) -> None:
        """New columns, in room made before."""
        wanted = self.order + W.shape[1]
        if wanted > self._V.shape[1]:
            more = np.empty_like(self._V)
            self._V, self._MV = (
                np.asfortranarray(np.hstack([self._V, more])),
                np.asfortranarray(np.hstack([self._MV, more])),
            )
        self._V[:, self.order : wanted], self._MV[:, self.order : wanted] = W, MW
        self.order = wanted


def _shifts(M: Any, static: Callable[[Array], Array], ports: Array, tolerance: float) -> Array:
    """{0} and log-spaced rates from 30 times the slowest to the fastest that the tolerance sees.

    The fastest comes from the initial slope of the step response, b^T M^-1 b / (b^T K^-1 b), estimated from below by
    (b^T D^-1 b)^2 / (b^T D^-1 M D^-1 b) with D the diagonal of M; the factor 50 tolerance^-1/6 in front of it is where
    the order of reference and random strips was smallest for 1e-3..1e-6 (measured; flat within a factor 3).
    """
    x = np.column_stack([static(b) for b in ports.T])
    gain = np.einsum("ij,ij->j", ports, x)
    if np.any(gain <= 0):
        raise checks.InputError(f"the static gain {gain.min():g} K/W is not positive; is -A positive definite?")
    if M.diagonal().min() <= 0:
        raise checks.InputError("E is not positive definite; every heat capacity must be positive")
    lumped = ports / M.diagonal()[:, None]
    slope = np.einsum("ij,ij->j", ports, lumped) ** 2 / np.einsum("ij,ij->j", lumped, M @ lumped)
    fastest = 50 * tolerance ** (-1 / 6) * float(np.max(slope / gain))
    v = x.sum(axis=1)
    for _ in range(4):  # inverse iteration; its Rayleigh quotient is above the slowest rate by a few percent at most
        v = v / np.linalg.norm(v)
        w = static(M @ v)
        slowest, v = float(v @ (M @ w)) / float(w @ (M @ w)), w
    if slowest <= 0:
        raise checks.InputError(f"-A is not positive definite (a mode grows at {-slowest:g} 1/s); is a boundary held?")
    low = min(30 * slowest, fastest / 10)
    return np.concatenate([[0.0], np.geomspace(low, fastest, max(3, round(np.log10(fastest / low))))])
