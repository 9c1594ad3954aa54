"""The cycle on which a ring settles from a given state: a short transient, then Newton's method.

A transient with a few pulses starts Newton's method. The cycle found is accepted if it is stable and, where a stable
fixed point exists too, as large as the pulses of the transient. Otherwise the transient is continued, each time up to
twice as long, until the ring rests or pulses like the cycle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..kernel.tableaus import Method, tableau
from ..kernels.interrupts import new_watch, uninterrupted
from ..runs.window import check_end
from .closing import Settled, close, refined, swing
from .orbit import TRACE_RTOL, CycleProblem

if TYPE_CHECKING:
    from ..kernels.orbit_start import Transient

LONGEST = 2e6  # ns
SLOWEST = 30  # of the slowest heat, what a transient may take where that is longer
SLOW = ", such as that of a model without its slowest pole"
PATIENCE = 1e8  # ns, what it may take at most: ten to twenty seconds of computing
AGREE = 0.2  # relative difference of two amplitudes that are taken for the same


class RestError(InputError):
    """The ring comes to rest at a stable fixed point."""


def settled(p: CycleProblem, y: Array, begin: str = "a cold ring") -> Settled:
    """Return the cycle on which a ring settles from the state ``y``; raises as `pursued`."""
    from ..kernels.orbit_start import Transient

    return refined(p, pursued(p, Transient(y), stable_points(p), begin))


def pursued(
    p: CycleProblem,
    begun: Transient,
    points: Array,
    begin: str = "a cold ring",
) -> Settled:
    """Continue a transient from ``begin`` and return the cycle on which the ring settles, mostly a rough orbit.

    ``points`` are its stable fixed points as of `spectrum.stable`.

    Raises InputError: it comes to rest, or does not repeat itself within the longest transient.
    """
    from ..kernels.orbit_start import proceed

    longest, said, unstable = longest_of(p), "no pulse", False
    while True:
        if not begun.turn > 0 and begun.rest < 0:
            if begun.passed >= longest:
                raise InputError(
                    f"no settled cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz: "
                    f"{begun.passed / 1e3:.4g} us from {begin} do not lead to one ({said}); give guess= a cycle nearby"
                    + (SLOW if longest < SLOWEST / p.at.thermal.slowest else "")
                )
            begun = uninterrupted(
                proceed, begun, points, longest, p.at, p.floor, tableau(Method.RODAS4), TRACE_RTOL, new_watch()
            )
        check_end(np.array([0, 0, begun.ended]), begun.reached, begun.duration * 1e-9, TRACE_RTOL)
        low, high = begun.low, begun.high
        if begun.turn > 0:
            last = begun.passed >= longest
            found, said, met = close(p, begun.y, begun.turn, (low + high) / 2, unstable, last)
            unstable = unstable or met
            if found is not None:
                if points[0, 0] > 0 and not abs(swing(found.orbit) - (high - low)) <= AGREE * (high - low):
                    said = "the pulses still change"
                else:
                    return found
        if begun.rest >= 0:
            raise RestError(rest_words(p, begun.passed, points[begun.rest], begin))
        begun = begun._replace(turn=0.0)


def longest_of(p: CycleProblem) -> float:
    """The longest transient in ns: longer than `LONGEST` where heat is slow, up to `PATIENCE`."""
    return max(LONGEST, min(SLOWEST / p.at.thermal.slowest, PATIENCE))


def rest_words(p: CycleProblem, passed: float, point: Array, begin: str = "a cold ring") -> str:
    """Say that a ring rests at a stable fixed point, a row of `spectrum.stable`, after ``passed`` ns."""
    return (
        f"no limit cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz: within {passed / 1e3:.3g} us {begin} "
        f"comes to rest at a stable fixed point, {point[0]:.4g} fJ and {point[2]:.4g} K; give guess= a cycle nearby "
        "where one may lie beside it"
    )


def stable_points(p: CycleProblem) -> Array:
    """The stable fixed points as of `spectrum.stable`; none for a model without steady states at the largest power."""
    from ..equilibria.balance import absorbable, internal_ring
    from ..equilibria.spectrum import stable_points as stable_at

    try:
        at = internal_ring(p.ring, p.model, absorbable(p.ring, p.power))
    except InputError:
        return np.full((1, 3), np.nan)
    return np.asarray(stable_at(p.at.pump, np.array([p.at.detuning]), at)[0])
