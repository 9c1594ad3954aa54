"""Temperature fields for other programs: time series that ParaView opens, through meshio.

The plane of the mesh is (x, y) = (r, z) in m; ParaView's Rotational Extrusion makes the ring of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..checks import InputError
from .files import check_target, write_whole
from .variables import contents

if TYPE_CHECKING:
    import xarray as xr

NAME = "temperature_rise"  # K, of the field in the files
FIELDS = "a Dataset of th.solve with field_times, which keeps the temperature field"
_KINDS = (".xdmf", ".pvd", ".vtu")


def write_fields(data: xr.Dataset, path: str | Path) -> tuple[Path, ...]:
    """Write the temperature fields of a Dataset for ParaView.

    Parameters
    ----------
    data : Dataset
        from `solve` with ``field_times``: field (K) over field_time and vertex.
    path : str or Path
        its ending chooses: ".xdmf", one file that holds every time; ".pvd", a list of the times and one .vtu file for
        each beside it; ".vtu", a single time.

    Returns
    -------
    tuple of Path
        every file written, each whole or not at all; the one to open comes last.

    Raises
    ------
    InputError
        no field in the data, another ending, several times for one .vtu, a folder that cannot be written.

    >>> data = solve(assemble(strip_ring()), Pulse(2e-3, 1e-6), [1e-6], field_times=[0.5e-6, 1e-6])
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_fields(data, f"{folder}/heat.pvd")]
    ['heat_0000.vtu', 'heat_0001.vtu', 'heat.pvd']
    """
    data = check_field(data)
    times = data["field_time"].values
    *steps, path = files_of(path, times.size)
    if path.suffix == ".xdmf":
        return (write_whole(path, lambda p: _write_xdmf(data, p)),)
    if path.suffix == ".vtu":
        return (write_whole(path, lambda p: _mesh(data, 0).write(p, file_format="vtu")),)
    for k, step in enumerate(steps):
        write_whole(step, partial(_mesh(data, k).write, file_format="vtu"))
    return (*steps, write_whole(path, lambda p: p.write_text(_list_of_steps(times, steps), encoding="utf-8")))


def files_of(path: str | Path, count: int) -> tuple[Path, ...]:
    """The files that `write_fields` writes for ``count`` times, the one to open last.

    Raises InputError: what `write_fields` refuses for the names alone.
    """
    path = checks.path("path", path)
    kind = checks.choice("fields: ending", path.suffix, _KINDS, hint="ParaView opens these three")
    if kind == ".vtu" and count > 1:
        raise InputError(f"{path.name} holds one time and the data {count}; take .xdmf or .pvd, or select one")
    steps = [path.with_name(f"{path.stem}_{k:04d}.vtu") for k in range(count)] if kind == ".pvd" else []
    for file in (*steps, path):
        check_target(file)
    return (*steps, path)


def check_field(data: xr.Dataset) -> xr.Dataset:
    """The Dataset in SI; InputError unless it holds temperature fields."""
    return contents("data", data, ("field", "field_time", "triangles", "r", "z"), what=FIELDS)


def _points(data: xr.Dataset) -> np.ndarray:
    """Vertices as (r, z, 0) in m."""
    r, z = data["r"].values, data["z"].values
    return np.column_stack([r, z, np.zeros(r.size)])


def _mesh(data: xr.Dataset, at: int) -> Any:
    """One time as meshio holds it."""
    import meshio

    field = np.asarray(data["field"].isel(field_time=at).values, dtype=float)
    return meshio.Mesh(_points(data), [("triangle", _triangles(data))], point_data={NAME: field})


def _triangles(data: xr.Dataset) -> np.ndarray:
    """Numbers of corners, in a type that meshio knows."""
    return np.asarray(data["triangles"].values, dtype=np.int64)


def _write_xdmf(data: xr.Dataset, path: Path) -> None:
    """Every time in one file, numbers as text: meshio would put its HDF5 file into the working directory."""
    import meshio

    with meshio.xdmf.TimeSeriesWriter(path, data_format="XML") as writer:
        writer.write_points_cells(_points(data), [("triangle", _triangles(data))])
        for time, field in zip(data["field_time"].values, data["field"].values.astype(float), strict=True):
            writer.write_data(float(time), point_data={NAME: field})


def _list_of_steps(times: np.ndarray, steps: Sequence[Path]) -> str:
    """A ParaView data file: which file belongs to which time."""
    rows = "".join(
        f'    <DataSet timestep="{time!r}" file="{escape(step.name)}"/>\n'
        for time, step in zip(times.tolist(), steps, strict=True)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<VTKFile type="Collection" version="0.1">\n'
        f"  <Collection>\n{rows}  </Collection>\n</VTKFile>\n"
    )
