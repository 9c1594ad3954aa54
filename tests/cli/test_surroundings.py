"""Commands do the same whatever the working folder, the environment and the caller's streams hold."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
from commands import WIDE, process, thermofem

import surrogate
import thermofem as th
from thermofem_cli import _unforeseen

SIMULATE = ("simulate", "m.json", "--duration", "0.1 us", "--figure", "run.png")
WORKER = """
import sys
from multiprocessing import Pipe
from pathlib import Path
from thermofem_cli.reproduce import Settings
from thermofem_cli.reproduce.workers import _work
one, other = Pipe()
one.close()
_work(Path("out"), Settings(), other)
import matplotlib
print(matplotlib.rcParams["backend"])
"""


@pytest.fixture
def folder(tmp_path):
    """A model in a folder with somebody else's settings: modules that Matplotlib would import, Numba without code."""
    surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), tmp_path / "m.json")
    (tmp_path / "evil.py").write_text("open('executed', 'w')\n")
    (tmp_path / "matplotlibrc").write_text("backend: module://evil\ntext.usetex: True\n")
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    return tmp_path


def test_settings_in_the_working_folder_are_nobodys(folder):
    """They named programs (`animation.ffmpeg_path`), modules (`backend`), folders of stored code (`cache_dir`)."""
    done = process(*SIMULATE, cwd=folder)
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)
    assert (folder / "run.png").stat().st_size > 1000
    assert not (folder / "executed").exists()


def test_figures_of_a_command_that_a_notebook_starts(folder):
    """Jupyter asks for its own backend, which the environment of the command need not have."""
    (folder / "matplotlibrc").rename(folder / "mine")
    notebook = {"MPLBACKEND": "module://nobody_has.this", "MATPLOTLIBRC": str(folder / "mine")}
    done = process(*SIMULATE, cwd=folder, **notebook)
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)
    assert (folder / "run.png").exists()


def test_processes_of_a_reproduction_draw_without_settings_too(folder):
    asked = subprocess.run([sys.executable, "-c", WORKER], cwd=folder, capture_output=True, text=True, check=True)
    assert asked.stdout == "agg\n"
    assert not (folder / "executed").exists()


