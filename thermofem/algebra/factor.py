"""Factorization of the symmetric positive definite matrices of the heat equation."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix, diags, triu
from scipy.sparse.linalg import splu

from .. import checks

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

QDLDL_LIMIT = 150_000  # unknowns; beyond, SuperLU with minimum degree is faster (measured)
SINGULAR = "a matrix of the heat problem is singular; is a boundary held, and every heat capacity positive?"
# times a shift is factorized by the shared solver before it gets its own: new numbers alone cost 1/5 (measured)
PATIENCE = 4


def check_symmetric(name: str, matrix: Any, *, hint: str = "") -> None:
    """Raise InputError unless a matrix, dense or sparse, is finite, and symmetric up to round-off."""
    mirrored = matrix.T
    if getattr(matrix, "format", "") in ("csr", "csc") and matrix.nnz and matrix.has_canonical_format:
        mirrored = mirrored.asformat(matrix.format)
        if np.array_equal(matrix.indptr, mirrored.indptr) and np.array_equal(matrix.indices, mirrored.indices):
            matrix, mirrored = matrix.data, mirrored.data  # one pattern: a third of the time of sparse arithmetic
    # 1e-9 of the largest entry, in which round-off may leave a matrix asymmetric
    if not abs(matrix - mirrored).max() <= 1e-9 * abs(matrix).max() < np.inf:
        raise checks.InputError(f"{name} is not symmetric", hint)


def factorize(matrix: Any, *, upper: bool = False) -> Solve:
    """Factorize a symmetric definite sparse matrix (or its upper triangle) and return ``solve(right-hand side)``.

    L D L^T by qdldl up to `QDLDL_LIMIT` unknowns, SuperLU with the symmetric minimum-degree ordering beyond it or
    where qdldl is not installed.

    Raises InputError: a singular matrix.
    """
    return _factors(matrix, upper=upper).solve


def _factors(matrix: Any, *, upper: bool) -> Any:
    """The factorization of `factorize`: an object of qdldl or SuperLU with ``solve``."""
    matrix = csc_matrix(matrix)
    qdldl = _qdldl(matrix.shape[0])
    if qdldl is not None:
        with singular_refused():
            return qdldl.Solver(matrix, upper=upper)

    if upper:
        matrix = csc_matrix(matrix + matrix.T - diags(matrix.diagonal()))
    options = {"SymmetricMode": True}
    with singular_refused():
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


@contextmanager
def singular_refused() -> Iterator[None]:
    """Turn what qdldl and SuperLU raise at a pivot of zero into InputError."""
    try:
        yield
    except RuntimeError as error:
        if "singular" not in str(error) and "quasi-definite" not in str(error):  # such as no memory
            raise
        raise checks.InputError(SINGULAR) from None


_thread = threading.local()


def solve_once(matrix: Any, rhs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve one system with a symmetric definite sparse matrix; its factors are not kept.

    Matrices of one sparsity pattern, one after the other in a thread, share an ordering and a symbolic factorization.
    """
    n = matrix.shape[0]
    qdldl = _qdldl(n)
    if qdldl is None or n > 20_000:  # 20_000: unknowns; beyond, `solve_once` keeps nothing
        return factorize(matrix)(rhs)
    upper = csc_matrix(triu(matrix, format="csc"))
    last = getattr(_thread, "last", None)
    if last is not None and all(
        np.array_equal(a, b) for a, b in zip(last[1:], (upper.indptr, upper.indices), strict=True)
    ):
        with singular_refused():
            last[0].update(upper, upper=True)
    else:
        with singular_refused():
            last = _thread.last = qdldl.Solver(upper, upper=True), upper.indptr, upper.indices
    return np.asarray(last[0].solve(rhs))


def _qdldl(unknowns: int) -> Any:
    """The qdldl module if it is installed and faster for this size, else None."""
    if unknowns > QDLDL_LIMIT:
        return None
    try:
        import qdldl
    except ImportError:
        return None
    return qdldl


