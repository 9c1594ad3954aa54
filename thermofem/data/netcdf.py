"""netCDF files of any origin: their layout is checked before any value is loaded.

A file may declare more values than it holds, or bytes that lie in other files. `check` refuses both; `in_si` converts
the variables that `quantity.VARIABLES` names from the units that the file states.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import InputError, shown
from . import files, quantity

if TYPE_CHECKING:
    import xarray as xr

MOST_OBJECTS = 20_000  # variables, groups and dimension scales of one file
DEPTH = 8  # of groups
PACKED = 1100  # values a byte of a file can stand for: deflate reaches 1032 to 1
ROOM = 64_000_000  # bytes that any file may declare
LARGEST = 16_000_000_000  # bytes that no file may declare
DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
"""Exceptions of HDF5, h5netcdf and xarray for a damaged file."""
OPEN: dict[str, Any] = {"decode_times": False, "decode_timedelta": False, "phony_dims": "sort"}  # for open_dataset
HASH = "content_hash"  # attribute of the files that `dataset.save` writes: JSON with the hash and what it covers
VALID = ("valid_min", "valid_max", "valid_range")  # attributes; what lies outside is missing by CF's convention
ENCODED = {"missing_value", "scale_factor", "add_offset", "calendar", *VALID}  # attributes that change values
PER = "per unit"  # in the units of derivatives with respect to parameters
_PREFIXES = ("time_", "power_", "delta_T_")  # of a campaign: DRIVE follows


@contextlib.contextmanager
def opened_half() -> Iterator[None]:
    """Print nothing where h5netcdf closes a damaged file that it has opened half, and fails."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda unraisable: None
    try:
        yield
    finally:
        sys.unraisablehook = hook


def check(path: Path) -> None:
    """InputError unless every value of the file lies in it, and they are no more than it can hold.

    Raises InputError: external or virtual storage, links to other files, too many variables or values; a variable that
    is longer or shorter than its dimension, where h5netcdf leaves it so or adds zeros; no HDF5 file.
    """
    import h5py

    try:
        size = path.stat().st_size
        with h5py.File(path, "r") as file:
            declared = _declared(file)
    except DAMAGE as error:
        if isinstance(error, InputError):
            raise
        if _classic(path):
            raise InputError("is netCDF-3; save it as netCDF-4, such as with nccopy -k nc4 OLD NEW") from None
        raise InputError(f"cannot be read as netCDF ({error or type(error).__name__}); is it complete?") from None
    if declared > min(LARGEST, ROOM + PACKED * size):
        raise InputError(
            f"cannot be read: its {size} bytes declare {float(declared):.2g} bytes of values, more than fit"
        )


def _classic(path: Path) -> bool:
    """Whether a file is netCDF-3, which no reader here takes."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        return file.read(4) in (b"CDF\x01", b"CDF\x02", b"CDF\x05")
    return False


def _declared(file: Any) -> int:
    """Bytes of all values; InputError where values lie in another file."""
    import h5py

    groups, seen, total, depth = [file], 0, 0, 0
    while groups:
        below = []
        for group in groups:
            for name in group:
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    raise InputError(f"cannot be read: {shown(name)} is a link to another file")
                if isinstance(link, h5py.SoftLink):
                    raise InputError(f"cannot be read: {shown(name)} is a soft link; netCDF has none")
                item = group[name]
                seen += 1  # a group may hold itself under many names, and at the next depth each of them again
                if seen > MOST_OBJECTS or depth > DEPTH:
                    raise InputError(f"cannot be read: more than {MOST_OBJECTS} variables or {DEPTH} groups deep")
                if isinstance(item, h5py.Group):
                    below.append(item)
                elif isinstance(item, h5py.Dataset):
                    total += _values(name, item)
        groups, depth = below, depth + 1
    return total


def _values(name: str, item: Any) -> int:
    """Bytes of one variable; none for a dimension without coordinates, which is never loaded."""
    if item.external:
        raise InputError(f"cannot be read: the values of {shown(name)} lie in another file")
    if item.is_virtual:
        raise InputError(f"cannot be read: the values of {shown(name)} are views of other files")
    label = item.attrs.get("NAME", b"")
    if isinstance(label, bytes) and b"This is a netCDF dimension but not a netCDF variable." in label:
        return 0  # never loaded: h5netcdf compares the same words; in text of another type it does not find them
    for scales, length in zip(item.dims, item.shape or (), strict=False):
        if len(scales) and scales[0].shape[:1] != (length,):
            raise InputError(
                f"cannot be read: {shown(name)} has {length} values, its dimension {shown(scales[0].name.strip('/'))} "
                f"{'x'.join(map(str, scales[0].shape))}"
            )
    return int(np.prod(item.shape, dtype=object) if item.shape else 1) * max(1, item.dtype.itemsize)


def signed(variables: Mapping[Any, Any], attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes of a file with `HASH`: a hash of the content, and the names of the attributes that it covers.

    Others may be added to the file later, such as notes of its user. Each group of a file has a hash of its own.

    Parameters
    ----------
    variables : mapping from name to an object with dims, values and attrs
    attrs : mapping
        attributes of the Dataset.
    """
    plain = {key: value for key, value in attrs.items() if key != HASH}
    names = sorted(str(key) for key in plain if key != "coordinates")  # which xarray moves elsewhere
    return {**plain, HASH: json.dumps({"hash": _content_hash(variables, plain, names), "attributes": names})}


