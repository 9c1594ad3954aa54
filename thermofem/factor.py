"""Factorization of the symmetric positive definite matrices of the heat equation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

QDLDL_LIMIT = 150_000  # unknowns; beyond, SuperLU with minimum degree is faster (measured)


def factorize(matrix: Any) -> Solve:
    """Factorize a symmetric definite sparse matrix and return ``solve(right-hand side)``.

    L D L^T by qdldl up to `QDLDL_LIMIT` unknowns, SuperLU with the symmetric minimum-degree ordering beyond it or
    where qdldl is not installed.
    """
    from scipy.sparse import csc_matrix

    matrix = csc_matrix(matrix)
    if matrix.shape[0] <= QDLDL_LIMIT:
        try:
            import qdldl

            return qdldl.Solver(matrix).solve
        except ImportError:
            pass
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve
