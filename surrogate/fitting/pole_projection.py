"""Variable projection: the best poles of a thermal model for given data.

A model of n poles is linear in its gains g_i and nonlinear only in its rates,

    dT(t) = sum_i g_i phi(t; lambda_i),     dphi/dt = -lambda phi + P(t),

so the gains are eliminated by linear least squares and what is left is searched in the logarithms of the rates
(G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413 (1973); the Jacobian after L. Kaufman, BIT 15, 49 (1975)). phi is
closed form for every piecewise-linear drive, from rest as well as in the periodic state.

Of a measured trace the start of the heating and the baseline are estimates, so both are fitted with the poles. A
baseline b, the mean of n rows at rest, is one more linear unknown, known from the rest to noise/sqrt(n),

    rise = b + sum_i g_i phi_i,    0 = sqrt(n) b,

and is eliminated first. A shift of the start is searched with the rates.

Errors. With residuals r_k of trace k, of variance sigma_k^2 and autocorrelation rho_k, and the Jacobian J = U S V^T,

    covariance = V S^-1 (U^T N U) S^-1 V^T,        N = sigma_k^2 rho_k,|i-j| for samples i, j of trace k, else 0

which for white noise of one variance is the usual (J^T J)^-1 variance. rho is cut where its sums over pairs of lags end
to be positive (Geyer, Statist. Sci. 7, 473 (1992), Section 3.3; unequal variances: White, Econometrica 48, 817 (1980)).
A fit carries the noise of each trace into the residuals of the others, along the columns of J: where there are several
traces, these are taken out of each before its variance and rho are read.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import least_squares, nnls

from thermofem import checks
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import FEWEST, Array, ArrayLike, autocorrelation, independent
from thermofem.data.dataset import Response


def covariance(jacobian: Array, residuals: Sequence[Array], variance: float, *, rest: Sequence[int] = ()) -> Array:
    """Covariance of parameters by the formula of this module, shape (p, p).

    Of a direction that the samples do not show the variance is finite, but very large.

    jacobian [shape (rows, p)]
    residuals, variance, rest: as of `noise_along`.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0  # as of the rate of a pole without gain
    U, size, Vt = np.linalg.svd(jacobian / scale, full_matrices=False)
    back = Vt.T / np.maximum(size, CUT * size[0]) / scale[:, None]
    return np.asarray(back @ noise_along(residuals, U, variance, rest=rest) @ back.T)


def noise_along(
    residuals: Sequence[Array], U: Array, variance: float, *, alike: bool = False, rest: Sequence[int] = ()
) -> Array:
    """Noise covariance along the columns of U, U^T N U, shape (p, p), at least that of white noise in every direction.

    residuals: of each trace, in the order of the rows of U.
    U [shape (rows, p)]: orthonormal columns that span those of the Jacobian.
    variance: of all residuals together; taken for a single trace, and for rows that are no samples.
    alike: whether every trace has this variance.
    rest: the trace to which each of the rows after the samples belongs; rows beyond them belong to none.
    """
    sizes = [left.size for left in residuals]
    *parts, _ = np.split(U, np.cumsum(sizes))
    each = np.full(len(parts), variance)
    if len(parts) > 1:
        residuals, shown, freedom = zip(*map(_own, residuals, parts), strict=True)
        # 5 samples of a trace beyond the parameters that they fix, below which its variance is at least that of all
        least = np.where(np.array(freedom) < 5, variance, 0.0)
        each = each if alike else np.maximum(shown, least)
    of_row = np.full(len(U), variance)
    of_row[: sum(sizes) + len(rest)] = np.append(np.repeat(each, sizes), each[list(rest)])
    total = sum(own * _lags(left, part) for own, left, part in zip(each, residuals, parts, strict=True))
    value, vector = np.linalg.eigh((total + total.T) / 2)
    return np.asarray((U.T * of_row) @ U + (vector * np.maximum(value, 0)) @ vector.T)


