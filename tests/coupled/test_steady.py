"""Fixed points: known ones, the closed-form limits, none missed, and their eigenvalues against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import coupled
import surrogate
import thermofem as th
from coupled.equilibria import balance, spectrum, steady
from coupled.kernels import equations as eq
from coupled.kernels.kinds import Static

RING = coupled.borghi2021()
LUMPED = RING.with_lumped_fcd()
EXPERIMENT = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
KERR_FREE = replace(RING, tpa_coefficient=0.0, fcd=((0.0, 1.0),))  # heat alone shifts the resonance


def dbm(value):
    return 1e-3 * 10 ** (value / 10)


def states_of(found, model, ring=RING):
    """Each branch as a state of the compiled equations."""
    rates, fcd = eq.internal_rates(ring)
    coupling = 2 * ring.bus_rate * eq.NS
    drive, shift = eq.internal_pump(ring, found.attrs["input_power"]), eq.internal_detuning(found.attrs["detuning"])
    for k in range(found.sizes["branch"]):
        branch = found.isel(branch=k)
        U, N, dT = float(branch.energy) / eq.FJ, float(branch.carriers) / eq.DENSITY, float(branch.delta_T)
        D = -rates.thermal_shift * dT - eq.dispersion(N, fcd)[0] - shift
        gamma = rates.loss + rates.fca * N + rates.tpa * U
        a = 1j * drive / (gamma - 1j * D)
        share = np.asarray(model.R) / model.thermal_resistance
        yield np.array([a.real, a.imag, N, *(share * dT)]), drive, shift, coupling


def test_three_fixed_points_at_7_dbm_minus_28_ghz():
    found = coupled.steady_states(RING, EXPERIMENT, power=dbm(7), detuning=-28e9)
    # An independent scan in U, eight digits.
    assert found.energy.values == pytest.approx([10.100040e-15, 15.548322e-15, 21.760990e-15], rel=5e-8, abs=0)
    assert list(found.regime.values) == ["stable", "saddle", "unstable focus"]
    assert list(found.growth_rate.values > 0) == [False, True, True]
    assert list(found.frequency.values > 0) == [False, False, True]


def test_fixed_point_at_8_dbm_on_resonance(validated):
    found = coupled.steady_states(RING, EXPERIMENT, power=dbm(8), detuning=0.0)
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
    N = 1.990834
    U, D = (np.array([v]) for v in (18.740013, -128.149671))
    rates, fcd = eq.internal_rates(RING)
    R = Static(EXPERIMENT.thermal_resistance * eq.UW)
    values = spectrum.dense(U[0], D[0], rates, fcd, eq.internal_thermal(EXPERIMENT), R)
    values = sorted(values[values.imag >= 0], key=lambda v: -v.real)
    assert values[1] == pytest.approx(-0.00580991, rel=2e-6, abs=0)  # half a unit of the last digit, and U's
    assert values[2] == pytest.approx(-112.08 + 128.18j, abs=0.005 * 2**0.5)
    assert balance.balances(U, rates, fcd, R)[0, 0] == pytest.approx(N, rel=3e-7)


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
    rates, fcd = eq.internal_rates(ring)
    thermal = eq.internal_thermal(model)
    for k, (y, drive, shift, coupling) in enumerate(states_of(found, model, ring)):
        U = y[0] ** 2 + y[1] ** 2
        # The state follows from U to round-off; D, a difference of shifts up to 1e3 rad/ns, to 1e-13, and U with it by
        # dU/U = 2 D dD/(gamma^2 + D^2), whose factor is at most 1/gamma: 1e-14; the margin of 1e3 covers steep places.
        assert float(found.energy[k]) / eq.FJ == pytest.approx(U, rel=1e-11, abs=0)
        f = eq.right_hand_side(y, drive, shift, rates, fcd, thermal)
        assert np.abs(f[:2]).max() < 1e-11 * drive
        assert abs(f[2]) < 1e-11 * rates.g * U * U
        assert np.all(np.abs(f[3:]) <= 1e-11 * thermal.poles[1] * y[3:])
        branch = found.isel(branch=k)
        total = float(branch["drop"] + branch.through + branch.absorbed)
        assert total == pytest.approx(dbm(power), rel=1e-10, abs=0)
        assert float(branch["drop"]) == pytest.approx(coupling * U * eq.UW, rel=1e-11, abs=0)


@pytest.mark.parametrize("ring", [RING, LUMPED], ids=["two terms", "lumped"])
def test_slopes_of_the_balance_are_derivatives(ring):
    rates, fcd = eq.internal_rates(ring)
    U = np.geomspace(1e-2, 1e3, 40)
    at = balance.balances(U, rates, fcd, Static(7e-3))
    h = 1e-3 * U
    # Fourth-order differences: truncation (1e-3)^4/30 of powers of U up to the fourth, 1e-12; round-off 1e-16/1e-3 of
    # the value, 1e3 times that where thermal and carrier shift nearly cancel: 1e-10.
    rows = [balance.balances(U + k * h, rates, fcd, Static(7e-3)) for k in (-2, -1, 1, 2)]
    slopes = (rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h)
    for value, slope in ((0, 1), (3, 4), (5, 6)):
        scale = np.abs(at[slope]) + np.abs(at[value]) / U * 1e-2
        assert np.abs((slopes[value] - at[slope]) / scale).max() < 1e-9


def brute_force(ring, R, power, detuning, n=400_000):
    """Sign changes of drive^2 - U (gamma^2 + D^2) on a fine scan in U, both uniform and logarithmic."""
    rates, fcd = eq.internal_rates(ring)
    drive, shift = eq.internal_pump(ring, power), eq.internal_detuning(detuning)
    top = (drive / rates.loss) ** 2
    U = np.unique(np.concatenate([np.geomspace(1e-9 * top, top, n), np.linspace(1e-9 * top, top, n)]))
    _, _, _, resonance, _, gamma, _ = balance.balances(U, rates, fcd, Static(R * eq.UW))
    f = drive**2 - U * (gamma**2 + (resonance - shift) ** 2)
    return int(np.sum(np.sign(f[1:]) != np.sign(f[:-1])))


@given(power=st.floats(-10, 20), mhz=st.integers(-150000, 60000), R=st.floats(100, 3e4), lumped=st.booleans())
@settings(max_examples=25, deadline=None, derandomize=True)
@pytest.mark.slow
def test_no_fixed_point_is_missed(power, mhz, R, lumped):
    ring = LUMPED if lumped else RING
    found = coupled.steady_states(ring, th.Foster(R=[R], tau=[3e-7]), power=dbm(power), detuning=mhz * 1e6)
    assert found.sizes["branch"] == brute_force(ring, R, dbm(power), mhz * 1e6)


def cubic(power, detuning, R):
    """Energies in fJ with heat as the only nonlinearity: U (gamma^2 + (c U + delta)^2) = 2 gamma_e P."""
    rates, _ = eq.internal_rates(KERR_FREE)
    c, delta = rates.thermal_shift * R * eq.UW * 2 * rates.absorbed, eq.internal_detuning(detuning)
    drive = eq.internal_pump(KERR_FREE, power)
    roots = np.roots([c**2, 2 * c * delta, rates.loss**2 + delta**2, -(drive**2)])
    return np.sort(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real)


@given(power=st.floats(-20, 17), mhz=st.integers(-200000, 60000), R=st.floats(1e3, 2e4))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_thermal_bistability_is_the_cubic(power, mhz, R):
    want = cubic(dbm(power), mhz * 1e6, R)
    found = coupled.steady_states(KERR_FREE, th.Foster(R=[R], tau=[3e-7]), power=dbm(power), detuning=mhz * 1e6)
    # Companion-matrix roots carry round-off of the largest one, here up to 1e4 times the smallest.
    assert found.energy.values == pytest.approx(want * eq.FJ, rel=1e-10, abs=1e-13 * want[-1] * eq.FJ)
    assert np.all(found.carriers.values == 0)
    assert list(found.regime.values) == (["stable"] if want.size == 1 else ["stable", "saddle", "stable"])


@pytest.mark.parametrize("above", [1e-3, 1e-6, 1e-9])
def test_folds_next_to_the_cusp_are_told_apart(above):
    """Closed form: bistability begins at delta = -sqrt(3) gamma, c U = -2 delta/3, where both folds are one."""
    rates, _ = eq.internal_rates(KERR_FREE)
    R = 7e3
    gamma, c = rates.loss, rates.thermal_shift * R * eq.UW * 2 * rates.absorbed
    delta = -np.sqrt(3) * gamma * (1 + above)
    # dP/dU = 0 at 3 x^2 + 4 delta x + delta^2 + gamma^2 = 0 with x = c U; the power halfway between has three roots.
    x = np.roots([3, 4 * delta, delta**2 + gamma**2])
    assert np.all(np.isreal(x))
    middle = float(np.mean([xi * (gamma**2 + (xi + delta) ** 2) for xi in x]))
    power = middle / c / (2 * RING.bus_rate * eq.NS) * eq.UW
    found = coupled.steady_states(
        KERR_FREE, th.Foster(R=[R], tau=[3e-7]), power=power, detuning=delta / 2 / np.pi / eq.NS
    )
    # Between the folds x = -2 delta/3 is the middle root, and the outer ones lie sqrt(3) half the folds' distance away.
    assert found.sizes["branch"] == 3
    half = abs(x[0] - x[1]) / 2
    want = (-2 * delta / 3 + np.sqrt(3) * half * np.array([-1, 0, 1])) / c * eq.FJ
    # At a cusp a relative round-off e moves the roots by its cube root at most, and by e/above once they are apart.
    assert found.energy.values == pytest.approx(want, rel=min(1e-15 / above, 1e-5) * 10, abs=0)


@pytest.mark.parametrize("detuning", [-30e9, -5e9, 0.0, 12e9])
def test_weak_light_sees_a_lorentzian(detuning):
    power = 1e-9
    found = coupled.steady_states(RING, EXPERIMENT, power=power, detuning=detuning)
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
    model = th.Foster(R=R / R.sum() * EXPERIMENT.thermal_resistance, tau=10 ** rng.uniform(-10, -4, poles))
    one, other = (coupled.steady_states(RING, m, power=dbm(power), detuning=mhz * 1e6) for m in (EXPERIMENT, model))
    # R_th differs by the round-off of 40 terms. Folds amplify it by 1/distance; no draw is closer than 1e-3.
    for name in ("energy", "carriers", "delta_T", "drop"):
        assert other[name].values == pytest.approx(one[name].values, rel=1e-11, abs=0)


@pytest.mark.parametrize("poles", [1, 2, 16])
@pytest.mark.parametrize(("power", "detuning"), [(7, -28e9), (8, 0.0), (10, 20e9), (-10, 5e9)])
def test_eigenvalues_are_those_of_the_differentiated_right_hand_side(poles, power, detuning):
    model = EXPERIMENT if poles == 2 else th.Foster(R=np.full(poles, 7e3 / poles), tau=np.geomspace(3e-8, 5e-6, poles))
    found = coupled.steady_states(RING, model, power=dbm(power), detuning=detuning)
    rates, fcd = eq.internal_rates(RING)
    thermal = eq.internal_thermal(model)
    for k, (y, drive, shift, _) in enumerate(states_of(found, model)):
        J = np.empty((y.size, y.size))
        for j in range(y.size):
            h, unit = 1e-3 * abs(y[j]), np.eye(y.size)[j]
            f = [eq.right_hand_side(y + m * h * unit, drive, shift, rates, fcd, thermal) for m in (-2, -1, 1, 2)]
            J[:, j] = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
        growth, omega, regime = steady.kind_of(np.linalg.eigvals(J))
        # Differences: truncation (h^4/30) f^(5) ~ 1e-12, round-off 1e-16 x 300/(1e-3) = 3e-11 per ns; an eigenvalue of
        # 5e-3 per ns that is a small difference of rates of 100 per ns magnifies them by their ratio, 2e4: 1e-6.
        assert float(found.growth_rate[k]) == pytest.approx(growth / eq.NS, rel=1e-6, abs=1e-6 * abs(growth) / eq.NS)
        assert float(found.frequency[k]) == pytest.approx(omega / (2 * np.pi * eq.NS), rel=2e-6, abs=0)
        assert str(found.regime[k].values) == regime


@pytest.mark.parametrize("poles", [1, 2, 8, 24])
def test_eigenvalues_followed_from_a_neighbour_are_the_dense_ones(poles):
    rates, fcd = eq.internal_rates(RING)
    model = EXPERIMENT if poles == 2 else th.Foster(R=np.full(poles, 7e3 / poles), tau=np.geomspace(1e-9, 9e-6, poles))
    thermal, R = eq.internal_thermal(model), Static(model.thermal_resistance * eq.UW)
    z = spectrum.dense(1.0, -50.0, rates, fcd, thermal, R)
    for U, D in [(2.0, -50.0), (5.0, 0.0), (20.0, -130.0), (22.0, 60.0), (9.0, 180.0), (0.01, 2000.0)]:
        if not spectrum.follow(z, spectrum.secular(U, rates, fcd, R), D, thermal.poles):
            assert D == 0  # heat and light apart: two zeros may fall on one pole, which their sum tells
            z = spectrum.dense(U, D, rates, fcd, thermal, R)
        left = list(spectrum.dense(U, D, rates, fcd, thermal, R))
        for value in z:
            near = min(left, key=lambda w: abs(w - value))
            # LAPACK is backward stable: 1e-15 of the norm (300 to 2000 per ns) absolute, grown by condition ~10.
            assert abs(near - value) < 1e-10
            left.remove(near)


def test_a_lost_eigenvalue_is_noticed():
    rates, fcd = eq.internal_rates(RING)
    thermal = eq.internal_thermal(EXPERIMENT).poles
    z = np.full(5, np.nan + 0j)
    assert not spectrum.follow(z, spectrum.secular(5.0, rates, fcd, Static(7e-3)), 10.0, thermal)


def test_fem_reduction_goes_in_as_any_other_model():
    heat = th.assemble(th.strip_ring(), accuracy=1e-3)
    reduced = surrogate.reduce(heat.system, tolerance=1e-3).model
    found = coupled.steady_states(RING, reduced, power=dbm(8), detuning=0.0)
    equal = th.Foster(R=[reduced.thermal_resistance], tau=[3e-7])
    alike = coupled.steady_states(RING, equal, power=dbm(8), detuning=0.0)
    assert found.energy.values == pytest.approx(alike.energy.values, rel=1e-11, abs=0)
    assert found.regime.values == ["unstable focus"]  # it self-pulses, as the ring does


def test_a_pole_without_heat_and_equal_poles_do_no_harm():
    R, tau = np.asarray(EXPERIMENT.R), np.asarray(EXPERIMENT.tau)
    split = th.Foster(R=[*(R / 2), *(R / 2), 0.0], tau=[*tau, *tau, 1e-8])
    one, other = (coupled.steady_states(RING, m, power=dbm(8), detuning=0.0) for m in (EXPERIMENT, split))
    assert other.growth_rate.values == pytest.approx(one.growth_rate.values, rel=1e-9)


def test_variables_say_what_they_are(tmp_path):
    found = coupled.steady_states(RING, EXPERIMENT, power=dbm(7), detuning=-28e9)
    units = {name: v.attrs["units"] for name, v in found.data_vars.items()}
    assert units == {
        "energy": "J", "carriers": "1/m^3", "delta_T": "K", "drop": "W", "through": "W", "absorbed": "W",
        "growth_rate": "1/s", "frequency": "Hz", "regime": "1",
    }  # fmt: skip
    back = th.load(th.save(found, tmp_path / "states.nc"))
    assert back.equals(found)
    assert back.attrs["ring_parameters"] == found.attrs["ring_parameters"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"detuning": -10}, r"did you mean -10e9\?"),
        ({"detuning": float("nan")}, "detuning = nan is not finite"),
        ({"detuning": 193e12}, "laser minus cold resonance"),
        ({"power": 8}, "8 dBm is 6.31e-3"),
        ({"power": 0.0}, "power = 0 must be positive"),
        ({"power": -1e-3}, "positive"),
        ({"ring": EXPERIMENT}, "RingResonator"),
        ({"model": th.Foster(R=[9e3, -1e3], tau=[1e-7, 1e-6])}, "passive"),
    ],
)
def test_slips_are_named_in_one_line(change, message):
    with pytest.raises(th.InputError, match=message) as error:
        coupled.steady_states(**({"ring": RING, "model": EXPERIMENT, "power": 6.31e-3} | change))
    assert "\n" not in str(error.value)
