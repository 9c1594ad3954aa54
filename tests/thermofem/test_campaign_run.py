"""Runs of campaigns: nothing is lost, repeated or wrong where geometries fail, workers die, or the run is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from campaigns import make, marks, write

import thermofem as th
from thermofem.campaign.stored_tasks import WorkerDiedError, completed

pytestmark = pytest.mark.slow


def test_a_failing_geometry_is_recorded_and_the_others_go_on(tmp_path, threads):
    campaign = make(3, bad=1)
    summary = campaign.run(tmp_path, threads)
    assert (summary.finished, summary.failed) == (2, 1)
    with th.campaign.open_campaign(tmp_path) as data:
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


def test_a_larger_campaign_keeps_what_is_there_and_a_damaged_result_is_made_again(tmp_path, threads):
    make(3).run(tmp_path, threads)
    before = marks(tmp_path)
    summary = make(5).run(tmp_path, threads)  # 1.0, 1.1, ... 1.4: three of five are there
    assert (summary.reused, summary.finished) == (3, 2)
    assert before.items() <= marks(tmp_path).items()
    path = sorted((tmp_path / "results").glob("*.nc"))[0]
    path.write_bytes(path.read_bytes()[:100])
    assert make(5).run(tmp_path, threads).finished == 1
    th.load(path)


def deadly(number: int) -> int:
    """A task that takes its process with it."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 4:
        raise ValueError("four")
    return number


def test_a_task_that_kills_its_worker_is_found_and_the_others_go_on():
    found = {task: future.exception() or future.result() for task, future in completed(deadly, range(8), workers=2)}
    assert isinstance(found[3], WorkerDiedError)
    assert isinstance(found[4], ValueError)
    assert {k: found[k] for k in found if k not in (3, 4)} == {k: k for k in (0, 1, 2, 5, 6, 7)}


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "thermofem", "campaign", "campaign.toml", "-o", "out", *arguments]
    return subprocess.Popen(
        command, cwd=folder, text=True, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


def wait_for(enough) -> None:
    end = time.monotonic() + 120
    while not enough():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_killed_run_goes_on_where_it_was(tmp_path):
    write(tmp_path, 10)
    out = tmp_path / "out"
    first = start(tmp_path, "--workers", "1")
    wait_for(lambda: (out / "results.sha256").exists() and len((out / "results.sha256").read_text().splitlines()) >= 2)
    first.kill()  # SIGKILL
    first.communicate()
    time.sleep(2)  # a worker finishes its geometry: its file, without a hash, counts for nothing
    with th.campaign.open_campaign(out) as data:  # there is no index yet: it is made from the results
        known = int((data.status == "finished").sum())
        assert 2 <= known < 10
        assert data.delta_T_step.isnull().any()
    second = start(tmp_path)
    printed, _ = second.communicate()
    assert second.returncode == 0, printed
    assert f"{10 - known} finished" in printed
    assert "10 of 10 geometries have a domain_error of up to" in printed
    with th.campaign.open_campaign(out) as data:
        assert (data.status == "finished").all()
        # R_th falls with the oxide's conductivity, and every case has its own
        assert np.all(np.diff(data.thermal_resistance.values[:, 0]) < 0)


def test_ctrl_c_is_one_line(tmp_path):
    write(tmp_path, 40)
    run = start(tmp_path, "--workers", "2")
    wait_for(lambda: marks(tmp_path / "out"))
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does, to every process
    printed, _ = run.communicate(timeout=60)
    assert run.returncode == 130
    assert printed.strip().splitlines()[-1].endswith("interrupted")
    assert "Traceback" not in printed


def test_a_folder_that_cannot_be_used(tmp_path, threads):
    (tmp_path / "file").write_text("")
    with pytest.raises(th.InputError, match="file"):
        make(2).run(tmp_path / "file" / "out", threads)
    with pytest.raises(th.InputError, match="holds no campaign"):
        th.campaign.open_campaign(tmp_path)

    def again(summary):
        make(2).run(tmp_path / "out", threads)

    with pytest.raises(th.InputError, match="in use by another run"):
        make(2).run(tmp_path / "out", threads, report=again)


@pytest.mark.parametrize(
    "probes", [{"heated": "nosuch"}, {"heated": "box"}, {"read": ("core", "core")}, {"read": ("cor",)}]
)
def test_a_wrong_probe_stops_before_the_first_geometry(probes, tmp_path, threads):
    with pytest.raises(th.InputError, match=next(iter(probes))):
        replace(make(2), **probes).run(tmp_path / "out", threads)
    assert not marks(tmp_path / "out")


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
    with th.campaign.open_campaign(tmp_path / "out") as data, th.campaign.open_campaign(tmp_path / "own") as own:
        assert data.identical(own)
