"""Results of one layout as files: the first is written by xarray, the others are copies of it with other numbers.

Most of the time of a small netCDF file goes into its structure. All members of a campaign have the same one.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

_worker = threading.local()


def filled(results: dict[str, xr.Dataset], write: Callable[[dict[str, xr.Dataset]], bytes]) -> bytes:
    """The file of ``write(results)``, up to the order of attributes, made from an earlier file of the same layout."""
    layout = [_layout(name, data) for name, data in results.items()]
    if getattr(_worker, "layout", None) != layout:
        _worker.content, _worker.layout, _worker.first = write(results), layout, results
        return bytes(_worker.content)
    import h5py

    memory = io.BytesIO(_worker.content)
    with h5py.File(memory, "r+") as file:
        for number, (name, data) in enumerate(results.items()):
            group, first = file[name] if number else file, _worker.first[name]
            _attributes(group, first.attrs, data.attrs)
            for key, variable in data.variables.items():
                if variable.dtype.kind in "fiu" and not np.array_equal(first[key].values, variable.values):
                    group[str(key)][...] = variable.values
    return memory.getvalue()


def _layout(name: str, data: xr.Dataset) -> tuple[Any, ...]:
    """All that a file of other numbers has in common with this one."""
    variables = []
    for key, variable in data.variables.items():
        fixed = None if variable.dtype.kind in "fiu" else str(variable.values.tolist())
        variables.append((key, variable.dims, variable.shape, str(variable.dtype), fixed, str(variable.attrs)))
    attributes = [(key, type(value).__name__, np.shape(value)) for key, value in data.attrs.items()]
    return name, tuple(variables), tuple(attributes)


def _attributes(group: Any, before: dict[Any, Any], now: dict[Any, Any]) -> None:
    for key, value in now.items():
        if np.array_equal(before[key], value):
            continue
        if isinstance(value, str):
            group.attrs[key] = value
        else:
            group.attrs.modify(key, np.atleast_1d(value))  # in its place
