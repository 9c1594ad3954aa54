"""Factorization of the symmetric positive definite matrices of the heat equation."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import qdldl
from scipy.sparse import csc_matrix, csr_matrix, diags, triu
from scipy.sparse.linalg import splu

from .. import checks
from ..arrays import Array, Indices

Solve = Callable[[Array], Array]

REFUSAL = "E and -A must be symmetric and positive definite, as for every heat problem"
QDLDL_LIMIT = 150_000  # unknowns; beyond, SuperLU with minimum degree is faster (measured)
SINGULAR = "a matrix of the heat problem is singular; is a boundary held, and every heat capacity positive?"
# times a shift is factorized by the shared solver before it gets its own: new numbers alone cost 1/5 (measured)
PATIENCE = 4
KEPT = 24  # factorizations that a Pencil keeps


def check_symmetric(*, hint: str, **matrices: Any) -> None:
    """Raise InputError unless each matrix, dense or sparse, is finite, and symmetric up to round-off.

    The factorization reads one triangle only.
    """
    for name, matrix in matrices.items():
        # 1e-9 of the largest entry, in which round-off may leave a matrix asymmetric
        if not abs(matrix - matrix.T).max() <= 1e-9 * abs(matrix).max() < np.inf:
            raise checks.InputError(f"{name} is not symmetric", hint)


def factorize(matrix: Any) -> Solve:
    """Factorize a symmetric definite sparse matrix and return ``solve(right-hand side)``.

    L D L^T by qdldl up to `QDLDL_LIMIT` unknowns, SuperLU with the symmetric minimum-degree ordering beyond it.

    Raises InputError: a singular matrix.
    """
    return _factors(csc_matrix(triu(matrix))).solve


def _factors(upper: Any) -> Any:
    """Factors, by qdldl or SuperLU, of a symmetric matrix that is given by its upper triangle (CSC)."""
    with singular_refused():
        if upper.shape[0] <= QDLDL_LIMIT:
            return qdldl.Solver(upper, upper=True)
        whole = csc_matrix(upper + upper.T - diags(upper.diagonal()))
        return splu(whole, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


@contextmanager
def singular_refused() -> Iterator[None]:
    """Context in which errors of qdldl and SuperLU at a zero pivot become InputErrors."""
    try:
        yield
    except RuntimeError:
        raise checks.InputError(SINGULAR) from None


class Pencil:
    """Solves with a E + b K for any a, b >= 0, where E and K are the capacity and conduction of one heat problem.

    All combinations share one fill-reducing ordering. A shared factorization is updated with the numbers of the last
    combination; a combination that is used repeatedly gets its own. Safe to share between threads.
    """

    def __init__(self, E: Any, K: Any) -> None:
        n = E.shape[0]
        triangles = [_upper_triangle(matrix) for matrix in (E, K)]
        (place, _), (other, _) = triangles
        self._pattern = place if np.array_equal(place, other) else np.union1d(place, other)
        self._indices = self._pattern % n
        self._indptr = np.searchsorted(self._pattern, np.arange(n + 1) * n)
        self._data = self._values(triangles)
        self._shape = E.shape
        self.__setstate__({})

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the matrices alone: factors and locks cannot be copied or sent to another process."""
        return {name: getattr(self, name) for name in ("_pattern", "_indices", "_indptr", "_data", "_shape")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the matrices; factors are made when they are needed."""
        self.__dict__.update(state)
        self.factorizations = 0
        self._factors: dict[tuple[float, float], Any] = {}  # by combination
        self._shared: tuple[float, float] | None = None  # the combination whose factors the next one replaces
        self._seen: Counter[tuple[float, float]] = Counter()
        self._spare: list[Any] = []  # solvers of qdldl with the ordering and symbolic factorization of this pattern
        self._lock = threading.Lock()

    def _release(self) -> list[Any]:
        """Drop all factors; returns the qdldl solvers, which take other values on the same sparsity pattern."""
        solvers = [*self._spare, *self._factors.values()] if self._updates else []
        self._factors = {}
        self._shared = None
        self._spare = []
        return solvers

    @property
    def _updates(self) -> bool:
        """Whether a factorization can be updated with other values on the same sparsity pattern (qdldl)."""
        return self._shape[0] <= QDLDL_LIMIT

    def inherit(self, other: Pencil) -> None:
        """Take over the factors of another pencil of the same sparsity pattern: ordering and symbolic part are kept.

        The other pencil makes its factors again when it needs them. Nothing happens where the patterns differ.
        """
        if self is not other and np.array_equal(self._pattern, other._pattern):
            with other._lock:
                solvers = other._release()
            with self._lock:
                self._spare += solvers

    def _values(self, triangles: Sequence[tuple[Indices, Array]]) -> Array:
        """Entries of symmetric matrices, given as `_upper_triangle`, on the sparsity pattern; (matrices, entries)."""
        values = np.zeros((len(triangles), self._pattern.size))
        for row, (place, data) in zip(values, triangles, strict=True):
            row[np.searchsorted(self._pattern, place)] = data
        return values

    def replace(self, E: Any, K: Any) -> None:
        """Replace E and K by matrices with entries on the same sparsity pattern; all factors are dropped."""
        with self._lock:
            self._data = self._values([_upper_triangle(matrix) for matrix in (E, K)])
            self._spare = self._release()
            self._seen.clear()

    def ready(self, a: float, b: float) -> bool:
        """Whether factors of a E + b K are kept."""
        return _key(a, b) in self._factors

    def solve(self, a: float, b: float, rhs: Array) -> Array:
        """(a E + b K)^-1 rhs, with a and b rounded to 10 digits, so that it does not depend on earlier solves."""
        key = _key(a, b)
        with self._lock:
            if key not in self._factors:
                self._seen[key] += 1
                self._factorize(key, own=self._seen[key] > PATIENCE or not self._updates)
            return self._factors[key].solve(rhs)

    def keep(self, a: float, b: float) -> Solve:
        """Return a solver of a E + b K whose factorization is kept for further calls; a, b rounded as in `solve`."""
        key = _key(a, b)
        with self._lock:
            if key not in self._factors:
                self._factorize(key, own=True)
            elif key == self._shared:
                self._shared = None
            return self._factors[key].solve

    def _factorize(self, key: tuple[float, float], *, own: bool) -> None:
        """Factorize the combination ``key``, for itself (``own``) or as the shared one; reuses a spare solver."""
        self.factorizations += 1
        a, b = key
        matrix = csc_matrix((a * self._data[0] + b * self._data[1], self._indices, self._indptr), shape=self._shape)
        solver = self._factors.pop(self._shared) if self._shared else self._spare.pop() if self._spare else None
        self._shared = None if own else key
        if own and len(self._factors) >= KEPT:
            del self._factors[next(iter(self._factors))]
        if solver is None:
            solver = _factors(matrix)
        else:
            with singular_refused():
                solver.update(matrix, upper=True)
        self._factors[key] = solver


def _key(a: float, b: float) -> tuple[float, float]:
    """The pair (a, b) rounded to ten digits, as a key of the cache of factors."""
    return float(f"{a:.9e}"), float(f"{b:.9e}")


def _upper_triangle(matrix: Any) -> tuple[Indices, Array]:
    """Positions (column n + row, increasing) and values of a symmetric matrix's entries on and above its diagonal."""
    matrix = csr_matrix(matrix)  # its rows are its columns
    matrix.sum_duplicates()
    n = matrix.shape[0]
    column, row = np.repeat(np.arange(n), np.diff(matrix.indptr)), matrix.indices
    above = row <= column
    return column[above] * n + row[above], matrix.data[above]
