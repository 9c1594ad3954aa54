"""The second answer of a through port: the rate into the bus exchanged with all other rates of the ring.

    T = |1 - 2 b/(b + o + i w)|^2 = [w^2 + (o - b)^2]/[w^2 + (o + b)^2]

is the same with the rate b into the bus and the sum o of the others exchanged: an over- and an under-coupled ring. The
phase, a drop port, or carriers made by the light, tell them apart; the through power of a linear ring does not.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from thermofem.arrays import Array

from ..resonator import RingResonator
from ..unknowns import INTRINSIC, LOADED
from .transmission_search import End, Search, searched

LOSSES = ("loss_rate", "scattering_rate", "drop_rate")
AS_WELL = 9.0  # difference of the sums of squares, over the misfit squared, below which both fit: 3 deviations
MARGIN = 0.5  # of a logarithm, beyond the exchanged value, to which default bounds are widened
APART = 0.02  # relative difference of the two answers, below which they are one


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
    if abs(other_ring.bus_rate / ring.bus_rate - 1) < APART:
        return search, end, None
    pairs = sorted([(end.cost, 0), (other.cost, 1)])
    misfit_squared = max(pairs[0][0] / max(end.r.size - end.x.size, 1), 1.0)
    both_fit = pairs[1][0] - pairs[0][0] < AS_WELL * misfit_squared
    first_is_better = pairs[0][1] == 0
    keep_first = _over_coupled(ring) == _over_coupled(search.ring) if both_fit else first_is_better
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
        low[k] = min(low[k], x[k] - MARGIN)
        high[k] = max(high[k], x[k] + MARGIN)
    return replace(search, low=low, high=high)


def _over_coupled(ring: RingResonator) -> bool:
    """Whether the rate into the bus is larger than that of all other losses."""
    return ring.bus_rate > ring.linear_rate - ring.bus_rate
