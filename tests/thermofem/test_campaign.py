"""Campaigns: what is computed, and that nothing is lost, repeated or wrong whatever happens to the processes.

Most geometries here differ in materials only: their outline is the reference strip's, whose mesh is committed.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from paths import ROOT

import thermofem as th
from thermofem.campaign import Schedule, Variation, work
from thermofem.campaign.run import _Loop

TIMES = (0.0, 1e-8, 1e-7)
STEP = Schedule("step", th.Constant(1e-3), TIMES)
OXIDE = "material.SiO2.conductivity"
FILE = """
geometry = "ring.toml"
[[vary]]
path = "material.SiO2.conductivity"
name = "oxide"
from = "1.0 W/m/K"
to = "1.4 W/m/K"
count = {count}
[[drive]]
power = "1 mW"
duration = "100 ns"
first = "10 ns"
samples = 3
"""


def make(count: int = 4, *, bad: int | None = None, **options) -> th.Campaign:
    """A campaign over the oxide's conductivity; ``bad`` is the place of one geometry that cannot be."""
    values = np.linspace(1.0, 1.4, count).round(6).tolist()
    paths, unit = (OXIDE,), "W/m/K"
    if bad is not None:
        values[bad] = -1.0
    return th.Campaign(th.strip_ring().to_toml(), (Variation("oxide", paths, unit, tuple(values)),), (STEP,), **options)


def write(folder: Path, count: int) -> Path:
    """The same campaign as a file."""
    (folder / "ring.toml").write_text(th.strip_ring().to_toml())
    (folder / "campaign.toml").write_text(FILE.format(count=count))
    return folder / "campaign.toml"


@pytest.fixture(scope="module")
def threads():
    with ThreadPoolExecutor(2) as executor:
        yield executor


def marks(folder: Path) -> dict[str, int]:
    """When each result was written: a geometry computed again changes its mark."""
    return {
        path.name: path.stat().st_mtime_ns for path in (folder / "results").glob("[!.]*.nc")
    }  # not those being written


def test_results_are_what_solve_computes(tmp_path, threads):
    campaign = make(3, read=("core", "box"))
    summary = campaign.run(tmp_path, threads)
    assert (summary.total, summary.finished, summary.failed) == (3, 3, 0)
    with th.open_campaign(tmp_path) as data:
        assert data.oxide.values.tolist() == [1.0, 1.2, 1.4]
        assert data.oxide.attrs["units"] == "W/m/K"
        assert data.status.values.tolist() == ["finished"] * 3
        assert np.all((data.discretization_error > 0) & (data.discretization_error < 1e-3))
        for case, key in enumerate(data.key.values):
            text = th.load(tmp_path / "results" / f"{key}.nc").attrs["geometry"]
            heat = th.assemble(th.CrossSection.from_toml_text(text))
            assert heat.geometry.material_of("box").conductivity == data.oxide[case]
            expected = th.solve(heat, th.Constant(1e-3), TIMES, read=("core", "box"))
            assert np.array_equal(data.delta_T_step[case], expected.delta_T)
            resistances = [heat.thermal_resistance("core", name) for name in ("core", "box")]
            assert data.thermal_resistance[case].values.tolist() == resistances
    with xr.open_dataset(tmp_path / "training.nc", engine="h5netcdf") as training:
        assert training.features.dims == ("case", "feature")
        assert training.features.values[:, 0].tolist() == [1.0, 1.2, 1.4]
        assert training.feature_unit.item() == "W/m/K"
        assert not training.delta_T_step.isnull().any()


def test_every_drive_is_kept_and_the_file_trains(tmp_path, threads):
    square = Schedule("square", th.SquareWave(2e-3, 1e-6, 1 / 3), samples=31)
    geometry = th.strip_ring().to_toml()
    th.Campaign(geometry, (), (square, STEP)).run(tmp_path, threads)
    (path,) = (tmp_path / "results").glob("*.nc")
    heat = th.assemble(th.strip_ring())
    first = th.load(path)
    assert np.array_equal(first.delta_T, th.solve_periodic(heat, square.wave, 31).delta_T)
    assert th.dataset.drive_of(first).wave == square.wave
    with xr.open_dataset(path, engine="h5netcdf", group="step") as second:
        assert np.array_equal(second.delta_T, th.solve(heat, STEP.wave, TIMES).delta_T)
    with th.open_campaign(tmp_path) as data:
        assert data.delta_T_square.shape == (1, 31, 1)
        assert np.array_equal(data.delta_T_step[0, :, 0], th.solve(heat, STEP.wave, TIMES).delta_T)


