"""Noise that follows itself: the autocorrelation of samples, and how many independent ones they are worth.

Source: Geyer, Statist. Sci. 7, 473 (1992), Section 3.3 (initial positive sequence).
"""

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from ..arrays import Array

FEWEST = 50  # samples from which an autocorrelation is estimated; fewer count as white


def independent(left: Array) -> float:
    """Number of independent samples with as much noise in their mean, n/(1 + 2 sum rho)."""
    return float(left.size / max(1 + 2 * autocorrelation(left).sum(), 1.0))


def autocorrelation(left: Array) -> Array:
    """rho_1, rho_2, .. of the residuals of one trace, as far as they differ from noise."""
    n = left.size
    square = float(left @ left)
    if n < FEWEST or not square > 0:
        return np.empty(0)
    size = next_fast_len(2 * n, real=True)
    rho = irfft(np.abs(rfft(left, size)) ** 2, size)[: n // 2 * 2] / square
    pairs = rho[0::2] + rho[1::2]
    last = np.flatnonzero(pairs <= 0)
    return np.asarray(rho[1 : 2 * (last[0] if last.size else pairs.size)])
