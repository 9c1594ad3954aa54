"""Accuracy of compact models: period error, held-out drives, range of validity.

Source of the period error: Borghi et al., Opt. Express 29, 4363 (2021), Section 6 and Fig. 7.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.constants import c

from thermofem import Chirp, Constant, Pulse, SquareWave, Telegraph, checks, waveforms
from thermofem.arrays import Array, ArrayLike
from thermofem.data.variables import in_si
from thermofem.models import ThermalModel
from thermofem.piecewise import bounds
from thermofem.waveforms import Waveform

from .temperature_swing import period_of, swing_over_period, swings

PERIODS = np.geomspace(1e-7, 1e-5, 13)  # s, of the curves from which ranges of validity are read
COMPARED = 20_001  # times of one period at which models are compared: the fastest poles err just after an edge


def period_error(
    model: ThermalModel,
    reference: ThermalModel,
    periods: ArrayLike,
    *,
    power: float = 2e-3,
    duty: float = 1 / 3,
) -> xr.Dataset:
    """Error of a model on the self-pulsing period, by the paper's method.

    For each period T the reference's periodic state under a square wave has some swing; T_model is the period at which
    the model has that swing under the same power and duty:

        error = T - T_model,      swing_model(T_model) = swing_reference(T)

    Parameters
    ----------
    model : ThermalModel
    reference : ThermalModel
        the FEM or, a thousand times faster, its certified reduction; with k(T) the FEM itself, see `swings`.
    periods : array, shape (n,), s
    power : float, W
    duty : float

    Returns
    -------
    Dataset
        over ``period`` (s): ``period_model``, ``error`` (s), ``relative_error``, ``swing`` and ``swing_model`` (K).
        Where no period within a factor of 1e4 gives the model that swing, period_model is inf, or 0 if it has more.
        ``attrs["validity"]`` says in words where the error is within 10 %.

    Raises
    ------
    InputError
        periods that are not positive or do not increase, a power that is not positive, a duty outside 0..1.
    """
    periods = checks.array("periods", periods, increasing=True, hint="periods are in s (did you mean 1e-6?)")
    swing = swings(reference, periods, power, duty)
    return error_curve(model, swing, periods, float(power), float(duty))


def error_curve(model: ThermalModel, swing: Array, periods: Array, power: float, duty: float) -> xr.Dataset:
    """`period_error` against swings of a reference that are known already."""
    look = swing_over_period(model, periods, power, duty)
    found = np.array([period_of(look, s, t) for s, t in zip(swing, periods, strict=True)])
    error, own = periods - found, np.array([look(t) for t in periods])
    variables = {
        "period_model": ("period", found, {"units": "s", "long_name": "period at which the model has the swing"}),
        "error": ("period", error, {"units": "s", "long_name": "period error"}),
        "relative_error": ("period", error / periods, {"units": "1", "long_name": "period error over period"}),
        "swing": ("period", swing, {"units": "K", "long_name": "swing of the temperature rise"}),
        "swing_model": ("period", own, {"units": "K", "long_name": "swing of the model's temperature rise"}),
    }
    coords = {"period": ("period", periods, {"units": "s", "long_name": "period"})}
    curve = xr.Dataset(variables, coords=coords, attrs={"power": power, "duty": duty})
    trained = (getattr(model, "origin", None) or {}).get("training_period")
    if isinstance(trained, float):
        curve.attrs["training_period"] = trained
    return curve.assign_attrs(validity=validity(curve))


def valid_range(curve: xr.Dataset, *, within: float = 0.1, training: float | None = None) -> list[tuple[float, float]]:
    """Shortest and longest period (s) of every stretch where |relative error| <= ``within``.

    The ends are interpolated between the curve's periods, in their logarithm; where the curve ends within, so does the
    stretch.

    Parameters
    ----------
    curve : Dataset
        of `period_error`: ``relative_error`` over ``period`` (s).
    within : float
        relative error that is allowed.
    training : float, s, optional
        period of the model's training; default that of ``curve.attrs["training_period"]``, where it is known.

    Returns
    -------
    list of pairs of floats, s
        the stretch around the training period first, then the widest; empty if there is none.

    Raises
    ------
    InputError
        no curve, several models, or a limit that is not positive.
    """
    within = checks.positive("within", within, hint="0.1 is ten percent")
    period, error = in_si("curve", curve)["period"], curve["relative_error"]
    x = np.log(checks.array("curve.period", np.atleast_1d(period.values), increasing=True))
    if error.dtype.kind not in "fiu" or error.size != x.size:
        raise checks.InputError("curve.relative_error needs one number for each period; pick one model of several")
    y = np.abs(error.values.ravel())
    good = np.concatenate([[False], y <= within, [False]])
    first, last = np.flatnonzero(~good[:-1] & good[1:]), np.flatnonzero(good[:-1] & ~good[1:]) - 1

    def crossing(inside: int, outside: int) -> float:
        if not (0 <= outside < x.size and np.isfinite(y[outside])):
            return float(np.exp(x[inside]))
        share = (within - y[inside]) / (y[outside] - y[inside])
        return float(np.exp(x[inside] + share * (x[outside] - x[inside])))

    pairs = zip(first.tolist(), last.tolist(), strict=True)
    stretches = [(crossing(i, i - 1), crossing(j, j + 1)) for i, j in pairs]
    at = curve.attrs.get("training_period") if training is None else training

    def rank(ends: tuple[float, float]) -> tuple[bool, float]:
        return not (at is not None and ends[0] <= at <= ends[1]), -np.log(ends[1] / ends[0])

    return sorted(stretches, key=rank)


def widest_range(curve: xr.Dataset, *, within: float = 0.1) -> tuple[float, float]:
    """The widest stretch of `valid_range`, (nan, nan) where it is less than an octave and not the whole curve.

    An error that crosses zero is small at one period only, and that period is not known beforehand.
    """
    stretches = valid_range(curve, within=within)
    low, high = max(stretches, key=lambda ends: ends[1] / ends[0], default=(np.nan, np.nan))
    period = np.atleast_1d(in_si("curve", curve)["period"].values)
    # 2.0: a range of validity spans at least this factor
    if not high / low >= min(2.0, period[-1] / period[0]) * (1 - 1e-12):
        return float("nan"), float("nan")
    return low, high


def validity(curve: xr.Dataset, *, within: float = 0.1) -> str:
    """`valid_range` in words: 'within 10 % from 0.6 to 1.45 us (trained at 1 us) and from 3 to 4.1 us'.

    Parameters
    ----------
    curve : Dataset
        of `period_error`.
    within : float
        relative error that is allowed.

    Returns
    -------
    str

    Raises
    ------
    InputError
        as `valid_range`.
    """
    at, percent = curve.attrs.get("training_period"), 100 * float(within)
    trained = "" if at is None else f" (trained at {at * 1e6:.3g} us)"
    words = []
    for low, high in valid_range(curve, within=within):
        around = at is not None and low <= at <= high
        words.append(f"from {low * 1e6:.3g} to {high * 1e6:.3g} us{trained if around else ''}")
    if not words:
        return f"nowhere within {percent:g} %"
    return f"within {percent:g} % {' and '.join(words)}"


def compare(
    models: Mapping[str, ThermalModel],
    reference: ThermalModel,
    drives: Sequence[Waveform] | None = None,
    *,
    shift: float = 10.294e9,  # Hz/K: (nu_0/n_0) dn/dT of the paper's ring at 1555 nm, Appendix A
    wavelength: float = 1555e-9,  # 1555e-9 m
    periods: ArrayLike = PERIODS,
) -> xr.Dataset:
    """Error of several models on drives that their training did not see, and over which periods each can be trusted.

    Parameters
    ----------
    models : mapping from a name to a ThermalModel
    reference : ThermalModel
    drives : sequence of Waveform
        periodic ones are compared in the periodic state, the others from rest over their own length; default
        `held_out_drives`.
    shift : float, Hz/K
        resonance shift per kelvin.
    wavelength : float, m
    periods : array, s
        of the curve of `period_error`, at the drives' largest power, from which the ranges are read; empty for none.

    Returns
    -------
    Dataset
        over ``model`` and ``drive``: ``rms``, ``peak`` (K), ``rms_relative``, ``peak_relative`` (of the reference's
        swing), ``frequency_shift`` (Hz) and ``wavelength_shift`` (m) of the peak error, at `COMPARED` times of a period
        and four times as many of other drives; over ``model``: ``states``, and ``validity`` in words: "within 10 % from
        0.6 to 1.45 us".

    Raises
    ------
    InputError
        no model or what is none, no waveform, or a drive under which the reference does not move.
    """
    given: Any = held_out_drives() if drives is None else drives
    drives = [given] if hasattr(given, "breakpoints") else list(given)
    wavelength = checks.positive("wavelength", wavelength, unit="m", at_most=1e-4, hint="did you mean 1.55e-6?")
    shift = checks.finite("shift", shift, unit="Hz/K")
    exact = [_answer(reference, drive) for drive in drives]
    swing = np.array([np.ptp(y) for y in exact])
    if np.any(swing <= 0):
        raise checks.InputError(f"the reference does not move under drive {int(np.argmin(swing))}; is its power zero?")
    misfit = [[_answer(m, d) - y for d, y in zip(drives, exact, strict=True)] for m in models.values()]
    rms = np.array([[np.sqrt(np.mean(e**2)) for e in row] for row in misfit])
    peak = np.array([[np.max(np.abs(e)) for e in row] for row in misfit])
    fields = {
        "rms": (rms, "K", "rms error"),
        "peak": (peak, "K", "largest error"),
        "rms_relative": (rms / swing, "1", "rms error over swing"),
        "peak_relative": (peak / swing, "1", "largest error over swing"),
        "frequency_shift": (peak * shift, "Hz", "largest error of the resonance frequency"),
        "wavelength_shift": (peak * shift * wavelength**2 / c, "m", "largest error of the resonance wavelength"),
    }
    variables: dict[str, Any] = {
        name: (("model", "drive"), value, {"units": unit, "long_name": words})
        for name, (value, unit, words) in fields.items()
    }
    states = [float(getattr(m, "order", np.nan)) for m in models.values()]
    variables["states"] = ("model", states, {"units": "1", "long_name": "number of states"})
    periods = checks.array("periods", periods, increasing=True, empty=True)
    if periods.size:
        power, duty = max(map(_largest, drives)), 1 / 3
        swing = swings(reference, periods, power, duty)
        words = [error_curve(m, swing, periods, power, duty).attrs["validity"] for m in models.values()]
        variables["validity"] = ("model", words, {"long_name": "range of validity on the period"})
    return xr.Dataset(variables, coords={"model": list(models), "drive": [d.words for d in drives]})


def square_waves(
    power: float = 2e-3, *, periods: int = 11, duties: Sequence[float] = (0.1, 0.2, 1 / 3, 0.45, 0.6)
) -> list[Waveform]:
    """Square waves from 0.1 to 10 us at every duty: 55 by default, on which orders of models are compared.

    Parameters
    ----------
    power : float, W
        while the wave is on.
    periods : int
        number of periods, evenly spaced in their logarithm.
    duties : sequence of float
        fractions of the period that are on, between 0 and 1.

    Returns
    -------
    list of SquareWave
        ``periods`` times ``len(duties)``.

    Raises
    ------
    InputError
        a number out of its range.
    """
    periods = checks.integer("periods", periods, 1, 10_000)
    each = checks.array("duties", duties).tolist()
    return [SquareWave(power, t, d) for t in np.geomspace(1e-7, 1e-5, periods) for d in each]


def held_out_drives(power: float = 2e-3) -> list[Waveform]:
    """Drives of every kind that no training uses: square waves 0.1..10 us, pulses, random telegraph, chirp.

    Parameters
    ----------
    power : float, W
        the largest of each drive.

    Returns
    -------
    list of Waveform
        15 square waves, 4 pulses of 20 ns to 20 us, 2 random telegraphs, 1 chirp.

    Raises
    ------
    InputError
        a power out of its range.
    """
    pulses = [Pulse(power, width) for width in (2e-8, 2e-7, 2e-6, 2e-5)]
    noise: list[Waveform] = [Telegraph(power, 2e-7, 2e-5, seed=1), Telegraph(power, 2e-6, 1e-4, seed=2)]
    return [*square_waves(power, periods=5, duties=(0.1, 1 / 3, 0.6)), *pulses, *noise, Chirp(power, 1e-7, 1e-5, 1e-4)]


def _answer(model: ThermalModel, drive: Waveform) -> Array:
    """The periodic state, or the transient from rest over the drive and half as long again, edges included."""
    if drive.period is not None:
        return model.periodic_response(drive, COMPARED)
    length = _length(drive)
    edges = drive.breakpoints(0.0, 1.5 * length)
    times = np.unique(np.concatenate([np.linspace(0, 1.5 * length, 4 * COMPARED), edges]))
    return model.response(drive, times)


def _largest(drive: Waveform) -> float:
    """Largest power of a drive, W."""
    stop = drive.period if drive.period is not None else _length(drive)
    return bounds(waveforms.heating_pieces(drive, 0.0, stop))[1]


def _length(drive: Waveform) -> float:
    """Duration of a drive without a period, s."""
    match drive:
        case Pulse():
            return drive.stop
        case Telegraph() | Chirp():
            return drive.duration
        case Constant():
            return 1e-4
    raise checks.InputError(f"how long a {type(drive).__name__} lasts is not known; give one that repeats")
