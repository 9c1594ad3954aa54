"""Whether Datasets that one function takes together are of one channel and one geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .checks import InputError, shown

PARTS = "heated", "read"
OTHER = "the data are of two geometries or more, which one model cannot follow: fit each on its own"


def other_geometry(one: Mapping[str, Any] | None, other: Mapping[str, Any] | None) -> bool:
    """Whether two origins, such as attributes of a Dataset, state different geometries."""
    first, second = ((origin or {}).get("geometry") for origin in (one, other))
    return bool(first and second) and str(first) != str(second)


def check_together(datasets: Sequence[Any]) -> tuple[str, ...]:
    """Doubts about Datasets that together train one model; what they do not state counts as equal.

    Raises InputError: another heated part, or another part that is read.
    """
    for what in PARTS:
        stated = [(k, str(data.attrs[what])) for k, data in enumerate(datasets) if data.attrs.get(what)]
        for k, part in stated[1:]:
            first, other = stated[0]
            if part != other:
                here, there = f"data[{k}] was {what} in {shown(part)}", f"data[{first}] in {shown(other)}"
                raise InputError(f"{here} and {there}: two channels; fit each on its own")
    geometries = {str(data.attrs["geometry"]) for data in datasets if data.attrs.get("geometry")}
    return (OTHER,) if len(geometries) > 1 else ()
