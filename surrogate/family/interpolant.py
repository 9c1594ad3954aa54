"""A slow property of a family, computed for some members and interpolated between them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

TAIL = 1e-4  # probability beyond either end of the span on which members are worked out
TESTED = 5  # one member of so many is held out


@dataclass(frozen=True, eq=False)
class Interpolant:
    """A property as a function of the varied parameters.

    low, high [shape (p,)]: span of the computed members; samples outside it are moved to its ends.
    curve: of `smooth`.
    error, worst: rms and largest error over held-out members, relative to their mean.
    """

    low: Array
    high: Array
    curve: Callable[[Array], Array]
    error: float
    worst: float

    def __call__(self, x: Array) -> Array:
        """The property at parameters of shape (p, n)."""
        return self.curve(_shares(x, self.low, self.high))


def interpolate_members(
    values: Callable[[Array], Array],
    dists: Sequence[Any],
    box: tuple[Array, Array],
    count: int,
    reason: Callable[[], str] = lambda: "nan",
) -> Interpolant:
    """Compute a property for ``count`` members drawn from the distributions, and interpolate between them.

    values: the property from parameters of shape (p, n).
    dists [sequence of SciPy distributions]
    box [(array, array), shape (p,)]: its ends.
    reason: says why members lack the property.
    Raises InputError: too few members for the polynomial, or members without the property.

    Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), Section 2.7.
    """
    from scipy.stats import qmc

    p, (low, high) = len(dists), box
    least = 2 * (p + 1) * (p + 2)
    checks.between("interpolate", count, least, 2000, hint=f"members; {p} parameters need {least} at least")
    span = np.array([np.clip([d.ppf(TAIL), d.ppf(1 - TAIL)], a, b) for d, a, b in zip(dists, low, high, strict=True)])
    u = qmc.Sobol(p, seed=np.random.default_rng(1)).random(2 ** int(np.ceil(np.log2(count))))[:count]
    found = values(span[:, :1] + u.T * (span[:, 1:] - span[:, :1]))
    if np.isnan(found).any():
        raise checks.InputError(
            f"{np.isnan(found).sum()} of {count} members do not have the property, and an interpolation needs it "
            f"everywhere ({reason()}); take narrower distributions, or leave interpolate out"
        )
    test = np.arange(count) % TESTED == 0
    scale = float(abs(found.mean())) or 1.0
    curve = smooth(u[~test], found[~test])
    off = (curve(u[test]) - found[test]) / scale
    rms, worst = float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())
    return Interpolant(span[:, 0], span[:, 1], curve, rms, worst)


def smooth(u: Array, y: Array) -> Callable[[Array], Array]:
    """A quadratic polynomial through samples y (n,) at u (n, p) in a unit cube, and a Gaussian process of the rest."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    curve = np.linalg.lstsq(_terms(u), y, rcond=None)[0]
    kernel = ConstantKernel(1.0) * RBF(np.ones(u.shape[1]), (0.05, 50.0))
    process = GaussianProcessRegressor(kernel, alpha=1e-8, normalize_y=True)
    with warnings.catch_warnings():  # of its likelihood: held-out members say how good it is
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(u, y - _terms(u) @ curve)
    return lambda x: np.asarray(_terms(x) @ curve + process.predict(x))


def _shares(x: Array, low: Array, high: Array) -> Array:
    """Place in the span, shape (n, p); the middle where a parameter has one value only."""
    span = high - low
    return np.where(span > 0, np.clip((x.T - low) / np.where(span > 0, span, 1.0), 0.0, 1.0), 0.5)


def _terms(u: Array) -> Array:
    """1, u_i and u_i u_j, shape (n, terms)."""
    i, j = np.triu_indices(u.shape[1])
    return np.column_stack([np.ones(len(u)), u, u[:, i] * u[:, j]])
