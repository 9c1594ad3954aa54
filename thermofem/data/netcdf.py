"""Datasets as netCDF-4 files: written whole with a hash of their content, read only when their values fit into memory.

A file may declare more values than it holds, or bytes that lie in other files; `check` refuses both before any value
is loaded.
"""

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..checks import InputError, one_line, prefixed, shown
from .files import regular, write_whole
from .variables import in_si

log = logging.getLogger("thermofem")

SCHEMA = 1  # of training data, see `thermofem.data.dataset`
MOST_OBJECTS = 20_000  # variables and groups of one file
DEPTH = 8  # of groups
LARGEST = 16_000_000_000  # bytes that no file may declare
DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
"""Exceptions of HDF5, h5netcdf and xarray for a damaged file."""
OPEN: dict[str, Any] = {"decode_times": False, "decode_timedelta": False, "phony_dims": "sort"}  # for open_dataset
HASH = "content_hash"  # attribute of the files that `save` writes: JSON with the hash and what it covers


def save(data: xr.Dataset, path: str | Path) -> Path:
    """Write a Dataset as netCDF, whole or not at all; returns the path.

    Raises InputError: no Dataset, values that netCDF cannot hold, a folder that cannot be written.
    """
    if not packed(data):
        data = data.assign_attrs(signed(data.variables, data.attrs))
    # 1000: values above which a variable is written deflated
    encoding = {name: {"zlib": True} for name, v in data.data_vars.items() if v.size > 1000}
    with prefixed("data cannot be written as netCDF", TypeError, ValueError, OverflowError):
        content = data.to_netcdf(engine="h5netcdf", encoding=encoding)
    return write_whole(path, lambda p: p.write_bytes(content))


def intact(path: Path) -> bool:
    """Whether a file that `save` wrote can be read and is as it was written."""
    try:
        with xr.open_dataset(path, engine="h5netcdf", **OPEN) as opened:
            return unsigned(opened.load().variables, opened.attrs)[1] is True
    except DAMAGE:
        return False


def load(path: str | Path) -> xr.Dataset:
    """Read a Dataset written by `save`, into memory; time, power and the other known variables come in SI.

    Where values, units or attributes were changed after `save` wrote them, the log says so.

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
    data.attrs, same = unsigned(data.variables, data.attrs)
    if same is False:
        log.warning("%s was changed after thermofem wrote it: values, units or attributes are not those of then", path)
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
    if declared > min(LARGEST, 64_000_000 + 1100 * size):  # 64_000_000: bytes that any file may declare
        raise InputError(f"its {size} bytes declare {float(declared):.2g} bytes, more than fit")


def _declared(file: Any) -> int:
    """Bytes of all values; InputError where values lie in another file."""
    import h5py

    names: list[str] = []

    def wrong(name: str, link: Any) -> str | None:
        names.append(name)
        inside = isinstance(link, h5py.HardLink) and len(names) <= MOST_OBJECTS and name.count("/") <= DEPTH
        return None if inside else name

    if found := file.visititems_links(wrong):  # which ends at the first one
        raise InputError(f"{shown(found)} is a link, more than {MOST_OBJECTS} variables or {DEPTH} groups deep")
    return sum(_values(name, item) for name in names if isinstance(item := file[name], h5py.Dataset))


def _values(name: str, item: Any) -> int:
    """Bytes of one variable; none for a dimension without coordinates, which is never loaded."""
    label = item.attrs.get("NAME", b"")
    if isinstance(label, bytes) and b"This is a netCDF dimension but not a netCDF variable." in label:
        return 0
    sizes = zip(item.dims, item.shape or (), strict=False)
    short = any(len(scales) and scales[0].shape[:1] != (length,) for scales, length in sizes)  # h5netcdf adds zeros
    if short or item.external or item.is_virtual:
        raise InputError(f"values of {shown(name)} lie in another file, or are not as many as its dimensions say")
    return int(np.prod(item.shape, dtype=object) if item.shape else 1) * max(1, item.dtype.itemsize)


def packed(data: xr.Dataset) -> bool:
    """Whether a variable is written in another type than it has, as some programs' files are, which rounds it."""
    return any(
        "scale_factor" in v.encoding or np.dtype(v.encoding.get("dtype", v.dtype)).kind != v.dtype.kind
        for v in data.variables.values()
        if v.dtype.kind in "biufc"
    )


def signed(variables: Mapping[Any, Any], attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes of a file with `HASH`: a hash of the content, and the names of the attributes that it covers.

    Others may be added to the file later, such as notes of its user. Each group of a file has a hash of its own.

    variables: mapping from name to an object with dims, values and attrs.
    """
    bare = {key: value for key, value in attrs.items() if key != HASH}
    names = sorted(str(key) for key in bare if key != "coordinates")  # which xarray moves elsewhere
    return {**bare, HASH: json.dumps({"hash": _content_hash(variables, bare, names), "attributes": names})}


def unsigned(variables: Mapping[Any, Any], attrs: Mapping[Any, Any]) -> tuple[dict[Any, Any], bool | None]:
    """Attributes without `HASH`, and whether the content is as it was signed; None without a hash."""
    bare = {key: value for key, value in attrs.items() if key != HASH}
    if HASH not in attrs:
        return bare, None
    try:
        kept = json.loads(str(attrs[HASH]))
        return bare, bool(_content_hash(variables, bare, kept["attributes"]) == kept["hash"])
    except (LookupError, TypeError, ValueError, RecursionError):  # an attribute is missing, or the JSON is damaged
        return bare, False


def _content_hash(variables: Mapping[Any, Any], attrs: Mapping[Any, Any], names: Sequence[str]) -> str:
    """Hash of the values, dimensions and units of a Dataset, and of its attributes of these names."""
    found = hashlib.sha256()
    for name in sorted(variables, key=str):
        v = variables[name]
        values = np.asarray(v.values)
        head = [str(name), list(map(str, v.dims)), list(values.shape), str(v.attrs.get("units", ""))]
        found.update(json.dumps(head).encode() + _bytes(values))
    for name in names:
        found.update(json.dumps(name).encode() + _bytes(np.ravel(attrs[name])))
    return found.hexdigest()[:32]


def _bytes(values: Any) -> bytes:
    """Numbers in one type, which a file keeps; anything else as text."""
    kind = values.dtype.kind
    if kind in "biufc":
        return bytes(values.astype("<c16" if kind == "c" else "<f8").tobytes())
    return json.dumps([one.decode() if isinstance(one, bytes) else str(one) for one in values.ravel()]).encode()
