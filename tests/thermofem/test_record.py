"""Files that commands write without xarray are those that xarray writes, and fast commands do not import it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import coupled
import surrogate
import thermofem as th
from thermofem.data.record import Record, column

TIMES = np.linspace(0, 2e-6, 1501)  # more than what is written deflated


def ring_record():
    heat = th.assemble(th.strip_ring())
    return th.solve(heat, th.Pulse(2e-3, 1e-6), TIMES, read=("core", "box"), field_times=[1e-6, 2e-6])


RECORDS = {
    "several probes and fields": ring_record,
    "periodic": lambda: th.solve_periodic(th.assemble(th.strip_ring()), th.SquareWave(2e-3, 1e-6, 1 / 3)),
    "ring": lambda: coupled.simulate.record(
        coupled.borghi2021(), th.Foster(R=[2e3], tau=[1e-6]), power=1e-3, duration=1e-7
    ),
    "nothing in it": lambda: Record({"x": column(("a", "b"), np.zeros((0, 3)), {})}, {}, {"none": np.zeros(0)}),
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_writes_the_file_that_xarray_writes(name, tmp_path):
    record = RECORDS[name]()
    for path, data in (("record.nc", record), ("xarray.nc", record.dataset())):
        th.save(data, tmp_path / path)
    ours, theirs = (th.load(tmp_path / path) for path in ("record.nc", "xarray.nc"))
    xr.testing.assert_identical(ours, theirs)
    assert {k: v.dtype for k, v in ours.variables.items()} == {k: v.dtype for k, v in theirs.variables.items()}


def test_a_file_as_it_was_written_is_read_without_xarray(tmp_path):
    path, data = tmp_path / "heat.nc", RECORDS["periodic"]()
    for written in (data, data.dataset()):
        th.save(written, path)
        found = th.dataset.load(path)
        assert isinstance(found, Record)
        xr.testing.assert_identical(found.dataset(), th.load(path))
    th.save(data.dataset().assign(delta_T=data.dataset()["delta_T"].assign_attrs(units="mK")), path)
    assert not isinstance(th.dataset.load(path), Record)  # to be converted
    data.dataset().assign_attrs(content_hash="0" * 32).to_netcdf(path, engine="h5netcdf")
    assert not isinstance(th.dataset.load(path), Record)  # changed: the log says so


@pytest.mark.parametrize(
    ("command", "needed"),
    [
        ("solve --samples 11 -o heat.nc", set()),
        ("simulate model.json --duration '1 us' -o run.nc", set()),
        ("explore -o ring.html", {"surrogate"}),
        ("stability model.json --points '2, 2'", set()),
        ("map model.json --points '2, 2' --duration '200 ns'", set()),
        ("fit heat.nc", {"surrogate"}),
    ],
)
@pytest.mark.slow
def test_fast_commands_import_neither_xarray_nor_what_it_imports(command, needed, tmp_path):
    model, times = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), np.geomspace(1e-9, 1e-5, 41)
    surrogate.save_model(model, tmp_path / "model.json")
    step = th.Constant(2e-3)
    th.save(th.dataset.build(times, model.response(step, times), step), tmp_path / "heat.nc")
    code = f"import sys, shlex; sys.argv = ['thermofem', *shlex.split({command!r})]; from thermofem_cli import app\n"
    code += "app(standalone_mode=False); print({'xarray', 'pandas', 'dask', 'pint', 'surrogate'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str(needed or "set()")


def test_models_are_trained_on_a_record_as_on_its_dataset():
    """Fits read types and units of either; `thermofem explore` of a geometry trains on records."""
    exact, step = th.Foster(R=[2e3, 5e3], tau=[1e-7, 1e-6]), th.Constant(2e-3)
    times = np.geomspace(1e-9, 1e-4, 61)
    record = th.dataset.build(times, exact.response(step, times), step)
    mine, theirs = (surrogate.fit_foster(data, 2).model for data in (record, record.dataset()))
    assert (mine.R.tolist(), mine.tau.tolist()) == (theirs.R.tolist(), theirs.tau.tolist())
