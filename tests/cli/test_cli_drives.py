"""Heaters, sweeps, modulation and the co-simulation on the command line."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem

import coupled
import surrogate
import thermofem as th
from thermofem_cli.inputs import drive_texts


@pytest.fixture
def folder(tmp_path):
    """A folder with a model of two inputs; the heater reaches the core through a slow pole of negative residue."""
    rate, gain = 1 / np.array([55.8e-9, 1.2e-6]), np.array([1998.1, 5786.2])
    B = np.array([np.sqrt(gain * rate), [-500.0, 9000.0]]).T
    model = th.StateSpace(np.eye(2), -np.diag(rate), B, B.T[:1], inputs=("core", "heater"), outputs=("core",))
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
    (tmp_path / "ring.toml").write_text(th.heated_ring().to_toml())
    (tmp_path / "optics.toml").write_text('base = "borghi2021"\nname = "on one bus"\nbuses = 1\n')
    done = thermofem(
        "cosimulate", "ring.toml", "--heater", "heater=5 mW", "--power", "1 uW", "--duration", "0.2 us",
        "--predictor", "none", "--ring", "optics.toml", "-o", "run.nc", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = th.load(tmp_path / "run.nc")
    assert run.attrs["ring"] == "on one bus"
    assert run.attrs["predictor"] == "none"
    assert run.attrs["heat_in"] == pytest.approx(5e-3 * 0.2e-6, rel=1e-3, abs=0)  # 1 uW of light adds 1e-4
