"""Compact thermal models trained on heat data by variable projection.

A model of n poles is linear in its gains g_i and nonlinear only in its rates,

    dT(t) = sum_i g_i phi(t; lambda_i),     dphi/dt = -lambda phi + P(t),

so the gains are eliminated by linear least squares and what is left is searched in the logarithms of the rates
(G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973)). phi is closed form for every piecewise-linear drive,
from rest as well as in the periodic state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster, checks
from thermofem.dataset import Drive, drive_of
from thermofem.model import pole_responses

from .lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """A trained model and how well it fits its data.

    Attributes
    ----------
    model : Foster
    parameters : dict of float
        in SI, by name.
    standard_errors : dict of float
        one standard deviation of each parameter, from the Jacobian and the residual's variance.
    residual : float, K
        rms over all samples.
    relative_residual : float
        rms of residual over swing, each Dataset by its own swing.
    training : tuple of str
        the drive of each Dataset; the parameters mean little without it.
    """

    model: Foster
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    residual: float
    relative_residual: float
    training: tuple[str, ...]


def fit_newton(data: xr.Dataset | Sequence[xr.Dataset], *, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> Fit:
    """Train Newton's law: one pole, dT' = -dT/tau_th + P/(m c_p).

    Parameters
    ----------
    data : Dataset or list of them
        from `thermofem.solve` or `solve_periodic`; each is weighted by its swing.
    heat_capacity : float, J/K
        the heated core's own m c_p, for the ratio below.

    Returns
    -------
    Fit
        parameters ``tau_th`` (s), ``heat_capacity`` (m c_p of the fit, J/K) and ``heat_capacity_ratio`` (to the core's
        own: the paper finds about 7, an artefact of the single pole).

    Raises
    ------
    InputError
        data without power or rise, or whose best pole is not stable and heating.
    """
    found = _project(_drives(data), order=1)
    rate, gain = np.exp(found.log_rate[0]), found.gain[0]
    if gain <= 0:
        raise checks.InputError("the best single pole cools when heated; do power and delta_T of the data belong together?")
    parameters = {"tau_th": 1 / rate, "heat_capacity": 1 / gain, "heat_capacity_ratio": 1 / (gain * heat_capacity)}
    jacobian = np.array([[-1 / rate, 0], [0, -1 / gain**2], [0, -1 / (gain**2 * heat_capacity)]])
    return found.fit(newton(tau_th=1 / rate, heat_capacity=1 / gain), parameters, jacobian)


def fit_second_order(data: xr.Dataset | Sequence[xr.Dataset], *, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> Fit:
    """Train the paper's second-order equation (Eq. 3): two poles.

    Parameters
    ----------
    data : Dataset or list of them
        from `thermofem.solve` or `solve_periodic`; each is weighted by its swing.
    heat_capacity : float, J/K
        m c_p by which kappa and eta are normalised.

    Returns
    -------
    Fit
        parameters ``kappa`` (1/s), ``tau_f``, ``tau_s`` (s), ``eta``.

    Raises
    ------
    InputError
        data without power or rise, or that no stable pair of heating poles fits.
    """
    found = _project(_drives(data), order=2)
    (slow, fast), (g_s, g_f) = np.exp(found.log_rate), found.gain
    c_f, c_s = g_f * heat_capacity, g_s * heat_capacity
    parameters = {"kappa": c_f * slow + c_s * fast, "tau_f": 1 / fast, "tau_s": 1 / slow, "eta": c_f + c_s}
    jacobian = np.array(  # of (kappa, tau_f, tau_s, eta) by (log slow, log fast, g_s, g_f)
        [
            [c_f * slow, c_s * fast, heat_capacity * fast, heat_capacity * slow],
            [0, -1 / fast, 0, 0],
            [-1 / slow, 0, 0, 0],
            [0, 0, heat_capacity, heat_capacity],
        ]
    )
    return found.fit(second_order(**parameters, heat_capacity=heat_capacity), parameters, jacobian)


@dataclass(frozen=True, eq=False)
class _Projection:
    """Optimum of the variable projection, rates increasing."""

    log_rate: Array
    gain: Array
    covariance: Array  # of (log_rate, gain)
    residual: float
    relative_residual: float
    training: tuple[str, ...]

    def fit(self, model: Foster, parameters: Mapping[str, float], jacobian: Array) -> Fit:
        """Named parameters with standard errors by first-order propagation."""
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        errors = dict(zip(parameters, np.sqrt(np.maximum(variance, 0)).tolist(), strict=True))
        return Fit(model, {k: float(v) for k, v in parameters.items()}, errors, self.residual, self.relative_residual, self.training)


def _drives(data: xr.Dataset | Sequence[xr.Dataset]) -> list[Drive]:
    """Waveform, times and rise of every Dataset."""
    drives = [drive_of(d) for d in (data if isinstance(data, (list, tuple)) else [data])]
    if not drives:
        raise checks.InputError("data is empty; give at least one Dataset")
    return drives


def _project(drives: Sequence[Drive], order: int) -> _Projection:
    """Best rates and gains of ``order`` poles: a coarse scan of log-spaced rates, then least squares from the best."""
    from scipy.optimize import least_squares

    weight = np.concatenate([np.full(d.rise.size, 1 / d.swing) for d in drives])
    target = np.concatenate([d.rise / d.swing for d in drives])

    def columns(log_rate: Array) -> Array:
        answers = [pole_responses(np.exp(log_rate), d.wave, d.times, periodic=d.periodic) for d in drives]
        return np.concatenate(answers) * weight[:, None]

    def gains(log_rate: Array) -> tuple[Array, Array]:
        phi = columns(log_rate)
        norm = np.linalg.norm(phi, axis=0)
        gain = np.linalg.lstsq(phi / norm, target, rcond=None)[0] / norm
        return gain, target - phi @ gain

    grid = _rate_grid(drives)
    start = grid[_best_columns(columns(grid), target, order)]
    found = least_squares(lambda p: gains(p)[1], start, x_scale="jac", xtol=1e-12, ftol=1e-14, gtol=1e-12, max_nfev=200)
    log_rate = np.sort(found.x)
    gain, misfit = gains(log_rate)
    step = 1e-5
    slopes = [(columns(log_rate + step * e) - columns(log_rate - step * e)) @ gain / (2 * step) for e in np.eye(order)]
    jacobian = np.column_stack([*slopes, columns(log_rate)])
    scale = np.linalg.norm(jacobian, axis=0)
    freedom = max(target.size - 2 * order, 1)
    inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
    return _Projection(
        log_rate=log_rate,
        gain=gain,
        covariance=inverse * (misfit @ misfit) / freedom,
        residual=float(np.sqrt(np.mean((misfit / weight) ** 2))),
        relative_residual=float(np.sqrt(np.mean(misfit**2))),
        training=tuple(d.name for d in drives),
    )


def _rate_grid(drives: Sequence[Drive]) -> Array:
    """Logarithms of 14 rates between those that the shortest and the longest time of the data can show."""
    shortest = min(float(np.min(np.diff(np.unique(d.times)))) for d in drives)
    longest = max(float(np.ptp(d.times)) for d in drives)
    return np.log(np.geomspace(0.3 / longest, 0.3 / shortest, 14))


def _best_columns(columns: Array, target: Array, count: int) -> list[int]:
    """The ``count`` columns that together explain the target best, by trying all."""
    phi = columns / np.linalg.norm(columns, axis=0)
    gram, right = phi.T @ phi, phi.T @ target

    def explained(pick: list[int]) -> float:
        return float(right[pick] @ np.linalg.lstsq(gram[np.ix_(pick, pick)], right[pick], rcond=1e-12)[0])

    return max((list(pick) for pick in combinations(range(phi.shape[1]), count)), key=explained)
