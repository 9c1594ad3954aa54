"""Accuracy of compact models: swing of the periodic state, period error, held-out drives, range of validity.

Source of the period error: Borghi et al., Opt. Express 29, 4363 (2021), Section 6 and Fig. 7.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq

from thermofem import Chirp, Quadratic, SquareWave, StateSpace, Telegraph, checks, waveforms
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import Array, ArrayLike, rms, runs_of
from thermofem.data.variables import in_si
from thermofem.models import NonlinearSystem, ThermalModel, bare, two_kinds
from thermofem.piecewise import bounds
from thermofem.transient.integration import integrate_periodic
from thermofem.waveforms import Waveform

from ..reduction.nonlinear_reduction import QuadraticReduction, reduce_quadratic

PERIODS = np.geomspace(1e-7, 1e-5, 13)  # s, of the curves from which ranges of validity are read
PERIOD_SAMPLES = 301  # of one period
CHECKED = 5  # periods at which the full order with k(T) corrects its quadratic reduction
CHECKED_SAMPLES = 21  # of such a period: the swing is that of the two edges
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
    """`period_error` for given swings in K of the reference at the periods."""
    look = swing_over_period(model, periods, power, duty)
    period_model = np.array([period_of(look, s, t) for s, t in zip(swing, periods, strict=True)])
    error = periods - period_model
    columns = (
        ("period_model", period_model, "s", "period at which the model has the swing"),
        ("error", error, "s", "period error"),
        ("relative_error", error / periods, "1", "period error over period"),
        ("swing", swing, "K", "swing of the temperature rise"),
        ("swing_model", [look(t) for t in periods], "K", "swing of the model's temperature rise"),
    )
    coords = {"period": ("period", periods, {"units": "s", "long_name": "period"})}
    curve = xr.Dataset(labelled(columns, "period"), coords, {"power": power, "duty": duty})
    trained = (getattr(model, "origin", None) or {}).get("training_period")
    if isinstance(trained, float):
        curve.attrs["training_period"] = trained
    return curve.assign_attrs(validity=validity(curve))


def labelled(columns: Iterable[tuple[str, Any, str, str]], *dims: str) -> dict[str, Any]:
    """Variables of a Dataset over ``dims`` from their names, values, units and long names."""
    return {name: (dims, values, {"units": unit, "long_name": words}) for name, values, unit, words in columns}


def states_of(models: Mapping[str, ThermalModel]) -> dict[str, Any]:
    """Variable "states" over "model": number of states, nan where a model has no order."""
    states = [float(getattr(model, "order", np.nan)) for model in models.values()]
    return labelled([("states", states, "1", "number of states")], "model")


def swings(reference: ThermalModel, periods: Array, power: float, duty: float) -> Array:
    """Swing in K of the periodic state at each period, from the full order where k depends on temperature.

    The full order is solved at `CHECKED` periods. Between them its ratio to the quadratic reduction is interpolated in
    the logarithm of the period.

    Raises InputError: as `surrogate.period_error`; a power without a steady state.
    """
    for period in periods[[0, -1]]:
        SquareWave(power, float(period), duty)  # raises
    system = bare(reference)
    if not isinstance(system, NonlinearSystem):
        look = swing_over_period(reference, periods, power, duty)
        return np.array([look(t) for t in periods])
    reduction = reduce_quadratic(system, power)
    look = swing_over_period(reduction.model, periods, power, duty)
    swing = np.array([look(t) for t in periods])
    return swing * _correction(reduction, system, periods, power, duty)


def _correction(
    reduction: QuadraticReduction, system: NonlinearSystem, periods: Array, power: float, duty: float
) -> Array:
    """Ratio of the full-order swing to that of its quadratic reduction at each of the periods."""
    every = periods.size <= CHECKED
    few = periods if every else np.geomspace(periods[0], periods[-1], CHECKED)
    ratio = []
    for period in few:
        wave = SquareWave(power, float(period), duty)
        states = reduction.model.periodic_states(wave, CHECKED_SAMPLES)
        start = reduction.basis @ states[0, :-1]
        # 1e-3 of the full order: 1e-5 of its swing at 1 us (measured), as each step may err by a tenth of it
        full = integrate_periodic(system, wave, CHECKED_SAMPLES, rtol=1e-3, initial=start).outputs[:, 0]
        ratio.append(np.ptp(full) / np.ptp(states @ reduction.model.C))
    if every:
        return np.array(ratio)
    between = PchipInterpolator(np.log(few), ratio)
    return between(np.log(periods))


def swing_over_period(model: ThermalModel, periods: Array, power: float, duty: float) -> Callable[[float], float]:
    """Swing in K as a function of the period in s; for a quadratic model interpolated in a table around ``periods``."""
    if isinstance(bare(model), Quadratic) and periods.size > CHECKED:
        return _table(model, periods, power, duty)
    return lambda period: _swing(model, SquareWave(power, period, duty))


def _table(model: ThermalModel, periods: Array, power: float, duty: float) -> Callable[[float], float]:
    """Swing in K over the period in s, by a cubic spline in logarithms from half the shortest to twice the longest.

    Outside this range the swing is computed.
    """

    def exact(log_period: float) -> float:
        period = float(np.exp(log_period))
        return _swing(model, SquareWave(power, period, duty))

    low = np.log(periods[0] / 2)
    high = np.log(periods[-1] * 2)
    # 1.25: between the periods of a `_table`: interpolation leaves 1e-5 of the swing (measured)
    steps = int(np.ceil((high - low) / np.log(1.25)))
    nodes = np.linspace(low, high, 1 + steps)
    table = [exact(node) for node in nodes]
    spline = CubicSpline(nodes, np.log(table))

    def look(period: float) -> float:
        log_period = float(np.log(period))
        if low <= log_period <= high:
            return float(np.exp(spline(log_period)))
        return exact(log_period)

    return look


def _swing(model: ThermalModel, wave: SquareWave) -> float:
    """Largest minus smallest rise in K of the periodic state; in a passive network these lie at the two edges.

    swing = P sum_i R_i (1 - e^-a)(1 - e^-b)/(1 - e^-(a+b)),   a = duty T/tau_i,  b = (1 - duty) T/tau_i
    """
    system = bare(model)
    # 200: states of a model whose poles are computed for their swing; those of a FEM heat or arrive late
    large = isinstance(system, StateSpace) and system.order > 200
    if large or isinstance(system, NonlinearSystem):
        return float(np.ptp(model.periodic_response(wave, PERIOD_SAMPLES)))
    poles = two_kinds(model)
    if isinstance(poles, Quadratic):
        return _quadratic_swing(poles, wave)
    R = np.asarray(poles.linear.R)
    tau = np.asarray(poles.linear.tau)
    if poles.linear.passive and not poles.bent:
        on = -wave.duty * wave.period / tau
        off = -(1 - wave.duty) * wave.period / tau
        shares = np.expm1(on) * np.expm1(off) / np.expm1(on + off)
        return float(-wave.power * R @ shares)
    if poles.linear.passive:
        return float(np.ptp(poles.periodic_response(wave, PERIOD_SAMPLES)))
    phi = pole_responses(1 / tau, wave, _after_edges(wave, tau), periodic=True)
    rise = poles.of(phi @ poles.linear.gain)
    return float(np.ptp(rise))


def _quadratic_swing(model: Quadratic, wave: SquareWave) -> float:
    """`_swing` of a quadratic model; one that is no reduction of a FEM may overshoot."""
    if np.array_equal(model.A, model.A.T):
        return float(np.ptp(model.periodic_response(wave, PERIOD_SAMPLES)))
    start = model.periodic_states(wave, PERIOD_SAMPLES)[0]
    tau = -1 / np.linalg.eigvals(model.A).real
    states = model.states(wave, _after_edges(wave, tau), initial=start)
    return float(np.ptp(states @ model.C))


def _after_edges(wave: SquareWave, tau: Array) -> Array:
    """Times in s over one period, dense after both edges, where a model with time constants tau may overshoot."""
    first = 1e-2 * tau.min()
    last = 1e2 * tau.max()
    # 0.02: relative step of the times after an edge: 1e-4 of an overshoot
    steps = int(np.ceil(np.log(last / first) / 0.02))
    since = np.geomspace(first, last, steps)
    on = wave.duty * wave.period
    while_on = since[since < on]
    while_off = on + since[since < wave.period - on]
    return np.unique(np.concatenate([[0.0, on, wave.period], while_on, while_off]))


def period_of(look: Callable[[float], float], swing: float, near: float) -> float:
    """Period in s at which look(period) = ``swing``, by Brent's method; inf or 0 if none is within 1e4 of ``near``."""

    def excess(log_period: float) -> float:
        period = float(np.exp(log_period))
        return look(period) - swing

    inner = outer = float(np.log(near))
    # 1e4: a period this many times longer or shorter than the reference's counts as never reached
    step = np.log(1.5)
    farthest = np.log(1e4)
    side = -1.0 if excess(inner) > 0 else 1.0
    while side * excess(outer) < 0:
        inner = outer
        outer = outer + side * step
        step = 1.5 * step
        if abs(outer - np.log(near)) > farthest:
            return float("inf") if side > 0 else 0.0
    if inner == outer:
        return near
    return float(np.exp(brentq(excess, inner, outer, xtol=1e-10)))