def _own(left: Array, part: Array) -> tuple[Array, float, int]:
    """Residuals of one trace after what ``part`` explains is subtracted; their variance and degrees of freedom."""
    along, size, _ = np.linalg.svd(part, full_matrices=False)
    # 1e-6: share of a direction in a trace, of 1 in all, from which on its residuals follow the parameters
    along = along[:, size > 1e-6]
    left = left - along @ (along.T @ left)
    free = left.size - along.shape[1]
    return left, float(left @ left) / max(free, 1), free


def _lags(left: Array, part: Array) -> Array:
    """U_k^T (R - 1) U_k, shape (p, p), with the correlations R between the samples of one trace."""
    rho, n = autocorrelation(left), left.size
    size = next_fast_len(2 * n, real=True)
    circle = np.zeros(size)  # R - 1, a Toeplitz matrix, as a circulant one of twice the size or a little more
    circle[1 : rho.size + 1], circle[size - rho.size :] = rho, rho[::-1]
    spectrum = rfft(circle)
    columns = [irfft(spectrum * rfft(column, size), size)[:n] for column in part.T]
    return part.T @ np.stack(columns, axis=1)


STEP = 1e-6  # in ln(rate), of the difference quotient of a column: square root of round-off
CUT = 3e-8  # of the largest singular value, below which a direction counts as not there: square root of round-off
AT_END = 0.999  # of the range of a shift, from which on it counts as held there
ROUND_OFF, SIGMAS = 1e-9, 3.0  # of the swing; of the noise: below these a misfit counts as noise


