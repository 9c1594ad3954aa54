"""Settled cycles along a row of a map, compiled: each from those of the detunings just before.

The beginning and the period at the next detuning are those of the polynomial through the last one to three; Newton's
method (`orbit_return.near`) does the rest, with the neighbour's return map.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import orbit_measure
from .collocation import Ring, Scheme
from .compiling import compiled, forget_if_older
from .equations import Array
from .orbit_return import near
from .orbits import close
from .tableaus import Tableau

FLAT = 1e-5  # relative range of the carriers below which an orbit is a fixed point
SURE = 0.98  # a multiplier above which the rest of an error is magnified too much
CLOSE_ENOUGH, STEPS = 1e-7, 12  # of Newton's method where it is


@compiled
def largest_multiplier(M: Array) -> float:
    """Return the largest modulus of a multiplier but the one of the orbit's own direction."""
    every = np.linalg.eigvals(M.astype(np.complex128))
    own, out = np.argmin(np.abs(every - 1.0)), 0.0
    for k in range(every.size):
        out = max(out, abs(every[k])) if k != own else out
    return out


@compiled
def along(
    detunings: Array, starts: Array, periods: Array, M: Array, ring: Ring, floor: Array, scheme: Scheme,
    method: Tableau, rtol: float, share: float, tolerance: float, shots: int, level: float, watch: Array,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Return what a map keeps of the stable cycles of one pulse at ``detunings`` (rad/ns), as far as they go.

    Parameters
    ----------
    starts, periods : arrays, shape (k, m) and (k,)
        of up to three neighbours, the last one first.
    M : array, shape (m, m)
        derivative of the return map of the last one.
    level : float
        of the duty cycle; the rest is as for `orbit_return.near`.

    Returns
    -------
    rows : array, shape (n, 4)
        period (ns), duty, swing (K) and largest multiplier; n is smaller than the number of detunings where the next
        one has no such cycle beside it.
    starts, periods, M : arrays
        to go on from.
    """
    out, m = np.empty((detunings.size, 4)), M.shape[0]
    for j in range(detunings.size):
        at = Ring(ring.pump, detunings[j], ring.rates, ring.fcd, ring.thermal)
        known = periods.size
        ahead = np.array([1.0, 0.0, 0.0])
        if known == 2:
            ahead[0], ahead[1] = 2.0, -1.0
        elif known > 2:
            ahead[0], ahead[1], ahead[2] = 3.0, -3.0, 1.0
        y, T = np.zeros(m), 0.0
        for k in range(known):
            y, T = y + ahead[k] * starts[k], T + ahead[k] * periods[k]
        start, Y, tau, T, turned, move = near(
            y, T, 1, M, at, floor, scheme, method, rtol, share, tolerance, shots, watch
        )
        if not move < np.inf:
            return out[:j], starts, periods, M
        lowest, highest = np.inf, -np.inf
        for k in range(Y.shape[0]):
            for i in range(Y.shape[1]):
                lowest, highest = min(lowest, Y[k, i, 2]), max(highest, Y[k, i, 2])
        if highest - lowest <= FLAT * highest:
            return out[:j], starts, periods, M
        size = largest_multiplier(turned)
        if not size < 1.0:
            return out[:j], starts, periods, M
        if size > SURE:
            start, Y, T, columns, _, _ = close(start, Y, tau, T, at, scheme, CLOSE_ENOUGH, np.int64(STEPS))
            turned = columns[:, :m].copy()
        seen = orbit_measure.measured(start, Y, tau, at.thermal, scheme, level)
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = T, seen[0], seen[1], size
        kept = min(known, 2)
        further, longer = np.empty((kept + 1, m)), np.empty(kept + 1)
        further[0], longer[0] = start, T
        for k in range(kept):
            further[k + 1], longer[k + 1] = starts[k], periods[k]
        starts, periods, M = further, longer, turned
    return out, starts, periods, M


for file in Path(__file__).parent.glob("*.py"):  # it holds code of most of them
    forget_if_older(along, str(file))
