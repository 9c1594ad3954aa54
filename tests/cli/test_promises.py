"""Promises that hold for every command: one line for an error, nothing half-written, nothing ignored in silence."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from commands import thermofem

import surrogate
import thermofem as th
from surrogate.export import FORMATS

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
RING = 'base = "borghi2021"\n[carriers]\nlifetime = "10 ns"\n'
SHORT = ("--duration", "3 us", "--accuracy", "0.05", "--samples", "9")


@pytest.fixture
def folder(tmp_path):
    surrogate.save_model(MODEL, tmp_path / "model.json")
    (tmp_path / "ring.toml").write_text(RING)
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    return tmp_path


def refused(*arguments, cwd):
    """The one line of a command that is refused; every file is as before."""
    before = {path: path.read_bytes() for path in cwd.iterdir()}
    done = thermofem(*arguments, cwd=cwd)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
    assert {path: path.read_bytes() for path in cwd.iterdir()} == before
    return done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["map", "model.json", "--ring", "ring.toml", "-o", "ring.toml"],
        ["map", "model.json", "--ring", "ring.toml", "--resume", "ring.toml"],
        ["stability", "model.json", "--ring", "ring.toml", "-o", "ring.toml"],
        ["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--ring", "ring.toml", "--map", "ring.toml"],
        ["solve", "strip.toml", "--paraview", "strip.toml"],
        ["validate", "model.json", "--reference", "model.json", "-o", "model.json"],
        ["export", "model.json", "--to", "spice", "-o", "model.json"],
    ],
)
def test_no_command_writes_over_a_file_that_it_reads(arguments, folder):
    assert "read and written at once" in refused(*arguments, cwd=folder)


@pytest.mark.parametrize("to", FORMATS)
def test_an_export_replaces_exports_alone(to, tmp_path):
    """`export scope.json --to csv` replaced the measured scope.csv."""
    ending = FORMATS[to]
    surrogate.save_model(MODEL, tmp_path / "scope.json")
    (tmp_path / f"scope{ending}").write_text("time (s),delta_T (K)\n0,0\n")
    assert "exists and is no export" in refused("export", "scope.json", "--to", to, cwd=tmp_path)
    assert thermofem("export", "scope.json", "--to", to, "-o", f"scope{ending}", cwd=tmp_path).returncode == 0
    assert thermofem("export", "scope.json", "--to", to, cwd=tmp_path).returncode == 0  # over the former export


@pytest.mark.parametrize(
    "arguments",
    [
        ["explore", "model.json", "--heated", "nope"],
        ["simulate", "model.json", "--heater", "core=1 mW"],
        ["map", "model.json", "--points", "2,2", "--heater", "core=1 mW"],
        ["export", "", "--to", "csv"],
        ["solve", "--threads", "0"],
    ],
)
def test_an_error_is_one_line_alone(arguments, folder):
    refused(*arguments, cwd=folder)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "--no-solve", "--preview", "a.png", "-o", "b.nc"], "--output b.nc has no effect with --no-solve"),
        (["solve", "--no-solve", "--preview", "a.png", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["solve", "--square", "1 us", "--periodic", "--duration", "3 us"], "--duration 3 us has no effect"),
        (["design", "f.json", "--resistance", "9 K/mW", "--power", "3 dBm"], "--power 3 dBm goes with --period"),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--points", "3, 3"], "--points 3, 3 goes with --map"),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--detuning", "3 GHz"], "--detuning 3 GHz goes with"),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--period", "--map", "m.nc"], "--period and --map"),
        (["simulate", "model.json", "--sweep", "1 GHz, 2 GHz", "--detuning", "3 GHz"], "--detuning 3 GHz has no"),
        (["simulate", "model.json", "--sweep", "1 mW, 2 mW", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["explore", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of a geometry's mesh"),
        (["validate", "model.json", "--reference", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of"),
    ],
)
def test_no_option_is_ignored(arguments, words, folder):
    assert words in refused(*arguments, cwd=folder)


@pytest.mark.parametrize(
    "option", [["--heater", "core=1 mW pulse 1 us at 20 ns"], ["--modulate", "1 mW pulse 1 us at 10 ns"],
               ["--laser", "1 mW pulse 1 us at 1 s, 0 GHz"]]
)  # fmt: skip
def test_a_pulse_after_the_run_is_refused(option, folder):
    said = refused("simulate", "model.json", "--duration", "10 ns", *option, cwd=folder)
    assert "begins after the run of 10 ns" in said


@pytest.mark.parametrize("names", [["bad.nc"], ["good.nc", "bad.nc"]])
def test_an_error_of_the_data_names_the_file(names, folder):
    """`data.delta_T[2] = nan is not finite` did not say which of the files."""
    for name, last in (("good.nc", 2.0), ("bad.nc", np.nan)):
        data = th.dataset.build(1e-7 * np.arange(10), np.arange(10.0), th.Constant(1e-3))
        data["delta_T"][2] = last
        data.to_netcdf(folder / name, engine="h5netcdf")
    assert refused("fit", *names, cwd=folder) == "thermofem: error: bad.nc: data.delta_T[2] = nan is not finite\n"


def test_the_ending_for_paraview_is_refused_before_the_work(tmp_path):
    assert "'.vtk' is unknown" in refused("solve", "--paraview", "t.vtk", cwd=tmp_path)
    told = refused("solve", "--paraview", "t.vtu", "--field-times", "1 us, 2 us", cwd=tmp_path)
    assert "holds one time and the data 2" in told


@pytest.mark.slow
def test_ctrl_c_is_one_line_and_exit_code_130(folder):
    """Promise 6, of a run that would take minutes."""
    run = [sys.executable, "-m", "thermofem", "map", "model.json", "--points", "1000, 1000"]
    hear = "import os, signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    command = [sys.executable, "-c", f"{hear}os.execv(sys.argv[1], sys.argv[1:])", *run]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=folder) as running:
        time.sleep(15)  # imports
        os.kill(running.pid, signal.SIGINT)
        _, said = running.communicate(timeout=20)
    assert (running.returncode, said) == (130, "thermofem: interrupted\n")
    assert not (folder / "map.nc").exists()
