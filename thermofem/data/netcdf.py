"""Datasets as netCDF-4 files: written whole, read only when their values fit into memory.

A file may declare more values than it holds, or bytes that lie in other files; `check` refuses both before any value
is loaded.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..checks import InputError, one_line, prefixed, shown
from .files import regular, write_whole
from .variables import in_si

SCHEMA = 1  # of training data, see `thermofem.data.dataset`
MOST_OBJECTS = 20_000  # variables and groups of one file
DEPTH = 8  # of groups
DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
"""Exceptions of HDF5, h5netcdf and xarray for a damaged file."""
OPEN: dict[str, Any] = {"decode_times": False, "decode_timedelta": False, "phony_dims": "sort"}  # for open_dataset


def save(data: xr.Dataset, path: str | Path) -> Path:
    """Write a Dataset as netCDF, whole or not at all; returns the path.

    Raises InputError: no Dataset, values that netCDF cannot hold, a folder that cannot be written.
    """
    # 1000: values above which a variable is written deflated
    encoding = {name: {"zlib": True} for name, v in data.data_vars.items() if v.size > 1000}
    with prefixed("data cannot be written as netCDF", TypeError, ValueError, OverflowError):
        content = data.to_netcdf(engine="h5netcdf", encoding=encoding)
    return write_whole(path, lambda p: p.write_bytes(content))


def load(path: str | Path) -> xr.Dataset:
    """Read a Dataset written by `save`, into memory; time, power and the other known variables come in SI.

    Raises InputError: no such file, not netCDF, or written by a newer schema; values that lie in other files or that
    the file cannot hold; a unit of a known variable that is unknown or of another dimension.
    """
    path = regular(path)
    with prefixed(f"{path} cannot be read as netCDF", *DAMAGE, hint="is it complete?"):
        check(path)
        with xr.open_dataset(path, engine="h5netcdf", **OPEN) as opened:
            data = opened.load()
    schema = data.attrs.get("schema", SCHEMA)
    if not np.isscalar(schema) or schema not in range(SCHEMA + 1):
        what = f"{path} has schema {one_line(str(schema), most=80)}"
        raise InputError(f"{what}; this version reads up to {SCHEMA}, update thermofem")
    return in_si(str(path), data)


def check(path: Path) -> None:
    """InputError unless every value of the file lies in it, and they are no more than it can hold.

    Raises InputError: external or virtual storage, links to other files, too many variables or values, no HDF5 file.
    """
    import h5py

    size = path.stat().st_size
    with path.open("rb") as raw:
        if raw.read(3) == b"CDF":
            raise InputError("it is netCDF-3", "save it as netCDF-4, such as with nccopy -k nc4 OLD NEW")
    with h5py.File(path, "r") as file:
        declared = _declared(file)
    # 1100: values a byte of a file can stand for: deflate reaches 1032 to 1
    if declared > min(16e9, 64e6 + 1100 * size):  # 16e9: bytes that no file may declare; 64e6: that any may
        raise InputError(f"its {size} bytes declare {float(declared):.2g} bytes, more than fit")


def _declared(file: Any) -> int:
    """Number of bytes of all values in a file; InputError where values lie in another file."""
    import h5py

    names: list[str] = []

    def wrong(name: str, link: Any) -> str | None:
        names.append(name)
        few = len(names) <= MOST_OBJECTS and name.count("/") <= DEPTH
        return None if few and isinstance(link, h5py.HardLink) else name

    if found := file.visititems_links(wrong):  # which ends at the first one
        raise InputError(f"{shown(found)} is a link, more than {MOST_OBJECTS} variables or {DEPTH} groups deep")
    total = 0
    for name in names:
        item = file[name]
        if isinstance(item, h5py.Dataset):
            total += _values(name, item)
    return total


def _values(name: str, item: Any) -> int:
    """Number of bytes of one variable; 0 for a dimension without coordinates, which is never loaded."""
    label = item.attrs.get("NAME", b"")
    if isinstance(label, bytes) and b"This is a netCDF dimension but not a netCDF variable." in label:
        return 0
    shape = item.shape or ()
    sizes = zip(item.dims, shape, strict=False)
    short = any(len(scales) and scales[0].shape[:1] != (length,) for scales, length in sizes)  # h5netcdf adds zeros
    if short or item.external or item.is_virtual:
        raise InputError(f"values of {shown(name)} lie in another file, or are not as many as its dimensions say")
    return math.prod(shape) * max(1, item.dtype.itemsize)
