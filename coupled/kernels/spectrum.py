"""Eigenvalues of small matrices without LAPACK, whose import takes as long as a run; compiled.

Elimination to Hessenberg form with exchanges, then the QR iteration with Wilkinson's shift on complex numbers.

Source: Golub and Van Loan, Matrix Computations (2013), Sections 7.4 and 7.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compiling import inner

LARGEST = 40  # of a matrix for which this is no slower than LAPACK
EPSILON = 2.2e-16
TURNS = 60  # for one eigenvalue; two or three are usual

Complex = NDArray[np.complex128]


@inner
def eigenvalues(matrix: Complex) -> Complex:
    """Return the eigenvalues of a square complex matrix, in no order."""
    if matrix.shape[0] > LARGEST:
        return np.linalg.eigvals(matrix)  # type: ignore[return-value]
    H, n = matrix.copy(), matrix.shape[0]
    _to_hessenberg(H)
    last, turns = n - 1, 0
    while last > 0:
        low = last
        while low > 0 and abs(H[low, low - 1]) > EPSILON * (abs(H[low - 1, low - 1]) + abs(H[low, low])):
            low -= 1
        if low == last:
            last, turns = last - 1, 0
            continue
        if turns == TURNS:
            return np.linalg.eigvals(matrix)  # type: ignore[return-value]
        turns += 1
        shift = abs(H[last, last - 1]) + 0j if turns % 10 == 0 else _shift(H, last)
        _turn(H, low, last, shift)
    return np.diag(H).copy()


@inner
def _to_hessenberg(H: Complex) -> None:
    """Make everything below the first subdiagonal zero by similar matrices."""
    n = H.shape[0]
    for m in range(1, n - 1):
        pivot = m
        for i in range(m + 1, n):
            if abs(H[i, m - 1]) > abs(H[pivot, m - 1]):
                pivot = i
        if H[pivot, m - 1] == 0.0:
            continue
        if pivot != m:
            for j in range(n):
                H[m, j], H[pivot, j] = H[pivot, j], H[m, j]
            for j in range(n):
                H[j, m], H[j, pivot] = H[j, pivot], H[j, m]
        for i in range(m + 1, n):
            factor = H[i, m - 1] / H[m, m - 1]
            if factor != 0.0:
                for j in range(m - 1, n):
                    H[i, j] -= factor * H[m, j]
                for j in range(n):
                    H[j, m] += factor * H[j, i]
            H[i, m - 1] = 0.0


@inner
def _shift(H: Complex, last: int) -> complex:
    """Return the eigenvalue of the last two rows and columns that is nearest to the last entry."""
    a, b, c, d = H[last - 1, last - 1], H[last - 1, last], H[last, last - 1], H[last, last]
    half = 0.5 * (a - d)
    root = np.sqrt(half * half + b * c)
    if (half * root.conjugate()).real < 0.0:
        root = -root
    far = half + root
    return d if far == 0.0 else d - b * c / far


@inner
def _turn(H: Complex, low: int, last: int, shift: complex) -> None:
    """Take one step of the QR iteration on rows and columns ``low`` to ``last``."""
    cosines, sines = np.ones(last + 1, np.complex128), np.zeros(last + 1, np.complex128)
    for k in range(low, last + 1):
        H[k, k] -= shift
    for k in range(low, last):
        x, y = H[k, k], H[k + 1, k]
        size = np.hypot(abs(x), abs(y))
        c, s = (x / size, y / size) if size > 0.0 else (1.0 + 0j, 0j)
        cosines[k], sines[k] = c, s
        for j in range(k, last + 1):
            up, down = H[k, j], H[k + 1, j]
            H[k, j] = c.conjugate() * up + s.conjugate() * down
            H[k + 1, j] = c * down - s * up
    for k in range(low, last):
        c, s = cosines[k], sines[k]
        for i in range(low, k + 2):
            left, right = H[i, k], H[i, k + 1]
            H[i, k] = left * c + right * s
            H[i, k + 1] = right * c.conjugate() - left * s.conjugate()
    for k in range(low, last + 1):
        H[k, k] += shift