def test_commands_without_figures_load_no_matplotlib(folder):
    asked = "import sys; sys.argv[1:] = ['show', 'm.json']; from thermofem_cli import main; main(); "
    done = subprocess.run(
        [sys.executable, "-c", asked + "print('matplotlib' in sys.modules)"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.endswith("False\n")


@pytest.mark.skipif(os.name == "nt", reason="the words of a POSIX shell")
@pytest.mark.parametrize("closed", ["2>&-", "0<&- >&- 2>&-"])
def test_a_closed_standard_error_changes_nothing(closed, folder):
    """Daemons and some batch systems close it; the file must be the result alone, and nothing printed into it."""
    command = f'exec "$0" -m thermofem "$@" {closed}'
    words = ["sh", "-c", command, sys.executable, *SIMULATE, "-o", "run.nc"]
    environment = {**os.environ, **WIDE}
    assert subprocess.run(words, cwd=folder, env=environment, check=False, stdout=subprocess.PIPE).returncode == 0
    assert th.load(folder / "run.nc").sizes["time"] > 2
    assert (folder / "run.png").exists()
    words[words.index("m.json")] = "nothing.json"
    assert subprocess.run(words, cwd=folder, env=environment, check=False).returncode == 2


def test_numba_without_compilation_is_named(folder):
    """Its variable for debugging left half of the kernels without what they call: a TypeError."""
    done = process(*SIMULATE, cwd=folder, NUMBA_DISABLE_JIT="1")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("thermofem: error: NUMBA_DISABLE_JIT is set")
    assert "Traceback" not in done.stderr


def test_numba_that_does_not_start_is_named(folder):
    """Its import raised ValueError, and the command ended in a traceback."""
    done = process(*SIMULATE, cwd=folder, NUMBA_NUM_THREADS="0")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("thermofem: error: Numba does not start: Number of threads")
    found = process("doctor", "--json", cwd=folder, NUMBA_NUM_THREADS="0")
    assert (found.returncode, found.stderr.count("Traceback")) == (1, 0)
    assert "Numba does not start" in found.stderr + found.stdout


def test_byte_code_that_a_full_disk_cut_off_is_compiled_again(tmp_path):
    """Python before 3.13 stores what fits of it, and every later start ended in an unforeseen EOFError."""
    stored = {"PYTHONPYCACHEPREFIX": str(tmp_path), "PYTHONDONTWRITEBYTECODE": ""}
    assert process("--version", cwd=tmp_path, **stored).returncode == 0
    (cut,) = tmp_path.rglob("thermofem_cli/group.*.pyc")
    whole = cut.read_bytes()
    cut.write_bytes(whole[:300])
    assert process("--version", cwd=tmp_path, **stored).returncode == 0
    assert process("--version", cwd=tmp_path, **stored).returncode == 0
    assert cut.read_bytes() == whole


def test_an_error_that_nobody_foresaw_is_one_line_with_its_cause(folder, tmp_path):
    """Dask reads its settings where xarray looks at an array: two chained errors and the whole array were printed."""
    pytest.importorskip("dask")
    (tmp_path / "dask.yaml").write_text("a word alone\n")
    done = process(*SIMULATE, cwd=folder, DASK_CONFIG=str(tmp_path / "dask.yaml"))
    assert done.returncode == 70
    assert "Traceback" not in done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("thermofem: error: unforeseen ValueError: A dask config file")
    assert last.endswith("--verbose shows where; please report it")
    more = process(*SIMULATE, "--verbose", cwd=folder, DASK_CONFIG=str(tmp_path / "dask.yaml"))
    assert (more.returncode, "Traceback" in more.stderr) == (1, True)


def test_an_error_that_was_dealt_with_is_not_the_cause():
    """Numba asks an object for an attribute that it need not have; what failed after that was not said."""
    error = RuntimeError("can't start new thread")
    error.__context__ = AttributeError("'list' object has no attribute 'name'")
    assert "no more threads" in _unforeseen(error)


def test_no_more_threads_are_named(monkeypatch, folder):
    def none(*args):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("threading.Thread.start", none)
    done = thermofem("stability", "m.json", "--points", "3, 3", "-o", "s.nc", cwd=folder)
    assert (done.returncode, done.stderr.splitlines()[-1][:64]) == (
        70,
        "thermofem: error: the system allows this user no more threads; r",
    )


@pytest.mark.parametrize("address", ["x", "tls://localhost:1"])
def test_an_address_of_no_cluster_is_one_line(address, tmp_path):
    """Dask's client waited for 20 s and printed a traceback when it was deleted; without TLS set up, a TypeError."""
    pytest.importorskip("distributed")
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    vary = '[[vary]]\npath = "material.SiO2.conductivity"\nvalues = ["1 W/m/K", "2 W/m/K"]\n'
    (tmp_path / "plan.toml").write_text(f'geometry = "strip.toml"\n{vary}[[drive]]\npower = "1 mW"\n')
    begun = time.monotonic()
    done = process("campaign", "plan.toml", "-o", "out", "--scheduler", address, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"thermofem: error: --scheduler = '{address}' does not answer")
    assert time.monotonic() - begun < 15


@pytest.mark.parametrize("given", ["abc", "1e9", "99999999999999"])
def test_a_date_for_figures_that_is_none_is_named(given, tmp_path, monkeypatch):
    """Matplotlib raised when it wrote the figure, after the work, with exit code 70."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", given)
    for ending in ("pdf", "svg"):
        done = thermofem("solve", "--figure", f"heat.{ending}", cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n"), os.listdir(tmp_path)) == (2, 1, [])
        assert done.stderr.startswith(f"thermofem: error: SOURCE_DATE_EPOCH = {given!r} of the environment must be")
    th.files.check_image("heat.png")  # which holds no date
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    th.files.check_image("heat.pdf")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_unit_is_built_in_a_locale_without_utf8(fmi, tmp_path, monkeypatch):
    """The builder read the script, which names the parts, in the encoding of the locale."""
    for name, value in {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}.items():
        monkeypatch.setenv(name, value)
    model = th.Foster(R=[2e3], tau=[5e-8], inputs=("kern µ",), outputs=("kern µ",))
    surrogate.export_model(model, tmp_path / "m.fmu", to="fmu", fmi=fmi)
