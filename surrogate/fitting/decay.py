"""Sums of exponentials fitted to a cooling curve, as in the paper's Fig. 5(a)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike

from .correlated import noise_along
from .notes import EXPLAINED, cancelling, unseen_times
from .projection import CUT

GRID, BEST = 12, 3  # time constants on a grid, any of which are tried together; the best combinations begin a search
RANKED = 200  # samples by which they are compared
FASTER, SLOWER = 10.0, 100.0  # time constants between the closest samples over this, and the span times this
STEEPEST = 100.0  # largest |t|/tau of the first sample: a decay that it shows has not gone to exp(-100)
FALLEN = 0.99  # of the largest rise: what does not end below is no cooling curve
LATEST = 10.0  # begin of the times over their length; exp(-t/tau) of the first guess is zero from 18 times on


@dataclass(frozen=True, eq=False)
class Decay:
    """dT(t) = sum_i amplitude_i exp(-t/tau_i).

    Attributes
    ----------
    amplitude, tau : array, shape (n,), K and s
        fastest first.
    residual : float, K
        rms.
    notes : tuple of str
        time constants that the samples do not determine, and exponentials that cancel.
    """

    amplitude: Array
    tau: Array
    residual: float
    notes: tuple[str, ...] = ()

    def __call__(self, times: ArrayLike) -> Array:
        """Rise in K at ``times`` after the start of the cooling."""
        return np.exp(-checks.numbers("times", times)[..., None] / self.tau) @ self.amplitude


def fit_decay(times: ArrayLike, rise: ArrayLike, *, order: int = 2) -> Decay:
    """Fit ``order`` exponentials to a cooling curve by variable projection in the logarithms of the time constants.

    Parameters
    ----------
    times : array, shape (n,), s
        after the power went off, increasing from about 0: it begins within `LATEST` times its length.
    rise : array, shape (n,), K
    order : int, 1 to 5

    Raises
    ------
    InputError
        too few samples, times that do not increase or begin far from 0, a rise that does not fall or is noise, numbers
        that are not finite.

    Source of the form: Borghi et al., Opt. Express 29, 4363 (2021), Section 5, C_s exp(-t/tau_s) + C_f exp(-t/tau_f).
    """
    from scipy.optimize import least_squares

    t, y = checks.array("times", times, increasing=True), checks.array("rise", rise, most=np.inf)
    order = checks.integer("order", order, 1, 5)
    if t.size != y.size or t.size <= 2 * order:
        raise checks.InputError(
            f"times has {t.size} samples and rise {y.size}; both need the same, more than {2 * order}"
        )

    span, size = np.ptp(t), float(np.abs(y).max()) or 1.0
    if abs(t[0]) > LATEST * span:
        raise checks.InputError(
            f"times begins at {t[0]:g} s and lasts {span:g} s; 0 is the end of the power: subtract that moment"
        )
    y = y / size  # SciPy's tolerance of the gradient is absolute
    if np.abs(y[-1]) > FALLEN:
        raise checks.InputError(f"rise ends at {size * y[-1]:.3g} K of at most {size:.3g} K; a cooling curve falls")

    def misfit(log_tau: Array, few: slice = slice(None)) -> Array:
        columns = np.exp(-t[few, None] / np.exp(log_tau))
        return y[few] - columns @ np.linalg.lstsq(columns, y[few], rcond=None)[0]

    few = slice(None, None, max(1, t.size // RANKED))
    low = np.log(max(float(np.diff(t).min()) / FASTER, abs(float(t[0])) / STEEPEST, np.finfo(float).tiny))
    high = np.log(SLOWER * span)
    grid = np.linspace(low, high, GRID + 2)[1:-1]
    ways = sorted(combinations(grid, order), key=lambda way: float(np.sum(misfit(np.array(way), few) ** 2)))
    spread = np.log(np.geomspace(span / 40, span / 3, order) if order > 1 else [span / 5])
    starts = np.clip([spread, *ways[:BEST]], low, high)
    exactly: dict[str, Any] = {"bounds": (low, high), "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    best = min((least_squares(misfit, start, **exactly) for start in starts), key=lambda end: float(end.cost))
    tau = np.exp(np.sort(best.x))
    columns = np.exp(-t[:, None] / tau)
    amplitude = np.linalg.lstsq(columns, y, rcond=None)[0]
    left = y - columns @ amplitude
    variation = float(np.var(y))
    explained = 1 - float(np.mean(left**2)) / variation if variation else 1.0
    if explained < EXPLAINED:
        raise checks.InputError(
            f"{order} exponentials explain {max(explained, 0):.0%} of the variation of rise: it is noise, "
            "no cooling curve"
        )
    notes = _notes(t, tau, amplitude, left, size)
    return Decay(size * amplitude, tau, size * float(np.sqrt(np.mean(left**2))), notes)


def _notes(t: Array, tau: Array, amplitude: Array, left: Array, size: float) -> tuple[str, ...]:
    """Sentences on what the samples leave open, by the covariance of (ln rate, amplitude); fastest first.

    left [shape (n,)]: misfit, in units of ``size`` [K] as the amplitudes.
    """
    columns = np.exp(-t[:, None] / tau)
    jacobian = np.hstack([-t[:, None] / tau * columns * amplitude, columns])
    length = np.linalg.norm(jacobian, axis=0)
    length[length == 0] = 1.0
    U, s, Vt = np.linalg.svd(jacobian / length, full_matrices=False)
    back = Vt.T / np.maximum(s, CUT * s[0]) / length[:, None]
    noise = noise_along([left], U, float(left @ left) / max(t.size - 2 * tau.size, 1))
    span = float(np.diff(t).min()), float(np.ptp(t))
    deviation = np.sqrt(np.maximum((back @ noise @ back.T).diagonal()[: tau.size], 0))
    said = unseen_times(-np.log(tau[::-1]), amplitude[::-1], deviation[::-1], span)
    return (*said, *cancelling(amplitude * size, "K"))
