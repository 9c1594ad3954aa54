"""Reasons to doubt a fit of slow sweeps: what is left open, bounds, misfits, correlated residuals, a second answer."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from thermofem.arrays import Array

from ..identification.box_search import at_bound
from .slow_sweeps import ABSOLUTE
from .transmission_search import End, Search

WORSE = 1.5  # misfit over the noise above which a note reports it
SIGNIFICANT = 5.0  # deviations of the correlation of white residuals, 1/sqrt(n), above which it counts
LARGE = 0.5  # root mean square of the residuals of a sweep: below, what is left is smaller than its noise
LEVEL = 0.01  # of the input: offset of a through port in W or fractions, above which a note reports it
STRONGEST = 0.95  # correlation that widens deviations the most
CAUSES = (
    "fringes, a resonance split in two by backscatter (doublet), another resonance near by, or a saturated detector"
)


class Correlation(NamedTuple):
    """Correlation of the residuals of a sweep with those of the next samples, and the widening that it asks for.

    widening: sqrt((1 + c)/(1 - c)) of the deviation of a mean, for residuals of a first-order process; else 1.
    """

    value: float
    widening: float


def correlation_of(residual: Array) -> Correlation:
    """Correlation of neighbouring residuals, 0 where it is not significant or they are below the noise."""
    r = residual - residual.mean()
    square = float(r @ r)
    if square < LARGE**2 * r.size:
        return Correlation(0.0, 1.0)
    value = float(r[1:] @ r[:-1]) / square
    if value * np.sqrt(r.size) < SIGNIFICANT:
        return Correlation(0.0, 1.0)
    value = min(value, STRONGEST)
    return Correlation(value, float(np.sqrt((1 + value) / (1 - value))))


def level_doubts(samples: Sequence[xr.Dataset]) -> list[str]:
    """Sentence on through ports in W or fractions that are off 1 away from the resonance; empty where all are at 1."""
    off = []
    for k, sweep in enumerate(samples):
        unit = sweep["signal"].attrs["units"]
        if sweep.attrs["port"] != "through" or unit not in ABSOLUTE or "offset" not in sweep.attrs:
            continue
        share = sweep.attrs["offset"] / (1.0 if unit == "1" else sweep.attrs["power"])
        if abs(share) > LEVEL:
            off.append(f"{1 + share:.3f} of the input in sweep {k}")
    if not off:
        return []
    return [
        f"away from the resonance the through port is at {', '.join(off)}: what is off 1 counts as a dark level; "
        'where it is a loss or gain of fibres, give another unit, such as "V", which frees the level'
    ]


def doubts_of(
    search: Search, end: End, deviations: Mapping[str, float], misfit: float, correlations: Sequence[Correlation],
    other: Mapping[str, float] | None,
) -> list[str]:  # fmt: skip
    """Sentences on the doubts about a fit."""
    notes = []
    if other is not None:
        notes.append(_second_answer(search.values(end.x), other))
    for name in search.names:
        if np.isinf(deviations[name]):
            notes.append(f"the sweeps do not determine {name} alone: other values fit as well; free fewer")
    for k in np.flatnonzero(at_bound(end.x, search.low, search.high)):
        name = search.names[k] if k < len(search.names) else "the scale"
        notes.append(f"{name} ended on a bound of its search: the others hold for this value only; widen bounds")
    correlated = [k for k, found in enumerate(correlations) if found.value > 0]
    if correlated:
        strongest = max(found.value for found in correlations)
        which = ", ".join(map(str, correlated))
        notes.append(
            f"the residuals of sweep {which} are correlated, by up to {strongest:.2f} from one sample to the next: the "
            f"model misses something, such as {CAUSES}; the deviations are widened"
        )
    if misfit > WORSE:
        notes.append(
            f"the curves miss the samples by {misfit:.3g} times their noise and steps: {CAUSES}; the deviations are "
            "widened by it, and hold no error of the model"
        )
    return notes


def _second_answer(values: Mapping[str, float], other: Mapping[str, float]) -> str:
    """Sentence with the numbers of both answers that differ."""
    differ = [name for name in values if abs(other[name] / values[name] - 1) > 0.01]
    here = ", ".join(f"{name} = {values[name]:.4g}" for name in differ)
    there = ", ".join(f"{name} = {other[name]:.4g}" for name in differ)
    return (
        f"a through port alone does not tell the bus from the loss here: {there} fits as well as {here}; a drop port "
        "tells them apart, or more light in a ring with two-photon absorption"
    )
