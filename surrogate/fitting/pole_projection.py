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
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import least_squares, nnls

from thermofem import checks
from thermofem.algebra.krylov import symmetric_part
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import FEWEST_RESIDUALS, Array, ArrayLike, autocorrelation, deviations, independent, rms
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
    # 3e-8: of the largest singular value, below which a direction counts as not there: square root of round-off
    size = np.maximum(size, 3e-8 * size[0])
    back = Vt.T / size / scale[:, None]
    noise = noise_along(residuals, U, variance, rest=rest)
    return back @ noise @ back.T


def by_trace(values: Array, responses: Sequence[Response]) -> list[Array]:
    """Numbers of all samples, one trace after the other, as an array for each trace."""
    ends = np.cumsum([response.rise.size for response in responses])
    return np.split(values, ends[:-1])


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
    sizes = [trace.size for trace in residuals]
    *parts, _ = np.split(U, np.cumsum(sizes))
    variances = np.full(len(parts), variance)
    if len(parts) > 1:
        noise = [_noise(trace, part) for trace, part in zip(residuals, parts, strict=True)]
        residuals = [trace.residuals for trace in noise]
        if not alike:
            # 5 samples of a trace beyond the parameters that they fix, below which its variance is at least that of all
            least = [variance if trace.freedom < 5 else 0.0 for trace in noise]
            variances = np.maximum([trace.variance for trace in noise], least)
    samples = sum(sizes)
    of_row = np.full(len(U), variance)
    of_row[:samples] = np.repeat(variances, sizes)
    of_row[samples : samples + len(rest)] = variances[list(rest)]
    coloured = np.zeros((U.shape[1], U.shape[1]))
    for trace, part, of_trace in zip(residuals, parts, variances, strict=True):
        coloured += of_trace * _lags(trace, part)
    value, vector = np.linalg.eigh(symmetric_part(coloured))
    white = (U.T * of_row) @ U
    more = vector * np.maximum(value, 0)
    return white + more @ vector.T


class Noise(NamedTuple):
    """Residuals of one trace without what the parameters explain of them, their variance and degrees of freedom."""

    residuals: Array
    variance: float
    freedom: int


def _noise(residuals: Array, part: Array) -> Noise:
    """What is left of the residuals of a trace, without what the columns of ``part`` explain."""
    along, size, _ = np.linalg.svd(part, full_matrices=False)
    # 1e-6: share of a direction in a trace, of 1 in all, from which on its residuals follow the parameters
    followed = size > 1e-6
    along = along[:, followed]
    residuals = residuals - along @ (along.T @ residuals)
    freedom = residuals.size - int(followed.sum())
    square = float(residuals @ residuals)
    return Noise(residuals, square / max(freedom, 1), freedom)


def _lags(residuals: Array, part: Array) -> Array:
    """U_k^T (R - 1) U_k, shape (p, p), with the correlations R between the samples of one trace."""
    rho = autocorrelation(residuals)
    n = residuals.size
    size = next_fast_len(2 * n, real=True)
    circle = np.zeros(size)  # R - 1, a Toeplitz matrix, as a circulant one of twice the size or a little more
    circle[1 : rho.size + 1] = rho
    circle[size - rho.size :] = rho[::-1]
    spectrum = rfft(circle)
    products = [irfft(spectrum * rfft(column, size), size) for column in part.T]
    return part.T @ np.stack(products, axis=1)[:n]