def valid_range(curve: xr.Dataset, *, within: float = 0.1) -> list[tuple[float, float]]:
    """Shortest and longest period (s) of every stretch where |relative error| <= ``within``.

    The ends are interpolated between the curve's periods, in their logarithm; where the curve ends within, so does the
    stretch. One that spans less than an octave, and not the whole curve, does not count: an error that crosses zero is
    small at one period only, and that period is not known beforehand. The stretch around the training period comes
    first, then the widest.

    curve [Dataset of `period_error`]: ``relative_error`` over ``period`` (s).
    within: relative error that is allowed.
    Raises InputError: no curve, several models, or a limit that is not positive.
    """
    within = checks.positive("within", within, hint="0.1 is ten percent")
    period = np.atleast_1d(in_si("curve", curve)["period"].values)
    error = curve["relative_error"]
    x = np.log(checks.array("curve.period", period, increasing=True))
    if error.dtype.kind not in "fiu" or error.size != x.size:
        raise checks.InputError("curve.relative_error needs one number for each period; pick one model of several")
    y = np.abs(error.values.ravel())

    def crossing(inside: int, outside: int) -> float:
        known = 0 <= outside < x.size and np.isfinite(y[outside])
        if not known:
            return float(x[inside])
        dx = x[outside] - x[inside]
        dy = y[outside] - y[inside]
        share = (within - y[inside]) / dy
        return float(x[inside] + share * dx)

    least = min(np.log(2), x[-1] - x[0]) - 1e-12
    stretches = []
    for first, end in runs_of(y <= within):
        low = crossing(first, first - 1)
        high = crossing(end - 1, end)
        if high - low >= least:
            stretches.append((float(np.exp(low)), float(np.exp(high))))
    trained = curve.attrs.get("training_period", np.nan)

    def order(ends: tuple[float, float]) -> tuple[bool, float]:
        low, high = ends
        return not low <= trained <= high, low / high

    return sorted(stretches, key=order)


