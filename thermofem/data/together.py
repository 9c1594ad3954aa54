"""Whether Datasets that one function takes together are of one channel and one geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..checks import InputError, shown

PARTS = "heated", "read"
NAMES = "the data were read in {}: one model follows them only where these are names of one part"
OTHER = "the data are of two geometries or more, which one model cannot follow: fit each on its own"


def other_geometry(one: Mapping[str, Any] | None, other: Mapping[str, Any] | None) -> bool:
    """Whether two origins, such as attributes of a Dataset, state different geometries."""
    first, second = ((origin or {}).get("geometry") for origin in (one, other))
    return bool(first and second) and str(first) != str(second)


def check_together(datasets: Sequence[Any]) -> tuple[str, ...]:
    """Doubts about Datasets that together train one model; what they do not state counts as equal.

    A measured table states no heated part, and as what is read the name of its column, which need not be a part.

    Raises InputError: another heated part, or another part that is read.
    """
    attrs = [data.attrs for data in datasets]
    solved = [(k, stated) for k, stated in enumerate(attrs) if stated.get("heated")]
    for what in PARTS:
        parts = [(k, str(stated[what])) for k, stated in solved if stated.get(what)]
        for k, part in parts[1:]:
            first, other = parts[0]
            if part != other:
                here, there = f"data[{k}] was {what} in {shown(part)}", f"data[{first}] in {shown(other)}"
                raise InputError(f"{here} and {there}: two channels; fit each on its own")
    return tuple(
        words.format(" and ".join(map(shown, found)))
        for words, found in (
            (NAMES, dict.fromkeys(str(stated["read"]) for stated in attrs if stated.get("read"))),
            (OTHER, dict.fromkeys(str(stated["geometry"]) for stated in attrs if stated.get("geometry"))),
        )
        if len(found) > 1
    )
