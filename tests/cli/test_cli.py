"""The command line; through real processes where how it starts matters."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from commands import process, thermofem

import surrogate
import thermofem as th

GEOMETRY, ONE_POLE = th.strip_ring().to_toml(), th.Foster(R=[5e3], tau=[1e-6])


def test_help_and_version(tmp_path):
    done = process("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in ("solve", "campaign", "reproduce", "doctor"):
        assert command in done.stdout
    assert process("--version", cwd=tmp_path).stdout.strip() == th.__version__


def test_solve_writes_what_the_library_computes(tmp_path):
    (tmp_path / "ring.toml").write_text(GEOMETRY)
    arguments = "--power=1 mW", "--pulse=1 us", "--duration=2 us", "--samples=11", "--read=core", "--preview=mesh.png"
    done = thermofem("solve", "ring.toml", *arguments, "-o", "heat.nc", "--figure", "heat.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = th.load(tmp_path / "heat.nc")
    expected = th.solve(th.assemble(th.strip_ring()), th.Pulse(1e-3, 1e-6), np.linspace(0, 2e-6, 11))
    assert np.array_equal(data.delta_T, expected.delta_T)
    for picture in ("heat.png", "mesh.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")


def test_solve_periodic(tmp_path):
    done = thermofem("solve", "--square", "1 us", "--duty", "0.33", "--periodic", "--samples", "101", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = th.load(tmp_path / "heat.nc")
    assert data.attrs["kind"] == "periodic"
    assert np.ptp(data.delta_T.values) == pytest.approx(6.3354375, rel=1e-3)  # converged reference at accuracy 1e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "missing.toml"], "missing.toml"),
        (["solve", "bad_key.toml"], "thicknes"),
        (["solve", "bad_material.toml"], "SiO3"),
        (["solve", "wide.toml"], "0.45"),
        (["solve", "--power", "2 mV"], "--power"),
        (["solve", "--power", "2 parsnips"], "parsnips"),
        (["solve", "--power", "2"], "--power"),
        (["solve", "--square", "1 us", "--duty", "-0.3"], "duty = -0.3"),
        (["solve", "--square", "1 us", "--pulse", "1 us"], "exclude each other"),
        (["solve", "--square", "1 h"], "--square 1 h: period = 3600 is larger than 10 (in s)"),
        (["solve", "--pulse", "1 h"], "--pulse 1 h: width = 3600 is larger than 10 (in s)"),
        (["solve", "--power", "1 GW"], "--power 1 GW: power = 1e+09 must lie between 0 and 10 (in W)"),
        (["solve", "--samples", "1"], "'--samples'"),
        (["solve", "--accuracy", "7"], "accuracy = 7"),
        (["solve", "--read", "cor"], "did you mean 'core'"),
        (["solve", "--periodic"], "has no period"),
        (["solve", "-o", "nowhere/heat.nc"], "nowhere is not a folder"),
        (["solve", "--nonsense"], "--nonsense"),
        (["solve", "good.toml", "-o", "good.toml"], "read and written at once"),
        (["solve", "-o", "same.png", "--figure", "same.png"], "would be written twice"),
        (["solve", "-o", "."], "is a folder or a device"),
        (["solve", "--samples", "100000000000"], "'--samples'"),
        (["solve", "--field-times", ","], "--field-times = ''"),
        (["reproduce", "--quick", "-o", "bad_key.toml/out"], "cannot be made"),
        (["simulate", "good.toml"], "`thermofem reduce good.toml -o model.json` makes it from this"),
        (["fit", "good.toml"], "`thermofem solve good.toml -o heat.nc` makes it from this"),
        (["show", "map.nc"], "map.nc holds a result (netCDF) that trains no model, not a thermal model; th.load"),
        (["fit", "map.nc"], "map.nc holds a result (netCDF) that trains no model, not data (netCDF) or a table"),
        (["show", "table.csv"], "`thermofem fit table.csv --power '1 mW' -o model.json` makes it from this"),
        (["show", "good.png"], "good.png holds an image, not a thermal model; no command reads one"),
        (["show", "empty.toml"], "is nothing that show knows: a thermal model (JSON), or a ring or geometry (TOML)"),
        (["calibrate", "model.json", "map.nc"], "model.json holds a thermal model, not a family of rings"),
        (["design", "good.toml", "--resistance", "8 K/mW"], "good.toml holds a geometry, not a family of rings"),
        (["cite", "good.toml"], "good.toml holds a geometry, not data (netCDF) or a thermal model"),
        (["map", "optics.toml"], "simulate, cosimulate, map, stability and explore take it with --ring"),
        (["solve", "optics.toml"], "holds the optics of a ring, not a geometry"),
        (["campaign", "good.toml"], "holds a geometry, not a campaign; thermofem solve"),
        (["reduce", "plan.toml"], "holds a campaign, not a geometry; thermofem campaign takes it"),
        (["fit", "table.csv"], "thermofem.read_trace makes training data of it"),
        (["cosimulate", "model.json"], "holds a thermal model, not a geometry"),
        (["stability", "model.json", "--ring", "good.toml"], "not the optics of a ring"),
        (["solve", "-o", f"{'n' * 300}.nc"], "File name too long"),
        (["cite", f"{'n' * 300}.nc"], "File name too long"),
        (["cosimulate", "--detuning", "1554.2 nm"], "must be a distance from the resonance at 1554.3 nm, not a wav"),
        (["campaign", "missing.toml"], "campaign file 'missing.toml' does not exist"),
        (["campaign", "bad.toml"], "not valid TOML"),
        (["campaign", "empty.toml"], "geometry is missing"),
        (["campaign", "plan.toml", "-o", "bad.toml/out"], "cannot be made"),
        (["campaign", "plan.toml", "--workers", "0"], "--workers"),
        (["campaign", "plan.toml", "--workers", "2", "--scheduler", "tcp://x:1"], "exclude each other"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, tmp_path):
    (tmp_path / "good.toml").write_text(GEOMETRY)
    (tmp_path / "bad.toml").write_text("geometry = ")
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "bad_key.toml").write_text(GEOMETRY.replace("thickness", "thicknes", 1))
    (tmp_path / "bad_material.toml").write_text(GEOMETRY.replace('"SiO2"', '"SiO3"', 1))
    (tmp_path / "wide.toml").write_text(GEOMETRY.replace("450 nm", "0.45 m"))
    (tmp_path / "optics.toml").write_text('base = "borghi2021"\n')
    (tmp_path / "plan.toml").write_text('geometry = "good.toml"\n[[drive]]\npower = "1 mW"\n')
    (tmp_path / "good.png").touch()
    (tmp_path / "table.csv").write_text("Time (us),T (K)\n0,1\n1,2\n")
    th.save(surrogate.judge({"one": ONE_POLE}, ONE_POLE, periods=[1e-7, 1e-6]), tmp_path / "map.nc")
    surrogate.save_model(ONE_POLE, tmp_path / "model.json")
    before = sorted(tmp_path.iterdir())
    done = thermofem(*arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(tmp_path.iterdir()) == before  # nothing half-written


@pytest.mark.slow
def test_doctor_names_the_missing_library(tmp_path, monkeypatch):
    """gmsh that cannot load its shared library: doctor says which, and strips still solve on the committed mesh."""
    (tmp_path / "gmsh.py").write_text(
        "raise OSError('libGLU.so.1: cannot open shared object file: No such file or directory')"
    )
    done = process("doctor", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode == 1
    assert "libGLU.so.1" in done.stdout
    assert "libglu1-mesa" in done.stdout
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    (tmp_path / "new.toml").write_text(th.rib_ring().to_toml())
    done = thermofem("solve", "new.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "libglu1-mesa" in done.stderr
    done = thermofem("solve", "--duration", "1 us", "--samples", "3", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_solve_preview_alone_writes_no_data(tmp_path):
    for option, name in (((), "preview.png"), (("--preview", "ring.png"), "ring.png")):
        done = thermofem("solve", *option, "--no-solve", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert len([*tmp_path.iterdir()]) == 2


def test_solve_writes_fields(tmp_path):
    arguments = ["solve", "--duration", "1 us", "--samples", "3", "--field-times", "0.2 us, 1 us"]
    done = thermofem(*arguments, "--paraview", "heat.xdmf", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = th.load(tmp_path / "heat.nc")
    assert data.field_time.values.tolist() == [0.2e-6, 1e-6]
    assert "Time Value" in (tmp_path / "heat.xdmf").read_text()
    done = thermofem("solve", "--square", "1 us", "--periodic", "--field-times", "1 us", cwd=tmp_path)
    assert done.returncode == 2
    assert "has no effect with --periodic" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["solve", "--nosuch"], "No such option: --nosuch; `thermofem solve --help` lists what there is"),
        (["nosuch"], "No such command 'nosuch'; `thermofem --help` lists what there is"),
        (["solve", "--samples", "1e9"], "Invalid value for '--samples'"),
        (["fit"], "Missing argument 'data'; `thermofem fit --help` lists what there is"),
    ],
)
def test_wrong_usage_is_one_line_too(arguments, said, monkeypatch, capsys):
    from thermofem_cli import main

    monkeypatch.setattr("sys.argv", ["thermofem", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    error = capsys.readouterr().err
    assert stop.value.code == 2
    assert error.startswith(f"thermofem: error: {said}")
    assert error.count("\n") == 1
