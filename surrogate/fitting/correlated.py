"""What noise that is correlated from sample to sample does to the covariance of fitted parameters.

With residuals r of autocorrelation rho and the Jacobian J = U S V^T,

    covariance = V S^-1 (U^T R U) S^-1 V^T variance,        R_ij = rho_|i-j|

which for white noise is the usual (J^T J)^-1 variance. rho is cut where its sums over pairs of lags end to be positive.

Source: Geyer, Statist. Sci. 7, 473 (1992), Section 3.3 (initial positive sequence).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermofem.arrays import Array

FEWEST = 50  # samples from which an autocorrelation is estimated; fewer count as white


def correlated(residuals: Sequence[Array], U: Array) -> Array:
    """U^T R U, shape (p, p), at least 1 in every direction.

    residuals: of each trace, in the order of the rows of U; rows beyond them are no samples.
    U [shape (rows, p)]: orthonormal columns that span those of the Jacobian.
    """
    total, at = np.zeros((U.shape[1], U.shape[1])), 0
    for left in residuals:
        part, at = U[at : at + left.size], at + left.size
        rho = _autocorrelation(left)
        if rho.size:  # R - 1, a Toeplitz matrix, as a circulant one of twice the size
            circle = np.zeros((2 * left.size, 1))
            circle[1 : rho.size + 1, 0], circle[-rho.size :, 0] = rho, rho[::-1]
            spectrum = np.fft.rfft(circle, axis=0) * np.fft.rfft(part, 2 * left.size, axis=0)
            total += part.T @ np.fft.irfft(spectrum, axis=0)[: left.size]
    value, vector = np.linalg.eigh((total + total.T) / 2)
    return np.asarray(np.eye(len(total)) + (vector * np.maximum(value, 0)) @ vector.T)


def _autocorrelation(left: Array) -> Array:
    """rho_1, rho_2, .. of the residuals of one trace, as far as they differ from noise."""
    n = left.size
    square = float(left @ left)
    if n < FEWEST or not square > 0:
        return np.empty(0)
    spectrum = np.fft.rfft(left, 2 * n)
    rho = np.fft.irfft(np.abs(spectrum) ** 2)[: n // 2 * 2] / square
    pairs = rho[0::2] + rho[1::2]
    last = np.flatnonzero(pairs <= 0)
    return np.asarray(rho[1 : 2 * (last[0] if last.size else pairs.size)])
