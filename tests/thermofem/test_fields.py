"""Temperature fields for ParaView and as pictures."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

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


def test_fields_in_other_units_and_number_types(data, tmp_path):
    """A field in mK is written in K."""
    other = data.copy(deep=True)
    for name in ("field", "delta_T"):
        other[name] = other[name] * 1e3
        other[name].attrs["units"] = "mK"
    other = other.assign_coords(field_time=("field_time", data.field_time.values * 1e6, {"units": "us"}))
    other.to_netcdf(tmp_path / "other.nc", encoding={"triangles": {"dtype": "u2"}})
    loaded = th.load(tmp_path / "other.nc")
    np.testing.assert_allclose(loaded["field"], data["field"], rtol=1e-12)
    np.testing.assert_allclose(loaded["field_time"], data["field_time"], rtol=1e-12)
    assert th.data.fields.write_fields(loaded, tmp_path / "heat.xdmf").exists()