RATE_STEP = 1e-6  # in ln(rate), of the difference quotient of a column: square root of round-off
SIGMAS = 3.0  # of the noise: a misfit below counts as noise


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
        return deviations(self.covariance)[: self.log_rate.size]


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
            begin, end = d.times[[0, -1]]
            off = d.wave.mean(begin, end) == d.wave.before(begin) == 0
            if off or not np.ptp(late_responses(d, slowest, 0.0)):
                raise checks.InputError(
                    f"the power of the {d.name} moves nothing that the samples show: is it zero throughout, or is a "
                    "time shifted or in another unit?"
                )
        sizes = [d.rise.size for d in self.responses]
        weight = np.repeat([1 / d.swing for d in self.responses], sizes)
        object.__setattr__(self, "weight", weight)
        rises = [d.rise[:, None] / d.swing for d in self.responses]
        object.__setattr__(self, "target", self._rows(rises)[:, 0])

    @property
    def within(self) -> Array:
        """Largest shift of the start of heating that each response allows, in s; shape (responses,)."""
        return np.array([d.start_within for d in self.responses])

    def columns(self, log_rate: Array, shift: ArrayLike = 0.0) -> Array:
        """Columns of the linear fit, shape (rows, poles): response of each pole per unit gain, in swings.

        The rows are all samples, then the rows at rest, last the static gain where it is imposed.

        shift [shape (responses,), s]: of the start of the heating.
        """
        rate = np.exp(log_rate)
        shifts = np.broadcast_to(shift, len(self.responses))
        answers = []
        for d, late in zip(self.responses, shifts, strict=True):
            answer = late_responses(d, rate, late)
            answers.append(answer * (1 / d.swing))
        gain = rate * (self.thermal_resistance or 1.0)
        return self._rows(answers, 1 / gain)

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
            weight = 1e3 * np.sqrt(self.weight.size + len(rest))
            rest.append(weight * np.broadcast_to(gain, parts[0].shape[1]))
        return np.vstack([*parts, *rest])

    def misfit(self, phi: Array, gain: Array) -> Array:
        """Residuals of the samples, in swings, of poles with these `columns` and gains."""
        residuals = self.target - phi @ gain
        return residuals[: self.weight.size]

    def gains(self, phi: Array) -> Array:
        """Gains of the poles by linear least squares, >= 0 where ``positive``; shape (poles,)."""
        norm = np.linalg.norm(phi, axis=0)
        norm[norm == 0] = 1.0  # a pole too fast for any sample
        scaled = phi / norm
        if self.positive:
            gain, _ = nnls(scaled, self.target, maxiter=30 * norm.size)
        else:
            gain, *_ = np.linalg.lstsq(scaled, self.target, rcond=None)
        return gain / norm

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
            latest = np.searchsorted(edges, d.times, side="right") - 1
            since = d.times - edges[latest]
            steps = np.diff(np.unique(d.times))
            shortest.append(max(steps.min(), since[since > 0].min()))
        lengths = [np.ptp(d.times) for d in self.responses]
        return float(min(shortest)), float(max(lengths))


def optimum(problem: FitProblem, order: int) -> Optimum:
    """Best ``order`` poles, from several starts.

    Raises InputError: fewer samples than unknowns.
    """
    checks.enough("data", problem.weight.size, 2 * order, hint=f"or take fewer than {order} poles")
    return polish(problem, *_starts(problem, order))


def polish(problem: FitProblem, *starts: Array) -> Optimum:
    """The best optimum that searches from log rates reach."""
    ends = [_descend(problem, start) for start in starts]
    best = min(ends, key=lambda end: end.square)
    return _conclude(problem, best.unknowns)


def late_responses(response: Response, rate: Array, late: float) -> Array:
    """Responses of poles of gain 1, shape (times, poles), to a drive that begins at t = ``late`` s; zero before it."""
    if late == 0:
        return pole_responses(rate, response.wave, response.times, periodic=response.periodic)
    times = response.times - late
    heated = times >= 0
    answers = np.zeros((times.size, rate.size))
    answers[heated] = pole_responses(rate, response.wave, times[heated])
    return answers


def _shift(problem: FitProblem, end: Array) -> Array:
    """Shifts of the start of heating in s, shape (responses,), from the unknowns ``end`` of a search.

    The unknowns are the log rates, then the shifts that are fitted, each as a fraction of its range.
    """
    within = problem.within
    shift = np.zeros(within.size)
    free = within > 0
    shares = end[end.size - free.sum() :]
    shift[free] = shares * within[free]
    return shift