def test_lists_are_crossed_and_ranges_fill_a_latin_hypercube():
    listed = Variation("material", ("layer.cladding.material",), values=("SiO2", "Si3N4"))
    radius = Variation("radius", ("part.core.radius",), "m", low=5e-6, high=10e-6)
    box = Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6, logarithmic=True)
    campaign = th.Campaign(th.strip_ring().to_toml(), (radius, listed, box), (STEP,), samples=10, seed=3)
    cases = campaign.cases()
    assert len(cases) == len(campaign) == 20
    for material in ("SiO2", "Si3N4"):
        chosen = [case.values for case in cases if case.values[1] == material]
        # a Latin hypercube has one point in each tenth of every axis
        shares = np.array([[(r - 5e-6) / 5e-6, np.log(b / 1e-6) / np.log(4)] for r, _, b in chosen])
        assert np.sort(np.floor(shares * 10), axis=0).T.tolist() == [list(range(10))] * 2
    section = th.CrossSection.from_toml_text(campaign.geometry_of(cases[-1].values))
    core = section.parts[0]
    assert (core.inner_radius + core.outer_radius) / 2 == pytest.approx(cases[-1].values[0], rel=1e-12, abs=0)
    assert section.layers[1].thickness == cases[-1].values[2]
    assert section.layers[2].material == "Si3N4"
    assert [c.key for c in campaign.cases()] == [c.key for c in cases]


def test_a_campaign_file(tmp_path):
    campaign = th.Campaign.from_toml(write(tmp_path, 5))
    assert [case.values[0] for case in campaign.cases()] == [1.0, 1.1, 1.2, 1.3, 1.4]
    np.testing.assert_allclose(campaign.schedules[0].kept, [0, 1e-8, 1e-7], rtol=1e-14)
    inline = FILE.format(count=5).replace('geometry = "ring.toml"', "") + "[geometry]\n"
    inline += "\n".join(line for line in (tmp_path / "ring.toml").read_text().splitlines()).replace(
        "[[", "[[geometry."
    ).replace("[boundary]", "[geometry.boundary]")  # fmt: skip
    (tmp_path / "inline.toml").write_text(inline)
    again = th.Campaign.from_toml(tmp_path / "inline.toml")
    assert [case.key for case in again.cases()] == [case.key for case in campaign.cases()]


def test_paths_reach_every_table():
    base = """
outer_radius = "60 um"
layer = [{ name = "box", material = "SiO2", thickness = "9 um", datum = true }]
[[part]]
name = "a.b"
material = "Si"
radius = "5 um"
width = "450 nm"
bottom = "-5 um"
height = "220 nm"
heated = true
[[interface]]
part = "a.b"
resistance = "1e-8 m^2*K/W"
[boundary]
top = "insulated"
[material.Si]
conductivity = { value = "130 W/m/K", exponent = -1.3, reference = "300 K" }
"""
    paths = {
        "part.a.b.radius": (6e-6, "m"),
        "interface.a.b.resistance": (2e-8, "m^2*K/W"),
        "boundary.top.convection": (1e4, "W/m^2/K"),
        "material.Si.conductivity": (100.0, "W/m/K"),
        "material.Si.density": (2300.0, "kg/m^3"),
        "outer_radius": (50e-6, "m"),
        "ambient": (310.0, "K"),
    }
    variations = tuple(Variation(path, (path,), unit, (value,)) for path, (value, unit) in paths.items())
    campaign = th.Campaign(base, variations, (STEP,))
    section = th.CrossSection.from_toml_text(campaign.geometry_of(campaign.cases()[0].values))
    assert section.parts[0].outer_radius == pytest.approx(6.225e-6, rel=1e-12, abs=0)
    assert section.interfaces[0].resistance == 2e-8
    assert section.top == th.Boundary("convection", 1e4)
    assert section.material_of("a.b").density == 2300.0
    assert (section.outer_radius, section.ambient) == (50e-6, 310.0)
    assert 'value = "100 W/m/K"' in campaign.geometry_of(campaign.cases()[0].values)
    exponent = Variation("n", ("material.Si.conductivity.exponent",), "", (-1.0,))
    steeper = th.Campaign(base, (exponent,), (STEP,))
    assert 'exponent = "-1"' in steeper.geometry_of((-1.0,))
    assert th.CrossSection.from_toml_text(steeper.geometry_of((-1.0,))).material_of("a.b").conductivity == 130
    for path, words in {
        "part.a.c.radius": "did you mean 'a.b'",
        "layer.bx.thickness": "did you mean 'box'",
        "heater.width": "leads nowhere",
    }.items():
        with pytest.raises(th.InputError, match=words):
            th.Campaign(base, (Variation(path, (path,), "m", (1e-6,)),), (STEP,))


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


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    code = "from thermofem.cli import main; main()"
    command = [sys.executable, "-c", code, "campaign", "campaign.toml", "-o", "out", *arguments]
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)


