"""A few fields that hold almost all of what a heat problem does: a rational Krylov space in modal form.

The space collects (K + s_j M)^-1 R for a few real shifts s_j taken in turn, R being what the space so far leaves of
the heat vectors; a rotation then makes V^T M V = 1 and V^T K V = diag(rate). It carries no bound of its error
(`surrogate.reduce` gives one): it speeds up what is exact with any fields, see `thermofem.transient.deflation`, or is
grown until an answer no longer moves, see `thermofem.transient.modal`.

Source: A. Ruhe, Linear Algebra Appl. 58, 391 (1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..factor import Solve, factorize
from ..model import StateSpace

Array = NDArray[np.float64]

SHIFTS = 4
CYCLES = 5  # 20 fields a heated part: Z(f) within 2e-5 of R_th up to 3 GHz (measured on strip, rib, heated ring)
REFUSAL = "the system is none of heat flow: E and -A must be symmetric and positive definite"


@dataclass(frozen=True, eq=False)
class Basis:
    """M-orthonormal fields V in which the reduced system is diagonal: dz/dt = -rate z + (V^T B) P.

    Attributes
    ----------
    rate : array, shape (k,), 1/s
    vectors : array, shape (n, k)
    heating : array, shape (k, inputs)
        V^T B.
    """

    rate: Array
    vectors: Array
    heating: Array

    def reduced(self, system: StateSpace) -> StateSpace:
        """The reduced model with the inputs and outputs of ``system``."""
        names = {"inputs": system.inputs, "outputs": system.outputs}
        return StateSpace(np.eye(self.rate.size), -np.diag(self.rate), self.heating, system.C @ self.vectors, **names)


class Space:
    """A rational Krylov space of a heat problem: grown by rounds through its shifts, M-orthonormal.

    Parameters
    ----------
    system : StateSpace
        E and -A symmetric positive definite.
    shifts : array, 1/s
    solvers : sequence of callable
        solve with K + s M, for each shift s.
    """

    def __init__(self, system: StateSpace, shifts: Array, solvers: Sequence[Solve]) -> None:
        from scipy.sparse import csr_matrix

        self.M, self.K, self.B = csr_matrix(system.E), -csr_matrix(system.A), np.asarray(system.B, dtype=float)
        self.shifts, self.solvers = shifts, solvers
        self.V = self.MV = np.empty((system.order, 0))
        self.stiffness = np.empty((0, 0))
        self.sizes = [0]

    @property
    def order(self) -> int:
        """Number of fields."""
        return int(self.V.shape[1])

    def grow(self) -> None:
        """One round through the shifts; the space stays as it is once it holds everything."""
        for solve in self.solvers:
            if self.order < self.V.shape[0]:
                rest = self.B - self.MV @ (self.V.T @ self.B)
                self._add(np.column_stack([solve(b) for b in rest.T]))
        self.sizes.append(self.order)

    def _add(self, W: Array) -> None:
        room = self.V.shape[0] - self.order
        W = orthonormal(W, self.M, self.V, self.MV, most=room, smallest=1e-16)
        KW = self.K @ W
        across, corner = self.V.T @ KW, W.T @ KW
        self.V, self.MV = np.column_stack([self.V, W]), np.column_stack([self.MV, self.M @ W])
        self.stiffness = np.block([[self.stiffness, across], [across.T, symmetric_part(corner)]])

    def basis(self, size: int | None = None, extra: Array | None = None) -> Basis:
        """Its first ``size`` fields (default all), and an extra one of shape (n,), in modal form."""
        size = self.order if size is None else size
        V, stiffness = self.V[:, :size], self.stiffness[:size, :size]
        if extra is not None and size < len(V):
            w = orthonormal(extra[:, None], self.M, V, self.MV[:, :size], smallest=1e-16)
            across = V.T @ (self.K @ w)
            V = np.column_stack([V, w])
            stiffness = np.block([[stiffness, across], [across.T, w.T @ (self.K @ w)]])
        rate, rotation = np.linalg.eigh(stiffness)
        V = V @ rotation
        return Basis(rate, V, V.T @ self.B)


def krylov(system: StateSpace, cycles: int = CYCLES) -> Basis:
    """Return the basis of ``cycles`` rounds through four shifts, for all inputs at once; empty for 0 rounds.

    Raises
    ------
    InputError
        a system that is not one of heat flow: E and -A symmetric positive definite.
    """
    from scipy.sparse import csr_matrix

    check_heat_flow(system)
    if cycles == 0:
        none = np.empty((system.order, 0))
        return Basis(np.empty(0), none, none.T @ np.asarray(system.B, dtype=float))
    M, K = csr_matrix(system.E), -csr_matrix(system.A)
    static = factorize(K)
    slow, fast = rates(system, static)
    shifts = np.append(0.0, np.geomspace(30 * slow, 300 * fast, SHIFTS - 1))
    space = Space(system, shifts, [static, *(factorize(K + s * M) for s in shifts[1:])])
    for _ in range(cycles):
        space.grow()
    return space.basis()


def rates(system: StateSpace, static: Solve) -> tuple[float, float]:
    """The slowest and the fastest rate in 1/s at which the heated parts answer: gain/content, and initial slope/gain.

    The slope b^T M^-1 b is estimated from below by (b^T D^-1 b)^2 / (b^T D^-1 M D^-1 b) with D the diagonal of M.

    Raises
    ------
    InputError
        a static gain or a heat content that is not positive.
    """
    B, M = np.asarray(system.B, dtype=float), system.E
    x = np.column_stack([static(b) for b in B.T])
    gain, content = np.einsum("ij,ij->j", B, x), np.einsum("ij,ij->j", x, M @ x)
    if np.any(gain <= 0) or np.any(content <= 0):
        raise checks.InputError(REFUSAL)
    lumped = B / M.diagonal()[:, None]
    slope = np.einsum("ij,ij->j", B, lumped) ** 2 / np.einsum("ij,ij->j", lumped, M @ lumped)
    return float((gain / content).min()), float((slope / gain).max())


def check_heat_flow(system: StateSpace) -> None:
    """Raise InputError unless E and A are symmetric: the factors take one triangle for both."""
    for name, matrix in (("E", system.E), ("A", system.A)):
        checks.symmetric(name, matrix, hint=REFUSAL)


def orthonormal(W: Array, M: Any, V: Array, MV: Array, *, most: int | None = None, smallest: float) -> Array:
    """What the columns of W add to an M-orthonormal basis V, M-orthonormal itself.

    Parameters
    ----------
    W : array, shape (n, p)
    M : sparse matrix, shape (n, n)
    V, MV : array, shape (n, k)
        the basis, and M times it.
    most : int
        columns to keep at most, those that add most; default all.
    smallest : float
        squared length, of columns of unit length before what V holds is taken out, below which round-off is left.

    Raises
    ------
    InputError
        M not positive definite.
    """
    MW = M @ W
    size = np.einsum("ij,ij->j", W, MW)
    if np.any(size <= 0):
        raise checks.InputError("E is not positive definite; every heat capacity must be positive")
    W, MW = W / np.sqrt(size), MW / np.sqrt(size)
    for _ in range(2):  # once more removes what round-off left
        inside = MV.T @ W
        W, MW = W - V @ inside, MW - MV @ inside
    value, vector = np.linalg.eigh(symmetric_part(W.T @ MW))
    kept = value > smallest
    if most is not None:
        kept[: max(0, kept.size - most)] = False
    return np.asarray(W @ (vector[:, kept] / np.sqrt(value[kept])))


def symmetric_part(matrix: Array) -> Array:
    """(A + A^T)/2."""
    return (matrix + matrix.T) / 2