@dataclass(frozen=True, eq=False)
class Optimum:
    """Best rates and gains of a fit, in order of increasing rate.

    log_rate [shape (n,)]
    gain [shape (n,), K/J]
    covariance [shape (2n, 2n)]: of (log_rate, gain), from the Jacobian, and the variance and autocorrelation of the
        residuals of each response.
    residual [K]: rms over all samples.
    relative_residual: rms of residual over swing.
    shift, shift_error [shape (responses,), s]: of the start of the heating, 0 where it is known; its error is inf at
        an end of its range.
    offset, offset_error [shape (responses,), K]: of the baseline, 0 where it is known.
    swarm_residual [K]: rms of the swarm's best particle that the search began with, if one did.
    noise: whether the misfit is noise, see `is_noise`.
    independent: number of independent samples, fewer than all where their residuals are correlated.
    """

    log_rate: Array
    gain: Array
    covariance: Array
    residual: float
    relative_residual: float
    shift: Array
    shift_error: Array
    offset: Array
    offset_error: Array
    noise: bool
    independent: float
    swarm_residual: float | None = None

    @property
    def deviation(self) -> Array:
        """Standard deviation of every ``log_rate``, shape (n,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal()[: self.log_rate.size], 0))


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Samples of the responses to one or several drives, each divided by its swing, and prior knowledge of the poles.

    thermal_resistance [float, K/W, or None]: imposed on sum_i g_i/lambda_i.
    positive: every gain >= 0.
    """

    responses: Sequence[Response]
    thermal_resistance: float | None = None
    positive: bool = False
    weight: Array = field(init=False)
    target: Array = field(init=False)

    def __post_init__(self) -> None:
        slowest = np.array([1 / self.span[1]])
        for d in self.responses:
            off = d.wave.mean(*d.times[[0, -1]]) == d.wave.before(d.times[0]) == 0
            if off or not np.ptp(pole_responses(slowest, d.wave, d.times, periodic=d.periodic)):
                raise checks.InputError(
                    f"the power of the {d.name} moves nothing that the samples show: is it zero throughout, or is a "
                    "time shifted or in another unit?"
                )
        weight = np.repeat([1 / d.swing for d in self.responses], [d.rise.size for d in self.responses])
        object.__setattr__(self, "weight", weight)
        object.__setattr__(self, "target", self._rows([d.rise[:, None] / d.swing for d in self.responses])[:, 0])

    @property
    def within(self) -> Array:
        """Largest shift of the start of heating that each response allows, in s; shape (responses,)."""
        return np.array([d.start_within for d in self.responses])

    def columns(self, log_rate: Array, shift: Array | None = None) -> Array:
        """Columns of the linear fit, shape (rows, poles): response of each pole per unit gain, in swings.

        The rows are all samples, then the rows at rest, last the static gain where it is imposed.

        shift [shape (responses,), s]: of the start of the heating.
        """
        rate = np.exp(log_rate)
        shifts = np.zeros(len(self.responses)) if shift is None else shift
        answers = [late_responses(d, rate, late) for d, late in zip(self.responses, shifts, strict=True)]
        for d, answer in zip(self.responses, answers, strict=True):
            answer *= 1 / d.swing
        return self._rows(answers, 1 / (rate * (self.thermal_resistance or 1.0)))

    def _rows(self, parts: Sequence[Array], gain: ArrayLike = 1.0) -> Array:
        """Complete the rows of `columns` from those of the samples of each response, which are overwritten.

        The best multiple of each estimated baseline is subtracted from every column.

        gain: static gain of each column, relative to the one imposed.
        """
        rest = []
        for d, part in zip(self.responses, parts, strict=True):
            level = part.sum(axis=0) / (len(part) + d.rest_rows)
            part -= level
            if 0 < d.rest_rows < np.inf:
                rest.append(-np.sqrt(d.rest_rows) * level)
        if self.thermal_resistance is not None:
            # 1e3: weight of the static-gain row over all samples together; the last 1e-6 are rescaled away
            rest.append(1e3 * np.sqrt(self.weight.size + len(rest)) * np.broadcast_to(gain, parts[0].shape[1]))
        return np.vstack([*parts, *rest])

    def gains(self, phi: Array) -> Array:
        """Gains of the poles by linear least squares, >= 0 where ``positive``; shape (poles,)."""
        norm = np.linalg.norm(phi, axis=0)
        norm[norm == 0] = 1.0  # a pole too fast for any sample
        if self.positive:
            return np.asarray(nnls(phi / norm, self.target, maxiter=30 * norm.size)[0] / norm)
        return np.asarray(np.linalg.lstsq(phi / norm, self.target, rcond=None)[0] / norm)

    @property
    def rested(self) -> list[int]:
        """Index of the response that each row at rest of `columns` belongs to."""
        return [k for k, d in enumerate(self.responses) if 0 < d.rest_rows < np.inf]

    @property
    def span(self) -> tuple[float, float]:
        """Shortest and longest time (s) that the samples show."""
        shortest = []
        for d in self.responses:
            edges = np.append(0.0, d.wave.breakpoints(0.0, float(d.times[-1])))
            since = d.times - edges[np.searchsorted(edges, d.times, side="right") - 1]
            steps = np.diff(np.unique(d.times))
            shortest.append(max(float(steps.min()), float(since[since > 0].min())))
        return min(shortest), max(float(np.ptp(d.times)) for d in self.responses)


def optimum(problem: FitProblem, order: int) -> Optimum:
    """Best ``order`` poles, from several starts.

    Raises InputError: fewer samples than unknowns.
    """
    checks.enough("data", problem.weight.size, 2 * order, hint=f"or take fewer than {order} poles")
    ends = [_descend(problem, start) for start in _starts(problem, order)]
    return _conclude(problem, min(ends, key=lambda end: end[1])[0])


def polish(problem: FitProblem, log_rate: Array) -> Optimum:
    """The optimum that a search from the rates ``log_rate`` reaches."""
    return _conclude(problem, _descend(problem, log_rate)[0])


def late_responses(response: Response, rate: Array, late: float) -> Array:
    """Responses of poles of gain 1, shape (times, poles), to a drive that begins at t = ``late`` s; zero before it."""
    if late == 0:
        return pole_responses(rate, response.wave, response.times, periodic=response.periodic)
    times = response.times - late
    answers = np.zeros((times.size, rate.size))
    answers[times >= 0] = pole_responses(rate, response.wave, times[times >= 0])
    return answers


