"""Results of one layout as files: the first is written from scratch, the others are copies of it with other numbers.

Most of the time of a small netCDF file goes into its structure. All members of a campaign have the same one.
"""

from __future__ import annotations

import io
import threading
from typing import Any

import numpy as np

from ..data.record import Record

_worker = threading.local()
_WRITABLE = 1  # flag of HDF5's H5LTopen_file_image: the image may be written to


def filled(results: dict[str, Record]) -> bytes:
    """Content of a netCDF file; an earlier file of the same layout serves as the template.

    The first result is its root, as `thermofem.load` reads it; each further one is a group. Each has its hash. Made in
    memory: HDF5 can take the whole process down when a disk is full.
    """
    results = {name: record.signed() for name, record in results.items()}
    layout = [_layout(name, record) for name, record in results.items()]
    if getattr(_worker, "layout", None) != layout:
        _worker.content, _worker.layout, _worker.first = _written(results), layout, results
        return bytes(_worker.content)
    import h5py

    file = h5py.h5f.open_file_image(_worker.content, _WRITABLE)
    try:
        for number, (name, record) in enumerate(results.items()):
            group, first = h5py.h5g.open(file, name.encode() if number else b"/"), _worker.first[name]
            _attributes(group, first.attrs, record.attrs)
            for key, column in record.variables.items():
                values = column.values
                if values.dtype.kind in "fiu" and not np.array_equal(first[key].values, values):
                    h5py.h5d.open(group, key.encode()).write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(values))
        h5py.h5f.flush(file)
        return bytes(file.get_file_image())
    finally:
        file.close()


def _written(results: dict[str, Record]) -> bytes:
    import h5netcdf

    memory = io.BytesIO()
    with h5netcdf.File(memory, "w") as file:
        for number, (name, record) in enumerate(results.items()):
            record.write_into(file.create_group(name) if number else file)
    return memory.getvalue()


def _layout(name: str, record: Record) -> tuple[Any, ...]:
    """All that a file of other numbers has in common with this one."""
    variables = []
    for key, column in record.variables.items():
        values = column.values
        fixed = None if values.dtype.kind in "fiu" else str(values.tolist())
        variables.append((key, column.dims, values.shape, str(values.dtype), fixed, str(column.attrs)))
    attributes = [(key, type(value).__name__, np.shape(value)) for key, value in record.attrs.items()]
    return name, tuple(variables), tuple(attributes)


def _attributes(group: Any, before: Any, now: Any) -> None:
    """Other values of the attributes, in their places."""
    import h5py

    for key, value in now.items():
        if np.array_equal(before[key], value):
            continue
        place = h5py.h5a.open(group, key.encode())
        if isinstance(value, str):
            place.write(np.array(value, dtype=object).astype(h5py.string_dtype()))
        else:
            place.write(np.asarray(value, dtype=place.dtype).reshape(place.shape))
