"""Datasets on disk: whole or not at all, and enough for the next stage."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import thermofem as th


@pytest.fixture(scope="module")
def data():
    heat = th.assemble(th.strip_ring())
    return th.solve(
        heat, th.Pulse(2e-3, 1e-6), np.linspace(0, 2e-6, 21), field_times=[0.5e-6, 1e-6], read=("core", "box")
    )


def test_schema(data):
    assert data.delta_T.dims == ("time", "probe")
    assert data.delta_T.attrs["units"] == "K"
    assert data.time.attrs["units"] == "s"
    assert data.power.attrs["units"] == "W"
    assert data.power.values[9:11].tolist() == [2e-3, 0]  # continuous from the right
    attributes = "geometry mesh_hash materials thermofem_version waveform accuracy rtol heat_imbalance"
    assert {*attributes.split()} <= data.attrs.keys()


def test_round_trip_keeps_everything(data, tmp_path):
    again = th.load(th.save(data, tmp_path / "heat.nc"))
    assert again.identical(data)
    assert th.CrossSection.from_toml_text(again.attrs["geometry"]) == th.strip_ring()


def test_field_and_mean_agree(data):
    """The field's hottest vertex lies in or above the core, and above the core's mean."""
    hottest = data.field.isel(field_time=1).argmax("vertex").item()
    mean = data.delta_T.sel(probe="core").interp(time=1e-6).item()
    assert mean < data.field.isel(field_time=1, vertex=hottest).item() < 1.2 * mean
    assert abs(data.r[hottest].item() - 7.955e-6) < 0.3e-6


@pytest.mark.parametrize("width", [3e-6, 5e-6, 20e-6, 1.3e-6])
@pytest.mark.parametrize("periodic", [False, True])
def test_times_of_another_unit_keep_the_edges_of_the_power(width, periodic):
    """20 us times 1e-6 lies just before the edge at 2e-5 s: the Dataset "contradicts the waveform attribute"."""
    model = th.Foster(R=[2000.0, 5000.0], tau=[50e-9, 1e-6])
    wave = th.SquareWave(2e-3, 2 * width, 0.5) if periodic else th.Pulse(2e-3, width)
    t = th.waveforms.period_times(wave, 301) if periodic else np.linspace(0, 2 * width, 401)
    rise = model.periodic_response(wave, 301) if periodic else model.response(wave, t)
    held = th.dataset.build(t, rise, wave, periodic=periodic)
    given = held.assign_coords(time=("time", t * 1e6, {"units": "us"}))
    found, wanted = th.dataset.response_of(given), th.dataset.response_of(held)
    np.testing.assert_allclose(found.times, wanted.times, rtol=1e-15)
    np.testing.assert_array_equal(wave(found.times), wave(wanted.times))


def test_power_that_contradicts_the_waveform_is_refused(data):
    core = data.sel(probe="core")
    with pytest.raises(th.InputError, match="contradicts the waveform attribute"):
        th.dataset.response_of(core.assign(power=2 * core.power))
    with pytest.raises(th.InputError, match="attrs\\['kind'\\] = 'foo' is unknown"):
        th.dataset.response_of(core.assign_attrs(kind="foo"))
    with pytest.raises(th.InputError, match="data has 3 samples"):
        th.dataset.response_of(core.isel(time=slice(0, 3)))


def test_data_that_are_warm_before_any_heat_are_doubted():
    model, wave, t = th.Foster(R=[2e3, 5e3], tau=[8e-8, 1.2e-6]), th.Pulse(1.3e-3, 4e-6), np.linspace(0, 12e-6, 601)
    (doubt,) = th.dataset.response_of(th.dataset.build(t, 1 + model.response(wave, t), wave)).doubts
    assert "1 K before any heat" in doubt


def test_unreadable_files(data, tmp_path):
    with pytest.raises(th.InputError, match="does not exist"):
        th.load(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("not netCDF")
    with pytest.raises(th.InputError, match=r"text.nc cannot be read as netCDF"):
        th.load(tmp_path / "text.nc")
    whole = th.save(data, tmp_path / "heat.nc").read_bytes()
    (tmp_path / "half.nc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(th.InputError, match=r"half.nc cannot be read"):
        th.load(tmp_path / "half.nc")
    th.save(data.assign_attrs(schema=99), tmp_path / "new.nc")
    with pytest.raises(th.InputError, match="schema 99; this version reads up to"):
        th.load(tmp_path / "new.nc")
    with pytest.raises(th.InputError, match="is not a folder"):
        th.save(data, tmp_path / "no" / "heat.nc")


@pytest.mark.slow
def test_a_disk_that_fills_up_leaves_no_file(tmp_path):
    """HDF5 keeps to itself that its last write failed; a limit on the size of files stands for the full disk."""
    script = f"""
import resource, numpy as np, thermofem as th
from thermofem import dataset
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
times = np.linspace(0, 1e-5, 20_001)
data = dataset.build(times, np.random.default_rng(0).random(times.size), th.Constant(1e-3))
try:
    dataset.save(data, {str(tmp_path / "large.nc")!r})
except th.InputError as error:
    print(error)
"""
    pytest.importorskip("resource", reason="limits on the size of files are POSIX")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "large.nc cannot be written" in done.stdout
    assert list(tmp_path.iterdir()) == []
