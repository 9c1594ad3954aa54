"""Results as plain arrays with dimensions, units and names: the content of a Dataset without importing xarray.

A command needs no more than this to write its file. Importing xarray costs more than solving the reference strip: it
imports pandas, and dask and pint where they are installed.
"""

from __future__ import annotations

import functools
import inspect
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from . import netcdf

if TYPE_CHECKING:
    import xarray as xr

P = ParamSpec("P")
COMPRESSED = 1000  # values above which a variable is written deflated


class Column(NamedTuple):
    """One variable: dimensions, values and attributes."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: Mapping[str, Any]

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return self.values.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the values."""
        return self.values.dtype


@dataclass(frozen=True, eq=False)
class Record:
    """Variables, coordinates and attributes of a Dataset; read as one: ``record["time"].values``, ``record.attrs``."""

    data: Mapping[str, Column]
    coordinates: Mapping[str, Column]
    attrs: Mapping[str, Any]

    @property
    def variables(self) -> dict[str, Column]:
        """Data and coordinates."""
        return {**self.data, **self.coordinates}

    def __getitem__(self, name: str) -> Column:
        return self.variables[name]

    def __contains__(self, name: str) -> bool:
        return name in self.variables

    def dataset(self) -> xr.Dataset:
        """Convert to xarray's Dataset."""
        import xarray as xr

        return xr.Dataset(dict(self.data), coords=dict(self.coordinates), attrs=dict(self.attrs))

    def to_netcdf(self) -> memoryview:
        """Content of the netCDF-4 file, as xarray would write it."""
        import h5netcdf

        whole = io.BytesIO()
        with h5netcdf.File(whole, "w") as file:
            self.signed().write_into(file)
        return whole.getbuffer()

    def signed(self) -> Record:
        """The record with the hash of its content among its attributes."""
        return replace(self, attrs=netcdf.signed(self.variables, self.attrs))

    def write_into(self, group: Any) -> None:
        """Write everything into an empty h5netcdf file or group."""
        for column in self.variables.values():
            for dim, size in zip(column.dims, column.values.shape, strict=True):
                group.dimensions.setdefault(dim, size)
        for name, column in self.variables.items():
            _write(group, name, column, self._beside(name))
        for key, value in self.attrs.items():
            group.attrs[key] = value

    def _beside(self, name: str) -> str:
        """Names of the coordinates of a variable that are not its dimensions, in netCDF's convention."""
        if name in self.coordinates:
            return ""
        dims = set(self[name].dims)
        return " ".join(k for k, v in self.coordinates.items() if k not in v.dims and dims.issuperset(v.dims))


class Answering(Protocol[P]):
    """A function that returns a Dataset; its attribute ``record`` is the function that returns a Record instead."""

    record: Callable[P, Record]

    def __call__(self, *args: P.args, **given: P.kwargs) -> xr.Dataset:
        """The Dataset."""


def as_dataset(function: Callable[P, Record]) -> Answering[P]:
    """A decorator: the function returns a Dataset; ``function.record`` is the one that needs no xarray."""

    @functools.wraps(function)
    def call(*args: P.args, **given: P.kwargs) -> xr.Dataset:
        return function(*args, **given).dataset()

    found = cast("Any", call)
    found.record = function
    found.__signature__ = inspect.signature(function).replace(return_annotation="xr.Dataset")
    return cast("Answering[P]", found)


def _write(file: Any, name: str, column: Column, beside: str) -> None:
    """One variable with its attributes."""
    import h5py

    values, text = column.values, column.values.dtype.kind in "UO"
    deflated = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if values.size > COMPRESSED else {}
    dtype = h5py.string_dtype() if text else values.dtype
    variable = file.create_variable(name, column.dims, dtype, **deflated)
    variable[...] = values.astype(object) if text else values
    for key, value in {**column.attrs, **({"coordinates": beside} if beside else {})}.items():
        variable.attrs[key] = value


def column(dims: str | tuple[str, ...], values: Any, attrs: Mapping[str, Any]) -> Column:
    """A column of any array."""
    return Column((dims,) if isinstance(dims, str) else dims, np.asarray(values), attrs)


def recorded(
    variables: Mapping[str, tuple[Any, ...]], coordinates: Mapping[str, tuple[Any, ...]], attrs: Mapping[str, Any]
) -> Record:
    """A record of what `xarray.Dataset` takes: dimensions, values and attributes by name."""
    data, others = ({name: column(*one) for name, one in of.items()} for of in (variables, coordinates))
    return Record(data, others, attrs)


def stored(path: Path) -> Record | None:
    """Read a file of `dataset.save` or `Record.to_netcdf` whose content hash is unchanged and whose units are SI.

    None for any other file, and for one with text or several probes: xarray reads those.
    """
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        attrs, variables = dict(file.attrs), dict[str, Column]()
        if netcdf.HASH not in attrs or file.groups:
            return None
        beside: set[str] = set()
        for name, variable in file.variables.items():
            about = dict(variable.attrs)
            beside.update(str(about.pop("coordinates", "")).split())
            if not np.all(np.isnan(about.pop("_FillValue", np.nan))):  # what xarray writes beside floats is NaN
                return None
            if variable.dtype.kind not in "fiu" or about.keys() & netcdf.ENCODED or not netcdf.says_si(name, about):
                return None
            variables[name] = Column(tuple(variable.dimensions), np.asarray(variable[...]), about)
    attrs, whole = netcdf.unsigned(variables, attrs)
    if "probe" in variables or not whole:
        return None
    beside.update(name for name, one in variables.items() if one.dims == (name,))
    coordinates = {name: one for name, one in variables.items() if name in beside}
    return Record({name: one for name, one in variables.items() if name not in beside}, coordinates, attrs)


def joined(first: Record, second: Record) -> Record:
    """Variables of both, attributes of the first."""
    return Record({**first.data, **second.data}, {**first.coordinates, **second.coordinates}, first.attrs)
