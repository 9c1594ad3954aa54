"""The rational Krylov space of a reduction: grown one shift at a time, with what its certificate needs.

It begins with some solves at s = 0, which give the static gain and the slowest rate, and goes on with two or three
shifts in turn: the factors of K then make place for those of the first.

Sources: A. Ruhe, Linear Algebra Appl. 58, 391 (1984); A. C. Antoulas, Approximation of Large-Scale Dynamical Systems
(SIAM, 2005), ch. 11.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import checks
from thermofem.factor import Pencil
from thermofem.transient.krylov import orthonormal, symmetric_part

from .certificate import Projection

Array = NDArray[np.float64]

EXHAUSTED = 1e-13  # of the ports outside the basis: round-off
FAR = 200.0  # between two shifts: beyond, the bound in their middle is three times the error (measured)
ROOM = 32  # columns that the basis has room for at first


class Space:
    """A rational Krylov space that grows one shift at a time, M-orthonormal."""

    projection: Projection

    def __init__(self, K: Any, M: Any, ports: Array, tolerance: float) -> None:
        n, p = ports.shape
        if M.diagonal().min() <= 0:
            raise checks.InputError("E is not positive definite; every heat capacity must be positive")
        self.K, self.M, self.ports, self.remainder, self.solves = K, M, ports, ports, 0
        self.order, self.turn = 0, 0
        self.stiffness, self._inside = np.empty((0, 0)), np.empty((0, p))
        self._V, self._MV = (np.empty((n, ROOM), order="F") for _ in range(2))
        self._pencil = Pencil(M, K)
        self.shifts = np.zeros(1)
        for _ in range(_static(tolerance)):
            if not self.extend(self.solve(0)) or self.exhausted:
                break
        self.shifts, self.growing = _shifts(M, ports, self.projection, tolerance)
        for s in self.shifts[2:]:
            self._pencil.keep(s, 1.0)

    @property
    def V(self) -> Array:
        """The basis."""
        return self._V[:, : self.order]

    @property
    def MV(self) -> Array:
        """M times the basis."""
        return self._MV[:, : self.order]

    @property
    def exhausted(self) -> bool:
        """Whether the basis holds the ports but for round-off; Phi is then lost in it (`certify_defect`)."""
        return bool(np.linalg.norm(self.remainder) <= EXHAUSTED * np.linalg.norm(self.ports))

    @property
    def defect(self) -> Array:
        """K V Z - M V Z diag(rate) of the projection."""
        Z, rate = self.projection.vectors, self.projection.rate
        return np.asarray(self.K @ (self.V @ Z) - (self.MV @ Z) * rate)

    def solve(self, j: int) -> Array:
        """(K + s_j M)^-1 times what the basis leaves of the ports."""
        self.solves += self.remainder.shape[1]
        return self._apply(j, self.remainder)

    def static(self, columns: Array) -> Array:
        """K^-1 times columns; the first of the other shifts loses its factors to it."""
        return self._apply(0, columns)

    def _apply(self, j: int, columns: Array) -> Array:
        return np.column_stack([self._pencil.solve(self.shifts[j], 1.0, column) for column in columns.T])

    def solve_next(self) -> tuple[int, Array]:
        """The solve with the next shift in turn: it extends the basis and also certifies the one so far."""
        j = 1 + self.turn % self.growing
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
        KW, MW = self.K @ W, self.M @ W
        across, corner = self.V.T @ KW, W.T @ KW
        self._append(W, MW)
        self.stiffness = np.block([[self.stiffness, across], [across.T, symmetric_part(corner)]])
        # slow fields come first: this triangle keeps the slow rates, and with them R_th, to 1e-12 beside the fast ones
        rate, Z = np.linalg.eigh(self.stiffness, UPLO="U")
        if not rate[0] > 0:
            raise checks.InputError(
                f"-A is not positive definite (a mode grows at {-rate[0]:g} 1/s); is a boundary held?"
            )
        inside = W.T @ self.remainder
        self._inside = np.vstack([self._inside, inside])
        self.remainder = self.remainder - MW @ inside
        self.projection = Projection(rate, Z.T @ self._inside, self.remainder, self.MV, Z)
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


def _static(tolerance: float) -> int:
    """Solves at s = 0 before the other shifts."""
    return int(np.clip(round(-np.log10(tolerance)), 2, 4))


def _shifts(M: Any, ports: Array, projection: Projection, tolerance: float) -> tuple[Array, int]:
    """{0} and log-spaced rates from a multiple of the slowest rate to one of the fastest that the ports see.

    Second, how many of them beside 0 the space grows with; one more only tightens the bound, where two lie far apart.

    The fastest comes from the initial slope of the step response, b^T M^-1 b / (b^T K^-1 b), estimated from below by
    (b^T D^-1 b)^2 / (b^T D^-1 M D^-1 b) with D the diagonal of M. The multiples are where strips, a rib, a heater and a
    disc need the fewest states at 1e-2..1e-7 (measured; flat within a factor 1.3). Down to 1e-4 two shifts are enough,
    below a third keeps the states few.
    """
    lumped = ports / M.diagonal()[:, None]
    slope = np.einsum("ij,ij->j", ports, lumped) ** 2 / np.einsum("ij,ij->j", lumped, M @ lumped)
    slowest, fastest = projection.rate[0], float(np.max(slope / projection.gain.diagonal()))
    if tolerance >= 1e-4:
        count, low, high = 2, max(20.0, 40 * (1e-4 / tolerance) ** 0.22) * slowest, 2.5 * tolerance**-0.3 * fastest
    else:
        count, low, high = 3, 18 * slowest, 1.1 * tolerance**-0.5 * fastest
    low = min(low, high / 10)
    between = [np.sqrt(low * high)] if count == 2 and high > FAR * low else []
    return np.concatenate([[0.0], np.geomspace(low, high, count), between]), count
