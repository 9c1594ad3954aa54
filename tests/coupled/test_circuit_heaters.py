"""Heaters of circuits: functions of time, several rings, continuation, cycles."""

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp

import coupled
import thermofem as th

RATE = np.array([1 / 60e-9, 1 / 1.2e-6, 1 / 8e-6])
OWN, OTHER = np.array([[0.8, 0.6, 0.4], [0.02, 0.3, 0.5]]) * np.sqrt(5000 * RATE)
SPIKE = th.Function(lambda t: 20e-3 * np.exp(-(((t - 12e-6) / 50e-9) ** 2)))


def heated(rate=RATE, own=OWN, other=OTHER) -> th.StateSpace:
    """One ring and one heater."""
    B = np.column_stack([own, other])
    return th.StateSpace(
        np.eye(rate.size), -np.diag(rate), B, own[None], inputs=("ring 1", "heater"), outputs=("ring 1",)
    )


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("frequency", [2e5, 5e5, 2e6])
def test_a_heater_that_follows_a_sine_has_its_closed_form(frequency, rtol):
    """x' = -r x + P (1 + sin w t): the rise was off by 0.03 K, 0.39 K and 0.81 K of 5 K."""
    P, w, times = 2e-3, 2 * np.pi * frequency, np.linspace(0, 20e-6, 2001)
    wave = th.Function(lambda t: P * (1 + np.sin(w * t)))
    run = coupled.simulate(
        coupled.bus(RING), heated(), power={}, heaters={"heater": wave}, duration=20e-6, times=times, rtol=rtol
    )
    r, t = RATE[:, None], times
    turning = (r * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-r * t)) / (r * r + w * w)
    exact = (OWN * OTHER * P) @ ((1 - np.exp(-r * t)) / r + turning)
    # 0.01 rtol of the cubics, and 1e-8 of the largest power of its cubics, times R_th = 2.1 kK/W: 8e-8 K
    assert run.delta_T.values[0] == pytest.approx(exact, rel=0, abs=1e-2 * rtol * exact.max() + 1e-7)


def test_a_spike_between_two_edges_heats():
    """Of 2.34 K, 1.00 K was seen: samples stood 8 % of the time since the last edge apart."""
    run = coupled.simulate(
        coupled.bus(RING), heated(), power={}, heaters={"heater": SPIKE}, duration=20e-6, rtol=1e-8,
        times=np.linspace(11.9e-6, 20e-6, 200),
    )  # fmt: skip
    exact = solve_ivp(
        lambda t, x: OTHER * float(SPIKE(t)) - RATE * x, (0, 20e-6), np.zeros(3), t_eval=run.time.values, rtol=1e-10,
        atol=1e-16, max_step=10e-9,
    )  # fmt: skip
    # SciPy's 1e-10 a step of 2000 steps
    assert run.delta_T.values[0] == pytest.approx(OWN @ exact.y, rel=0, abs=2e-7 * 2.34)


def test_a_heater_takes_what_the_heater_of_a_ring_takes():
    """Lists, which add; powers that no heater has are refused."""
    circuit, run = coupled.bus(RING), {"power": {}, "duration": 2e-6, "times": np.linspace(0, 2e-6, 9), "rtol": 1e-8}
    bias, pulse = th.Constant(1e-3), th.Pulse(2e-3, width=0.3e-6, start=0.5e-6)
    each = [coupled.simulate(circuit, heated(), heaters={"heater": w}, **run) for w in (bias, pulse)]
    both = coupled.simulate(circuit, heated(), heaters={"heater": [1e-3, pulse]}, **run)
    expected = sum(one.delta_T.values for one in each)
    np.testing.assert_allclose(both.delta_T, expected, rtol=0, atol=3e-10 * expected.max())  # 0.01 rtol of three runs
    assert np.array_equal(both.heater_power, sum(one.heater_power.values for one in each))
    for wave in (th.Function(lambda t: 1e-3 * np.sin(1e7 * t)), th.Function(lambda t: 20.0 + 0 * t), 20.0, -1e-3):
        with pytest.raises(th.InputError, match=r"heaters\['heater'\] = .* must lie between 0 and 10"):
            coupled.simulate(circuit, heated(), heaters={"heater": wave}, **run)


def test_a_run_goes_on_under_a_function():
    """A sine in two halves, the second from the heat of the first, against a whole one."""
    circuit, run = coupled.bus(RING), {"power": {"in": 1e-3}, "detuning": -20e9, "rtol": 1e-9}
    period, times = 1e-6, np.linspace(0, 2e-6, 21)
    wave = th.Function(lambda t: 2e-3 * (1 + np.sin(2 * np.pi * t / period)))
    whole = coupled.simulate(circuit, heated(), heaters={"heater": wave}, duration=2e-6, times=times, **run)
    half = coupled.simulate(circuit, heated(), heaters={"heater": wave}, duration=1e-6, **run)
    rest = coupled.simulate(
        circuit, heated(), heaters={"heater": wave}, duration=1e-6, times=times[10:] - 1e-6, initial=half, **run
    )
    # 1e-9 a step of some hundred steps
    np.testing.assert_allclose(rest.delta_T, whole.delta_T[:, 10:], rtol=0, atol=3e-7 * float(whole.delta_T.max()))


def test_the_cycle_beside_a_heater_is_that_of_limit_cycle():
    """A model with a heater was refused: "initial has 0 states of heaters"."""
    rate = np.append(1 / np.asarray(SECOND_ORDER.tau), 1 / 5e-6)
    own, other = np.sqrt(np.append(SECOND_ORDER.R, 100.0) * rate), np.array([0.2, 0.3, 0.5]) * np.sqrt(1000 * rate)
    model = heated(rate, own, other)
    for heaters in ({"heater": 1e-3}, None):
        cycle = coupled.limit_cycle(coupled.bus(RING), model, power={"in": 6.31e-3}, heaters=heaters)
        one = coupled.limit_cycle(RING, model, power=6.31e-3, heaters=heaters, heated="ring 1", read="ring 1")
        assert cycle.attrs["period"] == pytest.approx(one.attrs["period"], rel=1e-5)  # limit_cycle's own error