def _row_derivatives(problem: FitProblem, end: Array, phi: Array, gain: Array) -> Array:
    """Derivatives of the fitted rows with respect to the unknowns ``end`` at constant gains; (rows, unknowns)."""
    log_rate = end[: gain.size]
    shift = _shift(problem, end)
    faster = problem.columns(log_rate + RATE_STEP, shift)
    by_rate = (faster - phi) / RATE_STEP * gain
    by_shift = []
    for k in np.flatnonzero(problem.within):
        later = shift.copy()
        later[k] += RATE_STEP * problem.within[k]
        change = problem.columns(log_rate, later) - phi
        by_shift.append(change @ gain / RATE_STEP)
    return np.column_stack([by_rate, *by_shift])


class End(NamedTuple):
    """Unknowns at the end of a search, and half the sum of squares there."""

    unknowns: Array
    square: float


def _descend(problem: FitProblem, log_rate: Array) -> End:
    """Minimise over log rates and shifts of the start, from the rates ``log_rate`` and no shift."""
    shortest, longest = problem.span
    n = log_rate.size
    free = int(np.count_nonzero(problem.within))
    slowest = np.log(1e-3 / longest)
    fastest = np.log(30 / shortest)
    low = np.repeat([slowest, -1.0], [n, free])
    high = np.repeat([fastest, 1.0], [n, free])

    def columns(p: Array) -> Array:
        shift = _shift(problem, p)
        return problem.columns(p[:n], shift)

    def misfit(p: Array) -> Array:
        phi = columns(p)
        fitted = phi @ problem.gains(phi)
        return problem.target - fitted

    def jacobian(p: Array) -> Array:
        phi = columns(p)
        gain = problem.gains(phi)
        active = phi[:, gain != 0]
        slopes = _row_derivatives(problem, p, phi, gain)
        Q, _ = np.linalg.qr(active)
        along = Q.T @ slopes
        return Q @ along - slopes

    start = np.append(log_rate, np.zeros(free))
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    end = least_squares(misfit, inside, jacobian, bounds=(low, high), xtol=1e-10, ftol=1e-12, gtol=1e-14, max_nfev=200)
    return End(end.x, float(end.cost))


def _starts(problem: FitProblem, order: int) -> list[Array]:
    """Log rates to start from: up to three poles the best set on a grid; beyond, log-spaced over several spans."""
    shortest, longest = problem.span
    if order <= 3:  # 3: up to this order all sets of grid rates are tried for the start; beyond, log-spaced starts
        grid = np.log(np.geomspace(0.3 / longest, 0.3 / shortest, 14))
        best = _best_columns(problem.columns(grid), problem.target, order)
        return [grid[best]]
    slow = np.log(1 / longest)
    fast = np.log(1 / shortest)
    margins = np.array([0.0, 0.2]) * (fast - slow)
    return [np.linspace(slow + margin, fast - margin, order) for margin in margins]


def _best_columns(columns: Array, target: Array, count: int) -> list[int]:
    """Indices of the ``count`` columns that together fit the target best, by trying all sets."""
    gram = columns.T @ columns
    norm = np.sqrt(gram.diagonal())
    gram = gram / np.outer(norm, norm)
    right = columns.T @ target / norm

    def explained(pick: list[int]) -> float:
        chosen = gram[np.ix_(pick, pick)]
        aims = right[pick]
        gain, *_ = np.linalg.lstsq(chosen, aims, rcond=1e-12)
        return float(aims @ gain)

    sets = combinations(range(norm.size), count)
    return max(map(list, sets), key=explained)


