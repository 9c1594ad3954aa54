"""fit, reduce, validate and simulate, each fed with the file the one before wrote."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import partial

import numpy as np
import pytest
from commands import thermofem

import coupled
import surrogate
import thermofem as th
from thermofem.data import quantity


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Training data, a trained model and a reduction of the reference strip."""
    folder = tmp_path_factory.mktemp("models")
    heat = th.assemble(th.strip_ring())
    th.save(th.solve_periodic(heat, th.SquareWave(2e-3, 1e-6, 0.33)), folder / "square.nc")
    for arguments in (["fit", "square.nc", "-o", "second.json"], ["reduce", "-o", "fem.json"]):
        done = thermofem(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize(
    ("kind", "fit", "units"),
    [
        ("second-order", surrogate.fit_second_order, {"kappa": "1/s", "tau_f": "s", "tau_s": "s"}),
        ("newton", surrogate.fit_newton, {"tau_th": "s", "heat_capacity": "J/K"}),
        ("foster", partial(surrogate.fit_foster, order=1), {"R_1": "K/W", "tau_1": "s"}),
    ],
)
def test_fit_prints_numbers_errors_and_units(folder, kind, fit, units):
    """Of all but the ratios eta and heat_capacity_ratio; four digits, and two of the error."""
    order = ["--order", "1"] if kind == "foster" else []
    done = thermofem("fit", "square.nc", "--kind", kind, *order, "-o", f"{kind}.json", cwd=folder)
    words = [line.split() for line in done.stdout.splitlines() if "±" in line]
    printed = {name: (f"{value} {unit}", f"{error} {unit}") for name, _, value, _, error, unit in filter(six, words)}
    R_th, _ = printed.pop("R_th")
    assert printed.keys() == units.keys()
    found = fit(th.load(folder / "square.nc"))
    assert quantity.parse(R_th, "K/W") == pytest.approx(found.model.thermal_resistance, rel=1e-3, abs=0)
    for name, (value, error) in printed.items():
        assert quantity.parse(value, units[name]) == pytest.approx(found.parameters[name], rel=1e-3, abs=0)
        assert quantity.parse(error, units[name]) == pytest.approx(found.standard_errors[name], rel=0.05, abs=0)


def six(words):
    """Whether a line is name = value ± error unit."""
    return len(words) == 6


def test_fit_and_reduce_write_models(folder):
    second, fem = (json.loads((folder / f"{name}.json").read_text()) for name in ("second", "fem"))
    assert len(second["poles"]) == 2
    assert sum(pole["R"] for pole in second["poles"]) == pytest.approx(
        7890, rel=0.02
    )  # table of the trained parameters
    assert sum(pole["R"] for pole in fem["poles"]) == pytest.approx(7867.156, rel=1e-3)  # converged reference, accuracy
    assert fem["provenance"]["error_bound"] <= 1e-4


SHELLS = """
[[probe]]
name = "near"
part = "core"
shell = "0.2 um"
[[probe]]
name = "far"
part = "core"
shell = "0.8 um"
"""


@pytest.mark.slow
def test_fit_identifies_a_sindy_network_from_shells(folder):
    (folder / "shells.toml").write_text(th.strip_ring().to_toml() + SHELLS)
    drive = ["--square", "1 us", "--duration", "20 us", "--samples", "10001"]
    reads = ["--read", "core", "--read", "near", "--read", "far"]
    for arguments in (
        ["solve", "shells.toml", *drive, *reads, "-o", "shells.nc"],
        ["fit", "shells.nc", "--kind", "sindy", "-o", "sindy.json"],
        ["validate", "sindy.json", "--reference", "fem.json", "-o", "sindy.nc"],
    ):
        done = thermofem(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
        if arguments[0] == "fit":
            assert [line.split("/")[0] for line in done.stdout.splitlines()[:3]] == ["dT[core]", "dT[near]", "dT[far]"]
    model, fem = (surrogate.load_model(folder / name) for name in ("sindy.json", "fem.json"))
    error = surrogate.compare({"": model.poles}, fem, surrogate.square_waves(), periods=[]).rms_relative
    assert float(np.sqrt((error**2).mean())) < 0.05  # what three states may err by
    backwards = ["--read", "near", "--read", "core"]
    assert thermofem("solve", "shells.toml", *drive, *backwards, "-o", "other.nc", cwd=folder).returncode == 0
    done = thermofem("fit", "other.nc", "--kind", "sindy", cwd=folder)
    assert done.returncode == 2
    assert "the first probe is 'near'; it must be the heated part, 'core'" in done.stderr


def test_validate_states_the_range(folder):
    done = thermofem("validate", "second.json", "--reference", "fem.json", "--figure", "curve.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "within 10 %" in done.stdout
    curve = th.load(folder / "period_error.nc").sel(model="second").interp(period=1e-6)
    assert curve.relative_error.item() == pytest.approx(0.04, abs=0.015)  # +4 % at 1 us by an independent code
    assert (folder / "curve.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_validate_adds_the_points_of_a_ring(folder):
    paper = coupled.borghi2021()
    bus_rate = (paper.omega / 40_000 - paper.loss_rate) / 2  # of a loaded Q of 20 000
    (folder / "high.toml").write_text(f'base = "borghi2021"\nname = "high Q"\nbus_rate = "{bus_rate} 1/s"\n')
    judged = "validate", "second.json", "--reference", "fem.json", "-o", "ring.nc", "--json"
    found = json.loads(thermofem(*judged, "--ring", "high.toml", cwd=folder).stdout)["ring"]["second"]
    assert found["loaded_q"] == pytest.approx(20_000)
    assert found["points"] > 0
    curves = th.load(folder / "ring.nc")
    points = curves.sel(model="second").dropna("point")
    assert points.sizes["point"] == found["points"]
    ring = coupled.RingResonator.from_toml(folder / "high.toml")
    light = {"power": points["ring_power"].values[0], "detuning": points["ring_detuning"].values[0]}
    for name, column in (("fem", "ring_period"), ("second", "ring_period_model")):
        cycle = coupled.limit_cycle(ring, surrogate.load_model(folder / f"{name}.json"), **light)
        assert points[column].values[0] == pytest.approx(cycle.attrs["period"], rel=1e-5, abs=0)
    quiet = thermofem(*judged, "--ring", "high.toml", "--duty", "0.5", cwd=folder)  # another wave, the same ring
    assert json.loads(quiet.stdout)["ring"]["second"] == found


@pytest.mark.slow
def test_validate_trains_every_model_on_a_geometry(folder):
    (folder / "ring.toml").write_text(th.strip_ring().to_toml())
    done = thermofem("validate", "ring.toml", "--figure", "ring.png", "-o", "ring.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows = {line.split("│")[1].strip(): line for line in done.stdout.splitlines() if line.startswith("│")}
    foster, reduction = [f"Foster, trained ({n})" for n in (3, 5)], "certified reduction (0.0001)"
    assert set(rows) == {"Newton", "second order", *foster, reduction, "SINDy"}
    ranges = [tuple(map(float, each.split(" to "))) for each in rows["second order"].split("│")[4].split(",")]
    low, high = next(ends for ends in ranges if ends[0] < 1 < ends[1])  # us, around the training period
    # .6 to 1.45 us by an independent code, which calls 1.5 points of the error agreement; its slope there is 1 % in 2 %
    assert (low, high) == (pytest.approx(0.6, rel=0.1), pytest.approx(1.45, rel=0.05))
    assert rows[reduction].split("│")[3].strip() == "0.1 to 10"
    assert "within 10%: Foster, trained (5) suffices (5 states)" in done.stdout
    assert f"within 1%: {reduction} suffices (14 states)" in done.stdout
    assert "strip ring: square waves of 2 mW, 33% duty, against its FEM" in done.stdout
    assert "the same at every power" in done.stdout
    assert (folder / "ring.png").read_bytes().startswith(b"\x89PNG")
    curve = th.load(folder / "ring.nc")["relative_error"].sel(model="second order").interp(period=1e-6)
    assert curve.item() == pytest.approx(0.04, abs=0.015)  # as in test_validate_states_the_range
    assert sorted(th.load(folder / "ring.nc")["model"].values) == sorted(rows)


def test_stability_says_where_the_hopf_curve_begins_outside_its_plane(folder):
    """The plane that it names has the threshold of the eigenvalues on a grid."""
    above = "stability", "second.json", "--power", "8 dBm, 10 dBm", "--points", "3, 10", "-o", "above.nc"
    hint = thermofem(*above, cwd=folder).stderr
    assert "the Hopf curve begins at" in hint
    (plane,) = re.findall(r'--power "([^"]*)" --detuning "([^"]*)"', hint)
    axes = "--power", plane[0], "--detuning", plane[1], "--points", "40, 200", "--json", "-o", "plane.nc"
    done = thermofem("stability", "second.json", *axes, cwd=folder)
    threshold = json.loads(done.stdout)["thresholds"]["self-pulsing"]
    least = quantity.parse(re.findall("begins at ([^(]*) \\(", hint)[0], "W")
    assert threshold == pytest.approx(least, rel=0.07)  # the powers are 6 % apart
    assert quantity.parse(plane[0].split(",")[0], "W") == pytest.approx(least / 2, rel=0.01)  # three digits are printed
    below = "--power", "1 uW, 2 uW", "--points", "2, 10", "-o", "below.nc"
    assert "the Hopf curve begins at" in thermofem("stability", "second.json", *below, cwd=folder).stderr


def test_simulate_pulses_with_the_period_of_the_fem(folder):
    done = thermofem("simulate", "fem.json", "--power", "8 dBm", "--figure", "traces.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "are those of the ring 'Borghi 2021'; --ring RING.toml takes those of yours" in done.stderr
    period = float(done.stdout.split("\nperiod ")[1].split(" ns")[0])
    assert period == pytest.approx(680, rel=0.01)  # the same optics on an independent code's heat
    assert th.load(folder / "traces.nc")["drop"].max() > 3e-3


def test_simulate_reads_a_ring_file(folder):
    (folder / "ring.toml").write_text('base = "borghi2021"\nname = "on one bus"\nbuses = 1\n')
    done = thermofem("simulate", "fem.json", "--ring", "ring.toml", "--duration", "1 us", "-o", "one.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "those of the ring 'on one bus'\n" in done.stderr
    run = th.load(folder / "one.nc")
    assert run.attrs["ring"] == "on one bus"
    assert float(run["drop"].max()) == 0
    (folder / "section.toml").write_text(th.strip_ring().to_toml())
    done = thermofem("simulate", "fem.json", "--ring", "section.toml", "-o", "one.nc", cwd=folder)
    assert "section.toml holds a geometry, not the optics of a ring" in done.stderr


@pytest.mark.slow
def test_heated_and_read_pick_a_channel_to_fit_and_to_judge(tmp_path):
    """A heater is judged from heater to core; the figures of the first channel are another's."""
    (tmp_path / "ring.toml").write_text(th.heated_ring().to_toml())
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    times = np.append(0.0, np.geomspace(1e-9, 1e-4, 150))
    both = th.solve(heat, th.Constant(1e-3), times=times, heated="heater", read=("heater", "core"))
    th.save(both, tmp_path / "both.nc")
    surrogate.save_model(surrogate.reduce(heat.channels(["core", "heater"]), 1e-4), tmp_path / "fem.json")
    fitted = "fit", "both.nc", "--kind", "foster", "--order", "4", "-o", "m.json"
    done = thermofem(*fitted, "--heated", "heater", "--read", "core", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    model = surrogate.load_model(tmp_path / "m.json")
    assert (model.inputs, model.outputs) == (("heater",), ("core",))
    judged = "validate", "m.json", "--reference", "fem.json", "--shortest", "2 us"
    done = thermofem(*judged, "--heated", "heater", "--read", "core", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["models"]["m"]["largest_error"] < 0.1
    done = thermofem(*judged, "--heated", "core", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["models"]["m"]["largest_error"] is None  # another channel, without that swing
    whole = "validate", "ring.toml", "--accuracy", "1e-2", "--shortest", "2 us", "-o", "v.png", "--json"
    done = thermofem(*whole, "--heated", "heater", "--read", "core", cwd=tmp_path)
    found = json.loads(done.stdout)
    assert found["models"]["certified reduction (0.0001)"]["largest_error"] < 1e-2
    assert "SINDy" in found["refused"]
    for command, words in ((fitted, "--read core"), (judged, "--heated = None is unknown")):
        done = thermofem(*command, cwd=tmp_path)
        assert done.returncode == 2
        assert words in done.stderr


def test_show_says_what_the_fit_said_of_the_second_order_equation(tmp_path):
    known = {
        "parameters": {"kappa": 8.87e5, "tau_f": 55.8e-9, "eta": 0.31},
        "standard_errors": {"eta": 0.02, "kappa": []},
    }
    surrogate.save_model(th.Foster([1e3], [1e-6]), tmp_path / "m.json", provenance=known)
    said = thermofem("show", "m.json", cwd=tmp_path).stdout
    assert "kappa : 887000 1/s\n" in said
    assert "eta : 0.31 ± 0.02\n" in said
    assert "tau_f" not in said  # of a pole


BUS = """
name = "two rings on a bus"
[[ring]]
name = "a"
base = "borghi2021"
[[ring]]
name = "b"
base = "borghi2021"
shift = "5 GHz"
[[waveguide]]
start = "a.through"
stop = "b.in"
loss = 0.3
[[laser]]
name = "in"
stop = "a.in"
[[detector]]
name = "out"
start = "b.through"
"""


def test_a_circuit_is_exported_with_a_deck_that_ngspice_runs(folder, tmp_path):
    """At rest, 1 mW and -20 GHz; ngspice at reltol 1e-4 against the fixed point."""
    program = shutil.which("ngspice") or pytest.skip("ngspice is not installed")
    (tmp_path / "bus.toml").write_text(BUS)
    arguments = "--circuit=bus.toml", "--to=spice", "--power=1 mW", "--detuning=-20 GHz", "--output=bus.cir"
    done = thermofem("export", str(folder / "second.json"), *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    subprocess.run([program, "-b", "bus_demo.cir"], cwd=tmp_path, capture_output=True, check=True)
    names, *rows = (tmp_path / "bus_demo.csv").read_text().splitlines()
    circuit, model = coupled.Circuit.from_toml(tmp_path / "bus.toml"), surrogate.load_model(folder / "second.json")
    rest = coupled.steady_states(circuit, model, power={"in": 1e-3}, detuning=-20e9)
    last = dict(zip(names.split(","), map(float, rows[-1].split(",")), strict=True))
    for port, name in {"out": "out", "a.drop": "a_drop", "b.drop": "b_drop"}.items():
        assert last[name] == pytest.approx(rest["output"].sel(port=port).item(), rel=1e-3)


def test_the_export_of_a_quiet_ring_says_that_this_is_normal(tmp_path):
    """At 10 uW no equilibrium of the paper's ring oscillates: it has no period, and the file is written."""
    surrogate.save_model(th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6]), tmp_path / "heat.json")
    asked = ("export", "heat.json", "--ring", "borghi2021", "--to", "spice", "--power", "-20 dBm")
    done = thermofem(*asked, "--json", cwd=tmp_path)
    assert "quiet at this power and detuning, which is normal" in done.stderr
    numbers = json.loads(done.stdout)
    assert numbers["period"] is None
    assert (tmp_path / numbers["demo"]).is_file()
