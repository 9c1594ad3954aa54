"""Heaters in volts and amperes on the rings of a circuit, whose resistances follow their temperatures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from correctors import RING
from scipy.integrate import solve_ivp
from scipy.optimize import approx_fprime, fsolve

import coupled
import surrogate
import thermofem as th

ALPHA = 1.5e-3  # 1/K
OHM = np.array([120.0, 150.0])
NAMES = ("ring 1", "ring 2", "heater 1", "heater 2")
BUS = coupled.bus([RING, RING])
POWER = 2e-3
DRIVES = {"heater 1": coupled.Volts(2.0), "heater 2": coupled.Amperes(9e-3)}
SQUARES = np.array([2.0**2, 9e-3**2])
EXPONENTS = np.array([-1, 1])


def four(read=NAMES) -> th.StateSpace:
    """Two rings and their heaters as four heat capacities."""
    E = np.diag([8e-12, 8e-12, 60e-12, 50e-12])  # J/K
    K = 1e-4 * np.array([[5, -0.2, -1, 0], [-0.2, 5, 0, -1], [-1, 0, 3, -0.3], [0, -1, -0.3, 3]])  # W/K
    C = np.eye(4)[[NAMES.index(name) for name in read]]
    resistors = {name: [R, ALPHA] for name, R in zip(NAMES[2:], OHM.tolist(), strict=True)}
    return th.StateSpace(E, -K, np.eye(4), C, NAMES, tuple(read), origin={"resistors": resistors})


def watts(rises, squares=SQUARES):
    """P_h = V^2/R_h or I^2 R_h at the rises (K) of both heaters."""
    return squares * (OHM * (1 + ALPHA * rises)) ** EXPONENTS


def slopes(state, detuning, squares=SQUARES):
    """Two rings on one bus and the four temperatures in SI; of them the absorbed powers, too."""
    light = state[:6].reshape(2, 3)
    T = state[6:]
    a = light[:, 0] + 1j * light[:, 1]
    N = light[:, 2]
    U = np.abs(a) ** 2
    fast = RING.carriers
    index = RING.thermo_optic * T[:2] + sum(c * N * (N * N + 1e30) ** ((p - 1) / 2) for c, p in RING.fcd)
    D = -RING.index_rate * index - 2 * np.pi * detuning
    own = RING.loss_rate + RING.eta_fca * N + RING.eta_tpa * U
    couple = np.sqrt(2 * RING.bus_rate)
    through = np.sqrt(POWER) + 1j * couple * a[0]
    entering = np.array([np.sqrt(POWER), through])
    da = (1j * D - own - 2 * RING.bus_rate) * a + 1j * couple * entering
    dN = RING.g_tpa * U * U - N * (1 + fast.b * N) / (fast.tau0 * (1 + fast.a * N))
    absorbed = 2 * own * U
    model = four()
    dT = np.linalg.solve(model.E, model.A @ T + np.concatenate([absorbed, watts(T[2:], squares)]))
    return np.concatenate([np.column_stack([da.real, da.imag, dN]).ravel(), dT]), absorbed


def dark(squares=SQUARES):
    """The four temperatures at rest without light."""
    K = -four().A
    return fsolve(lambda T: np.linalg.solve(K, np.append([0, 0], watts(T[2:], squares))) - T, np.zeros(4), xtol=1e-12)


SIZE = np.array([1e-7, 1e-7, 1e23, 1e-7, 1e-7, 1e23, 1, 1, 1, 1])
SHIFT = RING.thermal_shift / (2 * np.pi)


def test_scipy_agrees_on_two_rings():
    """Constant drives have been on for long: the run begins at the warm rest in the dark; 1e-5 as of one ring.

    The second run begins with a ramp on heater 2 and nothing before.
    """
    times = np.linspace(0, 1e-6, 21)
    detuning = -SHIFT * dark()[0] - 10e9
    ramp = {"heater 1": coupled.Volts(2.0), "heater 2": coupled.Amperes(coupled.Sweep([0, 1e-6], [0, 9e-3]))}
    for drives, end, before in ((DRIVES, 0.0, SQUARES), (ramp, 1e-6, np.array([4.0, 0.0]))):

        def right(t, scaled, end=end):
            squares = SQUARES * [1, (t / end) ** 2 if end else 1]
            return slopes(scaled * SIZE, detuning, squares)[0] / SIZE

        start = np.append(np.zeros(6), dark(before)) / SIZE
        expected = solve_ivp(right, (0, 1e-6), start, "Radau", times, rtol=1e-9, atol=1e-10).y * SIZE[:, None]
        run = coupled.simulate(
            BUS, four(), power={"in": POWER}, detuning=detuning, heaters=drives, duration=1e-6, times=times, rtol=1e-8
        )
        assert run["delta_T"].values == pytest.approx(expected[6:8], rel=1e-5)
        share = np.array([np.ones(times.size), (times / end) ** 2 if end else np.ones(times.size)])
        power = np.array([watts(rises, SQUARES * part) for rises, part in zip(expected[8:].T, share.T, strict=True)]).T
        assert run["heater_power"].values == pytest.approx(power, rel=1e-5, abs=1e-5 * power.max())
        lit = np.abs(power[:, -1] - power[:, 0])
        assert lit[0] > 5e-5 * power[0, 0]  # so that the heat of the light is seen
        both = run["heater_voltage"] * run["heater_current"]
        assert both.values == pytest.approx(run["heater_power"].values, rel=1e-12)


def test_a_run_of_a_circuit_goes_on_under_a_voltage():
    light = {"power": {"in": POWER}, "detuning": -SHIFT * dark()[0] - 10e9, "rtol": 1e-9, "heaters": DRIVES}
    whole = coupled.simulate(BUS, four(), duration=0.8e-6, **light)
    first = coupled.simulate(BUS, four(), duration=0.3e-6, **light)
    second = coupled.simulate(BUS, four(), duration=0.5e-6, initial=first, **light)
    assert second["heater_power"].values[:, 0] == pytest.approx(first["heater_power"].values[:, -1], rel=1e-7)
    assert second["delta_T"].values[:, -1] == pytest.approx(whole["delta_T"].values[:, -1], rel=1e-7)


def test_fixed_points_of_a_circuit_and_their_stability():
    """The state is a root of the equations in SI, and its growth rate that of their Jacobian by differences.

    The light heats the heaters by .1 K: the share of the power that is linearised errs by (1.5e-4)^2 of 40 K in them.
    The rates belong to dP/dT in the dark, which alpha times .1 K changes by 1.5e-4 of a share of 5 %.
    """
    detuning = -SHIFT * dark()[0] - 10e9
    states = coupled.steady_states(BUS, four(), power={"in": POWER}, detuning=detuning, heaters=DRIVES, starts=0)
    at = states.isel(state=0)

    def residual(scaled):
        return slopes(scaled * SIZE, detuning)[0] / SIZE / 1e9

    start = np.append(np.zeros(6), dark()) / SIZE
    settled = solve_ivp(lambda t, y: residual(y) * 1e9, (0, 20e-6), start, "Radau", rtol=1e-8, atol=1e-10).y[:, -1]
    root = fsolve(residual, settled, xtol=1e-12)
    assert at["delta_T"].values == pytest.approx(root[6:8], rel=1e-6)
    assert at["energy"].values == pytest.approx((root[[0, 3]] ** 2 + root[[1, 4]] ** 2) * 1e-14, rel=1e-5)
    jacobian = approx_fprime(root, residual, 1e-6 * np.maximum(np.abs(root), 1e-2))
    leading = np.linalg.eigvals(jacobian * 1e9).real.max()
    assert float(at["growth_rate"]) == pytest.approx(leading, rel=1e-4)
    # the feedback is in it: without, by constant powers, it differs by more
    attrs = states.attrs
    fixed = {name: attrs[f"power_in_{name}"] for name in DRIVES}
    without = coupled.steady_states(BUS, four(), power={"in": POWER}, detuning=detuning, heaters=fixed, starts=0)
    assert float(without["growth_rate"][0]) != pytest.approx(leading, rel=1e-2)
    assert [*fixed.values()] == pytest.approx(watts(dark()[2:]), rel=1e-9)
    for name, power in fixed.items():
        assert attrs[f"voltage_of_{name}"] * attrs[f"current_of_{name}"] == pytest.approx(power, rel=1e-12)


def test_the_ambient_warms_heaters_and_rings_at_rest():
    """3 K more at every part of the geometry's ambient, without that input in the model: R_h is that of the sum."""
    rises = dark()
    K = -four().A
    warm = fsolve(lambda T: np.linalg.solve(K, np.append([0, 0], watts(T[2:]))) + 3.0 - T, rises, xtol=1e-12)
    detuning = -SHIFT * warm[0] - 10e9
    drive = {"power": {"in": 1e-9}, "detuning": detuning, "heaters": DRIVES, "ambient": 3.0}
    states = coupled.steady_states(BUS, four(), starts=0, **drive)
    # 1 nW heats by 1e-5 K
    assert states["delta_T"].values[0] == pytest.approx(warm[:2], rel=0, abs=1e-5)
    assert states.attrs["power_in_heater 1"] == pytest.approx(watts(warm[2:])[0], rel=1e-9)
    assert states.attrs["ambient"] == 3.0


