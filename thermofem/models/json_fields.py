"""Fields of a model file, read with errors that name them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..names import check_names


def names(content: Mapping[str, Any], which: str) -> tuple[str, ...]:
    """A list of names, not empty."""
    return check_names(which, content[which])


def parts(content: Mapping[str, Any]) -> dict[str, Any]:
    """Heated and read parts, as keyword arguments of a model."""
    return {which: names(content, which) for which in ("inputs", "outputs")}


def table(content: Mapping[str, Any], which: str, dimensions: int) -> NDArray[np.float64]:
    """An array of numbers with the given number of dimensions, written as nested lists."""
    try:
        found = np.array(content[which], dtype=float)
    except ValueError:
        raise checks.InputError(f"{which} must hold rectangular tables of numbers") from None
    if found.ndim != dimensions:
        needed = {1: "a list of numbers", 2: "a table of rows"}[dimensions]
        raise checks.InputError(f"{which} has {found.ndim} dimensions; {needed} is needed")
    return checks.numbers(which, found)
