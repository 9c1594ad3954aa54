"""The full-order field over windows: any basis, the same field; a tolerance in kelvin; heat that adds up."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from models import coarse, coarse_fem, coarse_warm_fem, linear_ledger
from scipy.integrate import quad

import thermofem as th
from thermofem.algebra.krylov import krylov
from thermofem.algebra.pole_responses import phi
from thermofem.transient import integrate
from thermofem.transient.deflation import FieldIntegrator

SQUARE = th.SquareWave(2e-3, 0.4e-6, 1 / 3)  # its edges fall on no step
TIMES = np.linspace(0, 0.8e-6, 161)


@cache
def reference():
    """To 1e-6 K."""
    return integrate(coarse_fem(), SQUARE, TIMES, rtol=1e-7).outputs[:, 0]


def march(field, wave, times, windows):
    """Outputs over equal windows, and the last state."""
    state, outputs = field.start(), []
    for part in np.array_split(np.arange(times.size - 1), windows):
        out, state, _ = field.advance(state, [wave], times[part[0] : part[-1] + 2])
        outputs.append(out[:-1] if part[-1] + 2 < times.size else out)
    return np.concatenate(outputs)[:, 0], state


@pytest.mark.parametrize("y", [0.0, 1e-6, 0.3, 0.999, 1.001, 3.0, 40.0, 1e4])
def test_phi_functions(y):
    for m, value in enumerate(phi(np.array([y]))[:, 0]):
        exact = quad(lambda u, m=m: np.exp(-y * (1 - u)) * u**m, 0, 1, points=[1 - 1 / (y + 2)], epsabs=0)[0]
        assert value == pytest.approx(exact, rel=1e-10, abs=0)  # what quad reaches


@pytest.mark.parametrize(("cycles", "tolerance"), [(0, 1e-3), (2, 1e-3), (5, 1e-3), (5, 1e-4)])
def test_any_basis_gives_the_full_order_field(cycles, tolerance):
    system = coarse_fem()
    found, _ = march(FieldIntegrator(system, krylov(system, cycles), tolerance=tolerance), SQUARE, TIMES, 4)
    assert np.abs(found - reference()).max() < tolerance


@pytest.mark.parametrize("cycles", [0, 4])
def test_with_conductivity_and_heat_capacity_that_depend_on_temperature(cycles):
    system, times, wave = coarse_warm_fem(), TIMES[:41], th.SquareWave(20e-3, 0.4e-6, 1 / 3)
    exact = integrate(system, wave, times, rtol=1e-5).outputs[:, 0]  # 2e-4 K
    linear = integrate(system.linear, wave, times, rtol=1e-5).outputs[:, 0]
    found, _ = march(FieldIntegrator(system, krylov(system.linear, cycles), tolerance=2e-2), wave, times, 2)
    assert np.abs(found - exact).max() < 2e-2
    assert np.abs(linear - exact).max() > 0.2  # so that it is seen


def test_a_better_basis_takes_fewer_steps():
    system, work = coarse_fem(), {}
    for cycles in (0, 5):
        field = FieldIntegrator(system, krylov(system, cycles), tolerance=1e-3)
        march(field, SQUARE, TIMES, 1)
        work[cycles] = field.stepper.steps
    assert work[5] < work[0] / 5


def test_heat_adds_up():
    d = coarse()[1]
    system = d.state_space(("core",), ("core",))
    for cycles, allowed in ((0, 1e-11), (5, 2e-6)):  # round-off; the cubics between the grid times of the fast part
        field = FieldIntegrator(system, krylov(system, cycles), tolerance=1e-2, ledger=linear_ledger(d))
        _, state = march(field, SQUARE, TIMES, 2)
        assert state.heat_in == pytest.approx(SQUARE.mean(0, 0.8e-6) * 0.8e-6, rel=1e-12, abs=0)
        assert state.heat_in - field.stored(state) - state.heat_out == pytest.approx(0, abs=allowed * state.heat_in)


def test_a_window_can_be_taken_again():
    system = coarse_fem()
    field = FieldIntegrator(system, krylov(system, 2), tolerance=1e-3)
    start = field.advance(field.start(), [SQUARE], TIMES[:81])[1]
    first, end, _ = field.advance(start, [SQUARE], TIMES[80:])
    field.advance(start, [th.Constant(9e-3)], TIMES[80:])
    again, _, kept = field.advance(start, [SQUARE], TIMES[80:], keep=TIMES[[80, 120, -1]])
    assert np.array_equal(first, again)
    # the kept fields are those that are read
    assert kept @ system.C[0] == pytest.approx(again[[0, 40, -1], 0], rel=1e-9, abs=0)
    assert field.temperature(end) == pytest.approx(kept[-1], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("warm", [False, True], ids=["linear", "k(T), c_p(T)"])
def test_a_revised_window_is_the_one_under_the_new_power(warm):
    """A pulse of 2.2 K comes 2 ns later: outputs, field, what follows, and the heat balance, with hardly a solve."""
    d = coarse()[1]
    system = coarse_warm_fem() if warm else d.state_space(("core",), ("core",))
    basis, ledger = krylov(system.linear if warm else system), None if warm else linear_ledger(d)
    one, late = (th.Pulse(20e-3, 60e-9, start=start) for start in (20e-9, 22e-9))
    times, then = np.linspace(0, 0.2e-6, 101), np.linspace(0.2e-6, 0.3e-6, 11)
    field = FieldIntegrator(system, basis, tolerance=1e-4, ledger=ledger)
    before = field.advance(field.start(), [one], times)[0]
    solves = field.stepper.solves
    found, state, _ = field.revised([late], times)
    assert field.stepper.solves <= solves + 5
    exact = FieldIntegrator(system, basis, tolerance=1e-4, ledger=ledger)
    wanted, end, _ = exact.advance(exact.start(), [late], times)
    change = np.abs(before - wanted).max()
    assert change > 0.1
    assert np.abs(found - wanted).max() < 2e-4 + 1e-3 * change  # 1e-4 of each, and the share that the basis misses
    assert field.temperature(state) == pytest.approx(exact.temperature(end), rel=0, abs=2e-3)
    gone, wanted = (f.advance(s, [th.Constant(0.0)], then)[0] for f, s in ((field, state), (exact, end)))
    assert gone == pytest.approx(wanted, rel=0, abs=3e-4)
    assert state.heat_in == pytest.approx(end.heat_in, rel=1e-12, abs=0)
    if ledger:  # what flows in and out of the remainder is revised, too
        assert state.heat_in - field.stored(state) - state.heat_out == pytest.approx(0, abs=1e-6 * state.heat_in)


def test_two_heated_parts_superpose():
    d = coarse()[1]
    names = ("core", "oxide")
    system = d.state_space(names, ("core",))
    waves = [SQUARE, th.Pulse(20e-3, 0.3e-6, start=0.21e-6)]
    found, _, _ = FieldIntegrator(system, krylov(system), tolerance=1e-3).advance(
        FieldIntegrator(system, krylov(system), tolerance=1e-3).start(), waves, TIMES
    )
    alone = [
        integrate(system.channel(name, "core"), wave, TIMES, rtol=1e-7) for name, wave in zip(names, waves, strict=True)
    ]
    assert found[:, 0] == pytest.approx(sum(one.outputs[:, 0] for one in alone), rel=0, abs=1e-3)


def test_the_basis_keeps_the_static_gain():
    system = coarse_fem()
    basis = krylov(system, 1)
    assert basis.reduced(system).thermal_resistance == pytest.approx(system.thermal_resistance, rel=1e-9, abs=0)