@pytest.mark.parametrize("ambient", [None, 2.0])
def test_the_transmission_of_a_circuit_under_volts(ambient):
    """At low power: the fixed points of a millionth of a watt, and the closed form of two rings at their rises."""
    rises = dark()
    K = -four().A
    above = ambient or 0.0
    warm = fsolve(lambda T: np.linalg.solve(K, np.append([0, 0], watts(T[2:]))) + above - T, rises, xtol=1e-12)
    nu = -SHIFT * warm[0] + np.linspace(-30e9, 30e9, 7)
    curve = coupled.transmission(BUS, four(), detuning=nu, heaters=DRIVES, ambient=ambient)
    rate = RING.linear_rate + 2j * np.pi * (nu + SHIFT * warm[:2, None])
    expected = np.abs(np.prod(1 - 2 * RING.bus_rate / rate, axis=0)) ** 2
    assert curve["transmission"].sel(port="through").values == pytest.approx(expected, rel=1e-9)
    cold = coupled.transmission(BUS, detuning=nu)["transmission"].sel(port="through").values
    assert np.abs(cold - expected).max() > 0.1
    weak = {"power": {"in": 1e-9}, "heaters": DRIVES, "ambient": ambient, "starts": 0}
    states = coupled.steady_states(BUS, four(), detuning=float(nu[2]), **weak)
    output = states["output"].sel(port="through").values[0]
    # 1 nW moves a resonance by 1e-6 of its width
    assert output / 1e-9 == pytest.approx(expected[2], rel=1e-4)