def widest_range(curve: xr.Dataset, *, within: float = 0.1) -> tuple[float, float]:
    """The widest stretch of `valid_range`, (nan, nan) where there is none."""
    stretches = valid_range(curve, within=within)
    return max(stretches, key=lambda ends: ends[1] / ends[0], default=(np.nan, np.nan))


def validity(curve: xr.Dataset, *, within: float = 0.1) -> str:
    """`valid_range` in words: 'within 10 % from 0.6 to 1.45 us (trained at 1 us) and from 3 to 4.1 us'."""
    trained = curve.attrs.get("training_period", np.nan)
    percent = 100 * float(within)
    words = []
    for low, high in valid_range(curve, within=within):
        text = f"from {low * 1e6:.3g} to {high * 1e6:.3g} us"
        if low <= trained <= high:
            text += f" (trained at {trained * 1e6:.3g} us)"
        words.append(text)
    if not words:
        return f"nowhere within {percent:g} %"
    return f"within {percent:g} % {' and '.join(words)}"


def compare(
    models: Mapping[str, ThermalModel],
    reference: ThermalModel,
    drives: Sequence[Waveform] | None = None,
    *,
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
    periods : array, s
        of the curve of `period_error`, at the drives' largest power, from which the ranges are read; empty for none.

    Returns
    -------
    Dataset
        over ``model`` and ``drive``: ``rms``, ``peak`` (K), ``rms_relative``, ``peak_relative`` (of the reference's
        swing), at `COMPARED` times of a period and four times as many of other drives; over ``model``: ``states``, and
        ``validity`` in words: "within 10 % from 0.6 to 1.45 us".

    Raises
    ------
    InputError
        no model or what is none, no waveform, or a drive under which the reference does not move.
    """
    asked: Any = held_out_drives() if drives is None else drives
    drives = [asked] if hasattr(asked, "breakpoints") else list(asked)
    exact = [_rise_under(reference, drive) for drive in drives]
    swing = np.array([np.ptp(y) for y in exact])
    if np.any(swing <= 0):
        raise checks.InputError(f"the reference does not move under drive {int(np.argmin(swing))}; is its power zero?")
    errors = np.empty((len(models), len(drives)))
    peak = np.empty_like(errors)
    for i, model in enumerate(models.values()):
        for j, drive in enumerate(drives):
            misfit = _rise_under(model, drive) - exact[j]
            errors[i, j] = rms(misfit)
            peak[i, j] = np.abs(misfit).max()
    columns = (
        ("rms", errors, "K", "rms error"),
        ("peak", peak, "K", "largest error"),
        ("rms_relative", errors / swing, "1", "rms error over swing"),
        ("peak_relative", peak / swing, "1", "largest error over swing"),
    )
    variables = labelled(columns, "model", "drive") | states_of(models)
    periods = checks.array("periods", periods, increasing=True, empty=True)
    if periods.size:
        power = max(map(_largest, drives))
        duty = 1 / 3
        exact_swings = swings(reference, periods, power, duty)
        ranges = []
        for model in models.values():
            curve = error_curve(model, exact_swings, periods, power, duty)
            ranges.append(curve.attrs["validity"])
        variables["validity"] = ("model", ranges, {"long_name": "range of validity on the period"})
    coords = {"model": list(models), "drive": [d.words for d in drives]}
    return xr.Dataset(variables, coords=coords)


def square_waves(
    power: float = 2e-3, *, periods: int = 11, duties: Sequence[float] = (0.1, 0.2, 1 / 3, 0.45, 0.6)
) -> list[Waveform]:
    """Square waves from 0.1 to 10 us at every duty: 55 by default, on which orders of models are compared.

    power [W]: while the wave is on.
    periods: number of periods, evenly spaced in their logarithm.
    duties: fractions of the period that are on, between 0 and 1.
    """
    times = np.geomspace(1e-7, 1e-5, periods).tolist()
    return [SquareWave(power, time, duty) for time in times for duty in duties]


def held_out_drives() -> list[Waveform]:
    """Drives that no training uses, of 2 mW: 15 square waves of 0.1..10 us, 4 pulses, 2 telegraphs and a chirp."""
    power = 2e-3
    squares = square_waves(power, periods=5, duties=(0.1, 1 / 3, 0.6))
    pulses = [waveforms.Pulse(power, width) for width in (2e-8, 2e-7, 2e-6, 2e-5)]
    short = Telegraph(power, 2e-7, 2e-5, seed=1)
    long = Telegraph(power, 2e-6, 1e-4, seed=2)
    chirp = Chirp(power, 1e-7, 1e-5, 1e-4)
    return [*squares, *pulses, short, long, chirp]


def _rise_under(model: ThermalModel, drive: Waveform) -> Array:
    """Rise in K under a drive: one period of the periodic state, or from rest over 1.5 times the drive's length."""
    if drive.period is not None:
        return model.periodic_response(drive, COMPARED)
    end = 1.5 * _length(drive)
    even = np.linspace(0, end, 4 * COMPARED)
    times = np.unique(np.concatenate([even, drive.breakpoints(0.0, end)]))
    return model.response(drive, times)


def _largest(drive: Waveform) -> float:
    """Largest power of a drive, W."""
    stop = drive.period or _length(drive)
    _, largest = bounds(waveforms.heating_pieces(drive, 0.0, stop))
    return largest


def _length(drive: Waveform) -> float:
    """Duration of a drive without a period, s: its own, or until it last changes; 100 us where it never does."""
    whole = getattr(drive, "whole", None)
    if whole is None or whole.edges[-1] < waveforms.ENDLESS:  # a function, or a record that ends
        raise checks.InputError(f"how long a {type(drive).__name__} lasts is not known; give one that repeats")
    changes = whole.edges[1:-1]
    return float(getattr(drive, "duration", changes[-1] if changes.size else 1e-4))
