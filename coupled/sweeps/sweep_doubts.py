"""Reasons to doubt a fit of slow sweeps: what is left open, bounds, misfits, correlated residuals, a second answer.

A through port alone has a second answer:

    T = |1 - 2 b/(b + o + i w)|^2 = [w^2 + (o - b)^2]/[w^2 + (o + b)^2]

is the same with the rate b into the bus and the sum o of the others exchanged: an over- and an under-coupled ring. The
phase, a drop port, or carriers made by the light, tell them apart; the through power of a linear ring does not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem.arrays import Array

from ..identification.box_search import End, at_bound
from ..resonator import RingResonator
from ..unknowns import INTRINSIC, LOADED
from .slow_sweeps import ABSOLUTE
from .transmission_search import Search, searched

LOSSES = ("loss_rate", "scattering_rate", "drop_rate")
BEYOND_BOUND = 0.5  # of a logarithm, beyond the exchanged value, to which default bounds are widened
LARGE = 0.5  # root mean square of the residuals of a sweep: below, what is left is smaller than its noise
LEVEL = 0.01  # of the input: offset of a through port in W or fractions, above which a note reports it
CAUSES = (
    "fringes, a resonance split in two by backscatter (doublet), another resonance near by, or a saturated detector"
)


def with_other_answer(
    search: Search, end: End, bounds: Mapping[str, Any] | None
) -> tuple[Search, End, dict[str, float] | None]:
    """The better of a fit and the one started from exchanged rates, and the parameters of the other if it fits as well.

    Where both fit, the first is the one on the side of the initial ring, over- or under-coupled.
    """
    x = exchanged(search, end.x)
    wider = None if x is None else _reaching(search, x, bounds)
    if x is None or wider is None:
        return search, end, None
    other = searched(wider, x)
    ring = search.build(end.x)[0]
    other_ring = wider.build(other.x)[0]
    # two answers that differ by less than 2 % are one
    if abs(other_ring.bus_rate / ring.bus_rate - 1) < 0.02:
        return search, end, None
    misfit_squared = max(min(end.cost, other.cost) / max(end.r.size - end.x.size, 1), 1.0)
    # within three deviations both fit
    both_fit = abs(end.cost - other.cost) < 9.0 * misfit_squared
    keep_first = end.cost <= other.cost
    if both_fit:
        keep_first = _over_coupled(ring) == _over_coupled(search.ring)
    if keep_first:
        return search, end, wider.values(other.x) if both_fit else None
    return wider, other, search.values(end.x) if both_fit else None


def exchanged(search: Search, x: Array) -> Array | None:
    """Unknowns at which the rate into the bus is that of all others before, at the same linewidth; None without any."""
    ring = search.build(x)[0]
    symmetric = ring.drop_rate is None  # both buses move together, and the ring is always under-coupled
    through_alone = all(sweep.port == "through" for sweep in search.data)
    bus_moves = "bus_rate" in search.names or (LOADED in search.names and ring.drop_bus_rate == 0)
    if symmetric or not through_alone or not bus_moves:
        return None
    free = _free_losses(ring, search.names)
    others = ring.linear_rate - ring.bus_rate
    wanted = free + ring.bus_rate - others
    if free <= 0 or wanted <= 0:
        return None
    change = float(np.log(wanted / free))
    moved = x.copy()
    for k, name in enumerate(search.names):
        if name in LOSSES:
            moved[k] += change
        elif name == INTRINSIC:
            moved[k] -= change
        elif name == "bus_rate":
            moved[k] = np.log(others)
    return moved


def _free_losses(ring: RingResonator, names: tuple[str, ...]) -> float:
    """Sum of the rates other than that into the bus which a fit is free to change, 1/s."""
    rates = [getattr(ring, name) or 0.0 for name in LOSSES if name in names]
    if INTRINSIC in names:
        rates += [ring.loss_rate, ring.scattering_rate]
    return float(sum(rates))


def _reaching(search: Search, x: Array, bounds: Mapping[str, Any] | None) -> Search | None:
    """The search with default bounds widened to ``x``; None where bounds of the user exclude it."""
    low = search.low.copy()
    high = search.high.copy()
    for k, name in enumerate(search.names):
        inside = low[k] <= x[k] <= high[k]
        if inside:
            continue
        if bounds is not None and name in bounds:
            return None
        low[k] = min(low[k], x[k] - BEYOND_BOUND)
        high[k] = max(high[k], x[k] + BEYOND_BOUND)
    return replace(search, low=low, high=high)


def _over_coupled(ring: RingResonator) -> bool:
    """Whether the rate into the bus is larger than that of all other losses."""
    return ring.bus_rate > ring.linear_rate - ring.bus_rate


def correlation_of(residual: Array) -> float:
    """Correlation of neighbouring residuals, 0 where it is not significant or they are below the noise."""
    r = residual - residual.mean()
    square = float(r @ r)
    if square < LARGE**2 * r.size:
        return 0.0
    value = float(r[1:] @ r[:-1]) / square
    # the correlation of white residuals has the deviation 1/sqrt(n); five of them count
    return min(value, 0.95) if value * np.sqrt(r.size) >= 5.0 else 0.0


def widening_by(correlation: float) -> float:
    """Factor of the deviation of a mean, for residuals of a first-order process."""
    return float(np.sqrt((1 + correlation) / (1 - correlation)))


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
    search: Search, end: End, deviations: Mapping[str, float], misfit: float, correlations: Sequence[float],
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
    strongest = max(correlations)
    if strongest > 0:
        which = ", ".join(map(str, np.flatnonzero(correlations)))
        notes.append(
            f"the residuals of sweep {which} are correlated, by up to {strongest:.2f} from one sample to the next: the "
            f"model misses something, such as {CAUSES}; the deviations are widened"
        )
    if misfit > 1.5:
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