def _conclude(problem: FitProblem, end: Array) -> Optimum:
    """The `Optimum` at the unknowns ``end`` of a search: gains, covariance and residuals."""
    shift = _shift(problem, end)
    free = np.flatnonzero(problem.within)
    n = end.size - free.size
    log_rate = np.sort(end[:n])
    end = np.append(log_rate, end[n:])
    phi = problem.columns(log_rate, shift)
    gain = problem.gains(phi)
    R_th = problem.thermal_resistance
    if R_th is not None and np.any(gain):
        R = gain / np.exp(log_rate)
        gain = gain * R_th / np.sum(R)
    misfit = problem.misfit(phi, gain)
    traces = by_trace(misfit, problem.responses)
    derivatives = _row_derivatives(problem, end, phi, gain)
    by_rate, by_shift = np.split(derivatives, [n], axis=1)
    # 0.999: of the range of a shift, from which on it counts as held there
    inside = np.abs(end[n:]) < 0.999
    jacobian = np.hstack([by_rate, phi, by_shift[:, inside]])
    unknowns = jacobian.shape[1] - (R_th is not None)
    freedom = max(misfit.size - unknowns, 1)
    of_all = covariance(jacobian, traces, float(misfit @ misfit) / freedom, rest=problem.rested)
    of_poles = of_all[: 2 * n, : 2 * n]
    fitted = free[inside]
    shift_error = np.where(problem.within > 0, np.inf, 0.0)
    shift_error[fitted] = deviations(of_all)[2 * n :] * problem.within[fitted]
    offset = np.empty(shift.size)
    offset_error = np.empty(shift.size)
    noise = True
    for k, d in enumerate(problem.responses):
        offset[k], offset_error[k] = _offset(d, log_rate, gain, shift[k], of_poles)
        noise = noise and is_noise(d, traces[k] * d.swing)
    return Optimum(
        log_rate=log_rate,
        gain=gain,
        covariance=of_poles,
        residual=rms(misfit / problem.weight),
        relative_residual=rms(misfit),
        shift=shift,
        shift_error=shift_error,
        offset=offset,
        offset_error=offset_error,
        noise=noise,
        independent=sum(map(independent, traces)),
    )


def _offset(response: Response, log_rate: Array, gain: Array, shift: float, covariance: Array) -> tuple[float, float]:
    """Eliminated baseline of a response in K, (sum y - sum phi g)/(n + rest rows), and its standard error."""
    rows = response.times.size + response.rest_rows
    if not np.isfinite(rows):
        return 0.0, 0.0
    phi = late_responses(response, np.exp(log_rate), shift)
    faster = late_responses(response, np.exp(log_rate + RATE_STEP), shift)
    mean = phi.sum(axis=0) / rows
    change = faster.sum(axis=0) / rows - mean
    slope = np.concatenate([change / RATE_STEP * gain, mean])
    level = float(response.rise.sum() / rows - mean @ gain)
    residuals = response.rise - phi @ gain - level
    of_poles = max(slope @ covariance @ slope, 0.0)
    of_samples = np.mean(residuals**2) / rows
    return level, float(np.sqrt(of_poles + of_samples))


def is_noise(response: Response, residuals: Array) -> bool:
    """Whether a misfit in K is no larger than the rows at rest scatter; without such rows, whether it is white.

    The sum of n products of neighbouring rows of white noise, over that of the squares, is 0 +- 1/sqrt(n). Noise that
    stays for some rows, as behind a filter, is white in the means of more of them; a misfit of the model is not.
    """
    n = residuals.size
    square = float(residuals @ residuals)
    # 1e-9: of the swing: a misfit below counts as noise
    round_off = 1e-9 * response.swing
    if square <= n * round_off**2:
        return True
    if np.isfinite(response.rest_noise):
        rows = min(n, max(response.rest_rows, 2.0))
        slack = 1 + SIGMAS / np.sqrt(2 * rows)
        return bool(np.sqrt(square / n) <= response.rest_noise * slack)
    while not _is_white(residuals):
        if residuals.size < 2 * FEWEST_RESIDUALS:
            return False
        even = residuals.size // 2 * 2
        pairs = residuals[:even].reshape(-1, 2)
        residuals = pairs.mean(axis=1)
    return True


def _is_white(residuals: Array) -> bool:
    product = residuals[1:] @ residuals[:-1]
    share = SIGMAS / np.sqrt(residuals.size)
    return bool(abs(product) <= share * (residuals @ residuals))
