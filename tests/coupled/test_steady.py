"""Fixed points: known ones, the closed-form limits, none missed, and their eigenvalues against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from rings import LUMPED, RING, SECOND_ORDER
from support import ring_ode

import coupled
import thermofem as th
from coupled.equilibria.transmission import power_for_drop

KERR_FREE = replace(RING, tpa_coefficient=0.0, fcd=((0.0, 1.0),))  # heat alone shifts the resonance


def dbm(value):
    return 1e-3 * 10 ** (value / 10)


def test_three_fixed_points_at_7_dbm_minus_28_ghz():
    found = coupled.steady_states(RING, SECOND_ORDER, power=dbm(7), detuning=-28e9)
    # An independent scan in U, eight digits.
    assert found.energy.values == pytest.approx([10.100040e-15, 15.548322e-15, 21.760990e-15], rel=5e-8, abs=0)
    assert list(found.regime.values) == ["stable", "saddle", "unstable focus"]
    assert list(found.growth_rate.values > 0) == [False, True, True]
    assert list(found.frequency.values > 0) == [False, False, True]


def test_fixed_point_at_8_dbm_on_resonance(validated):
    found = coupled.steady_states(RING, SECOND_ORDER, power=dbm(8), detuning=0.0)
    # The same scan; tolerances are half a unit of its last digit.
    for name, unit, value, rel in (
        ("energy", "J", 18.740013e-15, 3e-8),
        ("carriers", "1/m³", 1.990834e23, 3e-7),
        ("delta_T", "K", 6.945106, 1e-7),
        ("growth_rate", "1/s", 0.01518554e9, 4e-7),
        ("frequency", "Hz", 0.006693e9 / (2 * np.pi), 8e-5),
    ):
        what = f"{name} of the fixed point at 8 dBm, 0 GHz"
        (ours,) = found[name].values
        validated("Coupled dynamics", what, ours, value, rel=rel, unit=unit, source="independent scan")
    assert found.regime.values == ["unstable focus"]


@given(
    power=st.floats(-20, 15),
    mhz=st.integers(-80000, 40000),
    lumped=st.booleans(),
    poles=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_every_branch_is_a_fixed_point_of_the_right_hand_side(power, mhz, lumped, poles, seed):
    ring = LUMPED if lumped else RING
    rng = np.random.default_rng(seed)
    model = th.Foster(R=rng.uniform(1, 15e3 / poles, poles), tau=10 ** rng.uniform(-9, -5, poles))
    found = coupled.steady_states(ring, model, power=dbm(power), detuning=mhz * 1e6)
    assert found.sizes["branch"] % 2 == 1
    assert np.all(np.diff(found.energy.values) > 0)
    P, nu = dbm(power), mhz * 1e6
    for branch in (found.isel(branch=k) for k in range(found.sizes["branch"])):
        y = ring_ode.state_at(branch, ring, model, P, nu)
        U = y[0] ** 2 + y[1] ** 2
        # The state follows from U to round-off; D, a difference of shifts up to 1e3 rad/ns, to 1e-13, and U with it by
        # dU/U = 2 D dD/(gamma^2 + D^2), whose factor is at most 1/gamma: 1e-14; the margin of 1e3 covers steep places.
        assert float(branch.energy) == pytest.approx(U, rel=1e-11, abs=0)
        f = ring_ode.right_hand_side(y, ring, model, P, nu)
        assert np.abs(f[:2]).max() < 1e-11 * np.sqrt(2 * ring.bus_rate * P)
        assert abs(f[2]) < 1e-11 * ring.g_tpa * U * U
        assert np.all(np.abs(f[3:]) <= 1e-11 * y[3:] / np.asarray(model.tau))
        assert float(branch["drop"] + branch.through + branch.absorbed) == pytest.approx(P, rel=1e-10, abs=0)
        assert float(branch["drop"]) == pytest.approx(2 * ring.bus_rate * U, rel=1e-11, abs=0)


def brute_force(ring, model, power, detuning, n=400_000):
    """Sign changes of P(U) - P on a fine scan in U, both uniform and logarithmic."""
    top = 2 * ring.bus_rate * power / ring.linear_rate**2
    U = np.unique(np.concatenate([np.geomspace(1e-9 * top, top, n), np.linspace(1e-9 * top, top, n)]))
    f = power_for_drop(ring, model, drop=2 * ring.drop_bus_rate * U, detuning=detuning) - power
    return int(np.sum(np.sign(f[1:]) != np.sign(f[:-1])))


@given(power=st.floats(-10, 20), mhz=st.integers(-150000, 60000), R=st.floats(100, 3e4), lumped=st.booleans())
@settings(max_examples=25, deadline=None, derandomize=True)
@pytest.mark.slow
def test_no_fixed_point_is_missed(power, mhz, R, lumped):
    ring = LUMPED if lumped else RING
    model = th.Foster(R=[R], tau=[3e-7])
    found = coupled.steady_states(ring, model, power=dbm(power), detuning=mhz * 1e6)
    assert found.sizes["branch"] == brute_force(ring, model, dbm(power), mhz * 1e6)


def cubic(power, detuning, R):
    """Energies in J with heat as the only nonlinearity: U (gamma^2 + (c U + delta)^2) = 2 gamma_e P."""
    c, delta = KERR_FREE.thermal_shift * R * 2 * KERR_FREE.loss_rate, 2 * np.pi * detuning
    gamma, drive = KERR_FREE.linear_rate, 2 * KERR_FREE.bus_rate * power
    roots = np.roots([c**2, 2 * c * delta, gamma**2 + delta**2, -drive]) if c else np.empty(0)
    return np.sort(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real)


@given(power=st.floats(-20, 17), mhz=st.integers(-200000, 60000), R=st.floats(1e3, 2e4))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_thermal_bistability_is_the_cubic(power, mhz, R):
    want = cubic(dbm(power), mhz * 1e6, R)
    found = coupled.steady_states(KERR_FREE, th.Foster(R=[R], tau=[3e-7]), power=dbm(power), detuning=mhz * 1e6)
    # Companion-matrix roots carry round-off of the largest one, here up to 1e4 times the smallest.
    assert found.energy.values == pytest.approx(want, rel=1e-10, abs=1e-13 * want[-1])
    assert np.all(found.carriers.values == 0)
    assert list(found.regime.values) == (["stable"] if want.size == 1 else ["stable", "saddle", "stable"])


@pytest.mark.parametrize("above", [1e-3, 1e-6, 1e-9])
def test_folds_next_to_the_cusp_are_told_apart(above):
    """Closed form: bistability begins at delta = -sqrt(3) gamma, c U = -2 delta/3, where both folds are one."""
    R = 7e3
    gamma, c = KERR_FREE.linear_rate, KERR_FREE.thermal_shift * R * 2 * KERR_FREE.loss_rate
    delta = -np.sqrt(3) * gamma * (1 + above)
    # dP/dU = 0 at 3 x^2 + 4 delta x + delta^2 + gamma^2 = 0 with x = c U; the power halfway between has three roots.
    x = np.roots([3, 4 * delta, delta**2 + gamma**2])
    assert np.all(np.isreal(x))
    middle = float(np.mean([xi * (gamma**2 + (xi + delta) ** 2) for xi in x]))
    power = middle / c / (2 * RING.bus_rate)
    found = coupled.steady_states(KERR_FREE, th.Foster(R=[R], tau=[3e-7]), power=power, detuning=delta / 2 / np.pi)
    # Between the folds x = -2 delta/3 is the middle root, and the outer ones lie sqrt(3) half the folds' distance away.
    assert found.sizes["branch"] == 3
    half = abs(x[0] - x[1]) / 2
    want = (-2 * delta / 3 + np.sqrt(3) * half * np.array([-1, 0, 1])) / c
    # At a cusp a relative round-off e moves the roots by its cube root at most, and by e/above once they are apart.
    assert found.energy.values == pytest.approx(want, rel=min(1e-15 / above, 1e-5) * 10, abs=0)


@pytest.mark.parametrize("detuning", [-30e9, -5e9, 0.0, 12e9])
def test_weak_light_sees_a_lorentzian(detuning):
    power = 1e-9
    found = coupled.steady_states(RING, SECOND_ORDER, power=power, detuning=detuning)
    delta = 2 * np.pi * detuning
    want = 2 * RING.bus_rate * power / (RING.linear_rate**2 + delta**2)
    # The shift by heat is 2 gamma_i U R_th 6.47e10 = 5e5 rad/s at 1 nW, 5e-6 of the linewidth; carriers shift less.
    assert found.energy.values == pytest.approx([want], rel=2e-5, abs=0)
    assert found.regime.values == ["stable"]
    assert found.growth_rate.values == pytest.approx([-1 / 1.03e-6], rel=1e-4)  # the slowest pole, unchanged by 5e-6


@given(poles=st.integers(1, 40), seed=st.integers(0, 2**32 - 1), power=st.floats(3, 10), mhz=st.integers(-40000, 30000))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_equal_thermal_resistance_means_equal_fixed_points(poles, seed, power, mhz):
    rng = np.random.default_rng(seed)
    R = rng.uniform(0.01, 1, poles)
    model = th.Foster(R=R / R.sum() * SECOND_ORDER.thermal_resistance, tau=10 ** rng.uniform(-10, -4, poles))
    one, other = (coupled.steady_states(RING, m, power=dbm(power), detuning=mhz * 1e6) for m in (SECOND_ORDER, model))
    # R_th differs by the round-off of 40 terms. Folds amplify it by 1/distance; no draw is closer than 1e-3.
    for name in ("energy", "carriers", "delta_T", "drop"):
        assert other[name].values == pytest.approx(one[name].values, rel=1e-11, abs=0)


def test_variables_say_what_they_are():
    found = coupled.steady_states(RING, SECOND_ORDER, power=dbm(7), detuning=-28e9)
    units = {name: v.attrs["units"] for name, v in found.data_vars.items()}
    assert units == {
        "energy": "J", "carriers": "1/m^3", "delta_T": "K", "drop": "W", "through": "W", "absorbed": "W",
        "growth_rate": "1/s", "frequency": "Hz", "regime": "1",
    }  # fmt: skip
