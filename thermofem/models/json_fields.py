"""Fields of a model file, read with errors that name them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..checks import check_names

Kind = TypeVar("Kind")


def reader(read: Callable[[type[Kind], Mapping[str, Any]], Kind]) -> Callable[[type[Kind], Mapping[str, Any]], Kind]:
    """Make a method ``from_json`` raise InputError for whatever content is not that of its model."""

    @wraps(read)
    def checked(cls: type[Kind], content: Mapping[str, Any]) -> Kind:
        try:
            return read(cls, content)
        except KeyError as error:
            raise checks.InputError(f"there is no {error.args[0]!r}; docs/models.md lists the fields") from None
        except (TypeError, AttributeError, IndexError) as error:
            raise checks.InputError(f"it is not laid out as docs/models.md says: {error}") from None

    return checked


def names(model: Any) -> dict[str, list[str]]:
    """Fields of the heated and read parts."""
    return {"inputs": list(model.inputs), "outputs": list(model.outputs)}


def parts(content: Mapping[str, Any]) -> dict[str, Any]:
    """Heated and read parts, as keyword arguments of a model."""
    return {which: check_names(which, content[which]) for which in ("inputs", "outputs")}


def rows(first: tuple[str, ArrayLike], second: tuple[str, ArrayLike]) -> list[dict[str, float]]:
    """Two arrays, each with its name, as a list of objects."""
    pairs = zip(np.asarray(first[1]).tolist(), np.asarray(second[1]).tolist(), strict=True)
    return [{first[0]: one, second[0]: other} for one, other in pairs]


def columns(content: Mapping[str, Any], which: str, **units: str) -> dict[str, Any]:
    """Each named number of a list of objects, not empty, as a list; ``units`` by name, for errors."""
    return {
        name: [checks.finite(f"{which}[{i}].{name}", one[name], unit=unit) for i, one in enumerate(content[which])]
        for name, unit in units.items()
    }


def table(content: Mapping[str, Any], which: str, dimensions: int) -> NDArray[np.float64]:
    """An array of numbers with the given number of dimensions, written as nested lists."""
    found = checks.numbers(which, content[which])
    if found.ndim != dimensions:
        raise checks.InputError(f"{which} has {found.ndim} dimensions; {dimensions} are needed")
    return found
