"""Every kind of thermal model in runs: another integrator, the contract's models, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from models import MODELS
from rings import BENT, LINEAR, RING, SECOND_ORDER
from scipy.integrate import solve_ivp

import coupled
import thermofem as th
from coupled.kernel import integrator, units as eq
from coupled.kernel.tableaus import Method
from coupled.thermal import compact

MAPPED = th.OutputMap(SECOND_ORDER, -4e-3)
KINDS = {"output map": MAPPED, "quadratic": BENT}
REAL = replace(RING, drop_rate=20e9, scattering_rate=3e9, kerr_coefficient=4.5e-18)


@pytest.mark.parametrize("kind", ["output map", "quadratic"])
def test_a_run_agrees_with_another_integrator(kind):
    model, times = KINDS[kind], np.linspace(20, 400, 20)
    problem = eq.single_ring(REAL, model, 6.31e-3, -3e9, 400e-9, Method.RODAS5P)
    other = solve_ivp(
        lambda _, y: problem.slopes(y)[0], (0, 400), np.zeros(5), method="LSODA", t_eval=times, rtol=1e-11, atol=1e-13
    )
    run = coupled.simulate(REAL, model, power=6.31e-3, detuning=-3e9, duration=400e-9, times=times * eq.NS, rtol=1e-9)
    z = other.y[3:].sum(axis=0)
    want = z - 4e-3 * z**2 if kind == "output map" else model.C @ other.y[3:]
    assert run.delta_T.values == pytest.approx(want, rel=1e-6)  # 1e-9 a step over a thousand of them
    assert run.carriers.values == pytest.approx(other.y[2] * eq.DENSITY, rel=1e-6)


def test_a_quadratic_model_without_its_quadratic_part_is_the_network():
    a, b = (coupled.simulate(RING, m, power=6.31e-3, duration=2e-6) for m in (SECOND_ORDER, LINEAR))
    assert a.sizes == b.sizes
    # round-off, grown as in the splitting of poles
    assert b.carriers.values == pytest.approx(a.carriers.values, rel=1e-6)


FULL_ORDER = ("fem", "fem, diagonalised", "fem, k(T) and c_p(T)")
# another form of the equations of "foster, trained", "second order" or "fem, reduced": all of them go through every
# function in test_every_model.py
AGAIN = ("a fit", "an entry of a ladder", "Cauer ladder", "a reduction")
CONTRACT = [name for name in MODELS if name not in FULL_ORDER + AGAIN]


@pytest.mark.parametrize("name", CONTRACT)
def test_every_compact_model_of_the_contract_goes_all_the_way(name):
    model = MODELS[name]()
    end = coupled.simulate(RING, model, power=0.4e-3, duration=200e-6).isel(time=-1)  # twenty slowest time constants
    rest = coupled.steady_states(RING, model, power=0.4e-3)
    assert rest.regime.values == ["stable"]
    for quantity in ("energy", "carriers", "delta_T", "absorbed"):
        assert float(end[quantity]) == pytest.approx(float(rest[quantity][0]), rel=1e-6)  # rtol of the run
    powers, detunings = [2e-3, 6.31e-3], [-20e9, -10e9, 0.0, 10e9]
    by_rate = coupled.stability_map(RING, model, powers, detunings)
    by_time = coupled.pulsing_map(RING, model, powers, detunings, duration=10e-6)
    assert (by_time.regime != "failed").all()
    if name != "newton":  # whose pulses may stand beside a stable point
        assert not ((by_time.regime == "self-pulsing") & (by_rate.regime == "stable")).any()
    assert not ((by_time.regime == "stable") & (by_rate.regime == "self-pulsing")).any()
    for curve in coupled.hopf_curves(RING, model, powers, [-20e9, 10e9])[:1]:
        point = curve.isel(point=curve.sizes["point"] // 2)
        at = coupled.steady_states(RING, model, power=float(point.power), detuning=float(point.detuning))
        assert np.abs(at.growth_rate).min() < 1e-6 * 2 * np.pi * float(point.frequency)


@pytest.mark.parametrize("name", FULL_ORDER)
def test_the_fem_itself_is_sent_elsewhere(name):
    with pytest.raises(th.InputError, match=r"coupled\.cosimulate"):
        coupled.steady_states(RING, MODELS[name](), power=1e-3)


def test_models_that_cannot_be_integrated_say_why():
    with pytest.raises(th.InputError, match="passive"):
        compact(th.OutputMap(th.Foster(R=[9e3, -1e3], tau=[1e-7, 1e-6]), 1e-3))
    large = th.Quadratic(-np.eye(61), np.zeros((61, 61, 61)), np.zeros((61, 61)), np.ones(61), np.ones(61))
    with pytest.raises(th.InputError, match="from 1 to 60; reduce it"):
        compact(large)


FAST = -1e6 * np.eye(2)
HOT = {
    "Foster": th.Foster(R=[2e3, 1e30], tau=[5e-8, 1e-6]),
    "OutputMap": th.OutputMap(th.Foster(R=[2e3, 1e30], tau=[5e-8, 1e-6]), -4e-4),
    "StateSpace": th.StateSpace(np.eye(2), FAST, np.ones((2, 1)), 1e30 * np.ones((1, 2))),
    "Quadratic": th.Quadratic(FAST, np.zeros((2, 2, 2)), np.eye(2), np.ones(2), np.array([1, 1e30])),
    "Quadratic that cancels": th.Quadratic(FAST, np.zeros((2, 2, 2)), 0 * FAST, np.ones(2), np.array([-1e30, 1e30])),
}


@pytest.mark.parametrize("name", HOT)
def test_a_resistance_that_no_ring_has_is_refused(name):
    """R = 1e30 K/W: the detuning turned so fast that a run of .1 ns took millions of steps."""
    with pytest.raises(th.InputError, match=r"between -1e\+09 and 1e\+09.*resistances are in K/W"):
        coupled.simulate(RING, HOT[name], power=1e-4, duration=1e-10)


def test_light_and_heat_that_run_away_end_in_one_line():
    away = th.Quadratic(FAST, np.full((2, 2, 2), 1e30), 0 * FAST, 1e9 * np.ones(2), np.ones(2))
    with pytest.raises(th.InputError, match="no step small enough"):
        coupled.simulate(RING, away, power=1e-4, duration=1e-10)


@pytest.mark.parametrize("G", [1e26, 1e30])
def test_heat_that_grows_within_a_step_is_not_damped(G, monkeypatch):
    """An L-stable step ended on the unstable fixed point -B/G, a rise of -2e-21 K under light, without a word."""
    monkeypatch.setattr(integrator, "MAX_STEPS", 100_000)
    away = th.Quadratic(FAST, np.zeros((2, 2, 2)), np.full((2, 2), G), 1e9 * np.ones(2), np.ones(2))
    with pytest.raises(th.InputError, match=r"no step small enough|takes more than"):
        coupled.simulate(RING, away, power=1e-4, duration=1e-10)


@pytest.mark.parametrize("G", [1e26, 1e30])
def test_heat_that_grows_within_a_step_is_not_damped_beside_several_lasers(G, monkeypatch):
    monkeypatch.setattr(integrator, "MAX_STEPS", 100_000)
    away = th.Quadratic(FAST, np.zeros((2, 2, 2)), np.full((2, 2), G), 1e9 * np.ones(2), np.ones(2))
    with pytest.raises(th.InputError, match=r"no step small enough|takes more than"):
        coupled.simulate(RING, away, power=1e-4, duration=1e-10, lasers=coupled.Laser(1e-6, -2e9))


def test_no_cycle_damps_heat_that_grows_within_an_interval():
    """A third mode that grows at 3e11 1/s: Newton's method gave a stable cycle, on which it rests at -B/G."""

    def with_third(gain: float) -> th.Quadratic:
        rate = np.array([*1 / SECOND_ORDER.tau, 1e9])
        G, B = np.diag([0, 0, gain]), np.array([*SECOND_ORDER.gain, 1e6])
        return th.Quadratic(-np.diag(rate), np.zeros((3, 3, 3)), G, B, np.ones(3))

    cycle = coupled.limit_cycle(RING, with_third(0.0), power=6.31e-3)
    with pytest.raises(th.InputError, match="near the one given as guess"):
        coupled.limit_cycle(RING, with_third(1e14), power=6.31e-3, guess=cycle)


