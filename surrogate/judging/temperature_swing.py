"""Swing of the periodic state under a square wave, over its period, and the period at which a model has a swing."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq

from thermofem import Foster, OutputMap, Quadratic, SquareWave, StateSpace, checks
from thermofem.arrays import Array
from thermofem.models import Cauer, Network, NonlinearSystem, ThermalModel, bare
from thermofem.transient.integration import integrate_periodic

from ..reduction.nonlinear_reduction import QuadraticReduction, reduce_quadratic

SAMPLES = 301  # of one period
CHECKED = 5  # periods at which the full order with k(T) corrects its quadratic reduction
CHECKED_SAMPLES = 21  # of such a period: the swing is that of the two edges


def swings(reference: ThermalModel, periods: Array, power: float, duty: float) -> Array:
    """Swing in K of the periodic state at each period, from the full order where k depends on temperature.

    The full order is solved at `CHECKED` periods. Between them its ratio to the quadratic reduction is interpolated in
    the logarithm of the period.

    Raises InputError: as `surrogate.period_error`; a power without a steady state.
    """
    checks.positive("periods[0]", periods[0], unit="s")
    checks.positive("periods[-1]", periods[-1], unit="s", at_most=0.1, hint="periods are in s (did you mean 1e-6?)")
    power = checks.power("power", power)
    duty = checks.between("duty", duty, 1e-6, 1 - 1e-6, hint="the duty cycle is the fraction of the period that is on")
    system = bare(reference)
    if not isinstance(system, NonlinearSystem):
        look = swing_over_period(reference, periods, power, duty)
        return np.array([look(t) for t in periods])
    reduction = reduce_quadratic(system, power)
    look = swing_over_period(reduction.model, periods, power, duty)
    return np.array([look(t) for t in periods]) * _correction(reduction, system, periods, power, duty)


def _correction(
    reduction: QuadraticReduction, system: NonlinearSystem, periods: Array, power: float, duty: float
) -> Array:
    """Swing of the full order over that of its quadratic reduction at each period."""
    few = np.geomspace(periods[0], periods[-1], CHECKED) if periods.size > CHECKED else periods
    ratio = []
    for period in few:
        wave = SquareWave(power, float(period), duty)
        states = reduction.model.periodic_states(wave, CHECKED_SAMPLES)
        start = reduction.basis @ states[0, :-1]
        # 1e-3 of the full order: 1e-5 of its swing at 1 us (measured), as each step may err by a tenth of it
        full = integrate_periodic(system, wave, CHECKED_SAMPLES, rtol=1e-3, initial=start).outputs[:, 0]
        ratio.append(np.ptp(full) / np.ptp(states @ reduction.model.C))
    if periods.size <= CHECKED:
        return np.array(ratio)
    return np.asarray(PchipInterpolator(np.log(few), ratio)(np.clip(np.log(periods), *np.log(few[[0, -1]]))))


def swing_over_period(model: ThermalModel, periods: Array, power: float, duty: float) -> Callable[[float], float]:
    """Swing in K as a function of the period in s; for a quadratic model interpolated in a table around ``periods``."""
    if isinstance(bare(model), Quadratic) and periods.size > CHECKED:
        return _table(model, periods, power, duty)
    return lambda period: _swing(model, period, power, duty)


def _table(model: ThermalModel, periods: Array, power: float, duty: float) -> Callable[[float], float]:
    """A cubic spline of log swing over log period, from half the shortest to twice the longest; beyond, no table."""
    low, high = np.log(periods[0] / 2), np.log(periods[-1] * 2)
    # 1.25: between the periods of a `_table`: interpolation leaves 1e-5 of the swing (measured)
    nodes = np.linspace(low, high, 1 + int(np.ceil((high - low) / np.log(1.25))))
    spline = CubicSpline(nodes, np.log([_swing(model, float(np.exp(t)), power, duty) for t in nodes]))

    def look(period: float) -> float:
        at = float(np.log(period))
        return float(np.exp(spline(at))) if low <= at <= high else _swing(model, period, power, duty)

    return look


def _swing(model: ThermalModel, period: float, power: float, duty: float) -> float:
    """Largest minus smallest rise of the periodic state; a passive network has them at the two edges.

    swing = P sum_i R_i (1 - e^-a)(1 - e^-b)/(1 - e^-(a+b)),   a = duty T/tau_i,  b = (1 - duty) T/tau_i
    """
    poles = bare(model)
    # 200: states of a model whose poles are computed for their swing; those of a FEM heat or arrive late
    if isinstance(poles, Foster | Network | Cauer) or (isinstance(poles, StateSpace) and poles.order <= 200):
        poles = poles.dynamics
    if isinstance(poles, Foster) and poles.passive:
        on, off = -duty * period / np.asarray(poles.tau), -(1 - duty) * period / np.asarray(poles.tau)
        return float(-power * np.asarray(poles.R) @ (np.expm1(on) * np.expm1(off) / np.expm1(on + off)))
    wave = SquareWave(power, period, duty)
    if isinstance(poles, Foster):
        return float(np.ptp(_overshooting(poles, wave)))
    if isinstance(poles, OutputMap) and not poles.dynamics.linear.passive:
        return float(np.ptp(poles.of(_overshooting(poles.dynamics.linear, wave))))
    if isinstance(poles, Quadratic) and not np.array_equal(poles.A, poles.A.T):  # no reduction of a FEM
        start, tau = poles.periodic_states(wave, SAMPLES)[0], -1 / np.linalg.eigvals(poles.A).real
        return float(np.ptp(poles.states(wave, _after_edges(wave, tau), initial=start) @ poles.C))
    return float(np.ptp(model.periodic_response(wave, SAMPLES)))


def _after_edges(wave: SquareWave, tau: Array) -> Array:
    """Times in s over one period, dense after both edges, where a model with time constants tau may overshoot."""
    # 0.02: relative step of the times after an edge: 1e-4 of an overshoot
    since = np.geomspace(1e-2 * tau.min(), 1e2 * tau.max(), int(np.ceil(np.log(1e4 * tau.max() / tau.min()) / 0.02)))
    on = wave.duty * wave.period
    times = np.concatenate([[0.0, on, wave.period], since[since < on], on + since[since < wave.period - on]])
    return np.unique(times)


def _overshooting(poles: Foster, wave: SquareWave) -> Array:
    """Periodic rise in K at `_after_edges`, of poles of which some cool.

    P sum_i R_i (1 - e^(-t/tau_i) (1 - e^-b)/(1 - e^-(a+b))) from the rising edge on, and
    P sum_i R_i e^(-t/tau_i) (1 - e^-a)/(1 - e^-(a+b)) from the falling edge on
    """
    R, tau = np.asarray(poles.R), np.asarray(poles.tau)
    times, on = _after_edges(wave, tau), wave.duty * wave.period
    up, down = -on / tau, -(wave.period - on) / tau
    heats = times <= on
    decay = np.exp(-np.where(heats, times, times - on)[:, None] / tau)
    share = np.where(
        heats[:, None], 1 - decay * np.expm1(down) / np.expm1(up + down), decay * np.expm1(up) / np.expm1(up + down)
    )
    return wave.power * share @ R


def period_of(look: Callable[[float], float], swing: float, near: float) -> float:
    """The period in s at which the function ``look`` equals a swing: a bracket around ``near``, then Brent's method."""

    def excess(log_period: float) -> float:
        return look(float(np.exp(log_period))) - swing

    low = high = float(np.log(near))
    # 1e4: a period this many times longer or shorter than the reference's counts as never reached
    step, farthest = np.log(1.5), np.log(1e4)
    if excess(low) > 0:
        while excess(low) > 0:
            low, high, step = low - step, low, 1.5 * step
            if low < np.log(near) - farthest:
                return 0.0
    else:
        while excess(high) < 0:
            low, high, step = high, high + step, 1.5 * step
            if high > np.log(near) + farthest:
                return float("inf")
    return float(np.exp(brentq(excess, low, high, xtol=1e-10))) if low < high else near
