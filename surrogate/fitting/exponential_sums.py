"""Sums of exponentials: a few fitted to a cooling curve (the paper's Fig. 5(a)), and a spectrum on a grid.

The spectrum of time constants is always stable and passive:

    dT = sum_i R_i psi(t; tau_i),  R_i >= 0,  tau_i on a logarithmic grid,  sum_i R_i = R_th where it is known

There is nothing to search: the problem is convex and its optimum has few nonzero R_i.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from thermofem import Foster, checks
from thermofem.arrays import Array, ArrayLike, deviations, rms
from thermofem.data import quantity

from .fit import Fit, Training
from .fit_result import cancelling, check_explained, pole_parameters, unseen_times
from .pole_projection import covariance

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
        t = checks.numbers("times", times)[..., None]
        return np.exp(-t / self.tau) @ self.amplitude


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
    t = checks.array("times", times, increasing=True)
    y = checks.array("rise", rise, most=np.inf)
    order = checks.integer("order", order, 1, 5)
    checks.shape("rise", y, t.shape)
    checks.enough("rise", t.size, 2 * order + 1)
    span = np.ptp(t)
    size = float(np.abs(y).max()) or 1.0
    hint = "0 is the end of the power: subtract that moment"
    checks.between("times[0]", t[0], -LATEST * span, LATEST * span, unit="s", hint=hint)
    y = y / size  # SciPy's tolerance of the gradient is absolute
    # 0.99 of the largest rise: what does not end below is no cooling curve
    checks.between("the last over the largest rise", abs(y[-1]), 0, 0.99, hint="a cooling curve falls")
    # 100.0: largest |t|/tau of the first sample: a decay that it shows has not gone to exp(-100)
    from_first = abs(t[0]) / 100.0
    # 10.0: the closest samples over this are the shortest time constant
    closest = np.diff(t).min() / 10.0
    low = np.log(max(closest, from_first, np.finfo(float).tiny))
    # 100.0: the span times this is the longest time constant
    high = np.log(100.0 * span)
    # 12: time constants on a grid, any of which are tried together
    grid = np.linspace(low, high, 12 + 2)[1:-1]
    stride = max(1, t.size // 200)  # 200 samples by which the starts are compared

    def square(log_tau: Sequence[float]) -> float:
        _, residuals = _amplitudes(t[::stride], y[::stride], np.array(log_tau))
        return float(np.sum(residuals**2))

    def misfit(log_tau: Array) -> Array:
        _, residuals = _amplitudes(t, y, log_tau)
        return residuals

    starts = sorted(combinations(grid, order), key=square)
    exactly: dict[str, Any] = {"bounds": (low, high), "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    # 3: combinations of them that begin a search
    ends = [least_squares(misfit, start, **exactly) for start in starts[:3]]
    best = min(ends, key=lambda end: float(end.cost))
    log_tau = np.sort(best.x)
    amplitude, residuals = _amplitudes(t, y, log_tau)
    tau = np.exp(log_tau)
    misfit_of_all = rms(residuals)
    check_explained(misfit_of_all, float(np.std(y)), f"a sum of {order} exponentials", "rise")
    notes = _notes(t, tau, amplitude, residuals, size)
    return Decay(size * amplitude, tau, size * misfit_of_all, notes)


def _amplitudes(t: Array, y: Array, log_tau: Array) -> tuple[Array, Array]:
    """Best amplitudes of exponentials with the time constants exp(``log_tau``), and the residuals of the rise y."""
    columns: Any = np.exp(-t[:, None] / np.exp(log_tau))
    amplitude, *_ = np.linalg.lstsq(columns, y, rcond=None)
    return amplitude, y - columns @ amplitude


def _notes(t: Array, tau: Array, amplitude: Array, residuals: Array, size: float) -> tuple[str, ...]:
    """Sentences on time constants that the samples do not determine, and on exponentials that cancel; fastest first.

    residuals [shape (n,)]: they and the amplitudes are in units of ``size`` [K].
    """
    decays = -t[:, None] / tau
    columns = np.exp(decays)
    jacobian = np.hstack([decays * columns * amplitude, columns])
    freedom = max(t.size - 2 * tau.size, 1)
    square = float(residuals @ residuals)
    spread = covariance(jacobian, [residuals], square / freedom)
    deviation = deviations(spread)[: tau.size]
    span = float(np.diff(t).min()), float(np.ptp(t))
    unseen = unseen_times(-np.log(tau[::-1]), amplitude[::-1], deviation[::-1], span)
    return (*unseen, *cancelling(amplitude * size, "K"))


GRID_MARGIN = 10.0  # the grid reaches this factor beyond the times that the data show


def fit_spectrum(
    data: xr.Dataset | Sequence[xr.Dataset],
    *,
    per_decade: int = 8,
    thermal_resistance: float | None = None,
) -> Fit:
    """Fit the spectrum of time constants.

    Parameters
    ----------
    data : Dataset or list of them
        each is weighted by its swing.
    per_decade : int, 2 to 40
        time constants of the grid in each decade.
    thermal_resistance : float, K/W
        static gain to impose; default the Datasets' own, where they carry it.

    Returns
    -------
    Fit
        a Foster network of typically 15 to 30 poles; ``standard_errors`` are nan, as the grid is not fitted.

    Raises
    ------
    InputError
        data without power or rise, or that no heating pole fits.
    """
    checks.between("per_decade", per_decade, 2, 40)
    training = Training.of(data, thermal_resistance=thermal_resistance, impose=True)
    problem = training.problem
    shortest, longest = problem.span
    R_th = problem.thermal_resistance
    low = shortest / GRID_MARGIN
    high = longest if R_th is None else longest * GRID_MARGIN
    steps = int(np.ceil(per_decade * np.log10(high / low)))
    tau = np.geomspace(low, high, steps + 1)
    phi = problem.columns(-np.log(tau))
    gain = problem.gains(phi)
    misfit = problem.misfit(phi, gain)
    training.check(gain, rms(misfit))
    R = gain * tau
    tau = tau[gain > 0]
    R = R[gain > 0]
    if R_th is not None:
        R = R * R_th / R.sum()
    model = Foster(R=R, tau=tau, **training.parts)
    return Fit(
        model=model,
        parameters=pole_parameters(model),
        residual=rms(misfit / problem.weight),
        relative_residual=rms(misfit),
        training=training.names,
        notes=(*training.doubts, *_beyond(R, tau, longest)),
        geometry=training.geometry,
    ).recorded()


def _beyond(R: Array, tau: Array, longest: float) -> list[str]:
    """A sentence where much of the thermal resistance lies in poles that data of length ``longest`` s cannot show."""
    # 3.0: time constant over the length of the data from which a pole counts as beyond them
    slow = 3.0 * longest
    share = R[tau > slow].sum() / R.sum()
    # 0.1: share of the resistance in such poles that is worth a note
    if share <= 0.1:
        return []
    return [
        f"{share:.0%} of the thermal resistance lies in poles slower than {quantity.rounded(slow, 's')}, "
        "which the data are too short to show: only the stated thermal_resistance says so"
    ]
