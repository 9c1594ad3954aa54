"""What ends a command from outside: Ctrl-C, SIGTERM, a reader that has gone, another run in the same folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

import surrogate
import thermofem as th
from surrogate.family.snapshots import Solver
from thermofem.campaign.store import ResultStore
from thermofem.data import files
from thermofem_cli.reproduce import run

MODEL = th.Foster(R=[2e3], tau=[5e-8])
SWALLOWS = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0)
except BaseException:
    pass
"""
IMPORTS = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored
from thermofem import __main__, cli
cli.main = lambda: __import__("swallows")
__main__.run()
"""
WRITES = """
import os, signal, sys
from thermofem import files
def write(path):
    path.write_text("half")
    os.kill(os.getpid(), signal.{signal})
    path.write_text("whole")
files.write_whole(sys.argv[1], write)
"""


def python(code, *arguments, cwd):
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


def test_ctrl_c_while_a_library_is_imported(tmp_path):
    """A library that swallowed KeyboardInterrupt went on to the end; others left a traceback."""
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    done = python(IMPORTS, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "thermofem: interrupted\n")


def test_sigterm_leaves_no_temporary_file(tmp_path):
    done = python(WRITES.format(signal="SIGTERM"), tmp_path / "out.txt", cwd=tmp_path)
    assert done.returncode == -signal.SIGTERM, done.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_sigkill_leaves_is_swept_from_a_locked_folder(tmp_path):
    python(WRITES.format(signal="SIGKILL"), tmp_path / "out.txt", cwd=tmp_path)
    (tmp_path / ".mine-1.txt").write_text("stays")
    assert len(list(tmp_path.iterdir())) == 2
    files.sweep(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [".mine-1.txt"]


@pytest.mark.parametrize(("age", "left"), [(2 * files.FRESH, ["out.txt"]), (0.0, [".out", "out.txt"])])
def test_what_sigkill_leaves_goes_with_the_next_write(age, left, tmp_path):
    """It stayed for ever; a file that was touched just now may be that of a writer between making and locking it."""
    python(WRITES.format(signal="SIGKILL"), tmp_path / "out.txt", cwd=tmp_path)
    (leftover,) = tmp_path.iterdir()
    os.utime(leftover, (time.time() - age,) * 2)
    files.write_whole(tmp_path / "out.txt", lambda path: path.write_text("whole"))
    assert sorted(path.name.split("-")[0] for path in tmp_path.iterdir()) == left


def test_the_temporary_file_of_a_living_writer_stays(tmp_path):
    code = WRITES.format(signal="SIGSTOP")
    writer = subprocess.Popen([sys.executable, "-c", code, tmp_path / "out.txt"])
    try:
        os.waitpid(writer.pid, os.WUNTRACED)
        (temporary,) = tmp_path.iterdir()
        os.utime(temporary, (0.0, 0.0))
        files.write_whole(tmp_path / "out.txt", lambda path: path.write_text("other"))
        assert temporary.is_file()
    finally:
        os.kill(writer.pid, signal.SIGCONT)
    assert writer.wait() == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]
    assert (tmp_path / "out.txt").read_text() == "whole"


@pytest.mark.slow
def test_workers_of_a_killed_training_end(tmp_path):
    """Those of `family --workers 2` lived on for ever: standard error stayed open."""
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    vary = 'path = "layer.box.thickness"\nfrom = "1 um"\nto = "3 um"\n'
    (tmp_path / "rings.toml").write_text(f'geometry = "strip.toml"\n[[vary]]\n{vary}')
    command = [sys.executable, "-m", "thermofem", "family", "rings.toml", "--workers", "2", "--folder", "parts"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, cwd=tmp_path) as training:
        until = time.monotonic() + 60
        while not list(tmp_path.glob("parts/*.npz")) and time.monotonic() < until and training.poll() is None:
            time.sleep(0.05)
        assert training.poll() is None
        training.kill()
        training.communicate(timeout=15)  # ends when the last worker has closed it


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    """A file of the user alone became one that everybody could read."""
    path = tmp_path / "out.txt"
    path.write_text("old")
    path.chmod(0o600)
    files.write_whole(path, lambda path: path.write_text("new"))
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o600)


def test_a_write_protected_file_stays(tmp_path, monkeypatch):
    path = tmp_path / "out.txt"
    path.write_text("old")
    monkeypatch.setattr(os, "access", lambda at, _: at != path)  # tests may run as root, who may write everywhere
    with pytest.raises(th.InputError, match="write-protected"):
        files.write_whole(path, lambda path: path.write_text("new"))
    assert path.read_text() == "old"


@pytest.mark.parametrize("name", [".lock", "index.nc", "results.sha256"])
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_folder_of_somebody_else_writes_nowhere_else(name, kind, tmp_path):
    """A link in the folder of a campaign had the file that it names overwritten; a pipe was waited for."""
    folder, victim = tmp_path / "rings", tmp_path / "victim.txt"
    folder.mkdir()
    victim.write_text("precious")
    if kind == "link":
        (folder / name).symlink_to(victim)
    elif kind == "folder":  # was "Is a directory", for a campaign that had begun
        (folder / name).mkdir()
    else:
        os.mkfifo(folder / name)
    with pytest.raises(th.InputError, match=f"{name} is a"), files.folder_locked(folder):
        pass
    with pytest.raises(th.InputError, match=f"{name} is a"):
        files.sweep(folder)
    with pytest.raises(th.InputError, match=f"{name} is a"):
        Solver("key", folder=folder)
    assert victim.read_text() == "precious"


def test_a_linked_folder_of_results_is_not_followed(tmp_path):
    """Results were written, and half-written ones deleted, where the link leads."""
    (tmp_path / "other").mkdir()
    (tmp_path / "rings").mkdir()
    (tmp_path / "rings" / "results").symlink_to(tmp_path / "other")
    store = ResultStore(tmp_path / "rings")
    with pytest.raises(th.InputError, match="results is a link"), store.opened():
        pass


@pytest.mark.parametrize("arguments", [["show", "model.json"], ["show", "model.json", "--json", "-q"], ["--help"]])
def test_a_reader_that_has_gone_ends_a_command_without_a_word(arguments, tmp_path):
    """The exit code was 1, which is a finding of `doctor`."""
    surrogate.save_model(MODEL, tmp_path / "model.json")
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "thermofem", *arguments]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, cwd=tmp_path, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_second_reproduction_of_a_folder_is_refused(tmp_path):
    with files.folder_locked(tmp_path), pytest.raises(th.InputError, match="in use by another run"):
        run(tmp_path)
