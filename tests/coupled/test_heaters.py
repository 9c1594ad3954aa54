"""Heaters beside the light: models of several inputs, against SciPy, the FEM in the loop and exact limits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from correctors import RING
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import coupled
import surrogate
import thermofem as th
from coupled.cycles.cycle_folds import cycle_fold_curves
from coupled.cycles.derivatives import cycle_derivatives

WAVE = th.SquareWave(power=10e-3, period=0.1e-6, duty=0.4)


def chain() -> th.StateSpace:
    """Core, oxide and heater as heat capacities in a row; the last loses heat to the substrate as the second does."""
    E = np.diag([8e-12, 12e-12, 10e-12])  # J/K
    K = np.array([[4e-4, -4e-4, 0], [-4e-4, 7e-4, -1e-4], [0, -1e-4, 3e-4]])  # W/K
    B = np.array([[1.0, 0], [0, 0], [0, 1]])
    return th.StateSpace(E, -K, B, B.T[:1], inputs=("core", "heater"), outputs=("core",))


def scipy_run(model, power, wave, times, detuning):
    """The ring with all states of the matrices in SI, by SciPy from edge to edge of the heater's power."""
    A, B = np.linalg.solve(model.E, model.A), np.linalg.solve(model.E, model.B)
    fast, size = RING.carriers, np.array([1e-7, 1e-7, 1e23, 1, 1, 1])

    def right(t, scaled):
        re, im, N, *x = scaled * size
        a, U = re + 1j * im, re * re + im * im
        index = RING.thermo_optic * x[0] + sum(c * N * (N * N + 1e30) ** ((p - 1) / 2) for c, p in RING.fcd)
        D = -RING.index_rate * index - 2 * np.pi * detuning
        own = RING.loss_rate + RING.eta_fca * N + RING.eta_tpa * U
        da = (1j * D - own - 2 * RING.bus_rate) * a + 1j * np.sqrt(2 * RING.bus_rate * power)
        dN = RING.g_tpa * U * U - N * (1 + fast.b * N) / (fast.tau0 * (1 + fast.a * N))
        dx = A @ x + B @ [2 * own * U, float(wave(min(t, edge - 1e-18)))]
        return np.array([da.real, da.imag, dN, *dx]) / size

    y, out = np.zeros(6), []
    for start, edge in itertools.pairwise([0.0, *wave.breakpoints(0, times[-1]), times[-1]]):
        wanted = np.append(times[(times >= start) & (times < edge)], edge)
        found = solve_ivp(right, (start, edge), y, "Radau", wanted, rtol=1e-7, atol=1e-8)
        y = found.y[:, -1]
        out.append(found.y[3, :-1])
    return np.concatenate(out)


def test_scipy_agrees_on_a_ring_with_a_heater():
    """SciPy at rtol 1e-7 is within 1e-6 of 5 K; the drive stays below the first pulse."""
    model, times = chain(), np.linspace(0, 60e-9, 60, endpoint=False)
    drive = {"power": 3e-3, "detuning": -10e9, "duration": 60e-9}
    run = coupled.simulate(RING, model, heaters={"heater": WAVE}, times=times, rtol=1e-9, **drive)
    expected = scipy_run(model, 3e-3, WAVE, np.append(times, 60e-9), -10e9)
    alone = coupled.simulate(RING, model, heated="core", **drive)
    assert run["delta_T"].values == pytest.approx(expected, rel=0, abs=5e-6)
    assert abs(expected[-1] - alone["delta_T"].values[-1]) > 0.1  # so that the heater is seen
    assert run["heater_power"].sel(heater="heater").values == pytest.approx(WAVE(times))


