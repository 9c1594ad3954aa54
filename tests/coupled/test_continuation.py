"""Branches of cycles: folds and tori against long runs, Hopf points against the theory, doublings against pulses."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rings import FIVE, LUMPED, NEWTON, RING

import coupled
import thermofem as th
from coupled.cycles.branch import _is_there, born, follow
from coupled.cycles.cycle_problem import CycleProblem
from coupled.cycles.multiple_shooting import Family
from coupled.cycles.return_map import time_weights
from coupled.thermal import compact

POWER = 10**0.7 * 1e-3  # 7 dBm


def at(branch, kind):
    """Values of the parameter where a branch has a kind of special point."""
    return branch[branch.attrs["parameter"]].values[branch["special"].values == kind]


@pytest.fixture(scope="module")
def loop():
    """The branch of Newton's law: stable pulses, their fold, unstable pulses, the Hopf point."""
    return coupled.continue_cycle(LUMPED, NEWTON, "detuning", (20e9, -15e9), power=POWER, detuning=-2e9)


def test_a_fold_is_where_long_runs_stop_pulsing(loop, validated):
    (fold,) = at(loop, "fold")
    # newton.ode beside this file: it pulses at 4.60171 GHz and rests at 4.60173 GHz after 400 us
    source = "independent program, XPPAUT 6.11 with CVODE"
    validated("Coupled dynamics", "fold of cycles, Newton's law, 7 dBm", fold * 1e-9, 4.60172, within=1e-5,
              unit="GHz", source=source)  # fmt: skip
    # benchmarks/check_continuation.py; 200 and 400 intervals agree to 1e-10 GHz
    for kind, theirs in (("fold", 4.6017208389), ("Hopf", 0.0332798341)):
        what = f"{kind} point by continuation, Newton's law, 7 dBm"
        source, ours = "independent program, AUTO-07p", at(loop, kind).item() * 1e-9
        validated("Coupled dynamics", what, ours, theirs, within=1e-7, unit="GHz", source=source)
    cycle = None
    for off in (50e6, 15e6, 5e6, 2e6):  # towards the fold, each from the one before
        cycle = coupled.limit_cycle(LUMPED, NEWTON, power=POWER, detuning=fold - off, guess=cycle)
    begin = coupled.State.end_of(cycle)
    regimes = []
    for nu in (fold - 1e4, fold + 1e4):  # 2e-6 of the detuning, 3e-7 of the range
        run = coupled.simulate(LUMPED, NEWTON, power=POWER, detuning=nu, duration=4e-4, rtol=1e-8, initial=begin)
        regimes.append(str(coupled.pulsing(run).regime))
    assert regimes == ["self-pulsing", "stable"]


def test_the_branch_is_stable_up_to_the_fold_and_ends_in_the_hopf_point(loop):
    kinds = loop["stability"].values
    k = int(np.flatnonzero(loop["special"].values == "fold")[0])
    assert set(kinds[:k]) == {"stable"}
    assert set(kinds[k + 1 : -1]) == {"unstable"}
    others = loop["multipliers"].values[k]
    assert np.sort(np.abs(others - 1))[1] < 1e-2  # two at 1: a double root moves by the root of the error
    assert loop.attrs["reason"] == "a Hopf point"
    (curve,) = coupled.hopf_curves(LUMPED, NEWTON, [POWER * 0.999, POWER * 1.001], [-3e9, 3e9])
    power, nu = curve["power"].values, curve["detuning"].values
    order = np.argsort(power)
    # the curve is straight over .2 % of the power to 1e-7 of the range
    assert at(loop, "Hopf").item() == pytest.approx(np.interp(POWER, power[order], nu[order]), abs=35e9 * 1e-6)


def test_periods_of_a_branch_are_those_of_single_cycles(loop):
    for k in (3, 10):
        nu = float(loop["detuning"][k])
        one = coupled.limit_cycle(LUMPED, NEWTON, power=POWER, detuning=nu)
        for name in ("period", "duty", "swing"):
            # polynomials between the stages err by 3e-7 times up to eight on either mesh
            assert float(loop[name][k]) == pytest.approx(one.attrs[name], rel=1e-8 if name == "period" else 5e-6, abs=0)


