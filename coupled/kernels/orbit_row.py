"""The settled cycles along a row of a map, compiled: each from those of the detunings just before, or by a transient.

The beginning and the period at the next detuning are those of the polynomial through the last one to three; Newton's
method (`orbit_return.near`) does the rest, with the neighbour's return map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..kernel.tableaus import Tableau
from . import orbit_measure
from .collocation import Ring, Scheme
from .compiling import compiled, forget_if_older, merged
from .control import DONE
from .equations import Array
from .kinds import order
from .orbit_return import near
from .orbit_start import FIRST, FLAT, Transient, proceed
from .orbits import close

SURE = 0.98  # a multiplier above which the rest of an error is magnified too much
CLOSE_ENOUGH, STEPS = 1e-7, 12  # of Newton's method where it is


class Options(NamedTuple):
    """How orbits are closed, as for `orbit_return.near`, and what is kept of them."""

    rtol: float
    share: float
    tolerance: float
    shots: int
    resolved: float
    level: float  # of the duty cycle
    longest: float  # ns, a transient


class Beside(NamedTuple):
    """Up to three cycles just before, the last one first, and the derivative of its return map; or empty arrays."""

    starts: Array  # shape (k, m)
    periods: Array  # ns, shape (k,)
    M: Array  # shape (m, m)


@compiled
def largest_multiplier(M: Array) -> float:
    """Return the largest modulus of a multiplier but the one of the orbit's own direction."""
    every = np.linalg.eigvals(M.astype(np.complex128))
    own, out = np.argmin(np.abs(every - 1.0)), 0.0
    for k in range(every.size):
        out = max(out, abs(every[k])) if k != own else out
    return out


@compiled
def after(beside: Beside, start: Array, T: float, M: Array) -> Beside:
    """Return the cycles before the next detuning."""
    kept = min(beside.periods.size, 2)
    starts, periods = np.empty((kept + 1, start.size)), np.empty(kept + 1)
    starts[0], periods[0] = start, T
    for k in range(kept):
        starts[k + 1], periods[k + 1] = beside.starts[k], beside.periods[k]
    return Beside(starts, periods, M)


@merged
def continued(
    beside: Beside, at: Ring, floor: Array, scheme: Scheme, method: Tableau, options: Options, watch: Array
) -> Any:
    """Return the stable cycle of one pulse that continues those ``beside``: start, period, return map and measures.

    The measures are period (ns), duty, swing (K) and largest multiplier; the period is 0 where there is no such cycle.
    """
    m, known, seen = beside.M.shape[0], beside.periods.size, np.zeros(4)
    ahead = np.array([1.0, 0.0, 0.0])
    if known == 2:
        ahead[0], ahead[1] = 2.0, -1.0
    elif known > 2:
        ahead[0], ahead[1], ahead[2] = 3.0, -3.0, 1.0
    y, T = np.zeros(m), 0.0
    for k in range(known):
        y, T = y + ahead[k] * beside.starts[k], T + ahead[k] * beside.periods[k]
    start, Y, tau, T, M, move = near(
        y, T, 1, beside.M, at, floor, scheme, method, options.rtol, options.share, options.tolerance, options.shots,
        options.resolved, watch,
    )  # fmt: skip
    if move < np.inf:
        lowest, highest = np.inf, -np.inf
        for k in range(Y.shape[0]):
            for i in range(Y.shape[1]):
                lowest, highest = min(lowest, Y[k, i, 2]), max(highest, Y[k, i, 2])
        size = largest_multiplier(M) if highest - lowest > FLAT * highest else 1.0
        if size < 1.0:
            if size > SURE:
                start, Y, T, columns, _, _ = close(start, Y, tau, T, at, scheme, CLOSE_ENOUGH, np.int64(STEPS))
                M = columns[:, :m].copy()
            measured = orbit_measure.measured(start, Y, tau, at.thermal, scheme, options.level)
            seen[0], seen[1], seen[2], seen[3] = T, measured[0], measured[1], size
    return start, seen[0], M, seen


@compiled
def along(
    detunings: Array, still: Array, points: Array, beside: Beside, ring: Ring, floor: Array, scheme: Scheme,
    method: Tableau, options: Options, watch: Array,
) -> tuple[Array, Beside, Transient]:  # fmt: skip
    """Return what a map keeps at ``detunings`` (rad/ns), up to the first where a transient does not end at rest.

    Parameters
    ----------
    still : array of bool, shape (n,)
        where a fixed point is stable.
    points : array, shape (n, most, 3)
        the stable fixed points as of `spectrum.stable`.
    beside : Beside
        cycles before the first detuning.

    Returns
    -------
    rows : array, shape (.., 5)
        period (ns), duty, swing (K), largest multiplier and -1; where the ring rests 0, 0, 0, the time until then
        (ns) and the number of the fixed point.
    beside : Beside
        cycles before the next detuning.
    transient : Transient
        from a cold ring at the next detuning, where there is one.
    """
    m = 3 + order(ring.thermal)
    out, none = np.empty((detunings.size, 5)), Beside(np.empty((0, m)), np.empty(0), np.empty((0, 0)))
    cold = Transient(np.zeros(m), 0.0, FIRST, 0.0, 0.0, 0.0, 0.0, np.int64(-1), 0.0, np.int64(DONE))  # type: ignore[arg-type]
    for j in range(detunings.size):
        at = Ring(ring.pump, detunings[j], ring.rates, ring.fcd, ring.thermal)
        out[j, 4] = -1.0
        if beside.periods.size > 0 and not still[j]:
            start, T, M, seen = continued(beside, at, floor, scheme, method, options, watch)
            if T > 0.0:
                out[j, :4] = seen
                beside = after(beside, start, T, M)
                continue
        now = proceed(cold, points[j], options.longest, at, floor, method, options.rtol, watch)
        if now.rest < 0 or now.turn > 0.0:
            return out[:j], beside, now
        out[j, 0], out[j, 1], out[j, 2], out[j, 3], out[j, 4] = 0.0, 0.0, 0.0, now.passed, now.rest
        beside = none
    return out, beside, cold


for file in Path(__file__).parent.glob("*.py"):  # it holds code of most of them
    forget_if_older(along, str(file))