def test_the_fem_in_the_loop_agrees_on_a_heater():
    """1e-3 K of tolerance, and 1e-4 of R_th of the reduction; a first pulse may magnify them by ten."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    model = surrogate.reduce(heat.channels(("core", "heater"), "core"), tolerance=1e-4)
    drive = {"power": 6.31e-3, "duration": 0.66e-6, "heaters": {"heater": 10e-3}}
    fem = coupled.cosimulate(RING, heat, **drive)
    run = coupled.simulate(RING, model, times=fem["time"].values, **drive)
    assert run["delta_T"].values == pytest.approx(fem["delta_T"].values, rel=0, abs=1e-2)
    assert fem["heater_power"].values == pytest.approx(run["heater_power"].values)


def test_a_run_goes_on_with_its_heater():
    drive = {"power": 3e-3, "detuning": -10e9, "rtol": 1e-9}
    whole = coupled.simulate(RING, chain(), heaters={"heater": 5e-3}, duration=0.6e-6, **drive)
    first = coupled.simulate(RING, chain(), heaters={"heater": 5e-3}, duration=0.2e-6, **drive)
    second = coupled.simulate(RING, chain(), heaters={"heater": 5e-3}, duration=0.4e-6, initial=first, **drive)
    assert second.attrs["final_state"] == pytest.approx(whole.attrs["final_state"], rel=1e-6, abs=0)


def test_windows_of_a_stepped_heater_are_one_run_under_its_waveform():
    """A constant heater relaxes in the poles of the kernel, a waveform in cubics to rtol/100: two routes, each to 1e-9.

    In the windows the rise of 5 K and the state of 3 K are restarted eight times.
    """
    watts = [5e-3, 0.0, 8e-3, 2e-3, 5e-3, 5e-3, 1e-3, 4e-3]
    window = 50e-9
    light = {"power": 1e-3, "detuning": -10e9, "rtol": 1e-9}
    edges = window * np.arange(1, len(watts))
    wave = th.Function(lambda t: watts[min(int(t / window + 1e-9), 7)], breakpoints=tuple(edges))
    whole = coupled.simulate(
        RING, chain(), heaters={"heater": wave}, duration=8 * window, times=window * np.arange(1, 9), **light
    )
    state = None
    for k, power in enumerate(watts):
        run = coupled.simulate(RING, chain(), heaters={"heater": power}, duration=window, initial=state, **light)
        state = coupled.State.end_of(run)
        for name in ("drop", "delta_T"):
            assert float(run[name][-1]) == pytest.approx(float(whole[name][k]), rel=1e-6, abs=0), (name, k)


def test_constant_heaters_shift_every_equilibrium():
    """A ring at rest under a heater: simulate ends on the fixed point of steady_states, and the map says the same."""
    model, power = chain(), 0.5e-3
    heaters = {"heater": 8e-3}
    run = coupled.simulate(RING, model, heaters=heaters, power=power, duration=60e-6, rtol=1e-8)
    states = coupled.steady_states(RING, model, power=power, heaters=heaters)
    for name in ("energy", "carriers", "delta_T"):
        assert states[name].values[0] == pytest.approx(run[name].values[-1], rel=1e-6, abs=0)
    # by hand: the rise of the heater turned into a detuning
    rise = np.linalg.solve(-model.A, model.B[:, 1])[0] * 8e-3
    turned = RING.thermal_shift * rise / (2 * np.pi)
    bare = coupled.steady_states(RING, model.channel("core"), power=power, detuning=turned)
    assert states["energy"].values == pytest.approx(bare["energy"].values, rel=1e-12, abs=0)
    powers, detunings = np.array([0.5e-3, 6e-3]), np.array([-40e9, -20e9])
    for function, more in ((coupled.stability_map, {}), (coupled.pulsing_map, {"duration": 3e-6})):
        found = function(RING, model, powers, detunings, heaters=heaters, **more)
        other = function(RING, model.channel("core"), powers, detunings + turned, **more)
        assert (found["regime"].values == other["regime"].values).all()
        assert found["detuning"].values == pytest.approx(detunings)
        assert found.attrs["power_in_heater"] == 8e-3


def beside(power):
    """Two poles, a heater that reaches the core through a slow pole of negative residue, and its constant rise."""
    rate, gain = 1 / np.array([55.8e-9, 1.2e-6]), np.array([1998.1, 5786.2])
    B = np.array([np.sqrt(gain * rate), [-500.0, 9000.0]]).T
    model = th.StateSpace(np.eye(2), -np.diag(rate), B, B.T[:1], inputs=("core", "heater"), outputs=("core",))
    return model, np.linalg.solve(-model.A, model.B[:, 1]) @ model.C[0] * power


def test_a_settled_cycle_under_a_heater():
    """The same cycle as without, at the laser that follows the resonance; hotter by what the heater adds."""
    model, rise = beside(4e-3)
    moved = -RING.thermal_shift * rise / (2 * np.pi)
    cold = coupled.limit_cycle(RING, model.channel("core"), power=6.31e-3)
    warm = coupled.limit_cycle(RING, model, power=6.31e-3, detuning=moved, heaters={"heater": 4e-3})
    assert warm.attrs["period"] == pytest.approx(cold.attrs["period"], rel=1e-9, abs=0)
    # between the samples, which lie up to a picosecond elsewhere: the splines of 266 of them agree to 1e-12 there
    rises = CubicSpline(warm.time, warm.delta_T)(cold.time[:-1]) - cold.delta_T.values[:-1]
    assert rises == pytest.approx(rise, rel=1e-9)


def test_branches_and_derivatives_of_cycles_under_a_heater():
    """Those of the bare model at the laser that follows the resonance; by what moves the resonance, of both."""
    model, rise = beside(4e-3)
    turn = RING.thermal_shift * rise / (2 * np.pi)
    bare, heaters = model.channel("core"), {"heater": 4e-3}
    cold = coupled.continue_cycle(RING, bare, "detuning", (-2e9, 3e9), power=6.31e-3, detuning=0.0)
    ends = (-2e9 - turn, 3e9 - turn)
    warm = coupled.continue_cycle(RING, model, "detuning", ends, power=6.31e-3, detuning=-turn, heaters=heaters)
    assert warm["period"].values == pytest.approx(cold["period"].values, rel=1e-8, abs=0)
    assert warm["detuning"].values + turn == pytest.approx(cold["detuning"].values, rel=1e-8, abs=10.0)
    assert warm.attrs["power_in_heater"] == 4e-3
    first = coupled.limit_cycle(RING, model, power=6.31e-3, detuning=-turn, heaters=heaters)
    again = coupled.continue_cycle(RING, model, "detuning", ends, guess=first, heaters=heaters)
    assert again["period"].values == pytest.approx(warm["period"].values, rel=1e-8, abs=0)
    names, run = ["power", "detuning", "thermo_optic"], {"power": 6.31e-3, "detuning": -turn, "heaters": heaters}
    found = cycle_derivatives(RING, model, names, **run)["period"].values
    without = cycle_derivatives(RING, bare, names, power=6.31e-3)["period"].values
    assert found[:2] == pytest.approx(without[:2], rel=1e-6, abs=0)
    step = 1e-4 * RING.thermo_optic
    two = [
        coupled.limit_cycle(replace(RING, thermo_optic=RING.thermo_optic + s), model, **run).attrs["period"]
        for s in (step, -step)
    ]
    # central differences: the square of 1e-4 times the ratio of the third derivative to the first, here below 1e3
    assert found[2] == pytest.approx((two[0] - two[1]) / (2 * step), rel=1e-4)
    assert abs(found[2] / without[2] - 1) > 0.1


def test_folds_of_cycles_under_a_heater():
    ring, newton = RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    R, tau = newton.dynamics.thermal_resistance, 275e-9
    model = th.StateSpace(
        np.eye(1), -np.eye(1) / tau, np.array([[np.sqrt(R / tau), 500.0]]), np.array([[np.sqrt(R / tau)]]),
        inputs=("core", "heater"), outputs=("core",),
    )  # fmt: skip
    turn = ring.thermal_shift * 500.0 * np.sqrt(R * tau) * 2e-3 / (2 * np.pi)
    (cold,) = cycle_fold_curves(ring, newton, [4.9e-3, 5.1e-3], [0.0, 10e9])
    nu = np.array([0.0, 10e9]) - turn
    (warm,) = cycle_fold_curves(ring, model, [4.9e-3, 5.1e-3], nu, heaters={"heater": 2e-3})
    assert warm["detuning"].values + turn == pytest.approx(cold["detuning"].values, rel=1e-7)
    assert warm["power"].values == pytest.approx(cold["power"].values, rel=1e-7)
    assert warm["detuning"].attrs == cold["detuning"].attrs