def children(parent: int) -> list[int]:
    """Processes whose parent is this one, from /proc."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == parent and fields[0] != "Z":
            found.append(int(entry.parent.name))
    return found


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


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
    _, printed = second.communicate()
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
    resource = pytest.importorskip("resource")
    write(tmp_path, 4)
    make_first = th.Campaign.from_toml(tmp_path / "campaign.toml")
    with ThreadPoolExecutor(1) as executor:
        small = th.Campaign(make_first.geometry, (Variation("oxide", (OXIDE,), "W/m/K", (1.0,)),), make_first.schedules)
        small.run(tmp_path / "out", executor)
    before = marks(tmp_path / "out")
    size = next((tmp_path / "out" / "results").glob("*.nc")).stat().st_size
    code = (
        "import resource; from thermofem.cli import main\n"
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


def test_names_that_are_not_there_stop_before_the_first_geometry(tmp_path, threads):
    with pytest.raises(th.InputError, match="did you mean 'core'"):
        make(2, read=("cor",)).run(tmp_path, threads)
    assert not marks(tmp_path)


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
        _, printed = done.communicate()
    assert done.returncode == 0, printed
    with ThreadPoolExecutor(1) as executor:
        th.Campaign.from_toml(tmp_path / "campaign.toml").run(tmp_path / "own", executor)
    with th.open_campaign(tmp_path / "out") as data, th.open_campaign(tmp_path / "own") as own:
        assert data.identical(own)


def test_dask_is_imported_nowhere_else():
    package = Path(th.__file__).parent
    imports = re.compile(r"^\s*(from|import) (dask|distributed)\b", re.MULTILINE)
    users = [p.relative_to(package).as_posix() for p in package.rglob("*.py") if imports.search(p.read_text())]
    assert users == ["cli/campaign.py"]
    code = "import sys, thermofem.cli.campaign; print('dask' in sys.modules, 'distributed' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('geometry = "ring.toml"', ""), "geometry is missing"),
        (("ring.toml", "rung.toml"), "rung.toml"),
        (("[[drive]]", "[[drives]]"), "did you mean 'drive'"),
        (("count", "cuont"), "did you mean 'count'"),
        (("count = 4", ""), "oxide has a range to draw from"),
        (("count = 4", "count = 1"), "count = 1 must be a whole number"),
        (("1.0 W/m/K", "2 W/m/K"), "from = 2 must be below to = 1.4"),
        (("1.0 W/m/K", "1.0 W/m"), "not all quantities of one kind"),
        (("1.0 W/m/K", "1.0"), "not all quantities of one kind"),
        (("SiO2.conductivity", "SiO2.conductivty"), None),
        (("path = ", "pth = "), "did you mean 'path'"),
        (('"oxide"', '"status"'), "vary: name = 'status' is taken"),
        (('"oxide"', '"a/b"'), "vary: name = 'a/b' is not usable"),
        (('power = "1 mW"', 'power = "1 mV"'), "power"),
        (('power = "1 mW"', 'power = "1 mW"\nperiodic = true'), "has no period"),
        (('first = "10 ns"', 'first = "10 us"'), "must lie between 0 and duration"),
        (("[[drive]]", 'values = ["1 W/m/K"]\n[[drive]]'), "not both"),
    ],
)
def test_campaign_files_that_cannot_be_meant(change, words, tmp_path, threads):
    path = write(tmp_path, 4)
    path.write_text(path.read_text().replace(*change))
    if words is None:  # an unknown key is for the geometry's reader to name
        th.Campaign.from_toml(path).run(tmp_path / "out", threads)
        with th.open_campaign(tmp_path / "out") as data:
            assert all("did you mean 'conductivity'" in reason for reason in data.reason.values)
        return
    with pytest.raises(th.InputError) as error:
        th.Campaign.from_toml(path)
    assert words in str(error.value)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_what_the_docs_and_the_example_describe_can_be_read(tmp_path):
    for name, target in (("geometry", "heater.toml"), ("campaigns", "campaign.toml")):
        text = (ROOT / "docs" / f"{name}.md").read_text()
        (tmp_path / target).write_text(re.findall(r"```toml[^\n]*\n(.*?)```", text, flags=re.DOTALL)[0])
    ring = th.CrossSection.from_toml(tmp_path / "heater.toml")
    assert ring.region_names == ("substrate", "box", "cladding", "core", "heater")
    campaign = th.Campaign.from_toml(tmp_path / "campaign.toml")
    assert len(campaign) == 100 * 5 * 2
    section = th.CrossSection.from_toml_text(campaign.geometry_of(campaign.cases()[-1].values))
    assert [p.outer_radius - p.inner_radius for p in section.parts[:2]] == pytest.approx([500e-9] * 2, rel=1e-9, abs=0)
    assert len(th.Campaign.from_toml(ROOT / "examples" / "campaign_200.toml").cases()) == 200
