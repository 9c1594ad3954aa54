"""A few fields that hold almost all of what a heat problem does: a rational Krylov basis in modal form.

The basis V collects (K + s_j M)^-1 R for four real shifts s_j taken in turn, R being what the basis so far leaves of
the heat vectors; a rotation then makes V^T M V = 1 and V^T K V = diag(rate). It carries no bound of its error
(`surrogate.reduce` gives one): it speeds up what is exact with any basis, see `thermofem.transient.deflation`.

Source: A. Ruhe, Linear Algebra Appl. 58, 391 (1984).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..factor import factorize
from ..model import StateSpace

Array = NDArray[np.float64]

SHIFTS = 4
CYCLES = 5  # 20 fields a heated part: Z(f) within 2e-5 of R_th up to 3 GHz (measured on strip, rib, heated ring)


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


def krylov(system: StateSpace, cycles: int = CYCLES) -> Basis:
    """Return the basis of ``cycles`` rounds through four shifts, for all inputs at once; empty for 0 rounds.

    Raises
    ------
    InputError
        a system that is not one of heat flow: E and -A symmetric positive definite.
    """
    from scipy.sparse import csr_matrix

    M, K, B = csr_matrix(system.E), -csr_matrix(system.A), np.asarray(system.B, dtype=float)
    refusal = "the system is none of heat flow: E and -A must be symmetric and positive definite"
    for name, matrix in (("E", M), ("A", K)):  # the factors take one triangle for both
        checks.symmetric(name, matrix, hint=refusal)
    V = MV = np.empty((system.order, 0))
    if cycles == 0:
        return Basis(np.empty(0), V, V.T @ B)
    static = factorize(K)
    x = np.column_stack([static(b) for b in B.T])
    gain, content = np.einsum("ij,ij->j", B, x), np.einsum("ij,ij->j", x, M @ x)
    if np.any(gain <= 0) or np.any(content <= 0):
        raise checks.InputError(refusal)
    lumped = B / M.diagonal()[:, None]
    slope = np.einsum("ij,ij->j", B, lumped) ** 2 / np.einsum("ij,ij->j", lumped, M @ lumped)
    shifts = np.geomspace(30 * (gain / content).min(), 300 * (slope / gain).max(), SHIFTS - 1)
    solvers = [static, *(factorize(K + s * M) for s in shifts)]
    for turn in range(SHIFTS * cycles):
        rest = B - MV @ (V.T @ B)
        W = np.column_stack([solvers[turn % SHIFTS](b) for b in rest.T])
        W = orthonormal(W, M, V, MV, smallest=1e-16)
        V, MV = np.column_stack([V, W]), np.column_stack([MV, M @ W])
    stiffness = V.T @ (K @ V)
    rate, modes = np.linalg.eigh(symmetric_part(stiffness))
    V = V @ modes
    return Basis(rate, V, V.T @ B)


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