def unsigned(variables: Mapping[Any, Any], attrs: Mapping[Any, Any]) -> tuple[dict[Any, Any], bool | None]:
    """Attributes without `HASH`, and whether the content is as it was signed; None without a hash.

    A hash of 32 digits, of an earlier version, counts as none.
    """
    plain = {key: value for key, value in attrs.items() if key != HASH}
    written = str(attrs.get(HASH, ""))
    if len(written) in (0, 32):
        return plain, None
    try:
        kept = json.loads(written)
        return plain, bool(_content_hash(variables, plain, kept["attributes"]) == kept["hash"])
    except (LookupError, TypeError, ValueError, RecursionError):  # an attribute is missing, or the JSON is damaged
        return plain, False


def sign(file: Any) -> None:
    """Write `HASH` into an open file of h5netcdf that is otherwise complete."""
    file.attrs[HASH] = signed(_stored(file), file.attrs)[HASH]


def whole(path: Path) -> bool | None:
    """Whether a file is as it was signed, without its values in memory at once; None without a hash."""
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        return unsigned(_stored(file), file.attrs)[1]


def _stored(file: Any) -> dict[str, Any]:
    return {name: SimpleNamespace(dims=v.dimensions, values=v, attrs=v.attrs) for name, v in file.variables.items()}


def _content_hash(variables: Mapping[Any, Any], attrs: Mapping[Any, Any], names: Sequence[str]) -> str:
    """Hash of the values, dimensions and units of a Dataset, and of its attributes of these names."""
    found = hashlib.sha256()
    for name in sorted(variables, key=str):
        v = variables[name]
        head = [str(name), list(map(str, v.dims)), list(v.values.shape), str(v.attrs.get("units", ""))]
        found.update(json.dumps(head).encode())
        for piece in _pieces(v.values):
            found.update(_bytes(piece))
    for name in names:
        found.update(json.dumps(name).encode() + _bytes(np.ravel(attrs[name])))
    return found.hexdigest()[:32]


