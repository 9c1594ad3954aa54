"""A rational Krylov space in modal form: a few fields that approximate the response of a heat problem.

The space collects (K + s_j M)^-1 R for a few real shifts s_j in turn, where R is the part of the heat vectors outside
the present space. A rotation then gives V^T M V = 1 and V^T K V = diag(rate). The space has no error bound
(`surrogate.reduce` has one). `thermofem.transient.deflation` uses it where any basis gives the exact result;
`thermofem.transient.modal` extends it until the result converges.

Source: A. Ruhe, Linear Algebra Appl. 58, 391 (1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_matrix

from .. import checks
from ..arrays import Array
from .factor import REFUSAL, Solve, check_symmetric, factorize

if TYPE_CHECKING:
    from ..models import StateSpace

ADDS_MUCH = 1e-6  # squared length of what a column of unit length adds, above which one projection more is enough


@dataclass(frozen=True, eq=False)
class Basis:
    """M-orthonormal fields V in which the reduced system is diagonal: dz/dt = -rate z + (V^T B) P.

    rate [shape (k,), 1/s]
    heating [shape (k, inputs)]: V^T B.
    fields [shape (n, k)]: M-orthonormal.
    rotation [shape (k, k)]: orthogonal; V = fields rotation.
    """

    rate: Array
    heating: Array
    fields: Array
    rotation: Array

    @cached_property
    def vectors(self) -> Array:
        """M-orthonormal modes V = fields rotation, shape (n, k)."""
        return self.fields @ self.rotation

    def read(self, C: Array) -> Array:
        """C V for functionals C, shape (outputs, n), without forming V."""
        return C @ self.fields @ self.rotation

    def reduced(self, system: StateSpace) -> StateSpace:
        """The reduced model with the inputs and outputs of ``system``."""
        E = np.eye(self.rate.size)
        A = -np.diag(self.rate)
        return replace(system, E=E, A=A, B=self.heating, C=self.read(system.C))


class KrylovSpace:
    """M-orthonormal fields, with K projected on them and the part of the heat vectors B outside their span.

    K, M [sparse matrix, shape (n, n)]: symmetric positive definite.
    B [shape (n, p)]
    smallest: a column of unit length is dropped when its squared remainder is below this value (round-off).
    V, MV [shape (n, order)]: the fields as columns, and M times them.
    stiffness [shape (order, order)]: V^T K V.
    inside [shape (order, p)]: V^T B.
    remainder [shape (n, p)]: B - M V V^T B.
    """

    def __init__(self, K: Any, M: Any, B: Array, smallest: float = 1e-16) -> None:
        self.K = K
        self.M = M
        self.B = B
        self.smallest = smallest
        self.V = self.MV = np.empty((B.shape[0], 0), order="F")
        self.stiffness = np.empty((0, 0))
        self.inside = np.empty((0, B.shape[1]))
        self.remainder = B

    @property
    def order(self) -> int:
        """Number of fields."""
        return self.V.shape[1]

    def extend(self, W: Array) -> bool:
        """Extend the space by the columns of W, shape (n, p); False if they lie in it already."""
        room = self.M.shape[0] - self.order
        W = W[:, W.any(axis=0)]  # nothing is left of heat that the space holds to the last digit
        if room == 0 or W.shape[1] == 0:
            return False
        W, MW = orthonormal(W, self.M, self.V, self.MV, most=room, smallest=self.smallest)
        if W.shape[1] == 0:
            return False
        KW = self.K @ W
        across = self.V.T @ KW
        corner = W.T @ KW
        self.V = np.hstack([self.V, W])
        self.MV = np.hstack([self.MV, MW])
        self.stiffness = np.block([[self.stiffness, across], [across.T, symmetric_part(corner)]])
        inside = W.T @ self.remainder
        self.inside = np.vstack([self.inside, inside])
        self.remainder = self.remainder - MW @ inside
        return True


class Rounds(KrylovSpace):
    """A rational Krylov space, grown by rounds through its shifts.

    shifts [1/s]
    solvers: solve with K + s M, for each shift s.
    """

    def __init__(self, system: StateSpace, shifts: Array, solvers: Sequence[Solve]) -> None:
        super().__init__(-csr_matrix(system.A), csr_matrix(system.E), np.asarray(system.B, dtype=float))
        self.shifts = shifts
        self.solvers = solvers
        self.sizes = [self.order]

    def grow(self) -> None:
        """Add one solve at each shift; nothing once the space holds every unknown."""
        for solve in self.solvers:
            if self.order < self.M.shape[0]:
                self.extend(np.column_stack([solve(b) for b in self.remainder.T]))
        self.sizes.append(self.order)

    def basis(self, size: int | None = None, *, constant: bool = False) -> Basis:
        """First ``size`` fields (default all) in modal form; ``constant``: with the constant field added."""
        size = self.order if size is None else size
        V = self.V[:, :size]
        stiffness = self.stiffness[:size, :size]
        inside = self.inside[:size]
        if constant and size < len(V):
            ones = np.ones((len(V), 1))
            w, _ = orthonormal(ones, self.M, V, self.MV[:, :size], smallest=self.smallest)
            Kw = self.K @ w
            across = V.T @ Kw
            corner = w.T @ Kw
            V = np.column_stack([V, w])
            inside = np.vstack([inside, w.T @ self.B])
            stiffness = np.block([[stiffness, across], [across.T, corner]])
        # slow fields come first: this triangle keeps the slow rates, and with them the heat balance, to 1e-11
        rate, rotation = np.linalg.eigh(stiffness, UPLO="U")
        return Basis(rate, rotation.T @ inside, V, rotation)


# 5 cycles are 20 fields a heated part: Z(f) within 2e-5 of R_th up to 3 GHz (measured on strip, rib, heated ring)
def krylov(system: StateSpace, cycles: int = 5) -> Basis:
    """Return the basis of ``cycles`` rounds through four shifts, for all inputs at once; empty for 0 rounds.

    Raises InputError: a system that is not one of heat flow: E and -A symmetric positive definite.
    """
    space = four_shifts(system)
    for _ in range(cycles):
        space.grow()
    return space.basis()


def four_shifts(system: StateSpace) -> Rounds:
    """Return the empty space of the shifts 0 and three from 30 times the slowest to 300 times the fastest of `rates`.

    Raises InputError: as `krylov`.
    """
    check_symmetric(E=system.E, A=system.A, hint=REFUSAL)
    M = csr_matrix(system.E)
    K = -csr_matrix(system.A)
    static = factorize(K)
    slow, fast = rates(system, static)
    positive = np.geomspace(30 * slow, 300 * fast, 3)
    solvers = [static, *(factorize(K + shift * M) for shift in positive)]
    return Rounds(system, np.append(0.0, positive), solvers)


def rates(system: StateSpace, static: Solve) -> tuple[float, float]:
    """Slowest and fastest rate in 1/s of the response of all heated parts: gain/heat content, and initial slope/gain.

    Raises InputError: a static gain, a heat content or a heat capacity that is not positive.
    """
    B = np.asarray(system.B, dtype=float)
    M = csr_matrix(system.E)
    x = np.column_stack([static(b) for b in B.T])
    gain = _products(B, x)
    content = _products(x, M @ x)
    for name, values in (("static gain", gain), ("heat content", content)):
        checks.positive(name, values.min(), hint=REFUSAL)
    slowest = (gain / content).min()
    fastest = (slopes(M, B) / gain).max()
    return float(slowest), float(fastest)


def slopes(M: Any, B: Array) -> Array:
    """Initial slope b^T M^-1 b of the step response of each column b, in K/J; InputError where M is not definite.

    Computed as the lower bound (b^T D^-1 b)^2 / (b^T D^-1 M D^-1 b) with D the diagonal of M.
    """
    checks.positive("diagonal of E", M.diagonal().min(), unit="J/K", hint=REFUSAL)
    lumped = B / M.diagonal()[:, None]
    inertia = _products(lumped, M @ lumped)
    return _products(B, lumped) ** 2 / inertia


def orthonormal(
    W: Array, M: Any, V: Array, MV: Array, *, most: int | None = None, smallest: float
) -> tuple[Array, Array]:
    """M-orthonormal basis of the part of W outside the span of V, and M times it; shape (n, found) each.

    Gram-Schmidt column by column, the one that adds most first, each orthogonalised again after it was scaled: so
    nearly equal columns give orthonormal ones to round-off (eigenvectors of their Gram matrix, exact to 1e-8
    only, were not).

    W [shape (n, p)]
    M [sparse matrix, shape (n, n)]
    V, MV [shape (n, k)]: the basis, and M times it.
    most: largest number of columns to return, those that add most; default all.
    smallest: squared length below which the rest of a column counts as round-off; columns begin with length 1.
    Raises InputError: M not positive definite.
    """
    MW = M @ W
    size = _products(W, MW)
    checks.positive("heat content of a field", size.min(), hint=REFUSAL)
    inside = MV.T @ W
    W = (W - V @ inside) / np.sqrt(size)
    MW = (MW - MV @ inside) / np.sqrt(size)
    count = W.shape[1] if most is None else min(most, W.shape[1])
    basis = np.empty((W.shape[0], count), order="F")
    M_basis = np.empty((W.shape[0], count), order="F")
    for k in range(count):
        outside = _products(W, MW)
        if outside.max() <= ADDS_MUCH:  # differences of M W know lengths no better
            MW = M @ W
            outside = _products(W, MW)
        pivot = int(np.argmax(outside))
        if outside[pivot] <= smallest:
            return basis[:, :k], M_basis[:, :k]
        w = W[:, pivot] / np.sqrt(outside[pivot])
        passes = 1 if outside[pivot] > ADDS_MUCH else 2  # round-off along the basis grows with 1/outside
        for _ in range(passes):
            along_basis = M_basis[:, :k].T @ w
            w = w - V @ (MV.T @ w) - basis[:, :k] @ along_basis
            Mw = M @ w
            length = np.sqrt(w @ Mw)
            w = w / length
            Mw = Mw / length
        basis[:, k] = w
        M_basis[:, k] = Mw
        if k + 1 < count:
            share = Mw @ W
            W = W - np.outer(w, share)
            MW = MW - np.outer(Mw, share)
    return basis, M_basis


def _products(V: Array, W: Array) -> Array:
    """v . w of every pair of columns, shape (p,); of W and M W the squared M-norms of the fields W."""
    return np.einsum("ij,ij->j", V, W)


def symmetric_part(matrix: Array) -> Array:
    """(A + A^T)/2."""
    return (matrix + matrix.T) / 2
