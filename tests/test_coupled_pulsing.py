"""Regime, period, duty and swing on traces whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import coupled
import surrogate
import thermofem as th
from coupled.pulsing import amplitude_limit, crossings

PERIOD = 0.7e-6
DURATION = 20e-6
TIMES = np.linspace(0, DURATION, 4001)  # 5 ns apart, 140 a period


def trace(carriers, drop=None, delta_T=None):
    """A run with these carriers (in 1e23/m^3) on TIMES."""
    drop = 1 + carriers if drop is None else drop
    delta_T = 8 + carriers if delta_T is None else delta_T
    return xr.Dataset(
        {"carriers": ("time", 1e23 * carriers), "drop": ("time", 1e-3 * drop), "delta_T": ("time", delta_T)},
        coords={"time": TIMES},
    )


def wave(amplitude=1.0, mean=2.0, phase=0.3):
    return mean + amplitude * np.sin(2 * np.pi * TIMES / PERIOD + phase)


def test_period_duty_and_swing_of_a_sine():
    found = coupled.pulsing(trace(wave()))
    assert found.regime == "self-pulsing"
    assert found.regime is coupled.Regime.SELF_PULSING
    assert found.cycles == 27  # from 0.95 periods to 28.57
    # The level lies within (2 pi/140)^2/8 = 2.5e-4 of the middle, which moves every crossing alike; the cubic through
    # four samples 1/140 of a period apart errs by (2 pi/140)^4 x 0.02/(2 pi) of a period = 1e-8.
    assert found.period == pytest.approx(PERIOD, rel=5e-8, abs=0)
    # A sine is above 0.45 of its range, sin = -0.1, for 1/2 + asin(0.1)/pi; range off by 2.5e-4, slope 2 pi: 4e-5.
    assert found.duty == pytest.approx(0.5 + np.arcsin(0.1) / np.pi, abs=1e-4)
    assert found.swing == pytest.approx(2, rel=5.1e-4)  # both extrema between samples: 2 x 2.5e-4 at most


def test_two_maxima_of_the_drop_power_are_one_cycle():
    x = 2 * np.pi * TIMES / PERIOD
    drop = 1 + np.clip(np.sin(x), 0, None) + 0.8 * np.clip(-np.sin(x), 0, None)  # up twice in a period
    found = coupled.pulsing(trace(wave(phase=0.0), drop=drop))
    assert found.period == pytest.approx(PERIOD, rel=5e-8, abs=0)
    want = 1 - (np.arcsin(0.45) + np.arcsin(0.45 / 0.8)) * 2 / (2 * np.pi)
    assert found.duty == pytest.approx(want, abs=5e-4)  # kinks between samples and the range: (2 pi/140)^2/8 x slope


@pytest.mark.parametrize(
    ("amplitude", "regime", "reason"),
    [
        (np.full(TIMES.size, 0.01), "self-pulsing", "steady"),
        (np.exp(-TIMES / 4e-6), "stable", "dies away"),
        (np.exp(-TIMES / 30e-6), "stable", "dies away"),
        (np.exp(-TIMES / 0.5e-6), "stable", "constant"),
        (0.3 + 0.7 * np.exp(-TIMES / 3e-6), "self-pulsing", "steady|falling"),
        (0.6 + 0.4 * np.exp(-TIMES / 8e-6), "self-pulsing", "falling"),
        (0.01 * np.exp(TIMES / 5e-6), "self-pulsing", "growing"),
    ],
)
def test_an_oscillation_pulses_unless_it_heads_for_zero(amplitude, regime, reason):
    found = coupled.pulsing(trace(wave(amplitude)))
    assert found.regime == regime
    assert any(word in found.reason for word in reason.split("|"))
    assert np.isnan(found.period) == (regime != "self-pulsing")
    assert np.isnan(found.duty) == (regime != "self-pulsing")


def test_a_small_oscillation_under_a_drift_is_seen():
    drift = 2 - 0.3 * np.exp(-TIMES / 4e-6)
    found = coupled.pulsing(trace(wave(0.02, mean=drift)))
    assert found.regime == "self-pulsing"
    # The drift lifts the carriers by 0.3 e^-5 (period/4 us) = 4e-4 from cycle to cycle, 0.02 of a radian: 3e-3.
    assert found.period == pytest.approx(PERIOD, rel=5e-3, abs=0)


@pytest.mark.parametrize(
    ("carriers", "regime", "reason"),
    [
        (2 - np.exp(-TIMES / 1e-6), "stable", "constant"),
        (2 - np.exp(-TIMES / 4e-6), "stable", "last quarter"),  # e^-3.75 - e^-5 = 1.7 % of 1 and 0.7 % to go, of 2
        (2 - np.exp(-TIMES / 30e-6), "slow transient", "no complete cycle"),
        (1 + TIMES / DURATION, "slow transient", "simulate longer"),
        (2 + np.sin(2 * np.pi * TIMES / 15e-6), "slow transient", "cycle"),
        (2 + np.sin(2 * np.pi * TIMES / PERIOD) * (TIMES < 12e-6) + TIMES / 60e-6, "slow transient", "no more"),
    ],
    ids=["settled", "settling", "slow", "ramp", "period of 15 us", "pulses that ended in a ramp"],
)
def test_what_does_not_pulse_is_at_rest_or_under_way(carriers, regime, reason):
    found = coupled.pulsing(trace(carriers))
    assert found.regime == regime
    assert reason in found.reason
    assert np.isnan(found.period)


def test_pulses_that_ended_are_stable():
    found = coupled.pulsing(trace(2 + np.sin(2 * np.pi * TIMES / PERIOD) * (TIMES < 12 * PERIOD)))
    assert found.regime == "stable"


def test_an_oscillation_that_a_drift_hides_in_the_last_half_is_seen_in_the_last_quarter():
    found = coupled.pulsing(trace(wave(0.003, mean=2 - 3 * np.exp(-TIMES / 2e-6))))
    assert found.regime == "self-pulsing"
    assert found.period == pytest.approx(PERIOD, rel=5e-3, abs=0)  # as above


def test_the_ghost_of_a_saddle_node_is_a_slow_transient():
    # At 5.5 dBm and -20 GHz the ring rests beside a vanished pair of fixed points and pulses only after 70 us.
    ring, model = coupled.borghi2021(), surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
    power = 1e-3 * 10**0.55
    early, late = (
        coupled.pulsing(coupled.simulate(ring, model, power=power, detuning=-20e9, duration=duration, rtol=1e-5))
        for duration in (20e-6, 100e-6)
    )
    assert early.regime == "slow transient"
    assert late.regime == "self-pulsing"


def test_crossings_are_exact_for_cubics():
    t = np.array([0.0, 0.4, 0.9, 1.7, 2.0, 2.6])
    x = (t - 0.6) ** 3 + 0.1 * (t - 0.6)
    assert crossings(t, x, 0.0) == pytest.approx([0.6], abs=1e-9)  # bisection of a step of 0.5 by 2^-32
    assert crossings(t, x, -1.0).size == 0
    assert crossings(t, t, 0.2) == pytest.approx([0.2], abs=1e-9)  # first step: the four samples to its right
    assert crossings(t, t, 2.5) == pytest.approx([2.5], abs=1e-9)


def test_amplitude_limit_is_exact_for_geometric_sequences():
    k = np.arange(18)
    assert amplitude_limit(0.4 + 0.5 * 0.8**k) == pytest.approx(0.4, rel=1e-9)
    assert amplitude_limit(0.9**k) == pytest.approx(0, abs=1e-12)
    assert amplitude_limit(np.linspace(1, 0.1, 18)) == 0  # straight to zero
    assert amplitude_limit(np.linspace(1, 3, 18)) == 3
    assert amplitude_limit(np.array([1.0, 0.99])) == 0.99
    assert amplitude_limit(np.array([1.0, 0.5])) == 0


def test_what_is_no_run_is_named():
    with pytest.raises(th.InputError, match="'carriers'"):
        coupled.pulsing(trace(wave()).drop_vars("carriers"))
    with pytest.raises(th.InputError, match="'time'"):
        coupled.pulsing({"carriers": 1})
    with pytest.raises(th.InputError, match="at least 8"):
        coupled.pulsing(trace(wave()).isel(time=slice(5)))
    spoiled = wave()
    spoiled[7] = np.nan
    with pytest.raises(th.InputError, match=r"run.carriers\[7\]"):
        coupled.pulsing(trace(spoiled))