def _shift(problem: FitProblem, end: Array) -> Array:
    """Shifts of the start of heating in s, shape (responses,), from the unknowns ``end`` of a search.

    The unknowns are the log rates, then the shifts that are fitted, each as a fraction of its range.
    """
    within = problem.within
    shift = np.zeros(within.size)
    free = within > 0
    shift[free] = end[end.size - free.sum() :] * within[free]
    return shift


def _row_derivatives(problem: FitProblem, end: Array, phi: Array, gain: Array) -> Array:
    """Derivatives of the fitted rows with respect to the unknowns ``end`` at constant gains; (rows, unknowns)."""
    n, shift = gain.size, _shift(problem, end)
    by_rate = (problem.columns(end[:n] + STEP, shift) - phi) / STEP * gain
    by_shift = []
    for k in np.flatnonzero(problem.within):
        later = shift + STEP * problem.within * (np.arange(shift.size) == k)
        by_shift.append((problem.columns(end[:n], later) - phi) @ gain / STEP)
    return np.column_stack([by_rate, *by_shift])


def _descend(problem: FitProblem, start: Array) -> tuple[Array, float]:
    """Minimise over log rates and shifts; returns the unknowns at the end, and half the sum of squares there."""
    shortest, longest = problem.span
    n, free = start.size, int(np.count_nonzero(problem.within))
    low = np.repeat([np.log(1e-3 / longest), -1.0], [n, free])
    high = np.repeat([np.log(30 / shortest), 1.0], [n, free])

    def misfit(p: Array) -> Array:
        phi = problem.columns(p[:n], _shift(problem, p))
        return problem.target - phi @ problem.gains(phi)

    def jacobian(p: Array) -> Array:
        phi = problem.columns(p[:n], _shift(problem, p))
        gain = problem.gains(phi)
        active = gain != 0
        moved = _row_derivatives(problem, p, phi, gain)
        Q = np.linalg.qr(phi[:, active])[0]
        return np.asarray(Q @ (Q.T @ moved) - moved)

    inside = np.clip(np.append(start, np.zeros(free)), low + 1e-6, high - 1e-6)
    end = least_squares(
        misfit, inside, jacobian, bounds=(low, high), x_scale=1.0, xtol=1e-10, ftol=1e-12, gtol=1e-14, max_nfev=200
    )
    return end.x, float(end.cost)


def _starts(problem: FitProblem, order: int) -> list[Array]:
    """Log rates to start from: up to three poles the best set on a grid; beyond, log-spaced over several spans."""
    shortest, longest = problem.span
    if order <= 3:  # 3: up to this order all sets of grid rates are tried for the start; beyond, log-spaced starts
        grid = np.log(np.geomspace(0.3 / longest, 0.3 / shortest, 14))
        return [grid[_best_columns(problem.columns(grid), problem.target, order)]]
    slow = np.log(1 / longest)
    fast = np.log(1 / shortest)
    spans = [(0.0, 0.0), (0.2, 0.2)]
    return [np.linspace(slow + a * (fast - slow), fast - b * (fast - slow), order) for a, b in spans]


def _best_columns(columns: Array, target: Array, count: int) -> list[int]:
    """Indices of the ``count`` columns that together fit the target best, by trying all sets."""
    gram = columns.T @ columns
    norm = np.sqrt(gram.diagonal())
    gram = gram / np.outer(norm, norm)
    right = columns.T @ target / norm

    def explained(pick: list[int]) -> float:
        return float(right[pick] @ np.linalg.lstsq(gram[np.ix_(pick, pick)], right[pick], rcond=1e-12)[0])

    return max((list(pick) for pick in combinations(range(norm.size), count)), key=explained)


