"""The command line; through real processes where how it starts matters."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from commands import process, thermofem

import coupled
import thermofem as th
from thermofem_cli import options

GEOMETRY, ONE_POLE = th.strip_ring().to_toml(), th.Foster(R=[5e3], tau=[1e-6])


def test_help_and_version(tmp_path):
    done = process("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in ("solve", "campaign", "reproduce", "doctor"):
        assert command in done.stdout
    assert process("--version", cwd=tmp_path).stdout.strip() == th.__version__


STARTED = "import sys; from thermofem_cli import main; sys.argv = {}\ntry: main()\nfinally: print(*sys.modules)"


@pytest.mark.parametrize(
    ("arguments", "absent"),
    [
        (["--version"], {"thermofem", "numpy", "scipy", "skfem", "xarray", "rich.console"}),
        (["--help"], {"thermofem", "numpy", "scipy", "skfem", "xarray"}),
        (["solve", "--no-solve"], {"coupled", "surrogate", "gmsh"}),
        (["simulate", "absent.json"], {"surrogate", "skfem.visuals", "gmsh", "matplotlib"}),
    ],
    ids=lambda given: given[0] if isinstance(given, list) else "",
)
def test_a_command_imports_what_it_needs(tmp_path, arguments, absent):
    code = STARTED.format(["thermofem", *arguments])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "thermofem_cli" in loaded
    assert loaded & absent == set()


def test_the_help_names_the_published_rings():
    for name in coupled.parameters.published_rings():
        assert name in options.RING


def test_show_takes_the_name_of_a_published_ring(tmp_path):
    """The numbers of the ring that coupled.borghi2021() is, derived ones too; an absent file is called so."""
    done = thermofem("show", "borghi2021", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["loaded_q"] == coupled.borghi2021().loaded_q
    assert "does not exist" in thermofem("show", "borghi2022", cwd=tmp_path).stderr


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


def test_solve_and_reduce_take_a_mesh_of_ones_own(tmp_path):
    """The coarser mesh is taken as it is: its R_th is its own, not that of accuracy 1e-3."""
    (tmp_path / "ring.toml").write_text(GEOMETRY)
    heat = th.assemble(th.strip_ring(), accuracy=1e-2)
    heat.mesh.save(tmp_path / "own.msh")
    own = heat.thermal_resistance("core")
    assert abs(own / th.assemble(th.strip_ring()).thermal_resistance("core") - 1) > 1e-5
    done = thermofem("solve", "ring.toml", "--mesh", "own.msh", "--samples", "3", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert th.load(tmp_path / "heat.nc").attrs["thermal_resistance"] == pytest.approx(own, rel=1e-12)
    done = thermofem("reduce", "ring.toml", "--mesh", "own.msh", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert th.models.load_model(tmp_path / "model.json").thermal_resistance == pytest.approx(own, rel=1e-9)


def test_solve_periodic(tmp_path):
    done = thermofem("solve", "--square", "1 us", "--duty", "0.33", "--periodic", "--samples", "101", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = th.load(tmp_path / "heat.nc")
    assert data.attrs["kind"] == "periodic"
    assert np.ptp(data.delta_T.values) == pytest.approx(6.3354375, rel=1e-3)  # converged reference at accuracy 1e-3


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
