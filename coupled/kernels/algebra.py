"""Small dense linear algebra for the compiled integrators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compiling import inlined, inner
from .equations import Array

Row3 = tuple[float, float, float]


@inlined
def inverse(m: tuple[Row3, Row3, Row3]) -> tuple[Row3, Row3, Row3]:
    """Return the inverse of a 3 x 3 matrix by cofactors; 1/(gamma h) on the diagonal keeps it well conditioned."""
    c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1]
    c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2]
    c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0]
    d = 1.0 / (m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2)
    return (
        (d * c0, d * (m[0][2] * m[2][1] - m[0][1] * m[2][2]), d * (m[0][1] * m[1][2] - m[0][2] * m[1][1])),
        (d * c1, d * (m[0][0] * m[2][2] - m[0][2] * m[2][0]), d * (m[0][2] * m[1][0] - m[0][0] * m[1][2])),
        (d * c2, d * (m[0][1] * m[2][0] - m[0][0] * m[2][1]), d * (m[0][0] * m[1][1] - m[0][1] * m[1][0])),
    )


@inlined
def factorize(m: Array, order: NDArray[np.int64]) -> None:
    """Overwrite the square matrix ``m`` by its triangular factors, with the exchanged rows in ``order``."""
    n = m.shape[0]
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(m[i, j]) > abs(m[pivot, j]):
                pivot = i
        order[j] = pivot
        if pivot != j:
            for k in range(n):
                m[j, k], m[pivot, k] = m[pivot, k], m[j, k]
        for i in range(j + 1, n):
            factor = m[i, j] / m[j, j]
            m[i, j] = factor
            if factor != 0.0:
                for k in range(j + 1, n):
                    m[i, k] -= factor * m[j, k]


@inlined
def follows(m: Array, order: NDArray[np.int64]) -> bool:
    """Factorize ``m`` = 1 - h J/s or s/h - J of an implicit step; return whether det M > 0.

    An L-stable step damps a mode that grows faster than it follows, and its error does not show it. Without such a mode
    det M > 0. A step with det M < 0 counts as one without an answer, so that it becomes shorter than the growth.
    """
    factorize(m, order)
    positive = True
    for i in range(m.shape[0]):
        positive ^= (order[i] != i) ^ (m[i, i] < 0.0)
    return positive


@inlined
def solve(m: Array, order: NDArray[np.int64], x: Array) -> None:
    """Overwrite ``x`` by the solution of the factorized system."""
    n = x.size
    for j in range(n):
        pivot = order[j]
        x[j], x[pivot] = x[pivot], x[j]
    for i in range(n):
        total = x[i]
        for j in range(i):
            total -= m[i, j] * x[j]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, n):
            total -= m[i, j] * x[j]
        x[i] = total / m[i, i]


@inner
def eliminate(m: Array) -> None:
    """Overwrite the right-hand sides in the last columns of ``m`` by the solutions of the system in its first ones.

    Rows are exchanged where a pivot is small; every inner loop runs along a row, which is what vectorises.
    """
    n, wide = m.shape
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(m[i, j]) > abs(m[pivot, j]):
                pivot = i
        if pivot != j:
            for k in range(j, wide):
                m[j, k], m[pivot, k] = m[pivot, k], m[j, k]
        scale = 1.0 / m[j, j]
        for i in range(j + 1, n):
            factor = m[i, j] * scale
            if factor != 0.0:
                for k in range(j + 1, wide):
                    m[i, k] -= factor * m[j, k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            factor = m[i, j]
            for k in range(n, wide):
                m[i, k] -= factor * m[j, k]
        scale = 1.0 / m[i, i]
        for k in range(n, wide):
            m[i, k] *= scale