def _conclude(problem: FitProblem, end: Array) -> Optimum:
    """The `Optimum` at the unknowns ``end`` of a search: gains, covariance and residuals."""
    shift = _shift(problem, end)
    free = np.flatnonzero(problem.within)
    n = end.size - free.size
    log_rate = np.sort(end[:n])
    end = np.append(log_rate, end[n:])
    phi = problem.columns(log_rate, shift)
    gain = problem.gains(phi)
    if problem.thermal_resistance is not None and np.any(gain):
        gain = gain * problem.thermal_resistance / np.sum(gain / np.exp(log_rate))
    misfit = (problem.target - phi @ gain)[: problem.weight.size]
    parts = np.split(misfit, np.cumsum([d.rise.size for d in problem.responses])[:-1])
    moved = _row_derivatives(problem, end, phi, gain)
    seen = np.abs(end[n:]) < AT_END
    jacobian = np.hstack([moved[:, :n], phi, moved[:, n:][:, seen]])
    unknowns = jacobian.shape[1] - (problem.thermal_resistance is not None)
    variance = float(misfit @ misfit) / max(misfit.size - unknowns, 1)
    found = covariance(jacobian, parts, variance, rest=problem.rested)
    of_poles = found[: 2 * n, : 2 * n]
    shift_error = np.where(problem.within > 0, np.inf, 0.0)
    shift_error[free[seen]] = np.sqrt(found.diagonal()[2 * n :]) * problem.within[free[seen]]
    each = zip(problem.responses, shift, strict=True)
    offset = np.array([_offset(d, log_rate, gain, late, of_poles) for d, late in each])
    return Optimum(
        log_rate=log_rate,
        gain=gain,
        covariance=of_poles,
        residual=float(np.sqrt(np.mean((misfit / problem.weight) ** 2))),
        relative_residual=float(np.sqrt(np.mean(misfit**2))),
        shift=shift,
        shift_error=shift_error,
        offset=offset[:, 0],
        offset_error=offset[:, 1],
        noise=all(is_noise(d, left * d.swing) for d, left in zip(problem.responses, parts, strict=True)),
        independent=sum(independent(left) for left in parts),
    )


def _offset(response: Response, log_rate: Array, gain: Array, shift: float, covariance: Array) -> tuple[float, float]:
    """Eliminated baseline of a response in K, (sum y - sum phi g)/(n + rest rows), and its standard error."""
    rows = response.times.size + response.rest_rows
    if not np.isfinite(rows):
        return 0.0, 0.0
    mean = late_responses(response, np.exp(log_rate + 0.0), shift).sum(axis=0) / rows
    other = late_responses(response, np.exp(log_rate + STEP), shift).sum(axis=0) / rows
    level = float(response.rise.sum() / rows - mean @ gain)
    slope = np.concatenate([(other - mean) / STEP * gain, mean])
    left = response.rise - late_responses(response, np.exp(log_rate), shift) @ gain - level
    return level, float(np.sqrt(max(slope @ covariance @ slope, 0.0) + np.mean(left**2) / rows))


def is_noise(response: Response, left: Array) -> bool:
    """Whether a misfit in K is no larger than the rows at rest scatter; without such rows, whether it is white.

    The sum of n products of neighbouring rows of white noise, over that of the squares, is 0 +- 1/sqrt(n). Noise that
    stays for some rows, as behind a filter, is white in the means of more of them; a misfit of the model is not.
    """
    n, square = left.size, float(left @ left)
    if square <= n * (ROUND_OFF * response.swing) ** 2:
        return True
    if np.isfinite(response.rest_noise):
        rows = min(n, max(response.rest_rows, 2.0))
        return bool(np.sqrt(square / n) <= response.rest_noise * (1 + SIGMAS / np.sqrt(2 * rows)))
    while abs(left[1:] @ left[:-1]) > SIGMAS / np.sqrt(left.size) * (left @ left):
        if left.size < 2 * FEWEST:
            return False
        left = left[: left.size // 2 * 2].reshape(-1, 2).mean(axis=1)
    return True
