"""When light and heaters of a run vary, from the inputs themselves: samples of a run may miss a short pulse."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..inputs import Pieces, pieces

if TYPE_CHECKING:
    import xarray as xr

    from thermofem.record import Record

ATTRIBUTE = "varying"
HAIR = 1e-9  # of the largest value: what a fit of cubics to a constant leaves
GAP = 1 / 50  # of a run; shorter pauses between two changes are not kept
LIGHT = "the light of "  # a ring of a circuit, in which lasers of several frequencies beat


def changes(function: Pieces) -> list[list[float]]:
    """From when to when a piecewise cubic changes, s; a jump begins and ends at once."""
    a, edges = function.coefficients, function.edges
    hair = HAIR * np.abs(a[:, 0]).max()
    moves = np.any(np.abs(a[:, 1:]) * np.diff(edges)[:, None] ** np.arange(1, 4) > hair, axis=1)
    jumps = edges[1:-1][np.abs(a[1:, 0] - function.ends[:-1]) > hair]
    begin, end = np.concatenate([edges[:-1][moves], jumps]), np.concatenate([edges[1:][moves], jumps])
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], np.maximum.accumulate(end[order])
    apart = np.flatnonzero(begin[1:] > end[:-1] + GAP * (edges[-1] - edges[0]))
    first, last = np.append(0, apart + 1), np.append(apart, begin.size - 1)
    pairs = np.column_stack([begin[first], end[last]]) if begin.size else np.empty((0, 2))
    return [[float(f"{t:.6g}") for t in pair] for pair in pairs]


def varying(inputs: Mapping[str, Any], duration: float, beating: Collection[str] = ()) -> dict[str, str]:
    """The attribute of a run: when which input varies, s, as JSON.

    inputs: numbers, waveforms or `Pieces`, by name.
    beating: names of what varies all the time, as lasers of several frequencies meet there.
    """
    given = {name: value for name, value in inputs.items() if not isinstance(value, float)}
    found = {name: changes(pieces(name, value, 0.0, duration)) for name, value in given.items()}
    found = {name: when for name, when in found.items() if when} | {name: [[0.0, duration]] for name in beating}
    return {ATTRIBUTE: json.dumps(found)}


def varies_in(run: xr.Dataset | Record, begin: float, end: float) -> str | None:
    """Names of the inputs that vary between two times in s, joined by "and"; None where attributes do not tell them.

    Of one ring of a circuit the light of the others does not count.
    """
    try:
        found = json.loads(run.attrs[ATTRIBUTE])
        moving = [str(name) for name, when in found.items() if any(a < end and b > begin for a, b in when)]
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return None  # a measured trace, or attributes that another program wrote
    own = LIGHT + str(run["ring"].values) if "ring" in getattr(run, "coords", {}) else ""
    return " and ".join(name for name in moving if not name.startswith(LIGHT) or name == own)
