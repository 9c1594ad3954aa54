"""Types of arrays, for annotations, and what several modules do with arrays."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike as ArrayLike, NDArray as NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.sparse import csr_matrix

Array: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]
Indices: TypeAlias = NDArray[np.intp]
Mask: TypeAlias = NDArray[np.bool_]

PIECE = 10_000_000  # numbers of an intermediate array
FEWEST_RESIDUALS = 50  # of which an autocorrelation is estimated; fewer count as white noise


def in_pieces(function: Callable[[Any], Any], x: NDArray[Any], width: int) -> NDArray[Any]:
    """Evaluate ``function(x[..., None])`` in chunks, so that its (x.size, width) intermediate stays below `PIECE`."""
    if x.size * width <= PIECE:
        return function(x[..., None])
    count = -(-x.size * width // PIECE)
    pieces = np.array_split(x.ravel(), count)
    values = [function(piece[:, None]) for piece in pieces]
    return np.concatenate(values).reshape(x.shape)


def scattered(local: Array, rows: Indices, columns: Indices, count: int) -> csr_matrix:
    """Sum of small matrices, each at its rows and columns of a sparse (count, count) matrix.

    local [shape (m, a, b)]; rows [shape (m, a)]; columns [shape (m, b)].
    """
    at_rows = np.broadcast_to(rows[:, :, None], local.shape).ravel()
    at_columns = np.broadcast_to(columns[:, None, :], local.shape).ravel()
    return csr_matrix((local.ravel(), (at_rows, at_columns)), shape=(count, count))


def summed(numbers: Indices, values: Any, count: int) -> Any:
    """Sum of all ``values``, real or complex, that have the same number; shape (count,)."""
    if np.iscomplexobj(values):
        return summed(numbers, values.real, count) + 1j * summed(numbers, values.imag, count)
    return np.bincount(numbers.ravel(), values.ravel(), minlength=count).astype(float)


def runs_of(holds: Mask) -> list[tuple[int, int]]:
    """First index of each run of true values, and the index after its last.

    >>> runs_of(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    change = np.diff(np.concatenate([[0], holds.astype(int), [0]]))
    starts = np.flatnonzero(change == 1).tolist()
    stops = np.flatnonzero(change == -1).tolist()
    return list(zip(starts, stops, strict=True))


def independent(residuals: Array) -> float:
    """Number of independent samples in the correlated residuals of one trace: n/(1 + 2 sum rho)."""
    rho = autocorrelation(residuals)
    return float(residuals.size / max(1 + 2 * rho.sum(), 1.0))


def autocorrelation(residuals: Array) -> Array:
    """rho_1, rho_2, .. of the residuals of one trace, up to where they vanish in noise (initial positive sequence).

    Source: C. J. Geyer, Statist. Sci. 7, 473 (1992), Section 3.3.
    """
    n = residuals.size
    square = float(residuals @ residuals)
    if n < FEWEST_RESIDUALS or not square > 0:
        return np.empty(0)
    size = next_fast_len(2 * n, real=True)
    spectrum = np.abs(rfft(residuals, size)) ** 2
    rho = irfft(spectrum, size)[: n // 2 * 2] / square
    pairs = rho[0::2] + rho[1::2]
    vanishing = np.flatnonzero(pairs <= 0)
    count = vanishing[0] if vanishing.size else pairs.size
    return rho[1 : 2 * count]


def noise_of(y: Array) -> float:
    """Standard deviation of white noise in y: from the median of its second differences, robust against edges."""
    curvature = float(np.median(np.abs(np.diff(y, 2))))
    noise = curvature / (0.6745 * np.sqrt(6))  # 0.6745: median of the absolute value of a standard normal number
    return max(noise, 1e-6 * float(np.ptp(y)), 1e-300)


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))


def deviations(spread: Array) -> Array:
    """Standard deviations, shape (p,), from the covariance of p parameters."""
    return np.sqrt(np.maximum(spread.diagonal(), 0))


def correlations(spread: Array) -> Array:
    """Correlations, shape (p, p), from the covariance of p parameters."""
    deviation = np.maximum(deviations(spread), np.finfo(float).tiny)
    return spread / np.outer(deviation, deviation)
