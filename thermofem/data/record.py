"""Datasets under the names that the folders of `coupled` still use; `xarray.Dataset` itself takes their place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, TypeVar

import numpy as np
import xarray as xr

F = TypeVar("F", bound=Callable[..., Any])
Record: TypeAlias = xr.Dataset
recorded = xr.Dataset


def column(dims: str | tuple[str, ...], values: Any, attrs: Mapping[str, Any]) -> tuple[Any, ...]:
    """One variable as `xarray.Dataset` takes it."""
    return dims, np.asarray(values), attrs


def as_dataset(function: F) -> F:
    """The function itself, also as its attribute ``record``."""
    function.record = function  # type: ignore[attr-defined]
    return function
