"""When light and heaters of a run vary, from the inputs themselves: samples of a run may miss a short pulse."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.arrays import Array

from ..inputs import Pieces, add, joint, pieces

if TYPE_CHECKING:
    import xarray as xr


ATTRIBUTE = "varying"
HAIR = 1e-9  # of the largest value: what a fit of cubics to a constant leaves
GAP = 1 / 50  # of a run; shorter pauses between two changes are not kept
Spans = list[list[float]]  # from when to when, s


def changes(function: Pieces) -> Spans:
    """From when to when a piecewise cubic changes; a jump begins and ends at once."""
    a, edges = function.coefficients, function.edges
    hair = HAIR * np.abs(a[:, 0]).max()
    moves = np.any(np.abs(a[:, 1:]) * np.diff(edges)[:, None] ** np.arange(1, 4) > hair, axis=1)
    jumps = edges[1:-1][np.abs(a[1:, 0] - function.ends[:-1]) > hair]
    begin, end = np.concatenate([edges[:-1][moves], jumps]), np.concatenate([edges[1:][moves], jumps])
    return _merged(begin, end, GAP * (edges[-1] - edges[0]))


def beats(powers: Sequence[Pieces], frequencies: Sequence[Pieces]) -> Spans:
    """From when to when two lasers of different frequencies are on at once, on one window."""
    begin, end, length = [], [], 0.0
    for i, j in combinations(range(len(powers)), 2):
        edges = joint(powers[i], powers[j], frequencies[i], frequencies[j])
        apart = add([frequencies[i], frequencies[j].times(-1.0)]).on(edges).coefficients
        both = [np.any(powers[k].on(edges).coefficients, axis=1) for k in (i, j)]
        largest = max(np.abs(frequencies[k].coefficients[:, 0]).max() for k in (i, j))
        at = both[0] & both[1] & (np.abs(apart).max(axis=1) > HAIR * largest)
        begin.append(edges[:-1][at])
        end.append(edges[1:][at])
        length = edges[-1] - edges[0]
    return _merged(np.concatenate(begin), np.concatenate(end), GAP * length) if begin else []


def _merged(begin: Array, end: Array, gap: float) -> Spans:
    """Spans in order, of which those that are less than ``gap`` apart are one; times to six digits."""
    if begin.size == 0:
        return []
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], np.maximum.accumulate(end[order])
    apart = np.flatnonzero(begin[1:] > end[:-1] + gap)
    pairs = np.column_stack([begin[np.append(0, apart + 1)], end[np.append(apart, begin.size - 1)]])
    return [[float(f"{t:.6g}") for t in pair] for pair in pairs]


def spans(inputs: Mapping[str, Any], duration: float) -> dict[str, Spans]:
    """When each of some inputs varies: numbers, waveforms or `Pieces`, by name; what never does is left out."""
    given = {name: value for name, value in inputs.items() if not isinstance(value, float)}
    found = {name: changes(pieces(name, value, 0.0, duration)) for name, value in given.items()}
    return {name: when for name, when in found.items() if when}


def attribute(varying: Mapping[str, Any]) -> dict[str, str]:
    """The attribute of a run: when what varies, by name, or of a circuit by ring and name; JSON."""
    return {ATTRIBUTE: json.dumps(varying)}


def varies_in(run: xr.Dataset, begin: float, end: float = np.inf) -> str | None:
    """Names of the inputs that vary between two times in s, joined by "and"; None where attributes do not tell them."""
    try:
        found = json.loads(run.attrs[ATTRIBUTE])
        if "ring" in getattr(run, "coords", {}):
            found = found[str(run["ring"].values)]
        return " and ".join(name for name, when in found.items() if any(a < end and b > begin for a, b in when))
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return None  # a measured trace, or attributes that another program wrote
