"""Heaters, sweeps, modulation and the co-simulation on the command line."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem

import coupled
import surrogate
import thermofem as th
from thermofem_cli.inputs import drive_texts

OHM = 120.0
ELECTRIC = th.heated_ring().with_({"part.heater.resistance": OHM})


@pytest.fixture
def folder(tmp_path):
    """A folder with a model of two inputs; the heater reaches the core through a slow pole of negative residue."""
    rate, gain = 1 / np.array([55.8e-9, 1.2e-6]), np.array([1998.1, 5786.2])
    B = np.array([np.sqrt(gain * rate), [-500.0, 9000.0]]).T
    origin = {"geometry": ELECTRIC.to_toml()}
    names = {"inputs": ("core", "heater"), "outputs": ("core",)}
    model = th.StateSpace(np.eye(2), -np.diag(rate), B, B.T[:1], origin=origin, **names)
    surrogate.save_model(model, tmp_path / "m.json")
    return tmp_path


def test_simulate_with_a_heater_and_a_modulated_laser(folder):
    done = thermofem(
        "simulate", "m.json", "--heated", "core", "--heater", "heater=5 mW square 1 us", "--modulate",
        "1 mW pulse 100 ns at 1 us", "--duration", "2 us", "--figure", "a.png", "-o", "run.nc", cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "light or heaters vary" in done.stdout
    run = th.load(folder / "run.nc")
    t = run["time"].values
    wave = th.SquareWave(5e-3, 1e-6, 0.5)
    assert (
        np.minimum(
            abs(run["heater_power"].values[0] - wave(t)), abs(run["heater_power"].values[0] - wave.before(t))
        ).max()
        == 0
    )
    assert np.interp([0.9e-6, 1.05e-6], t, run["input_power"].values) == pytest.approx([6.3096e-3, 7.3096e-3], rel=1e-4)
    assert (folder / "a.png").stat().st_size > 10_000


def test_simulate_sweeps_the_laser(folder):
    done = thermofem(
        "simulate", "m.json", "--heated", "core", "--power", "1 mW", "--sweep", "20 GHz, -40 GHz, 20 GHz",
        "--duration", "2 us", "--figure", "a.png", "-o", "run.nc", cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = th.load(folder / "run.nc")
    wanted = np.interp(run["time"].values, [0, 1e-6, 2e-6], [20e9, -40e9, 20e9])
    assert run["detuning"].values == pytest.approx(wanted, rel=1e-9, abs=1.0)
    assert (folder / "a.png").stat().st_size > 10_000


@pytest.mark.slow
def test_simulate_with_a_probe_on_another_resonance(folder):
    """Numbers and file against the same run in Python."""
    done = thermofem(
        "simulate", "m.json", "--heated", "core", "--laser", "1 uW -5 GHz on 1.5 THz", "--laser",
        "1 mW pulse 50 ns at 0.1 us, 4 GHz", "--duration", "0.4 us", "--figure", "a.png", "-o", "run.nc", "--json",
        cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said, run, ring = json.loads(done.stdout), th.load(folder / "run.nc"), coupled.borghi2021()
    lasers = [
        coupled.Laser(1e-6, -5e9, replace(ring, frequency=ring.frequency + 1.5e12)),
        coupled.Laser(th.Pulse(1e-3, 50e-9, start=0.1e-6), 4e9),
    ]
    model = surrogate.load_model(folder / "m.json")
    drive = {"power": 1e-3 * 10**0.8, "lasers": lasers, "duration": 0.4e-6, "heated": "core", "read": "core"}
    wanted = coupled.simulate(ring, model, **drive)
    for name in ("drop", "probe_drop", "delta_T"):
        assert run[name].values == pytest.approx(wanted[name].values, rel=1e-9, abs=0)
    late = wanted["probe_drop"].values[0][wanted["time"].values >= 0.2e-6]
    assert said["lasers"] == 3
    numbers = {"resonance": ring.frequency + 1.5e12, "drop_low": late.min(), "drop_high": late.max()}
    assert said["probes"] == [pytest.approx(numbers)]
    assert (folder / "a.png").stat().st_size > 10_000


def test_simulate_takes_volts(folder):
    """P = U^2/R, U of the option and R of the geometry that the model records."""
    options = "--heated", "core", "--power", "1 uW", "--duration", "10 ns", "-o", "run.nc"
    done = thermofem("simulate", "m.json", "--heater", "0.5 V square 10 ns", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    run = th.load(folder / "run.nc")
    on = run["time"].values < 5e-9
    assert run["heater_power"].values[0, on] == pytest.approx(0.5**2 / OHM, rel=1e-12, abs=0)
    assert run["heater_voltage"].values[0, on] == pytest.approx(0.5, rel=1e-12)
    assert run["heater_power"].values[0, ~on][1:] == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize(("text", "watts"), [("0.5 V", 0.5**2 / OHM), ("heater=5 mA", 5e-3**2 * OHM)])
def test_linearize_takes_volts_and_amperes(folder, text, watts):
    """The steady state that U^2/R or I^2 R moves, against the same power in watts."""
    done = thermofem("linearize", "m.json", "--detuning", "-40 GHz", "--heater", text, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    model = surrogate.load_model(folder / "m.json")
    drive = {"power": 1e-3, "detuning": -40e9, "heaters": {"heater": watts}}
    expected = coupled.linearize(coupled.borghi2021(), model, **drive)
    assert json.loads(done.stdout)["delta_T"] == pytest.approx(float(expected.state["delta_T"]), rel=1e-12)


def test_a_map_under_amperes_is_that_under_their_power(folder):
    plane = "--power", "0 dBm, 9 dBm", "--points", "2, 3", "--detuning", "-260 GHz, -150 GHz"
    tables = {}
    for text in ("heater=5 mA", "heater=3 mW", "heater=1 mW"):  # I^2 R = 3 mW
        done = thermofem("stability", "m.json", "--heater", text, *plane, "-o", "map.nc", cwd=folder)
        assert done.returncode == 0, done.stderr
        tables[text] = th.load(folder / "map.nc")["growth_rate"].values
    np.testing.assert_allclose(tables["heater=5 mA"], tables["heater=3 mW"], rtol=1e-9)
    assert not np.allclose(tables["heater=1 mW"], tables["heater=3 mW"], rtol=1e-2)


def test_explore_opens_at_the_power_of_a_voltage(folder):
    page = thermofem("explore", "m.json", "--heated", "core", "--heater", "0.5 V", "-o", "a.html", cwd=folder)
    assert page.returncode == 0, page.stderr
    found = re.search(r'"h0": ?([\d.e-]+)', (folder / "a.html").read_text(encoding="utf-8"))
    assert float(found[1]) == pytest.approx(1e3 * 0.5**2 / OHM, rel=1e-9)


BAD_HEATERS = {
    "foo=1 V": ("--heater = 'foo' is unknown", "--heated 'core, heater'"),
    "heater=1 kV": ("power of 'heater' by 1000 V in 120 ohm = 8333.33333 must lie between 0 and 10",),
    "heater=2 kV": ("--heater heater = 2000 must lie between -1000 and 1000 (in V)",),
    "heater=20 W": ("--heater heater = 20 must lie between 0 and 10 (in W)",),
    "heater=-1 mW": ("--heater heater = -0.001 must lie between 0",),
    "heater=5 kg": ("--heater heater = '5 kg' has the wrong dimension",),
    "heater=1 V square": ("--heater heater = '1 V square' ends before its time", "AMOUNT square PERIOD"),
    "heater=1 V square 1 us duty 2": ("--heater heater", "duty = 2 must lie between"),
    "heater": ("--heater heater = 'heater' does not begin with a number",),
}


@pytest.mark.parametrize("text", BAD_HEATERS)
@pytest.mark.parametrize("command", ["simulate", "linearize"])
def test_bad_heaters_are_named_in_words_of_the_command_line(folder, command, text):
    done = thermofem(command, "m.json", "--heater", text, cwd=folder)
    lines = done.stderr.splitlines()
    assert (done.returncode, len(lines)) == (2, 1)
    assert all(word in lines[0] for word in BAD_HEATERS[text]), lines
    assert "heaters[" not in lines[0]
    assert "5e-3" not in lines[0]


def test_a_drive_that_varies_is_refused_where_it_must_be_constant(folder):
    done = thermofem("linearize", "m.json", "--heater", "1 V square 1 us", cwd=folder)
    assert (done.returncode, "--heater heater varies in time" in done.stderr) == (2, True)


def test_a_map_with_a_heater(folder):
    arguments = ["--power", "0 dBm, 9 dBm", "--points", "3, 4", "-o", "map.nc"]
    shift = 4e-3 * (-500 * np.sqrt(1998.1 * 55.8e-9) + 9000 * np.sqrt(5786.2 * 1.2e-6)) * 10.294e9  # Hz
    ends = f"{-30e9 - shift:.0f} Hz, {30e9 - shift:.0f} Hz"
    done = thermofem("stability", "m.json", "--heater", "heater=4 mW", "--detuning", ends, *arguments, cwd=folder)
    assert done.returncode == 0, done.stderr
    warm = th.load(folder / "map.nc")
    done = thermofem("stability", "m.json", "--heated", "core", "--detuning", "-30 GHz, 30 GHz", *arguments, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert (warm["regime"].values == th.load(folder / "map.nc")["regime"].values).all()
    assert len(set(warm["regime"].values.ravel())) > 1


def test_reduce_makes_a_model_with_a_heater(tmp_path):
    (tmp_path / "ring.toml").write_text(th.heated_ring().to_toml())
    arguments = "reduce", "ring.toml", "--accuracy", "1e-2", "--heated", "core, heater", "-o", "m.json"
    for read, outputs in (((), ("core",)), (("--read", "core, box"), ("core", "box"))):
        done = thermofem(*arguments, *read, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert f"from heater to {outputs[-1]}" in done.stdout
        model = surrogate.load_model(tmp_path / "m.json")
        assert (model.inputs, model.outputs) == (("core", "heater"), outputs)


@pytest.mark.parametrize(
    ("text", "unit", "values"),
    [
        ("2 mW", "W", [2e-3, 2e-3, 2e-3]),
        ("2 mW square 1 us duty 0.25", "W", [2e-3, 0, 0]),
        ("2 mW pulse 200 ns at 0.25 us", "W", [0, 2e-3, 0]),
        ("2 GHz square 1 us", "Hz", [2e9, 2e9, 0]),
        ("-2 GHz pulse 200 ns at 0.25 us", "Hz", [0, -2e9, 0]),
        ("2 GHz sine 1 MHz", "Hz", [2e9 * np.sin(0.2 * np.pi), 2e9 * np.sin(0.8 * np.pi), 2e9 * np.sin(1.2 * np.pi)]),
    ],
)
def test_what_a_drive_says(text, unit, values):
    wave = drive_texts.varying("--modulate", text, unit)
    assert [wave if isinstance(wave, float) else float(wave(t)) for t in (0.1e-6, 0.4e-6, 0.6e-6)] == pytest.approx(
        values
    )


def test_cosimulate_writes_traces_fields_and_figure(tmp_path):
    done = thermofem(
        "cosimulate", "--duration", "2 us", "--field-times", "0.5 us, 1 us", "--paraview", "heat.xdmf",
        "--figure", "traces.png", "-o", "run.nc", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "self-pulsing" in done.stdout or "slow transient" in done.stdout
    assert "the ring 'Borghi 2021'; --ring RING.toml" in done.stderr
    run = th.load(tmp_path / "run.nc")
    assert run.field.sizes["field_time"] == 2
    assert run.attrs["largest_discrepancy"] < 1e-3
    assert abs(run.attrs["heat_imbalance"]) < 1e-6
    assert (tmp_path / "heat.xdmf").exists()
    assert (tmp_path / "traces.png").read_bytes().startswith(b"\x89PNG")


def test_cosimulate_with_a_heater_a_ring_file_and_no_predictor(tmp_path):
    """Under a voltage: U^2/R for 0.2 us is the heat that enters."""
    (tmp_path / "ring.toml").write_text(ELECTRIC.to_toml())
    (tmp_path / "optics.toml").write_text('base = "borghi2021"\nname = "on one bus"\nbuses = 1\n')
    done = thermofem("cosimulate", "ring.toml", "--heater", "core=1 V", cwd=tmp_path)
    assert (done.returncode, "'core'" in done.stderr) == (2, True)
    done = thermofem("cosimulate", "ring.toml", "--heater", "box=1 V", cwd=tmp_path)
    assert (done.returncode, "--heater = 'box' is unknown" in done.stderr) == (2, True)
    done = thermofem(
        "cosimulate", "ring.toml", "--heater", "0.8 V", "--power", "1 uW", "--duration", "0.2 us",
        "--predictor", "none", "--ring", "optics.toml", "-o", "run.nc", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = th.load(tmp_path / "run.nc")
    assert run.attrs["ring"] == "on one bus"
    assert run.attrs["predictor"] == "none"
    # 1 uW of light adds 1e-4
    assert run.attrs["heat_in"] == pytest.approx(0.8**2 / OHM * 0.2e-6, rel=1e-3, abs=0)
