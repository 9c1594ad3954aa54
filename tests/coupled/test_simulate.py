"""Runs as a user makes them: published regression values, balances, outputs, and slips of unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import coupled
import surrogate
from coupled import parameters as paper


def second_order(s):
    return surrogate.second_order(kappa=s.kappa, tau_f=s.tau_f, tau_s=s.tau_s, eta=s.eta, heat_capacity=s.heat_capacity)


def newton(s):
    return surrogate.newton(tau_th=s.tau_th, heat_capacity=s.heat_capacity)


RING = coupled.borghi2021()
EXPERIMENT, FEM = second_order(paper.SECOND_ORDER_EXPERIMENT), second_order(paper.SECOND_ORDER_FEM)


def dbm(value):
    return 1e-3 * 10 ** (value / 10)


@pytest.fixture(scope="module")
def run():
    """The paper's main point, (8 dBm, 0 GHz)."""
    return coupled.simulate(RING, EXPERIMENT, power=dbm(8), duration=20e-6)


def test_weak_light_on_resonance_divides_as_a_linear_ring_does():
    run = coupled.simulate(RING, EXPERIMENT, power=dbm(-40), duration=20e-6).isel(time=-1)
    loss, power = 91.5, dbm(-40)
    # Closed form of the linear ring. What is left of two-photon absorption, eta_TPA U, is 6.2e-8 of the loss: twice
    # that of the drop power, 91.5/5.5 times that of the absorbed one and twice as much again of through, which is a
    # small difference. The shift by 8e-5 K (5.2e-3 rad/ns) enters through as (5.2e-3/5.5)^2 = 9e-7.
    assert float(run["drop"]) / power == pytest.approx((86 / loss) ** 2, rel=2e-7)
    assert float(run.absorbed) / power == pytest.approx(4 * 43 * 5.5 / loss**2, rel=1.3e-6)
    assert float(run.through) / power == pytest.approx((5.5 / loss) ** 2, rel=3.5e-6)
    assert float(run["drop"] + run.through + run.absorbed) / power == pytest.approx(1, abs=1e-9)  # at rest: exact


# Rodas5P at rtol = 1e-9, cold start, last cycle of 20 us; by an implementation independent of this one.
REGRESSION = [
    (RING, EXPERIMENT, 7, -10, 499.334, 0.4117, 4.6393, 9.8403),
    (RING, EXPERIMENT, 8, 0, 535.939, 0.2819, 5.9956, 10.5484),
    (RING, EXPERIMENT, 10, 20, 725.112, 0.1271, 8.6442, 12.3597),
    (RING, FEM, 8, 0, 686.002, 0.2396, 5.8995, 10.5034),
    (RING.with_lumped_fcd(), newton(paper.NEWTON_MAPS), 7, -10, 588.395, 0.1562, 13.5693, 18.7454),
    (RING, newton(paper.NEWTON_FIT), 8, 0, 762.696, 0.3549, 6.6477, 10.7682),
]


@pytest.mark.parametrize("rtol", [1e-6, 1e-8])
@pytest.mark.parametrize(("ring", "model", "power", "detuning", "period", "duty", "swing", "highest"), REGRESSION)
def test_regression(ring, model, power, detuning, period, duty, swing, highest, rtol, validated):
    run = coupled.simulate(ring, model, power=dbm(power), detuning=detuning * 1e9, duration=20e-6, rtol=rtol)
    found = coupled.pulsing(run)
    assert found.regime == "self-pulsing"
    # Printed digits: period 1e-6, duty 2e-4, swing 1e-5. Integration at rtol = 1e-6: period below 1e-6. Reading extrema
    # and edges off the accepted steps: duty 1e-4, swing and maximum 1e-4.
    poles = "1 pole" if model.order == 1 else f"{model.order} poles"
    case = f"{poles} of {model.thermal_resistance:.0f} K/W, {power} dBm, {detuning} GHz"
    for name, ours, value, kept, unit in (
        ("period", found.period * 1e9, period, {"rel": 3e-6}, "ns"),
        ("duty cycle", found.duty, duty, {"within": 3e-4}, ""),
        ("swing", found.swing, swing, {"rel": 3e-4}, "K"),
    ):
        what = f"{name}, {case}, rtol {rtol:g}"
        validated("Coupled dynamics", what, ours, value, **kept, unit=unit, source="independent implementation")
    last = run.delta_T.values[run.time.values > run.time.values[-1] - 1.5 * found.period]
    assert last.max() == pytest.approx(highest, rel=3e-4)


