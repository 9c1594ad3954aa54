"""The full-order integrator: order, error control, edges, energy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from models import coarse_fem
from scipy.sparse import csr_matrix

import thermofem as th
import thermofem.transient.integration
from thermofem.models import foster
from thermofem.transient.esdirk import EMBEDDED, GAMMA, STAGE_TIMES, STAGES, WEIGHTS, Stepper
from thermofem.transient.integration import _march, _Record, integrate, integrate_periodic
from thermofem.transient.nonlinear import Ledger, NodalOperator


def cosine(omega: float) -> th.Function:
    """A smooth drive that no piecewise-linear shortcut fits, in W."""
    return th.Function(lambda t: 1 + np.cos(omega * t))


RATES = np.array([1.0, 3.0, 10.0])
GAINS = np.array([0.5, 2.0, 1.0])


def three_poles() -> th.StateSpace:
    """dx_i/dt = -rate_i x_i + gain_i P, dT = sum x_i, in s."""
    return th.StateSpace(E=np.eye(3), A=-np.diag(RATES), B=GAINS[:, None], C=np.ones((1, 3)))


def exact_under_cosine(t, omega):
    """From rest: sum g [ (1 - e^-rt)/r + (r cos wt + w sin wt - r e^-rt)/(r^2 + w^2) ]."""
    t = np.asarray(t)[..., None]
    steady = (RATES * np.cos(omega * t) + omega * np.sin(omega * t) - RATES * np.exp(-RATES * t)) / (
        RATES**2 + omega**2
    )
    return ((1 - np.exp(-RATES * t)) / RATES + steady) @ GAINS


def test_tableau_satisfies_the_order_conditions():
    """Row sums; b has the moments 1, 1/2, 1/3, 1/4 (order 4), the embedded b to 1/3 (order 3, 12 digits given)."""
    A = STAGES + GAMMA * np.diag([0, 1, 1, 1, 1, 1])
    assert np.allclose(A.sum(axis=1), STAGE_TIMES, atol=1e-15)
    for power in range(4):
        assert WEIGHTS @ STAGE_TIMES**power == pytest.approx(1 / (power + 1), abs=1e-14)
    assert pytest.approx(1 / 6, abs=1e-14) == WEIGHTS @ A @ STAGE_TIMES
    assert pytest.approx(1 / 24, abs=1e-14) == WEIGHTS @ A @ A @ STAGE_TIMES
    for power in range(3):
        assert EMBEDDED @ STAGE_TIMES**power == pytest.approx(1 / (power + 1), abs=1e-12)
    assert pytest.approx(1 / 6, abs=1e-12) == EMBEDDED @ A @ STAGE_TIMES


def fixed_steps(wave, edges, rung):
    """March with steps (piece length)/4^rung; the state at the end."""
    stepper = Stepper(three_poles(), wave)
    plan = [(a, b, [rung] * 4**rung) for a, b in itertools.pairwise(edges)]
    nothing = np.empty(0)
    return float(_march(plan, np.zeros(3), _Record(stepper, nothing, nothing, None, np.zeros(3))).sum())


def observed_orders(errors):
    return np.log(np.abs(errors[:-1] / errors[1:])) / np.log(4)


def test_order_four_with_a_time_varying_source():
    omega, stop = 3.0, 2.0
    errors = np.array([fixed_steps(cosine(omega), [0, stop], k) - exact_under_cosine(stop, omega) for k in (1, 2, 3)])
    assert np.all(observed_orders(errors) > 3.7)  # 4 asymptotically; a source sampled to first order would show as 1


def test_order_four_across_a_pulse_edge():
    pulse = th.Pulse(power=1.0, width=0.7)
    exact = foster(three_poles()).response(pulse, [1.5])[0]
    errors = np.array([fixed_steps(pulse, [0, 0.7, 1.5], k) - exact for k in (0, 1, 2)])
    assert np.all(observed_orders(errors) > 3.7)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize(
    "wave",
    [th.Constant(1e-3), th.Pulse(2e-3, 3e-6, start=0.2e-6), th.SquareWave(2e-3, 0.8e-6, 1 / 3)],
    ids=lambda w: type(w).__name__,
)
def test_error_stays_below_rtol_at_and_after_edges(wave, rtol):
    """Against the closed form of the same matrices; 'largest value so far' makes it pointwise on the first rise."""
    system = coarse_fem()
    times = np.concatenate([np.geomspace(1e-9, 0.2e-6, 20), np.linspace(0.21e-6, 6e-6, 200)])
    exact = foster(system).response(wave, times)
    got = integrate(system, wave, times, rtol=rtol).outputs[:, 0]
    assert np.all(np.abs(got - exact) <= rtol * np.maximum.accumulate(exact))


@pytest.mark.parametrize("rtol", [1e-1, 1e-2, 1e-4])
def test_a_first_time_long_after_every_transient_is_the_static_rise(rtol):
    """One L-stable step across the whole rise would end right and interpolate nonsense inside."""
    system = coarse_fem()
    for times in ([1.0, 10.0], [1e-3, 1e-2], np.linspace(0, 20, 11)[1:]):
        rise = integrate(system, th.Constant(2e-3), times, rtol=rtol).outputs[:, 0]
        assert rise == pytest.approx(2e-3 * system.thermal_resistance, rel=rtol)


def test_a_period_far_longer_than_every_transient_holds_the_static_rise():
    system = coarse_fem()
    slow = integrate_periodic(system, th.SquareWave(2e-3, 10.0, 0.3), 21, rtol=1e-4).outputs[:, 0]
    assert slow.min() > -1e-4 * slow.max()
    assert slow.max() == pytest.approx(2e-3 * system.thermal_resistance, rel=1e-3)


def test_few_steps_are_rejected_behind_an_edge():
    """The first wanted time asks for steps far too long at rtol = 1e-7; the error says by how much to cut them."""
    run = integrate(coarse_fem(), th.Constant(1e-3), [1e-7, 1e-6], rtol=1e-7)
    assert run.steps > 100
    assert 1 <= run.rejected <= 3  # 7 where each rejection shortens the step to a quarter


def test_energy_balance_notices_a_source_that_is_not_the_waveform():
    system = coarse_fem()
    ones = np.ones(system.order)
    stored, drain, none = (
        NodalOperator(csr_matrix(row), (), 0.0) for row in (ones @ system.E, -ones @ system.A, 0 * ones)
    )
    ledger = Ledger(stored, none, drain)
    louder = th.StateSpace(system.E, system.A, 1.001 * system.B, system.C)
    run = integrate(louder, th.Constant(1e-3), [1e-6], ledger=ledger)
    assert run.imbalance == pytest.approx(-0.001, rel=0.01)


def test_several_inputs_superpose():
    system = coarse_fem()
    weak, strong = th.Constant(1e-3), th.Pulse(2e-3, 1e-6)
    pair = th.StateSpace(system.E, system.A, np.hstack([system.B, system.B]), system.C, inputs=("one", "two"))
    times = np.linspace(0.1e-6, 3e-6, 30)
    both = integrate(pair, (weak, strong), times, rtol=1e-6).outputs
    apart = sum(integrate(system, w, times, rtol=1e-6).outputs for w in (weak, strong))
    assert np.allclose(both, apart, rtol=0, atol=2e-6 * both.max())


def test_snapshot_is_the_state_itself():
    system = coarse_fem()
    run = integrate(system, th.Pulse(2e-3, 1e-6), [0.5e-6, 2e-6], snapshots=[0.5e-6, 2e-6])
    assert run.snapshots @ system.C[0] == pytest.approx(run.outputs[:, 0], rel=1e-12)


def test_periodic_state_closes_and_needs_few_passes():
    system = coarse_fem()
    wave = th.SquareWave(2e-3, 1e-6, 0.33)
    run = integrate_periodic(system, wave, 301, rtol=1e-6)
    exact = foster(system).periodic_response(wave, 301)
    assert np.abs(run.outputs[:, 0] - exact).max() < 1e-6 * exact.max()


def test_progress_is_the_time_reached_and_changes_nothing():
    heat, wave, seen = th.assemble(th.strip_ring(), 1e-2), th.SquareWave(2e-3, 1e-6, 0.33), []
    times = np.linspace(0, 2e-6, 11)
    run = th.solve(heat, wave, times, progress=seen.append, method="stepping")
    assert run.equals(th.solve(heat, wave, times, method="stepping"))
    assert np.all(np.diff(seen) > 0)
    assert seen[-1] == pytest.approx(2e-6, rel=1e-12, abs=0)  # round-off of adding steps
    seen.clear()
    th.solve_periodic(heat, wave, progress=seen.append, method="stepping")
    assert np.all(np.diff(seen) > 0)
    assert seen[-1] / 1e-6 == pytest.approx(round(seen[-1] / 1e-6), rel=1e-12)  # whole passes
    seen.clear()
    th.solve(heat, wave, times, progress=seen.append)
    assert seen == [2e-6]  # in closed form: at the end


@pytest.mark.slow
def test_a_far_probe_does_not_rule_the_steps():
    """The heater 2 um above has 1e-9 of its rise after 50 ns: relative to that, a run takes three times the work."""
    heat, pulse, times = th.assemble(th.heated_ring()), th.Pulse(2e-3, 10e-6), np.geomspace(1e-9, 20e-6, 60)
    read = ("core", "heater")
    alone = th.solve(heat, pulse, times, rtol=1e-4, method="stepping")
    found, exact = (th.solve(heat, pulse, times, read=read, rtol=rtol, method="stepping") for rtol in (1e-4, 1e-7))
    assert found.attrs["solves"] < 1.2 * alone.attrs["solves"]
    error = np.abs(found.delta_T - exact.delta_T).transpose("probe", "time").values
    core, heater = np.maximum.accumulate(exact.delta_T.transpose("probe", "time").values, axis=1)
    assert np.all(error[0] < 1e-4 * core)  # the heated part leads the field: its own rise is the measure at all times
    there = heater > 0.01 * heater.max()
    assert np.all(error[1, there] < 1e-4 * heater[there])
    assert np.all(error[1, ~there] < 1e-6 * heater.max())


@pytest.mark.parametrize(
    ("wave", "words"),
    [
        (th.waveforms.PiecewiseCubic([0, 1e-6], [[-1e-3, 0, 0, 0]], repeat=True), "falls to -0.001 W; absorbed power"),
        (th.Function(lambda t: 2e3 + 0 * t, period=1e-6), "did you mean 2e-3 for 2 mW"),
        (th.Function(lambda t: 1e-3 * np.sin(2e6 * np.pi * t), period=1e-6), "falls to -0.001 W"),
    ],
)
def test_smooth_powers_that_no_light_has_are_refused(wave, words):
    """-1 mW cooled the core by 7.8 K; the compact models alone refused it."""
    system, heat = three_poles(), th.assemble(th.strip_ring(), accuracy=0.05)
    for run in (
        lambda: system.response(wave, [2e-6]),
        lambda: system.periodic_response(wave, 101),
        lambda: th.solve(heat, wave, [2e-6]),
        lambda: th.solve_periodic(heat, wave, 101),
    ):
        with pytest.raises(th.InputError, match=words):
            run()


def test_a_smooth_power_that_touches_zero_is_taken():
    """Its coarse fit falls below zero by rtol of the peak, which is no negative power."""
    wave = th.Function(lambda t: 1e-3 * np.sin(1e6 * np.pi * t) ** 2, period=1e-6)
    assert three_poles().response(wave, [3e-6], rtol=1e-2)[0] > 0
