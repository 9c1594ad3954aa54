"""The field eliminated: what it costs in accuracy, and that it is the same ring otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp

import coupled
import thermofem as th
from coupled.kernels import equations as eq


@pytest.mark.parametrize(("power", "detuning", "period"), [(8, 0, 535.939), (7, -10e9, 499.334), (10, 20e9, 725.112)])
def test_periods_are_those_of_the_whole_ring_to_a_fiftieth_of_a_percent(power, detuning, period):
    run = coupled.simulate(
        RING, SECOND_ORDER, power=1e-3 * 10 ** (power / 10), detuning=detuning, rtol=1e-7, adiabatic=True
    )
    found = coupled.pulsing(run)
    assert found.period == pytest.approx(period * 1e-9, rel=2.5e-4, abs=0)  # the published .02 %
    assert found.period != pytest.approx(period * 1e-9, rel=1e-5, abs=0)  # and no secret field


def test_the_field_is_at_rest_in_its_carriers_and_heat():
    ring = replace(RING, kerr_coefficient=4.5e-18)
    times = np.linspace(1e-9, 2e-6, 60)
    run = coupled.simulate(ring, SECOND_ORDER, power=6.31e-3, duration=2e-6, times=times, adiabatic=True)
    rates, fcd = eq.internal_rates(ring)
    for k in range(times.size):
        U, N = float(run.energy[k]) / eq.FJ, float(run.carriers[k]) / eq.DENSITY
        D = -rates.thermal_shift * float(run.delta_T[k]) - eq.dispersion(N, fcd)[0] - rates.kerr * U
        gamma = rates.loss + rates.fca * N + rates.tpa * U
        assert U * (gamma**2 + D**2) == pytest.approx(eq.internal_pump(ring, 6.31e-3) ** 2, rel=1e-12)
        # and every port is fed: at rest P = through + drop + absorbed
    total = run["through"] + run["drop"] + run["absorbed"]
    assert total.values == pytest.approx(6.31e-3, rel=1e-12, abs=0)


def test_it_agrees_with_another_integrator_under_moving_light():
    wave = th.Sampled([0, 100e-9, 250e-9, 400e-9], [1e-3, 6e-3, 0.0, 5e-3])
    rates, fcd = eq.internal_rates(RING)
    poles, times = eq.internal_thermal(SECOND_ORDER).poles, np.linspace(10e-9, 400e-9, 40)

    def f(t, y):
        N, x = max(y[0], 0.0), y[1:]
        D = -rates.thermal_shift * x.sum() - eq.dispersion(N, fcd)[0]
        power = eq.internal_pump(RING, float(wave(t * 1e-9))) ** 2
        low, high = 0.0, power / rates.loss**2
        for _ in range(80):
            U = (low + high) / 2
            low, high = (
                (U, high) if U * ((rates.loss + rates.fca * N + rates.tpa * U) ** 2 + D**2) < power else (low, U)
            )
        recombination = N * (1 + rates.b * N) / (rates.tau0 * (1 + rates.a * N))
        heat = eq.absorbed_power(U, N, rates)
        return np.array([rates.g * U**2 - recombination, *(poles[0] * heat - poles[1] * x)])

    other = np.zeros((0, 3))
    y = np.zeros(3)
    for start, stop in ((0, 100), (100, 250), (250, 400)):
        inside = [t * 1e9 for t in times if start < t * 1e9 <= stop + 1e-9]
        piece = solve_ivp(f, (start, stop), y, method="DOP853", rtol=1e-10, atol=1e-13, t_eval=np.minimum(inside, stop))
        other, y = np.vstack([other, piece.y.T]), piece.y[:, -1]
    run = coupled.simulate(RING, SECOND_ORDER, power=wave, duration=400e-9, times=times, rtol=1e-9, adiabatic=True)
    # steps at 1e-9, a cubic between them: (h^4/384) N''''
    assert run.carriers.values / eq.DENSITY == pytest.approx(other[:, 0], rel=2e-6)
    assert run.delta_T.values == pytest.approx(other[:, 1:].sum(axis=1), rel=2e-6)


def test_what_does_not_go_together_is_refused():
    with pytest.raises(th.InputError, match="adiabatic goes with neither"):
        coupled.simulate(RING, SECOND_ORDER, power=1e-3, adiabatic=True, method="rodas4")