def test_heat_whose_loss_outweighs_all_else_rests_where_gain_and_loss_balance():
    """G x + B = 0; the search for a fixed point after the run ended in NumPy's "Singular matrix"."""
    lossy = th.Quadratic(FAST, np.zeros((2, 2, 2)), np.full((2, 2), -1e30), 1e9 * np.ones(2), np.ones(2))
    data = coupled.simulate(RING, lossy, power=1e-4, duration=1e-8)
    assert float(data.delta_T[-1]) == pytest.approx(1e9 / 1e30, rel=1e-3, abs=0)


def _two(B):
    names = {"inputs": ("a", "b"), "outputs": ("a", "b")}
    return th.StateSpace(np.eye(2), np.diag([-1e6, -2e6]), np.array(B), np.eye(2), **names)


def test_heat_of_another_part_is_bounded_as_well():
    """A heater of 1e20 K/W kept a run of .1 ns busy for minutes; circuits took any array."""
    heated, array = _two([[1e10, 1e26], [1e26, 1e10]]), _two([[1e36, 0], [0, 1e36]])
    with pytest.raises(th.InputError, match=r"between -1e\+09 and 1e\+09"):
        coupled.simulate(RING, heated, power=1e-4, duration=1e-10, heaters={"b": 1e-3})
    with pytest.raises(th.InputError, match=r"between -1e\+09 and 1e\+09"):
        coupled.simulate(coupled.bus([RING, RING]), array, power={"in": 1e-4}, duration=1e-10)
