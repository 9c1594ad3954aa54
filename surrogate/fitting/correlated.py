"""What the noise of traces does to the covariance of fitted parameters.

With residuals r_k of trace k, of variance sigma_k^2 and autocorrelation rho_k, and the Jacobian J = U S V^T,

    covariance = V S^-1 (U^T N U) S^-1 V^T,        N = sigma_k^2 rho_k,|i-j| for samples i, j of trace k, else 0

which for white noise of one variance is the usual (J^T J)^-1 variance. rho is cut where its sums over pairs of lags end
to be positive. A fit carries the noise of each trace into the residuals of the others, along the columns of J: where
there are several traces, these are taken out of each before its variance and rho are read.

Sources: Geyer, Statist. Sci. 7, 473 (1992), Section 3.3 (initial positive sequence); White, Econometrica 48, 817 (1980)
(covariance of least squares under unequal variances).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermofem.algebra.autocorrelation import autocorrelation
from thermofem.arrays import Array

FREE = 5  # samples of a trace beyond the parameters that they fix, below which its variance is at least that of all
SEEN = 1e-6  # share of a direction in a trace, of 1 in all, from which on its residuals follow the parameters


def noise_along(
    residuals: Sequence[Array], U: Array, variance: float, *, alike: bool = False, rest: Sequence[int] = ()
) -> Array:
    """U^T N U, shape (p, p), at least that of white noise in every direction.

    residuals: of each trace, in the order of the rows of U.
    U [shape (rows, p)]: orthonormal columns that span those of the Jacobian.
    variance: of all residuals together, that of a single trace and of rows that are no samples.
    alike: whether every trace has this variance.
    rest: the trace to which each of the rows after the samples belongs; rows beyond them belong to none.
    """
    ends = np.cumsum([left.size for left in residuals])
    parts = np.split(U[: ends[-1]], ends[:-1])
    each = np.full(len(parts), variance)
    if len(parts) > 1:
        residuals, shown, freedom = zip(*map(_own, residuals, parts), strict=True)
        least = np.where(np.array(freedom) < FREE, variance, 0.0)
        each = each if alike else np.maximum(shown, least)
    other = np.append(each[list(rest)], np.full(len(U) - ends[-1] - len(rest), variance))
    scaled = U * np.sqrt(np.append(np.repeat(each, [left.size for left in residuals]), other))[:, None]
    total = sum(own * _lags(left, part) for own, left, part in zip(each, residuals, parts, strict=True))
    value, vector = np.linalg.eigh((total + total.T) / 2)
    return np.asarray(scaled.T @ scaled + (vector * np.maximum(value, 0)) @ vector.T)


def _own(left: Array, part: Array) -> tuple[Array, float, int]:
    """Residuals of one trace without what the parameters explain of them, their variance and degrees of freedom."""
    along, size, _ = np.linalg.svd(part, full_matrices=False)
    along = along[:, size > SEEN]
    left = left - along @ (along.T @ left)
    free = left.size - along.shape[1]
    return left, float(left @ left) / max(free, 1), free


def _lags(left: Array, part: Array) -> Array:
    """U_k^T (R - 1) U_k, shape (p, p), with the correlations R between the samples of one trace."""
    rho = autocorrelation(left)
    if not rho.size:
        return np.zeros((part.shape[1], part.shape[1]))
    circle = np.zeros((2 * left.size, 1))  # R - 1, a Toeplitz matrix, as a circulant one of twice the size
    circle[1 : rho.size + 1, 0], circle[-rho.size :, 0] = rho, rho[::-1]
    spectrum = np.fft.rfft(circle, axis=0) * np.fft.rfft(part, 2 * left.size, axis=0)
    return np.asarray(part.T @ np.fft.irfft(spectrum, axis=0)[: left.size])
