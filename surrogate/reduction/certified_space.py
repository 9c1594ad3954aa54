"""The rational Krylov space of a reduction, extended one shift at a time, with the data of its certificate.

It begins with some solves at s = 0, which give the static gain and the slowest rate, and goes on with two or three
shifts in turn: the factors of K then make place for those of the first.

Sources: A. Ruhe, Linear Algebra Appl. 58, 391 (1984); A. C. Antoulas, Approximation of Large-Scale Dynamical Systems
(SIAM, 2005), ch. 11.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem import checks
from thermofem.algebra import krylov
from thermofem.algebra.factor import Pencil
from thermofem.arrays import Array, NDArray

from .error_bound import Projection

EXHAUSTED = 1e-13  # of the ports outside the basis: round-off
FAR = 200.0  # between two shifts: beyond, the bound in their middle is three times the error (measured)


class CertifiedSpace(krylov.KrylovSpace):
    """A rational Krylov space that grows one shift at a time, and its projection."""

    projection: Projection

    def __init__(self, K: Any, M: Any, ports: Array, tolerance: float) -> None:
        if M.diagonal().min() <= 0:
            raise checks.InputError("E is not positive definite; every heat capacity must be positive")
        super().__init__(K, M, ports, smallest=1e-20)
        self.solves = self.turn = 0
        self._pencil = Pencil(M, K)
        self.shifts = np.zeros(1)
        for _ in range(_static(tolerance)):
            if not self.extend(self.solve(0)) or self.exhausted:
                break
        self.shifts, self.growing = _shifts(M, ports, self.projection, tolerance)
        for s in self.shifts[2:]:
            self._pencil.keep(s, 1.0)

    @property
    def exhausted(self) -> bool:
        """Whether the basis holds every port but for round-off; Phi is then lost in it (`certify_defect`)."""
        return not _left(self.remainder, self.B).any()

    @property
    def defect(self) -> Array:
        """K V Z - M V Z diag(rate) of the projection."""
        Z, rate = self.projection.vectors, self.projection.rate
        return np.asarray(self.K @ (self.V @ Z) - (self.MV @ Z) * rate)

    def solve(self, j: int) -> Array:
        """(K + s_j M)^-1 times the part of the ports outside the basis (`Projection.remainder`)."""
        columns = self.projection.remainder if self.order else self.remainder
        self.solves += columns.shape[1]
        return self.apply(j, columns)

    def next_residual(self) -> tuple[float, Array]:
        """Next shift s, the largest error of a port's own channel at s in K/W, and the columns that correct it.

        The columns are (K + s M)^-1 times the residual at s: the same direction as `solve`, above round-off for longer.
        """
        j = 1 + self.turn % self.growing
        self.turn += 1
        Y = self.projection.ports / (self.projection.rate + self.shifts[j])[:, None]
        left = self.remainder - self.defect @ Y
        left = left[:, np.linalg.norm(left, axis=0) > EXHAUSTED * np.linalg.norm(self.B, axis=0)]
        self.solves += left.shape[1]
        columns = self.apply(j, left)
        return float(np.einsum("ij,ij->j", left, columns).max(initial=0.0)), columns

    def apply(self, j: int, columns: Array) -> Array:
        """(K + s_j M)^-1 times columns."""
        if not columns.shape[1]:
            return columns
        return np.column_stack([self._pencil.solve(self.shifts[j], 1.0, column) for column in columns.T])

    def solve_next(self) -> tuple[int, Array]:
        """Solve with the next shift; the solution certifies the basis so far and then extends it."""
        j = 1 + self.turn % self.growing
        self.turn += 1
        return j, self.solve(j)

    def extend(self, W: Array) -> bool:
        """Add the columns of W, made orthogonal to the basis, and project; False if they lie in the basis."""
        if not super().extend(W):
            return False
        # slow fields come first: this triangle keeps the slow rates, and with them R_th, to 1e-12 beside the fast ones
        rate, Z = np.linalg.eigh(self.stiffness, UPLO="U")
        if not rate[0] > 0:
            raise checks.InputError(
                f"-A is not positive definite (a mode grows at {-rate[0]:g} 1/s); is a boundary held?"
            )
        Q, T = _independent(self.remainder, self.B)
        self.projection = Projection(rate, Z.T @ self.inside, Q, self.MV, Z, T, self.V)
        return True


def _left(remainder: Array, ports: Array) -> NDArray[np.bool_]:
    """Which ports the basis does not hold to round-off."""
    return np.asarray(np.linalg.norm(remainder, axis=0) > EXHAUSTED * np.linalg.norm(ports, axis=0))


def _independent(remainder: Array, ports: Array) -> tuple[Array, Array]:
    """Q and T of the remainder: its columns made independent, those of nearly equal ports too.

    A port that the basis holds to round-off has no share; one port is left as it is.
    """
    from scipy.linalg import qr

    if remainder.shape[1] == 1:
        return remainder, np.eye(1)
    left = _left(remainder, ports)
    if not left.any():
        return remainder, np.eye(remainder.shape[1])
    size = np.linalg.norm(remainder[:, left], axis=0)
    Q, T, order = qr(remainder[:, left] / size, mode="economic", pivoting=True)
    kept = np.abs(T.diagonal()) > EXHAUSTED
    shares = np.zeros((int(kept.sum()), remainder.shape[1]))
    shares[:, np.flatnonzero(left)[order]] = T[kept] * size[order]
    return np.ascontiguousarray(Q[:, kept]), shares


def _static(tolerance: float) -> int:
    """Solves at s = 0 before the other shifts."""
    return int(np.clip(round(-np.log10(tolerance)), 2, 4))


def _shifts(M: Any, ports: Array, projection: Projection, tolerance: float) -> tuple[Array, int]:
    """Shifts: 0, and log-spaced rates from a multiple of the slowest rate to a multiple of the fastest at the ports.

    Also returns the number of them, beside 0, that enlarge the space; a further one only tightens the bound.

    The fastest comes from the initial slope of the step response, b^T M^-1 b / (b^T K^-1 b). The multiples are where
    strips, a rib, a heater and a disc need the fewest states at 1e-2..1e-7 (measured; flat within a factor 1.3). Down
    to 1e-4 two shifts are enough, below a third keeps the states few.
    """
    slowest, fastest = projection.rate[0], float(np.max(krylov.slopes(M, ports) / projection.gain.diagonal()))
    if tolerance >= 1e-4:
        count, low, high = 2, max(20.0, 40 * (1e-4 / tolerance) ** 0.22) * slowest, 2.5 * tolerance**-0.3 * fastest
    else:
        count, low, high = 3, 18 * slowest, 1.1 * tolerance**-0.5 * fastest
    low = min(low, high / 10)
    between = [np.sqrt(low * high)] if count == 2 and high > FAR * low else []
    return np.concatenate([[0.0], np.geomspace(low, high, count), between]), count