@pytest.mark.parametrize(("ring", "model"), [(LUMPED, NEWTON), (RING, FIVE)])
def test_small_cycles_grow_as_the_first_lyapunov_coefficient_says(ring, model):
    """growth'(nu) (nu - nu_H) + g r^2 = 0 with r the relative amplitude of the carriers."""
    curve = coupled.hopf_curves(ring, model, [4e-3, 6e-3], [-30e9, 40e9])[0]
    hopf = curve.isel(point=curve.sizes["point"] // 2)
    P, nu = float(hopf["power"]), float(hopf["detuning"])
    rates = []
    for step in (1e6, -1e6):
        rest = coupled.steady_states(ring, model, power=P, detuning=nu + step)
        k = int(np.argmin(np.abs(rest["frequency"].values - float(hopf["frequency"]))))
        rates.append(float(rest["growth_rate"][k]))
    slope = (rates[0] - rates[1]) / 2e6
    family = Family(CycleProblem(ring, compact(model), P, nu), ("detuning",), np.array([1e9]))
    start, tangent = born(family, hopf)
    found, _ = follow(family, start, tangent, (nu - 1e9, nu + 1e9), 4)
    for cycle in found[1:]:
        orbit = cycle.place.orbit
        N = orbit.trace.rows[:, 3]
        r = float(np.ptp(N)) / 2 / float(time_weights(orbit) @ N / orbit.T)
        moved = float(cycle.place.values[0]) - nu
        # the next term of the normal form is r^2 of this one, times a number of order 10
        assert -slope * moved / r**2 == pytest.approx(float(hopf["lyapunov"]), rel=0.01 + 20 * r**2)


def test_a_time_constant_passes_that_of_another_pole():
    """Poles swap where they meet; the branch goes on, and every cycle has its own model."""
    fixed = {"R": [2000.0, 4300.0], "tau": [56e-9, 1.2e-6]}
    model = th.Foster(R=[*fixed["R"], 1500.0], tau=[*fixed["tau"], 600e-9])
    branch = coupled.continue_cycle(RING, model, "tau2", (3e-6, 0.5e-6), power=POWER, points=40)
    assert branch.attrs["reason"] == "the end of the range"
    assert branch["tau2"].values[-1] == pytest.approx(3e-6)
    for k in (5, branch.sizes["point"] - 1):
        there = th.Foster(R=[*fixed["R"], 1500.0], tau=[*fixed["tau"], float(branch["tau2"][k])])
        one = coupled.limit_cycle(RING, there, power=POWER)
        assert float(branch["period"][k]) == pytest.approx(one.attrs["period"], rel=1e-8, abs=0)


def test_a_branch_ends_where_the_network_is_passive_no_more():
    """`limit_cycle` refuses the rings beyond, down to -500 K/W."""
    model = th.Foster(R=[2000.0, 5500.0], tau=[56e-9, 1.2e-6])
    branch = coupled.continue_cycle(RING, model, "R1", (-500.0, 2500.0), power=POWER)
    assert branch["R1"].values.min() > 0
    assert branch.attrs["reason"] != "the end of the range"


def test_pulses_alternate_between_two_period_doublings():
    branch = coupled.continue_cycle(RING, FIVE, "detuning", (40e9, -5e9), power=POWER, detuning=20e9)
    first, second = at(branch, "period doubling")
    assert set(branch["stability"].values) == {"stable", "doubled"}
    inside = (branch["detuning"].values > first) & (branch["detuning"].values < second)
    assert set(branch["stability"].values[inside]) == {"doubled"}
    for nu, pulses in ((first - 1e6, 1), (first + 1e6, 2)):
        assert coupled.limit_cycle(RING, FIVE, power=POWER, detuning=nu).attrs["pulses"] == pulses
    curves = coupled.hopf_curves(RING, FIVE, [0.99 * POWER, 1.01 * POWER], [20e9, 40e9])
    hopf = min((c.isel(point=c.sizes["point"] // 2) for c in curves), key=lambda c: abs(float(c["detuning"]) - 28e9))
    # irregular pulses lie beside it, so a cold ring does not lead there
    above = coupled.limit_cycle(RING, FIVE, power=POWER, detuning=second + 5e6, guess=hopf)
    below = coupled.limit_cycle(RING, FIVE, power=POWER, detuning=second - 5e6, guess=coupled.State.end_of(above))
    assert (above.attrs["stability"], above.attrs["pulses"], below.attrs["pulses"]) == ("stable", 1, 2)
    for k in np.flatnonzero(branch["special"].values == "period doubling"):
        assert np.abs(branch["multipliers"].values[k] + 1).min() < 1e-6


def test_pulses_are_modulated_beyond_a_torus():
    """Found by a search over random networks: a pair of multipliers leaves the unit circle near 41.6 GHz."""
    model, P = th.Foster(R=[4769.2, 1591.5], tau=[90.2e-9, 8.875e-6]), 21.5e-3
    branch = coupled.continue_cycle(RING, model, "detuning", (43e9, 39e9), power=P, detuning=41e9)
    (torus,) = at(branch, "torus")
    others = branch["multipliers"].values[branch["special"].values == "torus"][0]
    pair = others[np.abs(others.imag) > 0.1]
    np.testing.assert_allclose(np.abs(pair), 1, atol=1e-6)
    cycle = coupled.limit_cycle(RING, model, power=P, detuning=torus - 100e6)
    begin = coupled.State.end_of(cycle)
    spread = []
    for nu in (torus - 50e6, torus + 50e6):
        run = coupled.simulate(RING, model, power=P, detuning=nu, duration=150e-6, rtol=1e-7, initial=begin)
        T = run["delta_T"].values[run["time"].values > 120e-6]
        spread.append(float(np.ptp(T[1:-1][(T[1:-1] > T[:-2]) & (T[1:-1] > T[2:])])))
    assert spread[0] < 0.02  # K; it falls by half in 15 cycles
    assert spread[1] > 5


def test_a_hopf_point_is_a_guess():
    curve = coupled.hopf_curves(RING, FIVE, [4e-3, 6e-3], [-30e9, 40e9])[0]
    hopf = curve.isel(point=curve.sizes["point"] // 2)
    P, nu = float(hopf["power"]), float(hopf["detuning"]) - 1e9
    near = coupled.limit_cycle(RING, FIVE, power=P, detuning=nu, guess=hopf)
    other = coupled.continue_cycle(RING, FIVE, "detuning", (nu, -5e9), power=P)  # from the large pulses at 0
    assert near.attrs["period"] == pytest.approx(float(other["period"][-1]), rel=1e-8, abs=0)
    # nearer than the first small cycle there was "no cycle on the branch"
    close = [
        coupled.limit_cycle(RING, FIVE, power=P, detuning=float(hopf["detuning"]) - off, guess=hopf)
        for off in (1e6, 10e6)
    ]
    size = [float(np.ptp(one["carriers"].values)) for one in close]
    assert size[1] / size[0] == pytest.approx(np.sqrt(10), rel=0.05)  # amplitudes go with the root of the distance
    with pytest.raises(th.InputError, match="has no size there"):
        coupled.limit_cycle(RING, FIVE, power=P, detuning=float(hopf["detuning"]), guess=hopf)
    with pytest.raises(th.InputError, match="a whole Hopf curve"):
        coupled.continue_cycle(RING, FIVE, "power", (1e-3, 9e-3), guess=curve)


@pytest.mark.parametrize(
    ("kind", "multipliers", "there"),
    [
        ("period doubling", (1.0, -1.0 + 1e-9, 0.2), True),
        ("period doubling", (1.0, 1e7, 0.2), False),  # beside a saddle the largest goes from -inf to inf
        ("torus", (1.0, np.exp(0.4j), np.exp(-0.4j)), True),
        ("torus", (1.0, 4.0, 0.25), False),
    ],
)
def test_a_sign_change_alone_is_no_bifurcation(kind, multipliers, there):
    orbit = SimpleNamespace(others=np.array(multipliers, dtype=complex)[1:])
    assert _is_there(kind, SimpleNamespace(orbit=orbit)) == there


def test_a_branch_that_turns_vertical_ends_instead_of_collecting_folds():
    """The end of a canard explosion is no row of folds, whatever the range."""
    ring = replace(coupled.borghi2021(), bus_rate=47147353672.30088).with_lumped_fcd()
    model = th.Foster(R=[2703.1507390077354, 5096.849260992264], tau=[7.271065412224265e-08, 6.582044312651478e-07])
    power = 0.005371607293613336
    points = [
        curve.isel(point=int(np.argmin(abs(curve.power.values - power))))
        for curve in coupled.hopf_curves(ring, model, [3e-3, 8e-3], [-10e9, 20e9])
    ]
    start = min(points, key=lambda point: abs(float(point.power) - power))
    ends = []
    for values in ((20e9, -10e9), (17.4e9, 15.4e9)):
        found = coupled.continue_cycle(ring, model, "detuning", values, guess=start)
        assert not (found.special.values == "fold").any()
        assert "turns vertical" in found.attrs["reason"]
        ends.append(float(found.detuning.values[-1]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-5)
