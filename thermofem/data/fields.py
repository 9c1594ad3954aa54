"""Temperature fields for other programs: time series that ParaView opens, through meshio.

The plane of the mesh is (x, y) = (r, z) in m; ParaView's Rotational Extrusion makes the ring of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from .files import check_target, write_whole
from .variables import contents

if TYPE_CHECKING:
    import xarray as xr

NAME = "temperature_rise"  # K, of the field in the files
FIELDS = "a Dataset of th.solve with field_times, which keeps the temperature field"


def write_fields(data: xr.Dataset, path: str | Path) -> Path:
    """Write the temperature fields of a Dataset for ParaView.

    Parameters
    ----------
    data : Dataset
        from `solve` with ``field_times``: field (K) over field_time and vertex.
    path : str or Path
        its ending chooses: ".xdmf" holds every time, ".vtu" a single one.

    Returns
    -------
    Path
        the file, written whole or not at all.

    Raises
    ------
    InputError
        no field in the data, another ending, several times for one .vtu, a folder that cannot be written.

    >>> data = solve(assemble(strip_ring()), Pulse(2e-3, 1e-6), [1e-6], field_times=[0.5e-6, 1e-6])
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_fields(data, f"{folder}/heat.xdmf").name
    'heat.xdmf'
    """
    data = check_field(data)
    path = field_file(path, data.sizes["field_time"])
    write = _write_xdmf if path.suffix == ".xdmf" else _write_vtu
    return write_whole(path, lambda target: write(data, target))


def field_file(path: str | Path, count: int) -> Path:
    """Check the file name that `write_fields` gets for ``count`` times, and return its path."""
    path = checks.path("path", path)
    kind = checks.choice("fields: ending", path.suffix, (".xdmf", ".vtu"), hint="ParaView opens these two")
    if kind == ".vtu" and count > 1:
        raise checks.InputError(f"{path.name} holds one time and the data {count}; take .xdmf, or select one")
    return check_target(path)


def check_field(data: xr.Dataset) -> xr.Dataset:
    """The Dataset in SI; InputError unless it holds temperature fields."""
    return contents("data", data, ("field", "field_time", "triangles", "r", "z"), what=FIELDS)


def _points(data: xr.Dataset) -> np.ndarray:
    """Vertices as (r, z, 0) in m, shape (vertices, 3)."""
    r = data["r"].values
    return np.column_stack([r, data["z"].values, np.zeros(r.size)])


def _triangles(data: xr.Dataset) -> list[tuple[str, Any]]:
    """Triangles in the form that meshio takes: a cell type and integer indices of corners."""
    return [("triangle", data["triangles"].values.astype(np.int64))]


def _write_vtu(data: xr.Dataset, path: Path) -> None:
    """Write the temperature field of the only time as .vtu."""
    import meshio

    field = data["field"].isel(field_time=0).values.astype(float)
    mesh = meshio.Mesh(_points(data), _triangles(data), point_data={NAME: field})
    mesh.write(path, file_format="vtu")


def _write_xdmf(data: xr.Dataset, path: Path) -> None:
    """Write the fields of all times as one .xdmf file, with numbers as text: meshio would misplace an HDF5 file."""
    import meshio

    with meshio.xdmf.TimeSeriesWriter(path, data_format="XML") as writer:
        writer.write_points_cells(_points(data), _triangles(data))
        fields = data["field"].values.astype(float)
        for time, field in zip(data["field_time"].values, fields, strict=True):
            writer.write_data(float(time), point_data={NAME: field})