METAL = th.Part("heater", "TiN", x=0.0, width=2e-6, bottom=2.22e-6, height=100e-9, heated=True)
GUIDE = th.straight_guide(substrate=20e-6)


@pytest.fixture(scope="module")
def chip():
    """A racetrack and a circle with a heater each, of 4.3e-7 ohm m."""
    values = {"material.TiN.resistivity": "4.3e-7 ohm*m", "part.heater.tcr": ALPHA}
    section = replace(GUIDE, parts=(*GUIDE.parts, METAL)).with_(values)
    circle = {"at": (24e-6, 0.0), "radius": 6e-6, "straight": 0.0}
    return surrogate.reduce_layout([
        th.racetrack("ring 1", section),
        th.racetrack("heater 1", section, part="heater"),
        th.racetrack("ring 2", section, **circle),
        th.racetrack("heater 2", section, part="heater", **circle),
    ])  # fmt: skip


def test_a_layout_records_the_resistance_of_every_shape(chip, tmp_path):
    """rho L/(w h) with the length of the shape: 2 pi R, and two straights of 8 um; 1e-4 of the polygon's arcs."""
    lengths = np.array([2 * np.pi * 5e-6 + 16e-6, 2 * np.pi * 6e-6])
    surrogate.save_model(chip, tmp_path / "chip.json")
    for model in (chip.model, surrogate.load_model(tmp_path / "chip.json")):
        resistors = model.origin["resistors"]
        assert [*resistors] == ["heater 1", "heater 2"]
        assert [pair[0] for pair in resistors.values()] == pytest.approx(4.3e-7 * lengths / (2e-6 * 100e-9), rel=1e-4)
        assert [pair[1] for pair in resistors.values()] == [ALPHA, ALPHA]


LAYOUT_DRIVES = {"heater 1": coupled.Volts(1.5), "heater 2": coupled.Volts(1.0)}


def layout_at_rest(chip):
    """Powers of the heaters and rises of the rings by the static gains: P_h = V^2/R_h at dT_h = sum H_hg P_g."""
    gain = chip.crosstalk
    ohm = np.array([pair[0] for pair in chip.model.origin["resistors"].values()])
    cold = np.array([1.5**2, 1.0**2]) / ohm
    heated = [1, 3]
    across = gain[np.ix_(heated, heated)]
    power = fsolve(lambda P: P * (1 + ALPHA * across @ P) / cold - 1, cold, xtol=1e-12)
    assert np.all(power < 0.97 * cold)  # so that the tcr is seen
    return power, gain[np.ix_([0, 2], heated)] @ power


def test_a_layout_under_volts_rests_where_its_static_gains_say(chip):
    power, rises = layout_at_rest(chip)
    light = {"power": {"in": 1e-9}, "detuning": -SHIFT * rises[0] - 20e9, "heaters": LAYOUT_DRIVES}
    states = coupled.steady_states(BUS, chip, starts=0, **light)
    found = [states.attrs["power_in_heater 1"], states.attrs["power_in_heater 2"]]
    assert found == pytest.approx(power, rel=1e-9)
    # 1 nW heats by 1e-5 K
    assert states["delta_T"].values[0] == pytest.approx(rises, rel=0, abs=2e-5)
    assert float(states["growth_rate"][0]) < 0


@pytest.mark.slow
def test_a_layout_under_volts_settles_on_its_fixed_point(chip):
    """The modes of a layout share their rates: run and fixed point agree, so they are kept apart rightly."""
    light = {
        "power": {"in": 0.5e-3}, "detuning": -SHIFT * layout_at_rest(chip)[1][0] - 20e9, "heaters": LAYOUT_DRIVES,
    }  # fmt: skip
    states = coupled.steady_states(BUS, chip, starts=0, **light)
    run = coupled.simulate(BUS, chip, duration=100e-6, times=[100e-6], **light)
    # exp(-100 us 1.1e5/s) of .1 K of light, and rtol
    assert run["delta_T"].values[:, -1] == pytest.approx(states["delta_T"].values[0], rel=1e-5)
