"""Runs of campaigns: nothing is lost, repeated or wrong whatever happens to processes and disks; memory; Dask."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from campaigns import OXIDE, make, marks, write
from processes import children, wait_for

import thermofem as th
from thermofem.campaign import Variation, work
from thermofem.campaign.run import _Loop

pytestmark = pytest.mark.slow


def test_a_failing_geometry_is_recorded_and_the_others_go_on(tmp_path, threads):
    campaign = make(3, bad=1)
    summary = campaign.run(tmp_path, threads)
    assert (summary.finished, summary.failed) == (2, 1)
    with th.open_campaign(tmp_path) as data:
        assert data.status.values.tolist() == ["finished", "failed", "finished"]
        assert "conductivity" in data.reason.values[1]
        assert np.isnan(data.thermal_resistance.values[1]).all()
        assert not np.isnan(data.delta_T_step.values[[0, 2]]).any()
    before = marks(tmp_path)
    tried = []
    campaign.run(tmp_path, threads, report=tried.append)
    assert [s.failed for s in tried] == [1]  # known from the start, not tried again
    tried.clear()
    campaign.run(tmp_path, threads, retry_failed=True, report=tried.append)
    assert [s.failed for s in tried] == [0, 1]
    assert marks(tmp_path) == before
    with xr.open_dataset(tmp_path / "training.nc", engine="h5netcdf") as training:
        assert training.features.values[:, 0].tolist() == [1.0, 1.4]


def test_a_larger_campaign_keeps_what_is_there(tmp_path, threads):
    make(3).run(tmp_path, threads)
    before = marks(tmp_path)
    summary = make(5).run(tmp_path, threads)  # 1.0, 1.1, ... 1.4: three of five are there
    assert (summary.reused, summary.finished) == (3, 2)
    assert before.items() <= marks(tmp_path).items()


def test_a_damaged_result_is_made_again(tmp_path, threads):
    make(2).run(tmp_path, threads)
    path = sorted((tmp_path / "results").glob("*.nc"))[0]
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(th.InputError):
        th.load(path)
    assert make(2).run(tmp_path, threads).finished == 1
    th.load(path)


def poisoned(task: work.Task) -> work.Outcome:
    """A geometry that takes its process with it."""
    if json.loads(task.values)["oxide"] == 1.2:
        os.kill(os.getpid(), signal.SIGKILL)
    return work.compute(task)


def test_a_geometry_that_kills_its_worker_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr("thermofem.campaign.run.compute", poisoned)
    summary = make(5).run(tmp_path, workers=1)
    assert (summary.finished, summary.failed) == (4, 1)
    with th.open_campaign(tmp_path) as data:
        assert data.status.values.tolist() == ["finished", "finished", "failed", "finished", "finished"]
        assert "worker process died" in data.reason.values[2]


def test_a_killed_worker_loses_nothing(tmp_path):
    seen = []

    def kill_once(summary):
        seen.append(marks(tmp_path))
        if summary.finished == 1:
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    summary = make(6).run(tmp_path, workers=2, report=kill_once)
    assert (summary.finished, summary.failed) == (6, 0)
    final = marks(tmp_path)
    assert len(final) == 6
    assert all(mark.items() <= final.items() for mark in seen)  # nothing was written twice


def test_a_killed_server_loses_nothing(tmp_path, monkeypatch):
    """It ended with EOFError where the server of the workers was killed while it started one."""
    forkserver = pytest.importorskip("multiprocessing.forkserver")
    connect, calls = forkserver.connect_to_new_process, []

    def killed(fds):
        calls.append(fds)
        if len(calls) in (1, 3):
            os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
            raise EOFError("unexpected EOF")
        return connect(fds)

    monkeypatch.setattr(forkserver, "connect_to_new_process", killed)
    summary = make(4).run(tmp_path, workers=2)
    assert (summary.finished, summary.failed) == (4, 0)
    assert len(calls) >= 3


def test_an_executor_that_breaks_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("thermofem.campaign.run.compute", poisoned)
    with (
        ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool,
        pytest.raises(th.InputError, match=r"the executor broke; \d geometries of this run are kept, run again"),
    ):
        make(5).run(tmp_path, pool)
    monkeypatch.undo()
    assert make(5).run(tmp_path, workers=2).failed == 0


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    code = "from thermofem_cli import main; main()"
    command = [sys.executable, "-c", code, "campaign", "campaign.toml", "-o", "out", *arguments]
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen(command, cwd=folder, text=True, start_new_session=True, **both)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_a_killed_parent_restarts_where_it_was(tmp_path):
    write(tmp_path, 10)
    out = tmp_path / "out"
    first = start(tmp_path)
    wait_for(lambda: len(marks(out)) >= 2)
    workers = children(first.pid)
    first.kill()  # SIGKILL
    first.communicate()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))  # no worker outlives its parent
    before = marks(out)
    assert 2 <= len(before) < 10
    with th.open_campaign(out) as data:  # there is no index yet: it is made from the results
        assert (data.status == "finished").sum() == len(before)
        assert data.delta_T_step.isnull().any()
    for name in before:
        assert th.load(out / "results" / name).delta_T.notnull().all()
    second = start(tmp_path)
    printed, _ = second.communicate()
    assert second.returncode == 0, printed
    assert f"{10 - len(before)} finished" in printed
    assert f"{len(before)} were there already" in printed
    after = marks(out)
    assert len(after) == 10
    assert before.items() <= after.items()
    with th.open_campaign(out) as data:
        assert (data.status == "finished").all()
        # R_th falls with the oxide's conductivity, and every case has its own
        assert np.all(np.diff(data.thermal_resistance.values[:, 0]) < 0)


def test_a_full_disk_is_one_line_and_the_finished_work_stays(tmp_path):
    """A limit on the size of files, below that of a result, in a real process: every write of a result fails."""
    resource = pytest.importorskip("resource", reason="limits on the size of files are POSIX")
    write(tmp_path, 4)
    make_first = th.Campaign.from_toml(tmp_path / "campaign.toml")
    with ThreadPoolExecutor(1) as executor:
        small = th.Campaign(make_first.geometry, (Variation("oxide", (OXIDE,), "W/m/K", (1.0,)),), make_first.drives)
        small.run(tmp_path / "out", executor)
    before = marks(tmp_path / "out")
    size = next((tmp_path / "out" / "results").glob("*.nc")).stat().st_size
    code = (
        "import resource; from thermofem_cli import main\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size // 2}, {size // 2}))\n"
        "import tempfile; main()"
    )
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != size // 2
    command = [sys.executable, "-c", code, "campaign", "campaign.toml", "-o", "out", "--workers", "1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "File too large" in done.stderr
    assert "run again to go on" in done.stderr
    assert "Traceback" not in done.stderr
    assert marks(tmp_path / "out") == before
    with th.open_campaign(tmp_path / "out") as data:
        assert (data.status == "finished").sum() == 1


def test_no_space_left_in_the_folder(tmp_path, threads, monkeypatch):
    """The disk fills up at the third result: two stay, and the run goes on once there is room."""
    written = []
    real = os.fsync

    def fsync(handle):
        written.append(handle)
        if len(written) > 3:  # the plan, then the results
            raise OSError(28, "No space left on device")
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(th.InputError, match=r"No space left on device; 2 finished geometries are kept"):
        make(6).run(tmp_path, threads)
    assert len(list((tmp_path / "results").iterdir())) == 2
    monkeypatch.undo()
    assert make(6).run(tmp_path, threads).reused == 2


def test_a_folder_that_cannot_be_used(tmp_path, threads):
    (tmp_path / "file").write_text("")
    with pytest.raises(th.InputError, match="cannot be made"):
        make(2).run(tmp_path / "file" / "out", threads)
    with pytest.raises(th.InputError, match="holds no campaign"):
        th.open_campaign(tmp_path)

    def again(summary):
        make(2).run(tmp_path / "out", threads)

    with pytest.raises(th.InputError, match="in use by another run"):
        make(2).run(tmp_path / "out", threads, report=again)


@pytest.mark.parametrize(
    ("probes", "words"),
    [
        ({"heated": "nosuch"}, "heated = 'nosuch' is unknown"),
        ({"heated": "box"}, "heated = 'box' is unknown"),
        ({"read": ("core", "core")}, "'core' twice"),
        ({"read": ("cor",)}, "did you mean 'core'"),
    ],
)
def test_a_wrong_probe_makes_no_folder(probes, words, tmp_path, threads):
    """The plan was written before the first worker met the name."""
    with pytest.raises(th.InputError, match=words):
        replace(make(2), **probes).run(tmp_path / "out", threads)
    assert not list(tmp_path.iterdir())


def test_memory_stays_flat(tmp_path, threads, monkeypatch):
    """Never more tasks under way than the window, however many geometries there are."""
    monkeypatch.setattr("thermofem.campaign.run.FOREIGN", 3)
    submitted, settled, most = 0, 0, 0
    submit, settle = threads.submit, _Loop._settle

    def counting(*args):
        nonlocal submitted, most
        submitted += 1
        most = max(most, submitted - settled)
        return submit(*args)

    def counted(self, *args):
        nonlocal settled
        settled += 1
        settle(self, *args)

    monkeypatch.setattr(threads, "submit", counting)
    monkeypatch.setattr(_Loop, "_settle", counted)
    make(9).run(tmp_path, threads)
    assert most == 4  # three, and the trial of the base geometry before them


@pytest.mark.skipif(find_spec("distributed") is None, reason='needs Dask: pip install "thermofem[dask]"')
@pytest.mark.filterwarnings("ignore")  # what Dask's own processes and sockets warn of is not ours
def test_dask_cluster(tmp_path):
    from distributed import LocalCluster

    write(tmp_path, 5)
    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="tcp", host="127.0.0.1"
    ) as cluster:
        done = start(tmp_path, "--scheduler", cluster.scheduler_address)
        printed, _ = done.communicate()
    assert done.returncode == 0, printed
    with ThreadPoolExecutor(1) as executor:
        th.Campaign.from_toml(tmp_path / "campaign.toml").run(tmp_path / "own", executor)
    with th.open_campaign(tmp_path / "out") as data, th.open_campaign(tmp_path / "own") as own:
        assert data.identical(own)


INTERRUPTED = """
import os, signal, sys, threading
import thermofem as th
from thermofem.campaign import run
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored
    begin = run.begin
    def soon():
        begin()
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()  # the server imports for a second
    run.begin = soon
    try:
        th.Campaign.from_toml(sys.argv[1]).run(sys.argv[2], workers=2)
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_ctrl_c_while_workers_start_leaves_no_traceback(tmp_path):
    """Workers complained of queues that were gone: 16 lines on standard error."""
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    vary = '[[vary]]\npath = "material.SiO2.conductivity"\nfrom = "1 W/m/K"\nto = "2 W/m/K"\ncount = 4\n'
    (tmp_path / "plan.toml").write_text(f'geometry = "strip.toml"\n{vary}[[drive]]\npower = "1 mW"\n')
    (tmp_path / "script.py").write_text(INTERRUPTED)
    command = [sys.executable, "script.py", "plan.toml", "out"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")