class Pencil:
    """Solves with a E + b K for any a, b >= 0, where E and K are the capacity and conduction of one heat problem.

    All combinations share one fill-reducing ordering. A shared factorization is updated with the numbers of the last
    combination; a combination that is used repeatedly gets its own. Safe to share between threads.
    """

    def __init__(self, E: Any, K: Any) -> None:
        n = E.shape[0]
        triangles = [_upper_triangle(matrix) for matrix in (E, K)]
        (place, _), (other, _) = triangles
        every = place if np.array_equal(place, other) else np.union1d(place, other)
        self._indices, self._indptr = every % n, np.searchsorted(every, np.arange(n + 1) * n)
        self._data = np.zeros((2, every.size))
        for row, (at, data) in zip(self._data, triangles, strict=True):
            row[slice(None) if at.size == every.size else np.searchsorted(every, at)] = data
        self._pattern = every
        self._shape = E.shape
        self.factorizations = 0
        self._forget()

    def _forget(self) -> None:
        """Drop all factors."""
        self._shared: Any = None
        self._there: tuple[float, float] | None = None
        self._asked = (0.0, 0.0), (0.0, 0.0)  # the last combination, and its key
        self._own: dict[tuple[float, float], Any] = {}  # factorizations by combination
        self._seen: dict[tuple[float, float], int] = {}
        self._spare: list[Any] = []  # qdldl's solvers with an ordering and a symbolic factorization for this pattern
        self._lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        """The matrices alone: factors and locks cannot be copied or sent to another process."""
        return {name: getattr(self, name) for name in ("_indices", "_indptr", "_data", "_pattern", "_shape")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Factors are made again when they are needed."""
        self.__dict__.update(state)
        self.factorizations = 0
        self._forget()

    def inherit(self, other: Pencil) -> None:
        """Take over the factors of another pencil of the same sparsity pattern: ordering and symbolic part are kept.

        The other one makes its factors again if it is asked once more. Nothing happens where the patterns differ.
        """
        if self is other or not np.array_equal(self._pattern, other._pattern) or _qdldl(self._shape[0]) is None:
            return
        with other._lock:
            solvers = [*other._spare, *other._own.values()]
            solvers += [] if other._shared is None else [other._shared]
            other._spare, other._shared, other._there = [], None, None
            other._own.clear()
        with self._lock:
            self._spare += solvers

    def entries(self, matrix: Any) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Indices (as used by `replace`) and values of the entries of a symmetric matrix on and above its diagonal."""
        place, data = _upper_triangle(matrix)
        return np.searchsorted(self._pattern, place), data

    @property
    def rows_and_columns(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column of each entry of the pattern."""
        return self._indices, self._pattern // self._shape[0]

    def replace(self, E: NDArray[np.float64], K: NDArray[np.float64]) -> None:
        """Other values of E and K on the same sparsity pattern."""
        with self._lock:
            self._data = np.stack([E, K])
            self._there = None
            self._own.clear()
            self._seen.clear()

    def ready(self, a: float, b: float) -> bool:
        """Whether factors of a E + b K are kept."""
        key = _key(a, b)
        return key == self._there or key in self._own

    def solve(self, a: float, b: float, rhs: NDArray[np.float64]) -> NDArray[np.float64]:
        """(a E + b K)^-1 rhs, with a and b rounded to 10 digits: nothing depends on which solve came first."""
        with self._lock:
            if self._asked[0] != (a, b):
                self._asked = (a, b), _key(a, b)
            key = self._asked[1]
            if key in self._own:
                return self._own[key].solve(rhs)
            if key != self._there:
                self._seen[key] = self._seen.get(key, 0) + 1
                if self._seen[key] > PATIENCE or _qdldl(self._shape[0]) is None:
                    return self._keep(key, self._matrix(*key))(rhs)
                self._replace(key, self._matrix(*key))
            return self._shared.solve(rhs)

    def keep(self, a: float, b: float) -> Solve:
        """Return the solver of (a E + b K), a and b rounded as in `solve`, with a factorization that is kept."""
        key = _key(a, b)
        with self._lock:
            if key in self._own:
                return self._own[key].solve
            if key == self._there:  # the shared place becomes its own
                self._own[key], self._shared, self._there = self._shared, None, None
                return self._own[key].solve
            if self._shared is not None and not self._spare:  # other numbers cost a fifth of another ordering
                self._spare, self._shared, self._there = [self._shared], None, None
            return self._keep(key, self._matrix(*key))

    def _matrix(self, a: float, b: float) -> Any:
        """Upper triangle of a E + b K on the union of both sparsity patterns (CSC)."""
        self.factorizations += 1
        return csc_matrix((a * self._data[0] + b * self._data[1], self._indices, self._indptr), shape=self._shape)

    def _replace(self, key: tuple[float, float], matrix: Any) -> None:
        """Factorize another combination with the shared solver."""
        if self._shared is None and self._spare:
            self._shared = self._spare.pop()
        with singular_refused():
            if self._shared is None:
                self._shared = _qdldl(self._shape[0]).Solver(matrix, upper=True)
            else:
                self._shared.update(matrix, upper=True)
        self._there = key

    def _keep(self, key: tuple[float, float], matrix: Any) -> Solve:
        """Factorize a combination with a solver of its own, which is kept."""
        if len(self._own) >= 24:  # 24: factorizations that a Pencil keeps
            del self._own[next(iter(self._own))]
        if self._spare:
            solver = self._spare.pop()
            with singular_refused():
                solver.update(matrix, upper=True)
        else:
            solver = _factors(matrix, upper=True)
        self._own[key] = solver
        return solver.solve


def _key(a: float, b: float) -> tuple[float, float]:
    """The pair rounded to ten digits, as a key of the cache."""
    return float(f"{a:.9e}"), float(f"{b:.9e}")


def _upper_triangle(matrix: Any) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Positions column n + row, increasing, and values of a symmetric matrix's entries on and above its diagonal."""
    matrix = csr_matrix(matrix)  # its rows are its columns
    matrix.sum_duplicates()
    n = matrix.shape[0]
    column, row = np.repeat(np.arange(n), np.diff(matrix.indptr)), matrix.indices
    above = row <= column
    return column[above] * n + row[above], matrix.data[above]