def test_newton_with_the_two_term_dispersion_does_not_pulse():
    for power, detuning in ((7, -10e9), (8, 0), (10, 20e9)):
        run = coupled.simulate(RING, newton(paper.NEWTON_MAPS), power=dbm(power), detuning=detuning)
        assert coupled.pulsing(run).regime == "stable"


def test_a_long_run_keeps_its_period(run):
    """Fifty times longer, 1800 cycles: a limit cycle, so neither drift nor memory of the start."""
    long = coupled.simulate(RING, EXPERIMENT, power=dbm(8), duration=1e-3)
    # After 36 cycles the cold start is forgotten. Cycles differ by how their steps fall: 1e-6 of an edge of 10 ns.
    assert coupled.pulsing(long).period == pytest.approx(coupled.pulsing(run).period, rel=2e-8, abs=0)
    assert coupled.pulsing(long).cycles > 1800


def test_ports_and_heat_carry_off_the_light_of_a_cycle(run):
    """Over one period the stored energy returns, so the means of drop, through and absorbed power sum to the input."""
    period, n = coupled.pulsing(run).period, 20_000
    times = 15e-6 + period * np.arange(n) / n  # 27 ps apart; the sharpest spike is 3 ns wide
    cycle = coupled.simulate(RING, EXPERIMENT, power=dbm(8), times=times, rtol=1e-8)
    mean = (cycle["drop"] + cycle.through + cycle.absorbed).values.mean()
    # Equal sums over a period of a smooth function are exact; the seam is off by 1e-8 of a period.
    assert mean == pytest.approx(dbm(8), rel=1e-8, abs=0)
    assert cycle.absorbed.values.min() > 0


def test_wanted_times_lie_on_the_trace_of_the_steps(run):
    times = run.time.values[::7]
    wanted = coupled.simulate(RING, EXPERIMENT, power=dbm(8), times=times)
    assert wanted.sizes == {"time": times.size}
    for name in run.data_vars:  # the same steps, so exactly their ends: x = 0 or 1 of the dense output, to round-off
        assert wanted[name].values == pytest.approx(run[name].values[::7], rel=1e-11, abs=0)


def test_variables_say_what_they_are(run):
    units = {"energy": "J", "carriers": "1/m^3", "delta_T": "K", "drop": "W", "through": "W", "absorbed": "W"}
    assert {name: v.attrs["units"] for name, v in run.data_vars.items()} == units
    assert run.time.attrs["units"] == "s"
    assert all(v.attrs["long_name"] for v in run.variables.values())
    assert run.attrs["input_power"] == dbm(8)
    assert run.attrs["ring"] == RING.name
    assert run.attrs["steps"] == run.sizes["time"] - 1
    assert run.time.values[[0, -1]] == pytest.approx([0, 20e-6], rel=1e-15, abs=0)


def test_darkness_stays_dark():
    run = coupled.simulate(RING, EXPERIMENT, power=0.0, duration=1e-6)
    assert all(np.all(run[name].values == 0) for name in run.data_vars)


def test_no_two_photon_absorption_leaves_no_carriers():
    run = coupled.simulate(replace(RING, tpa_coefficient=0.0), EXPERIMENT, power=dbm(8), duration=5e-6)
    assert np.all(run.carriers.values == 0)
    assert float(run.delta_T[-1]) == pytest.approx(EXPERIMENT.thermal_resistance * float(run.absorbed[-1]), rel=0.02)
