"""Output files: none is replaced that nobody named, and what cannot be written is refused before the work."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from commands import process, thermofem

import coupled
import surrogate
import thermofem as th
from surrogate.export import FORMATS
from thermofem.data import files
from thermofem.data.fields import files_of
from thermofem_cli.files import check_outputs

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
SHORT = ("--duration", "3 us", "--accuracy", "0.05", "--samples", "9")
WITHOUT_UTF8 = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.fixture(scope="module")
def data():
    heat = th.assemble(th.strip_ring(), 0.05)
    return th.solve(heat, th.Constant(1e-3), [0.0, 1e-6], field_times=[1e-7, 1e-6])


def refused(*arguments, cwd):
    """The one line of a command that is refused, and that every file is as before."""
    before = {path: path.read_bytes() for path in cwd.iterdir()}
    done = thermofem(*arguments, cwd=cwd)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
    assert {path: path.read_bytes() for path in cwd.iterdir()} == before
    return done.stderr


@pytest.mark.parametrize("to", FORMATS)
def test_an_export_replaces_exports_alone(to, tmp_path):
    """`export scope.json --to csv` replaced the measured scope.csv, and `export m.cir --to spice` the model."""
    ending = FORMATS[to][1]
    surrogate.save_model(MODEL, tmp_path / "scope.json")
    shutil.copy(tmp_path / "scope.json", tmp_path / f"model{ending}")
    (tmp_path / f"scope{ending}").write_text("time (s),delta_T (K)\n0,0\n")
    told = refused("export", f"model{ending}", "--to", to, cwd=tmp_path)
    assert "read and written at once" in told or (to == "csv" and "holds a table" in told)
    assert "exists and is no export" in refused("export", "scope.json", "--to", to, cwd=tmp_path)
    assert thermofem("export", "scope.json", "--to", to, "-o", f"scope{ending}", cwd=tmp_path).returncode == 0
    written = (tmp_path / f"scope{ending}").read_bytes()
    assert thermofem("export", "scope.json", "--to", to, cwd=tmp_path).returncode == 0  # the former export
    assert len((tmp_path / f"scope{ending}").read_bytes()) == pytest.approx(len(written), abs=50)


def test_a_default_name_is_no_input(tmp_path):
    """The names that validate takes without -o were not held against what it reads."""
    shutil.copy(surrogate.save_model(MODEL, tmp_path / "m.json"), tmp_path / "period_error.nc")
    told = refused("validate", "m.json", "--reference", "period_error.nc", cwd=tmp_path)
    assert "period_error.nc would be read and written at once" in told


def test_a_series_for_paraview_replaces_its_own_files_alone(data, tmp_path):
    (tmp_path / "t_0001.vtu").write_text("mine")
    with pytest.raises(th.InputError, match=r"t_0001\.vtu exists and is no part of an earlier t\.pvd"):
        th.write_fields(data, tmp_path / "t.pvd")
    assert [path.name for path in tmp_path.iterdir()] == ["t_0001.vtu"]
    told = refused("solve", *SHORT, "--paraview", "t.pvd", "--field-times", "1 us, 2 us", cwd=tmp_path)
    assert "t_0001.vtu exists" in told
    (tmp_path / "t_0001.vtu").unlink()
    for _ in range(2):  # the second time over the first
        assert len(th.write_fields(data, tmp_path / "t.pvd")) == 3
    (tmp_path / "t.pvd").write_text("<damaged")
    with pytest.raises(th.InputError, match=r"t_0000\.vtu exists"):
        files_of(tmp_path / "t.pvd", 1)


def test_a_series_that_cannot_be_listed_leaves_nothing(data, tmp_path, monkeypatch):
    def full(times, steps):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("thermofem.data.fields._list_of_steps", full)
    with pytest.raises(th.InputError, match=r"t\.pvd cannot be written: No space left"):
        th.write_fields(data, tmp_path / "t.pvd")
    assert not list(tmp_path.iterdir())


def test_the_ending_for_paraview_is_refused_before_the_work(tmp_path):
    told = refused("solve", "--paraview", "t.vtk", cwd=tmp_path)
    assert "'.vtk' is unknown" in told
    told = refused("solve", "--paraview", "t.vtu", "--field-times", "1 us, 2 us", cwd=tmp_path)
    assert "holds one time and the data 2" in told


def test_the_file_that_two_options_write_is_named(tmp_path):
    told = refused("solve", "-o", "h_0000.vtu", "--paraview", "h.pvd", cwd=tmp_path)
    assert told == "thermofem: error: h_0000.vtu would be written twice; give it another name\n"


def test_a_name_in_a_pvd_is_escaped(data, tmp_path):
    """The list of 'a & "b" <c>.pvd' was no XML."""
    *steps, listing = th.write_fields(data, tmp_path / 'a & "b" <c>.pvd')
    assert [entry.get("file") for entry in ET.parse(listing).iter("DataSet")] == [step.name for step in steps]
    th.write_fields(data, listing)  # which finds the names in it


def test_a_name_that_is_no_utf8_is_refused_by_the_pvd_alone(data, tmp_path):
    """It ended in UnicodeEncodeError, with the .vtu files written."""
    name = os.fsdecode(b"q\xff")
    with pytest.raises(th.InputError, match=r"q\\xff\.pvd is not UTF-8"):
        th.write_fields(data, tmp_path / f"{name}.pvd")
    assert not list(tmp_path.iterdir())
    assert th.write_fields(data, tmp_path / f"{name}.xdmf")[0].is_file()


@pytest.mark.slow
def test_a_pvd_in_a_locale_without_utf8(tmp_path):
    arguments = ("solve", *SHORT, "--field-times", "1 us", "--paraview", "µ.pvd")
    done = process(*arguments, cwd=tmp_path, **WITHOUT_UTF8)
    assert done.returncode == 0, done.stderr
    assert [entry.get("file") for entry in ET.parse(tmp_path / "µ.pvd").iter("DataSet")] == ["µ_0000.vtu"]


@pytest.fixture
def protected(tmp_path, monkeypatch):
    """A folder that cannot be written; tests may run as root, who may write everywhere."""
    folder, access = tmp_path / "locked", os.access
    folder.mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != folder and access(path, mode))
    return folder


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(protected, data, monkeypatch):
    """It was found when the work was done, which was lost."""
    from thermofem.plot import animate_field

    monkeypatch.setattr("thermofem.data.fields._mesh", None)
    for write in (
        lambda: check_outputs([protected / "out.json"]),
        lambda: coupled.explore(coupled.borghi2021(), MODEL, protected / "ring.html"),
        lambda: th.write_fields(data, protected / "t.pvd"),
        lambda: animate_field(data, protected / "t.gif"),
        lambda: surrogate.export_model(MODEL, protected / "m.csv", to="csv"),
        lambda: files.make_folder(protected),
    ):
        with pytest.raises(th.InputError, match=f"folder {protected} cannot be written; make it writable"):
            write()
    assert not os.listdir(protected)


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/stderr", "/dev/fd/1", "/proc/self/fd/1", "link", "deep/stdout"])
def test_an_open_stream_is_no_output(name, tmp_path):
    """`reduce -q -o /dev/stdout >> log.txt` replaced log.txt."""
    (tmp_path / "link").symlink_to("/dev/stdout")
    (tmp_path / "deep").symlink_to("/dev")
    (tmp_path / "log.txt").write_text("kept\n")
    code = "from thermofem import files, InputError; import sys\ntry: files.check_target(sys.argv[1])\n"
    code += "except InputError as error: sys.exit(str(error)[-70:])"
    with (tmp_path / "log.txt").open("a") as log:
        run = [sys.executable, "-c", code, name]
        done = subprocess.run(run, stdout=log, stderr=subprocess.PIPE, text=True, cwd=tmp_path, check=False)
        path = files.checks.path("path", f"/proc/{os.getpid()}/fd/{log.fileno()}")
        with pytest.raises(th.InputError, match="leads to an open file of a process"):
            files.check_target(path)
    assert "leads to an open file of a process; give the name of a file" in done.stderr
    assert (tmp_path / "log.txt").read_text() == "kept\n"


@pytest.mark.parametrize("name", ["one.json", "self.json", "self.png"])
def test_a_loop_of_links_is_no_output(name, tmp_path):
    """The link was replaced by the file, with exit code 0."""
    for link, to in (("one.json", "two.json"), ("two.json", "one.json"), ("self.json", "self.json"), ("self.png",) * 2):
        (tmp_path / link).symlink_to(to)
    with pytest.raises(th.InputError, match=rf"{name} is a link that leads back to itself; delete it"):
        files.write_whole(tmp_path / name, lambda path: path.write_text("new"))
    assert (tmp_path / name).is_symlink()
    (tmp_path / "new.json").symlink_to("made.json")  # a link that leads to no file is written through
    assert files.check_target(tmp_path / "new.json") == tmp_path / "made.json"


def test_a_relative_name_in_a_folder_that_was_deleted(tmp_path, monkeypatch):
    """The error was that of the name: "x.json... cannot be written: No such file or directory"."""
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    with pytest.raises(th.InputError, match="current folder was deleted; change into"):
        files.check_target("x.json")


def test_a_read_only_disk_is_named_with_the_file(tmp_path, monkeypatch):
    """The error named the hidden temporary file, whose removal fails with the same words."""

    def read_only(path, *more, **options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(os, "open", read_only)
    monkeypatch.setattr(Path, "unlink", read_only)
    with pytest.raises(th.InputError, match=r"out\.nc cannot be written: Read-only file system"):
        files.write_whole(tmp_path / "out.nc", lambda path: None)


@pytest.mark.parametrize("name", [b"q\xff", "mµ".encode()])
def test_names_of_files_are_labels_that_can_be_written(name, tmp_path):
    r"""`validate q\xff.json` did all the work and could not write its curves."""
    path = os.fsdecode(name + b".json")
    surrogate.save_model(MODEL, tmp_path / path)
    done = thermofem("validate", path, "--reference", path, "-o", "v.nc", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    label = name.decode(errors="backslashreplace")
    assert th.load(tmp_path / "v.nc")["model"].values.tolist() == [label]
    page = thermofem("explore", path, "-o", "r.html", cwd=tmp_path)
    assert page.returncode == 0, page.stderr


def test_tables_of_any_name_make_data_that_can_be_written(tmp_path):
    times = np.linspace(0, 5e-6, 60)
    rows = np.column_stack([times, MODEL.step_response(times) * 1e-3])
    np.savetxt(table := tmp_path / os.fsdecode(b"q\xff.csv"), rows, delimiter=",", header="time (s),T (K)", comments="")
    trained = th.read_trace(table, 1e-3)
    assert trained.attrs["source"] == r"q\xff.csv"
    th.save(trained, tmp_path / "data.nc")


@pytest.mark.slow
def test_reduce_gives_every_resistance_as_json(tmp_path):
    import json

    (tmp_path / "two.toml").write_text(th.strip_ring().to_toml())
    done = thermofem("reduce", "two.toml", "--read", "core, box", "--json", "--accuracy", "0.05", cwd=tmp_path)
    numbers = json.loads(done.stdout)
    assert (numbers["heated"], numbers["read"]) == (["core"], ["core", "box"])
    for to, (value,) in zip(numbers["read"], numbers["thermal_resistance"], strict=True):
        assert f"R_th = {value / 1e3:.4g} K/mW from core to {to}" in done.stderr
