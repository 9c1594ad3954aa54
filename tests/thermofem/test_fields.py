"""Temperature fields for ParaView and as pictures."""

from __future__ import annotations

import contextlib
import gc
import re
import shutil
import warnings

import meshio
import numpy as np
import pytest

import coupled
import thermofem as th

FIELD_TIMES = [1e-8, 0.5e-6, 1e-6]


@pytest.fixture(scope="module")
def data():
    return th.solve(th.assemble(th.strip_ring()), th.Pulse(2e-3, 1e-6), [0.0, 1e-6], field_times=FIELD_TIMES)


def same_mesh(points, cells, data) -> None:
    np.testing.assert_array_equal(points[:, :2], np.column_stack([data.r, data.z]))
    assert not points[:, 2].any()
    assert cells[0].type == "triangle"
    np.testing.assert_array_equal(cells[0].data, data.triangles)


def test_xdmf_reads_back(data, tmp_path):
    path = th.data.fields.write_fields(data, tmp_path / "heat.xdmf")
    assert list(tmp_path.iterdir()) == [path]
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        same_mesh(*reader.read_points_cells(), data)
        assert reader.num_steps == 3
        for k in range(3):
            time, point_data, _ = reader.read_data(k)
            assert time == FIELD_TIMES[k]
            np.testing.assert_array_equal(point_data["temperature_rise"], data.field[k])  # 17 digits: exact


def test_vtu_reads_back(data, tmp_path):
    mesh = meshio.read(th.data.fields.write_fields(data.isel(field_time=[1]), tmp_path / "one.vtu"))
    same_mesh(mesh.points, mesh.cells, data)
    np.testing.assert_array_equal(mesh.point_data["temperature_rise"], data.field[1])


def test_what_cannot_be_written_says_why(data, tmp_path):
    with pytest.raises(th.InputError, match=r"one time and the data 3; take .xdmf"):
        th.data.fields.write_fields(data, tmp_path / "heat.vtu")
    with pytest.raises(th.InputError, match=r"did you mean '.vtu'"):
        th.data.fields.write_fields(data, tmp_path / "heat.vtk")
    with pytest.raises(th.InputError, match="field"):
        th.data.fields.write_fields(data.drop_vars("field"), tmp_path / "heat.xdmf")
    with pytest.raises(th.InputError, match="is not a folder"):
        th.data.fields.write_fields(data, tmp_path / "no" / "heat.xdmf")
    assert not list(tmp_path.iterdir())


def test_animation(data, tmp_path):
    from PIL import Image

    from thermofem.plot import animate_field

    drawn = []
    path = animate_field(data, tmp_path / "heat.gif", frames_per_second=5, on_frame=lambda *at: drawn.append(at))
    assert drawn == [(0, 3), (1, 3), (2, 3)]
    with Image.open(path) as picture:
        assert picture.n_frames == 3
        assert picture.info["duration"] == 200  # ms: five a second
        frames = []
        for k in range(3):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB"), dtype=float))
    # one colour scale for all times: in the middle of the picture 9 K at 1 us outshine 1 K at 10 ns; with a scale for
    # each frame the small hot spot at 10 ns would be as bright as any
    early, late = (frames[k][150:250, 150:350] for k in (0, 2))
    assert early.mean() < 0.5 * late.mean()
    # the axes stand still: the numbers left of them are at the same place in every frame, up to the few pixels at
    # the edge of a letter that each frame's own palette of 256 colours makes lighter or darker
    left = [frame[:, :40].mean(axis=2) < 128 for frame in frames]
    assert all(np.sum(other != left[0]) < 0.1 * np.sum(left[0]) for other in left[1:])
    with pytest.raises(th.InputError, match=r"ending = '.mp3' is unknown"):
        animate_field(data, tmp_path / "heat.mp3")
    with pytest.raises(th.InputError, match="field_times"):
        animate_field(data.drop_vars("field"), tmp_path / "heat.gif")
    with warnings.catch_warnings(record=True) as said:  # Matplotlib's, of a film that was never drawn
        warnings.simplefilter("always")
        with contextlib.suppress(th.InputError):  # `pytest.raises` would keep the film
            animate_field(data, tmp_path / "no" / "heat.gif")
        gc.collect()
    assert not said
    assert re.fullmatch(r"heat\.gif", " ".join(p.name for p in tmp_path.iterdir()))


def test_a_film_needs_ffmpeg_and_says_so(data, tmp_path, monkeypatch):
    from thermofem.plot import animate_field

    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(th.InputError, match=r"heat.mp4 needs ffmpeg, which is not installed; .gif works without it"):
        animate_field(data, tmp_path / "heat.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_a_film_is_one_where_ffmpeg_is_installed(data, tmp_path):
    from thermofem.plot import animate_field

    assert animate_field(data, tmp_path / "heat.mp4").read_bytes()[4:8] == b"ftyp"  # the mark of an MP4 file


def test_more_fields_than_fit_into_memory_are_refused_before_the_run():
    """100 000 fields of 2500 values took 6 GB and ended in NumPy's MemoryError."""
    heat = th.assemble(th.strip_ring())
    with pytest.raises(
        th.InputError, match=r"field_times holds 100000 times; .* are 2(\.\d)? GB, .* give at most 39\d\d\d"
    ):
        th.solve(heat, th.Pulse(2e-3, 1e-6), [0.0, 1e-6], field_times=np.linspace(0, 1e-6, 100_000))
    with pytest.raises(th.InputError, match="field_times holds 100000 times"):
        coupled.FEM(heat, field_times=np.linspace(0, 1e-6, 100_000))


def test_fields_in_other_units_and_number_types(data, tmp_path):
    """A field in mK was written as it was, 14,315 for 14 K, and half precision ended in a KeyError of meshio."""
    other = data.copy(deep=True)
    for name in ("field", "delta_T"):
        other[name] = other[name] * 1e3
        other[name].attrs["units"] = "mK"
    other = other.assign_coords(field_time=("field_time", data.field_time.values * 1e6, {"units": "us"}))
    other.to_netcdf(tmp_path / "other.nc", encoding={"triangles": {"dtype": "u2"}})
    loaded = th.load(tmp_path / "other.nc")
    np.testing.assert_allclose(loaded["field"], data["field"], rtol=1e-12)
    np.testing.assert_allclose(loaded["field_time"], data["field_time"], rtol=1e-12)
    half = loaded.assign(field=loaded["field"].astype("f2"))
    assert th.data.fields.write_fields(loaded, tmp_path / "heat.xdmf").exists()
    path = th.data.fields.write_fields(half.isel(field_time=[2]), tmp_path / "last.vtu")
    last = meshio.read(path).point_data["temperature_rise"]
    np.testing.assert_allclose(last, data["field"][-1], rtol=2e-3, atol=1e-3)  # of half precision
