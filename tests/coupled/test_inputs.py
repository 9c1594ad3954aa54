"""Light that changes with time: order of the methods, breakpoints, zeros of the power, and runs that go on."""

from __future__ import annotations

import numpy as np
import pytest
from rings import RING, SECOND_ORDER, printed_equations, state
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import coupled
import thermofem as th
from coupled import State
from coupled.inputs import Pieces
from coupled.kernel import units as eq
from coupled.kernel.integrator import Problem
from coupled.kernel.tableaus import Method, tableau
from coupled.runs.window import Laser, advance, lights_of

NS, MW, GHZ = 1e-9, 1e-3, 1e9
UNIT = np.array([np.sqrt(eq.FJ), np.sqrt(eq.FJ), eq.DENSITY, 1, 1])


def exact(y, times, power, detuning, method="DOP853", rtol=1e-12):
    """The printed equations by SciPy from ``y`` at times[0], in internal units; power in W and detuning in Hz of t."""

    def f(t, z):
        y = z * UNIT
        da, dN, dx = printed_equations(
            y[0] + 1j * y[1], max(y[2], 0.0), y[3:], power(t * NS), detuning(t * NS), SECOND_ORDER
        )
        return np.array([da.real, da.imag, dN, *dx]) / UNIT * NS

    run = solve_ivp(f, (times[0], times[-1]), y, method=method, t_eval=times, rtol=rtol, atol=1e-13)
    return run.y.T


@pytest.mark.parametrize("method", Method)
def test_observed_order_under_moving_light(method):
    """Without df/dt in the stages it would be one."""
    duration, start, errors = 0.05, state(2), []
    power = Pieces(np.array([0, 1.0]) * NS, np.array([[6e-3, 1e-3 / NS * 20, -4e-3 / NS**2 * 100, 8 / NS**3]]))
    detuning = Pieces(np.array([0, 1.0]) * NS, np.array([[-3e9, 400e9 / NS, 2e12 / NS**2, -5e12 / NS**3]]))
    want = exact(start, [0, duration], power, detuning)[-1]
    heat, _ = eq.internal_heat(SECOND_ORDER)
    rings, drive = (
        eq.internal_rings([RING], 1.0, 1.0),
        lights_of(RING, [Laser(power, detuning)], 0.0, duration * NS).drive,
    )
    for n in (64, 128):
        h = duration / n  # of every step: any error is allowed
        run = Problem(rings, heat, drive, method).integrate(start, rtol=1e6, first_step=h, longest=h)
        assert run.accepted == n
        errors.append(np.abs(run.y - want).max())
    # As under constant light: the next order contributes h/tau = 0.13 of the leading one, log2(1.13) = 0.18.
    assert np.log2(errors[0] / errors[1]) == pytest.approx(tableau(method).order, abs=0.25)
    assert errors[1] > 1e-12


def test_a_smooth_drive_agrees_with_another_integrator():
    times = np.linspace(0, 150, 31)
    power = CubicSpline(np.linspace(0, 150, 7) * NS, np.array([1, 5, 3, 8, 2, 6, 4]) * MW)
    sweep = CubicSpline([0, 50 * NS, 150 * NS], [-5 * GHZ, 12 * GHZ, 0])
    want = exact(np.zeros(5), times, power, sweep, method="LSODA", rtol=1e-11)
    for rtol in (1e-6, 1e-8):
        run = coupled.simulate(
            RING, SECOND_ORDER, power=power, detuning=sweep, duration=150 * NS, times=times * NS, rtol=rtol
        )
        # the tolerance itself, times a hundred steps whose errors the fast rates forget
        assert run.carriers.values == pytest.approx(want[:, 2] * eq.DENSITY, rel=100 * rtol, abs=100 * rtol * 1e23)
        assert run.delta_T.values == pytest.approx(want[:, 3:].sum(axis=1), rel=100 * rtol, abs=100 * rtol)
        assert run["input_power"].values == pytest.approx(power(times * NS), rel=1e-12, abs=0)


def test_a_short_pulse_on_a_bias_is_not_missed():
    """A pulse of 2 ns at 5 us, where steps are long: the integration lands on both edges."""
    bias = 1e-3
    drive = [bias, th.Pulse(power=4e-3, width=2 * NS, start=5e-6)]
    run = coupled.simulate(RING, SECOND_ORDER, power=drive, duration=6e-6)
    t = run.time.values
    for edge in (5e-6, 5.002e-6):
        assert np.abs(t - edge).min() < 1e-15
    assert set(run.input_power.values) == {bias, bias + 4e-3}


