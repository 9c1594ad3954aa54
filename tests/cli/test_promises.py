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
GEOMETRY = th.strip_ring().to_toml()


@pytest.fixture
def folder(tmp_path):
    surrogate.save_model(MODEL, tmp_path / "model.json")
    (tmp_path / "ring.toml").write_text(RING)
    (tmp_path / "strip.toml").write_text(GEOMETRY)
    return tmp_path


def refused(*arguments, cwd):
    """The one line of a command that is refused; every file is as before."""
    before = {path: path.read_bytes() for path in cwd.iterdir()}
    done = thermofem(*arguments, cwd=cwd)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
    assert {path: path.read_bytes() for path in cwd.iterdir()} == before
    return done.stderr


@pytest.fixture(scope="module")
def every(tmp_path_factory):
    """A folder with a file of every kind, some of them bad."""
    folder = tmp_path_factory.mktemp("every")
    texts = {
        "strip.toml": GEOMETRY,
        "bad_key.toml": GEOMETRY.replace("thickness", "thicknes", 1),
        "bad_material.toml": GEOMETRY.replace('"SiO2"', '"SiO3"', 1),
        "wide.toml": GEOMETRY.replace("450 nm", "0.45 m"),
        "bad.toml": "geometry = ",
        "empty.toml": "",
        "optics.toml": RING,
        "plan.toml": 'geometry = "strip.toml"\n[[drive]]\npower = "1 mW"\n',
        "table.csv": "a (us),b (K)\n" + "".join(f"{k},{k % 3}\n" for k in range(20)),
        "note.txt": "1 carton of milk\n2 eggs\nsalt\n",
        "two.csv": "a,b\n" + "".join(f"{k}e-6,{k % 3}\n" for k in range(20)),
        "three.csv": "a,b,c\n" + "".join(f"{k},{k % 3},{k % 5}\n" for k in range(20)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "good.png").touch()
    two = {"inputs": ("core", "heater"), "outputs": ("core",)}
    models = {
        "model": MODEL,
        "heated": th.StateSpace(np.eye(2), -1e6 * np.eye(2), 1e5 * np.eye(2), 1e5 * np.ones((1, 2)), **two),
        "quadratic": th.Quadratic(-1e6 * np.eye(2), np.zeros((2, 2, 2)), np.zeros((2, 2)), [1e9, 1e9], [1.0, 1.0]),
    }
    for name, model in models.items():
        surrogate.save_model(model, folder / f"{name}.json")
    surrogate.save_model(MODEL, folder / "broken.json", provenance={"geometry": "[[layer"})
    surrogate.save_model(MODEL, folder / "claim.json", provenance={"error_bound": -1})
    times, wave = np.linspace(0, 2e-6, 41), th.Pulse(1e-3, 1e-6)
    th.save(th.dataset.build(times, MODEL.response(wave, times), wave), folder / "data.nc")
    th.save(surrogate.judge({"one": MODEL}, MODEL, periods=[1e-7, 1e-6]), folder / "map.nc")
    return folder


TABLE = ["fit", "two.csv", "--power", "1 mW"]
SPREAD = ["uncertainty", "f.json", "--spread", "box=2 um,1 nm"]
HEATED = ["simulate", "heated.json", "--heated", "core"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        # usage
        (["nosuch"], "No such command 'nosuch'; `thermofem --help` lists what there is"),
        (["solve", "--nosuch"], "No such option: --nosuch; `thermofem solve --help` lists what there is"),
        (["fit"], "Missing argument 'data'; `thermofem fit --help` lists what there is"),
        (["solve", "--samples", "1"], "'--samples'"),
        (["solve", "--samples", "100000000000"], "'--samples'"),
        # quantities
        (["solve", "--power", "2"], "--power"),
        (["solve", "--power", "2 mV"], "--power"),
        (["solve", "--power", "2 parsnips"], "parsnips"),
        (["solve", "--power", "8 dbm"], "did you mean 'dBm'"),
        (["solve", "--power", "1 mW*9**9**9**9"], "is not a unit"),
        (["solve", "--power", "1 GW"], "--power 1 GW: power = 1e+09 must lie between 0 and 10 (in W)"),
        (["solve", "--square", "1 h"], "--square 1 h: period = 3600 is larger than 10 (in s)"),
        (["solve", "--square", "1 us", "--duty", "-0.3"], "duty = -0.3"),
        (["solve", "--accuracy", "7"], "accuracy = 7"),
        (["solve", "--field-times", ","], "--field-times = ''"),
        ([*TABLE, "--pulse", "0 us"], "--pulse = '0 us' must be larger than zero"),
        (["fit", "two.csv", "--power", "-1 mW"], "--power = '-1 mW' must not be negative; a power is needed"),
        (["simulate", "model.json", "--detuning", "-10"], "--detuning"),
        (["simulate", "model.json", "--power", "8 dB"], "--power"),
        (["simulate", "model.json", "--duration", "1 ps"], "--duration = 1 ps: run.time has 4 samples"),
        (["cosimulate", "--max-discrepancy", "1 mW"], "--max-discrepancy"),
        (["cosimulate", "--detuning", "1554.2 nm"], "must be a distance from the resonance at 1554.3 nm, not a wav"),
        (["explore", "model.json", "--power", "40 dBm", "-o", "ring.html"], "power"),
        (["explore", "model.json", "--power", "-3 W", "-o", "ring.html"], "power"),
        # contents of files
        (["solve", "missing.toml"], "missing.toml"),
        (["solve", "bad_key.toml"], "thicknes"),
        (["solve", "bad_material.toml"], "SiO3"),
        (["solve", "wide.toml"], "0.45"),
        (["solve", "--read", "cor"], "did you mean 'core'"),
        (["campaign", "bad.toml"], "not valid TOML"),
        (["show", "claim.json"], "provenance.error_bound = -1 must lie between 0 and"),
        (["cite", "broken.json"], "broken.json"),
        (["campaign", "empty.toml"], "geometry is missing"),
        # one kind of file for another
        (["simulate", "strip.toml"], "`thermofem reduce strip.toml -o model.json` makes it from this"),
        (["fit", "strip.toml"], "`thermofem solve strip.toml -o heat.nc` makes it from this"),
        (["show", "table.csv"], "`thermofem fit table.csv --power '1 mW' -o model.json` makes it from this"),
        (["show", "map.nc"], "map.nc holds a result (netCDF) that trains no model, not a thermal model; th.load"),
        (["show", "good.png"], "good.png holds an image, not a thermal model; no command reads one"),
        (
            ["show", "empty.toml"],
            "is nothing that show knows: a thermal model (JSON), a family, or a ring or geometry (TOML)",
        ),
        (["calibrate", "model.json", "map.nc"], "model.json holds a thermal model, not a family of rings"),
        (["design", "strip.toml", "--resistance", "8 K/mW"], "strip.toml holds a geometry, not a family of rings"),
        (["cite", "strip.toml"], "strip.toml holds a geometry, not data (netCDF) or a thermal model"),
        (["map", "optics.toml"], "simulate, cosimulate, map, stability and explore take it with --ring"),
        (["campaign", "strip.toml"], "holds a geometry, not a campaign; thermofem solve"),
        (["reduce", "plan.toml"], "holds a campaign, not a geometry; thermofem campaign and family take it"),
        (["cosimulate", "model.json"], "holds a thermal model, not a geometry"),
        (["stability", "model.json", "--ring", "strip.toml"], "not the optics of a ring"),
        (["simulate", "model.json", "--ring", "borghi2022"], "neither a file nor one of borghi2021, borghi2021-lumped"),
        (["cosimulate", "--predictor", "missing.json"], "missing.json"),
        (["explore", "quadratic.json", "-o", "ring.html"], "surrogate.output_map"),
        # what is written
        (["solve", "-o", "nowhere/heat.nc"], "nowhere is not a folder"),
        (["solve", "-o", "."], "is a folder or a device"),
        (["solve", "-o", f"{'n' * 300}.nc"], "File name too long"),
        (["solve", "-o", "same.png", "--figure", "same.png"], "would be written twice"),
        (["cosimulate", "--figure", "a.txt"], "a.txt"),
        (["explore", "model.json", "-o", "ring.png"], "must end in .html"),
        (["reproduce", "--quick", "-o", "bad.toml/out"], "cannot be made"),
        (["solve", "--paraview", "t.vtk"], "'.vtk' is unknown"),
        (["solve", "--paraview", "t.vtu", "--field-times", "1 us, 2 us"], "holds one time and the data 2"),
        # a file that is read is not written over
        (["map", "model.json", "--ring", "optics.toml", "-o", "optics.toml"], "read and written at once"),
        (["map", "model.json", "--ring", "optics.toml", "--resume", "optics.toml"], "read and written at once"),
        (["stability", "model.json", "--ring", "optics.toml", "-o", "optics.toml"], "read and written at once"),
        ([*SPREAD, "--ring", "optics.toml", "--map", "optics.toml"], "read and written at once"),
        (["solve", "strip.toml", "--paraview", "strip.toml"], "read and written at once"),
        (["validate", "model.json", "--reference", "model.json", "-o", "model.json"], "read and written at once"),
        (["export", "model.json", "--to", "spice", "-o", "model.json"], "read and written at once"),
        # no option is ignored
        (["solve", "--no-solve", "--preview", "a.png", "-o", "b.nc"], "--output b.nc has no effect with --no-solve"),
        (["solve", "--no-solve", "--preview", "a.png", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["solve", "--square", "1 us", "--periodic", "--duration", "3 us"], "--duration 3 us has no effect"),
        (["design", "f.json", "--resistance", "9 K/mW", "--power", "3 dBm"], "--power 3 dBm goes with --period"),
        ([*SPREAD, "--points", "3, 3"], "--points 3, 3 goes with --map"),
        ([*SPREAD, "--detuning", "3 GHz"], "--detuning 3 GHz goes with"),
        ([*SPREAD, "--period", "--map", "m.nc"], "--period and --map"),
        (["simulate", "model.json", "--sweep", "1 GHz, 2 GHz", "--detuning", "3 GHz"], "--detuning 3 GHz has no"),
        (["simulate", "model.json", "--sweep", "1 mW, 2 mW", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["explore", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of a geometry's mesh"),
        (["validate", "model.json", "--reference", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of"),
        # options that need or exclude each other
        (["solve", "--square", "1 us", "--pulse", "1 us"], "exclude each other"),
        (["solve", "--periodic"], "has no period"),
        (["campaign", "plan.toml", "--workers", "2", "--scheduler", "tcp://x:1"], "exclude each other"),
        (["cosimulate", "--paraview", "a.xdmf"], "--field-times"),
        (["reduce", "--tolerance", "-1"], "tolerance"),
        (["solve", "--threads", "0"], "--threads"),
        (["export", "", "--to", "csv"], "thermofem: error:"),
        (["fit", "data.nc", "--kind", "secondorder"], "did you mean 'second-order'"),
        (["fit", "data.nc", "--kind", "sindy"], "[[probe]] in the geometry and solve"),
        (["fit", "data.nc", "data.nc", "--kind", "sindy"], "takes one transient from rest, not 2 files"),
        (["validate", "model.json"], "judged by a --reference"),
        (["export", "model.json"], "--to is missing: the format, one of spice, verilog-a, fmu, mat, csv"),
        (["validate", "strip.toml", "model.json"], "one geometry alone"),
        (["validate", "model.json", "model.json", "--reference", "heated.json"], "MODELS holds 'model' twice"),
        (["validate", "model.json", "--reference", "model.json", "--shortest", "20 us"], "must be below --longest"),
        # tables
        (["fit", "two.csv"], "--power"),
        (["identify", "two.csv", "--detuning", "0 GHz"], "--power is given 0 times for 1 tables"),
        (["identify", "missing.csv"], "missing.csv does not exist"),
        (["show", "note.txt"], "note.txt holds a text without rows of numbers, not a thermal model"),
        (["fit", "note.txt", "--power", "1 mW"], "without rows of numbers"),
        ([*TABLE, "--units", "s,V", "--sensitivity", "10 mV"], "--sensitivity"),
        ([*TABLE, "--duty", "0.5"], "--duty 0.5 goes with --square"),
        (["fit", "two.csv", *TABLE[1:], "--figure", "f.png"], "shows one file; 2 are given"),
        (["fit", "three.csv", "--power", "1 mW"], "--columns"),
        (["fit", "three.csv", "--power", "1 mW", "--time", "a"], "--columns"),
        (["fit", "three.csv", "--power", "1 mW", "--time", "a", "--temperature", "b"], "--units"),
        # maps
        (["map", "model.json", "--points", "2"], "two whole numbers"),
        (["map", "model.json", "--power", "9 dBm, 9 dBm"], "is not above"),
        (["map", "model.json", "--detuning", "10 GHz"], "two quantities"),
        (["map", "model.json", "--resume", "one", "-o", "one"], "give it another name"),
        (["map", "model.json", "--resume", "model.json"], "give it another name"),
        # heaters, sweeps, modulation and further lasers
        (["simulate", "heated.json"], "--heated core"),
        (["simulate", "heated.json", "--heater", "5 kg"], "--heater"),
        (["cosimulate", "--heater", "heatr=5 mW"], "'heatr' is unknown"),
        (["map", "heated.json", "--heater", "heater=5 mW square 1 us"], "--heater heater varies in time"),
        (["explore", "heated.json", "--heater", "oven=1 mW", "-o", "ring.html"], "heater"),
        (["explore", "heated.json", "--heater", "heater=-1 mW", "-o", "ring.html"], "heater"),
        (["explore", "heated.json", "--heated", "oven", "-o", "ring.html"], "oven"),
        ([*HEATED, "--sweep", "20 GHz"], "two quantities"),
        ([*HEATED, "--sweep", "20 GHz, 1 mW"], "--sweep"),
        ([*HEATED, "--modulate", "1 GHz sine"], "ends before its time"),
        ([*HEATED, "--modulate", "3 K square 1 us"], "--modulate"),
        ([*HEATED, "--modulate", "3 mW square 1 us duty x"], "AMOUNT square"),
        ([*HEATED, "--heater", "heater=1 mW pulse 1 us at 2 s"], "begins after the run of"),
        ([*HEATED, "--modulate", "1 mW pulse 1 us at 2 s"], "begins after the run of"),
        ([*HEATED, "--laser", "1 mW pulse 1 us at 1 s, 0 GHz"], "begins after the run of"),
        ([*HEATED, "--laser", "8 dBm"], "POWER DETUNING [on OFFSET]"),
        ([*HEATED, "--laser", "0 GHz 8 dBm"], "a power is needed"),
        ([*HEATED, "--laser", "8 dBm 0 K"], "a frequency is needed"),
        ([*HEATED, "--laser", "1 mW 0 GHz on -400 THz"], "frequency"),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "",
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, every):
    assert words in refused(*arguments, cwd=every)


@pytest.mark.parametrize("to", FORMATS)
def test_an_export_replaces_exports_alone(to, tmp_path):
    """`export scope.json --to csv` replaced the measured scope.csv."""
    ending = FORMATS[to].ending
    surrogate.save_model(MODEL, tmp_path / "scope.json")
    (tmp_path / f"scope{ending}").write_text("time (s),delta_T (K)\n0,0\n")
    assert "exists and is no export" in refused("export", "scope.json", "--to", to, cwd=tmp_path)
    assert thermofem("export", "scope.json", "--to", to, "-o", f"scope{ending}", cwd=tmp_path).returncode == 0
    assert thermofem("export", "scope.json", "--to", to, cwd=tmp_path).returncode == 0  # over the former export


@pytest.mark.parametrize("names", [["bad.nc"], ["good.nc", "bad.nc"]])
def test_an_error_of_the_data_names_the_file(names, folder):
    """`data.delta_T[2] = nan is not finite` stands behind the name of the file."""
    for name, last in (("good.nc", 2.0), ("bad.nc", np.nan)):
        data = th.dataset.build(1e-7 * np.arange(10), np.arange(10.0), th.Constant(1e-3))
        data["delta_T"][2] = last
        data.to_netcdf(folder / name, engine="h5netcdf")
    assert refused("fit", *names, cwd=folder) == "thermofem: error: bad.nc: data.delta_T[2] = nan is not finite\n"


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