def _pieces(values: Any) -> Iterator[Any]:
    """Rows of an array or of a variable of h5netcdf, of numbers so many at a time as memory holds."""
    if not values.shape or np.dtype(values.dtype).kind not in "biufc":
        yield np.asarray(values[()])
        return
    rows = max(1, ROOM // max(1, 8 * int(np.prod(values.shape[1:]))))
    for start in range(0, values.shape[0], rows):
        yield np.asarray(values[start : start + rows])


def _bytes(values: Any) -> bytes:
    """Numbers in one type, which a file keeps; anything else as text."""
    kind = values.dtype.kind
    if kind in "biufc":
        return bytes(values.astype("<c16" if kind == "c" else "<f8").tobytes())
    return json.dumps([one.decode() if isinstance(one, bytes) else str(one) for one in values.ravel()]).encode()


def packed(data: xr.Dataset) -> bool:
    """Whether a variable is written in another type than it has, as some programs' files are, which rounds it."""
    return any(
        "scale_factor" in v.encoding or np.dtype(v.encoding.get("dtype", v.dtype)).kind != v.dtype.kind
        for v in data.variables.values()
        if v.dtype.kind in "biufc"
    )


def in_si(data: xr.Dataset) -> xr.Dataset:
    """The Dataset with every known variable in the unit of `quantity.VARIABLES`; no unit counts as that unit.

    Raises InputError: a unit that is no text, unknown, or of another dimension; values that the file calls missing.
    """
    changed = {}
    for name, variable in data.variables.items():
        field, given = known(str(name)), variable.attrs.get("units")
        if field is None:
            continue
        _check_valid(str(name), variable)
        odd = _misnamed(variable.attrs)
        if odd is not None:
            raise InputError(f"variable {name!r} has an attribute {odd!r}; netCDF calls it 'units': rename it")
        if _divided(str(name), variable, field.unit):
            continue
        if variable.values.dtype.kind == "c":
            raise InputError(f"variable {name!r} holds complex values; real numbers are needed")
        if given is None or (isinstance(given, str) and given == field.unit):
            continue
        if not isinstance(given, str):
            raise InputError(f"variable {name!r} has the unit {shown(given)}, which is no text")
        if given in ("", "1") or variable.values.dtype.kind not in "fiu":
            if given in ("", "1") and field.unit not in ("", "1"):
                raise InputError(f"variable {name!r} states the unit {given!r}; {field.unit} is needed")
            continue
        offset, factor = _line(given, field, str(name))
        attributes = {key: value for key, value in variable.attrs.items() if key not in VALID}
        attributes["units"] = field.unit
        changed[name] = (variable.dims, offset + factor * np.asarray(variable.values, dtype=float), attributes)
    return data.assign(changed) if changed else data


def _divided(name: str, variable: Any, unit: str) -> bool:
    """Whether a variable is a derivative with respect to parameters, or an energy for 1 W in a linear spectrum."""
    given = variable.attrs.get("units")
    if not isinstance(given, str):
        return False
    return (given.startswith(f"{unit} {PER}") and "parameter" in variable.dims) or (name, given) == ("energy", "J/W")


def _check_valid(name: str, variable: Any) -> None:
    """InputError where a value is one that the attributes of its variable call missing, or outside its valid range.

    xarray has made nan of ``missing_value`` in a file that it read, and has scaled values but not their valid range.
    """
    values, attrs = variable.values, variable.attrs
    given = {key: np.ravel(attrs[key]) for key in (*VALID, "missing_value", "_FillValue") if key in attrs}
    if not given or values.dtype.kind not in "fiu":
        return
    for key, limit in given.items():
        if limit.dtype.kind not in "fiu" or (key in VALID and limit.size != 1 + (key == "valid_range")):
            raise InputError(f"variable {name!r} has {key} = {shown(attrs[key])}, which is no number or range")
        if key in VALID and limit.dtype.kind in "iu" and "scale_factor" in variable.encoding:
            scale, offset = (float(variable.encoding.get(k, d)) for k, d in (("scale_factor", 1), ("add_offset", 0)))
            limit = limit * scale + offset
        low = limit[0] if key in ("valid_min", "valid_range") else -np.inf
        high = limit[-1] if key in ("valid_max", "valid_range") else np.inf
        missing = (values < low) | (values > high) if key in VALID else np.isin(values, limit)
        if np.any(missing):
            raise InputError(
                f"variable {name!r} holds {values[missing][0]:g}, which its {key} = {shown(attrs[key])} calls missing; "
                "leave such samples out"
            )


def says_si(name: str, attrs: Mapping[str, Any]) -> bool:
    """Whether a variable needs no conversion: one of `quantity.VARIABLES` in its unit, or none of them."""
    field = known(name)
    if field is None or "units" not in attrs:
        return field is None or _misnamed(attrs) is None
    return bool(np.all(attrs["units"] == field.unit))


def _misnamed(attrs: Mapping[Any, Any]) -> str | None:
    """An attribute that means the unit, such as "Units", where there is no "units"."""
    return None if "units" in attrs else next((str(k) for k in attrs if str(k).lower() in ("unit", "units")), None)


def _line(given: str, field: quantity.Variable, name: str) -> tuple[float, float]:
    """Offset and factor of a unit; a rise in degrees Celsius has no offset."""
    unit = "" if field.unit == "1" else field.unit
    if unit not in quantity.SI:  # no unit that a person writes
        raise InputError(f"variable {name!r} is in {shown(given)}; {field.unit} is needed")
    offset, factor = quantity.line(given, unit, name=f"unit of variable {name!r}")
    return (0.0 if "rise" in field.long_name else offset), factor


def known(name: str) -> quantity.Variable | None:
    """Unit and long name of a variable; None for a name that is not ours."""
    found = quantity.VARIABLES.get(name)
    if found is None:
        prefix = next((p for p in _PREFIXES if name.startswith(p) and len(name) > len(p)), None)
        found = quantity.VARIABLES[prefix[:-1]] if prefix else None
    return found


def checked_path(path: str | Path) -> Path:
    """The path of a file whose layout is sound; InputError, beginning with the path, where it is not."""
    path = files.regular(path)
    try:
        check(path)
    except InputError as error:
        raise InputError(f"{path} {error}") from None
    return path