def test_a_run_goes_on_where_another_ended():
    whole = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=2e-6, rtol=1e-9)
    first = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=0.7e-6, rtol=1e-9)
    second = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=1.3e-6, rtol=1e-9, initial=first)
    for name in ("energy", "carriers", "delta_T"):
        # errors of 1e-9 a step, grown by e^(0.015/ns x 300 ns) = 100 in the unstable passage
        assert float(second[name][-1]) == pytest.approx(float(whole[name][-1]), rel=1e-6, abs=0)
    state = State.end_of(first)
    assert state.energy == pytest.approx(float(first.energy[-1]), rel=1e-14, abs=0)
    assert np.sum(state.thermal) == pytest.approx(float(first.delta_T[-1]), rel=1e-13)
    with pytest.raises(th.InputError, match=r"final_state.*shape \(5,\)"):
        coupled.simulate(RING, th.Foster(R=[7e3], tau=[1e-6]), power=1e-3, initial=first)


def test_power_may_come_and_go_through_zero():
    """A triangle from 0 to 0, whose drive sqrt(P) has an infinite slope at both ends, then darkness."""
    wave = th.Sampled([0, 50e-9, 100e-9, 200e-9], [0, 5e-3, 0, 0])
    times = np.linspace(1, 150, 30)
    want = exact(
        np.zeros(5), np.concatenate([[0], times]), lambda t: float(wave(t)), lambda t: 0.0, method="LSODA", rtol=1e-11
    )[1:]
    for rtol, bound in ((1e-6, 1e-4), (1e-8, 2e-6)):
        run = coupled.simulate(RING, SECOND_ORDER, power=wave, duration=200e-9, times=times * NS, rtol=rtol)
        size = np.abs(want).max(axis=0)
        assert np.abs(run.carriers.values / eq.DENSITY - want[:, 2]).max() < bound * size[2]
        assert np.abs(run.delta_T.values - want[:, 3:].sum(axis=1)).max() < bound * size[3:].sum()
        assert run.attrs["steps"] < 4000


def test_the_spline_of_absorbed_power_is_as_good_as_the_steps():
    run = advance(RING, SECOND_ORDER, State.cold(2), 0.0, 1e-6, power=6.31e-3, rtol=1e-6, slopes=True)
    t = np.linspace(1e-9, 1e-6, 4001)
    fine = advance(RING, SECOND_ORDER, State.cold(2), 0.0, 1e-6, power=6.31e-3, rtol=1e-10, times=t)
    spline = CubicHermiteSpline(run.time, run.absorbed, run.absorbed_slope)
    # heat: what the integral of the power is off by; and the power itself, through an edge of 1 ns after 800 ns
    heat = np.abs(np.cumsum(spline(t) - fine.absorbed)).max() * (t[1] - t[0])
    assert heat < 2e-6 * fine.absorbed.max() * 1e-6
    assert np.abs(spline(t) - fine.absorbed).max() < 1e-3 * fine.absorbed.max()


def test_events_are_found_between_the_steps():
    event = coupled.Event("delta_T", 5.0, stop=False)
    run = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=5e-6, event=event)
    t, dT = run.time.values, run.delta_T.values
    assert len(run.attrs["crossings"]) == np.sum((dT[:-1] < 5) & (dT[1:] >= 5)) > 3
    at = run.attrs["crossings"][1]
    again = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=5e-6, times=[at])
    assert float(again.delta_T[0]) == pytest.approx(5, abs=1e-8)  # bisection of a step to 1e-12
    stopped = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=5e-6, event=coupled.Event("delta_T", 5.0))
    assert stopped.time.values[-1] == stopped.attrs["crossings"][0] == run.attrs["crossings"][0]
    assert float(stopped.delta_T[-1]) == pytest.approx(5, abs=1e-8)
    assert State.end_of(stopped).carriers == pytest.approx(float(stopped.carriers[-1]), rel=1e-12)
    assert np.sum(State.end_of(stopped).thermal) == pytest.approx(5, abs=1e-8)
    assert t[-1] == pytest.approx(5e-6)
    # an index out of bounds came of times that all lie after the stop, and the crossing was lost
    late = {"event": coupled.Event("delta_T", 5.0), "times": [2e-6, 3e-6]}
    none = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=5e-6, **late)
    assert none.sizes["time"] == 0
    assert none.attrs["crossings"] == stopped.attrs["crossings"]


@pytest.mark.parametrize("further", [(), [coupled.Laser(power=th.Sampled([0, 4e-6], [0, 1e-6]), detuning=1e9)]])
@pytest.mark.slow
def test_a_ramp_of_one_piece_may_begin_in_the_dark(further):
    """The ring follows a slow ramp through its fixed points; the largest power is that at the end of the piece."""
    model = th.Foster(R=[1e-3], tau=[1e-8])  # no heat to wait for
    run = coupled.simulate(
        RING, model, power=th.Sampled([0, 4e-6], [0, 1e-5]), detuning=5e9, duration=4e-6, lasers=further
    )
    states = coupled.steady_states(RING, model, power=1e-5, detuning=5e9)
    if not further:  # a change of 1e-5 W in 4 us against 100 ps of the photons and 40 ns of the carriers: 1 %
        assert float(run.energy[-1]) == pytest.approx(float(states.energy[0]), rel=1e-2, abs=0)
    assert run.energy.values[-1] > 1e3 * run.energy.values[1]
