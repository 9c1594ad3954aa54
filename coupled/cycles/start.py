"""The cycle on which a ring settles from a given state: a short transient, then Newton's method.

A transient with a few pulses starts Newton's method. The cycle found is accepted if it is stable and, where a stable
fixed point exists too, as large as the pulses of the transient. Otherwise the transient is continued, each time up to
twice as long, until the ring rests or pulses like the cycle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from ..kernels.interrupts import new_watch, uninterrupted
from ..kernels.tableaus import Method, tableau
from ..runs.window import check_end
from .orbit import FINE_RTOL, TRACE_RTOL, CycleProblem, Orbit, around, shoot, until

if TYPE_CHECKING:
    from ..kernels.orbit_start import Transient

LONGEST = 2e6  # ns
SLOWEST = 30  # of the slowest heat, what a transient may take where that is longer
SLOW = ", such as that of a model without its slowest pole"
PATIENCE = 1e8  # ns, what it may take at most: ten to twenty seconds of computing
AGREE = 0.2  # relative difference of two amplitudes that are taken for the same
DIFFER = 20  # pulses that a doubled cycle is left for: those that differ more make a better start
FLAT = 1e-5  # relative range of the carriers below which an orbit is a fixed point
MOST_PULSES = 4
SAME = 1e-3  # of the period, by which some times a cycle of one pulse may differ from one of several that goes round it
BACK = 0.02  # of the largest heat, within which a trace that pulses unequally is back


class RestError(InputError):
    """The ring comes to rest at a stable fixed point."""


class Settled(NamedTuple):
    """A cycle, how many pulses it has, and the largest modulus of a multiplier but the trivial one."""

    orbit: Orbit
    pulses: int
    size: float = np.nan


def settled(p: CycleProblem, y: Array, begin: str = "a cold ring") -> Settled:
    """Return the cycle on which a ring settles from the state ``y``; raises as `pursued`."""
    from ..kernels.orbit_start import Transient

    return pursued(p, Transient(y), stable_points(p), begin)


def pursued(
    p: CycleProblem,
    begun: Transient,
    points: Array,
    begin: str = "a cold ring",
    rough: bool = False,
    longest: float = LONGEST,
) -> Settled:
    """Continue a transient from ``begin`` and return the cycle on which the ring settles.

    ``points`` are its stable fixed points as of `spectrum.stable`; ``rough`` is as for `shoot`, ``longest`` as for
    `longest_of`.

    Raises InputError: it comes to rest, or does not repeat itself within the longest transient.
    """
    from ..kernels.orbit_start import proceed

    longest, said, unstable = longest_of(p, longest), "no pulse", False
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
            found, said, met = _close(p, begun.y, begun.turn, (low + high) / 2, rough, rough and unstable)
            unstable = unstable or met
            if found is not None:
                if points[0, 0] > 0 and not abs(_range(found.orbit) - (high - low)) <= AGREE * (high - low):
                    said = "the pulses still change"
                else:
                    return found
        if begun.rest >= 0:
            raise RestError(rest_words(p, begun.passed, points[begun.rest], begin))
        begun = begun._replace(turn=0.0)


def longest_of(p: CycleProblem, longest: float) -> float:
    """The longest transient in ns: longer than ``longest`` where heat is slow, up to `PATIENCE`."""
    return max(longest, min(SLOWEST / p.at.thermal.slowest, PATIENCE))


def rest_words(p: CycleProblem, passed: float, point: Array, begin: str = "a cold ring") -> str:
    """Say that a ring rests at a stable fixed point, a row of `spectrum.stable`, after ``passed`` ns."""
    return (
        f"no limit cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz: within {passed / 1e3:.3g} us {begin} "
        f"comes to rest at a stable fixed point, {point[0]:.4g} fJ and {point[2]:.4g} K; give guess= a cycle nearby "
        "where one may lie beside it"
    )


def _close(
    p: CycleProblem, y: Array, T: float, level: float, rough: bool, wary: bool
) -> tuple[Settled | None, str, bool]:
    """The stable cycle near a trace that pulses every ``T`` ns through ``level``, of one pulse or a few; or why not.

    The last value says whether an unstable one is there. Where that is known, only a trace that repeats itself is tried
    (``wary``).
    """
    met = until(p, y, 4 * T, level)
    if met is None:
        return None, "the pulses end", False
    y = met
    pulses, said = _repeats(p, y, T, 1) if wary else 1, ""
    if pulses == 0:
        return None, "the pulses do not repeat", True
    while pulses <= MOST_PULSES:
        orbit = shoot(p, y, T, pulses, rough)
        if orbit is None and pulses == 1 and (pulses := _repeats(p, y, T)) > 1:
            orbit = shoot(p, y, T, pulses, rough)
            if orbit is None and (orbit := shoot(p, y, T, 1, rough, rtol=FINE_RTOL)) is not None:
                pulses = 1
        if orbit is None:
            return None, said or "the pulses do not repeat", bool(said)
        if _range(orbit) <= FLAT * orbit.Y[:, :, 2].max():
            return None, "the pulses die away", False
        others = nontrivial(orbit)
        size = float(np.abs(others).max())
        if size < 1:
            return _once(p, Settled(orbit, pulses, size), rough), "", False
        worst = others[np.argmax(np.abs(others))]
        if worst.real > -1 or abs(worst.imag) > 0:
            return None, "the cycle there is unstable", True
        said = f"a cycle of {pulses} has doubled, with a multiplier of {worst.real:.3g}"
        found = around(p, y, T, DIFFER)
        if found is None:
            return None, said, True
        y = found[1]
        pulses *= 2
    return None, said, True


def _once(p: CycleProblem, found: Settled, rough: bool) -> Settled:
    """The cycle of one pulse where a ``found`` one of several goes round it as many times."""
    y, T, pulses = found.orbit.start, found.orbit.T, found.pulses
    met = around(p, y, T / pulses, 1) if pulses > 1 else None
    if met is None or _away(met[1], y) > BACK:
        return found
    for rtol in (TRACE_RTOL, FINE_RTOL):
        orbit = shoot(p, met[1], T / pulses, 1, rough, rtol=rtol)
        if orbit is not None and abs(pulses * orbit.T - T) <= SAME * T:
            size = float(np.abs(nontrivial(orbit)).max())
            return Settled(orbit, 1, size) if size < 1 else found
    return found


def _away(y: Array, first: Array) -> float:
    """How far the heat of two states differs, of the largest."""
    return float(np.abs(y[3:] - first[3:]).max() / np.abs(first[3:]).max())


def _repeats(p: CycleProblem, y: Array, T: float, fewest: int = 2) -> int:
    """After how many pulses, ``fewest`` or more, a trace is nearly back; 0 where it is not within `MOST_PULSES`."""
    first = y
    for pulses in range(1, MOST_PULSES + 1):
        found = around(p, y, T, 1)
        if found is None:
            return 0
        y = found[1]
        if pulses >= fewest and _away(y, first) <= BACK:
            return pulses
    return 0


def nontrivial(orbit: Orbit) -> NDArray[np.complex128]:
    """The multipliers but the one of the orbit's own direction."""
    every = orbit.multipliers
    return np.delete(every, int(np.argmin(np.abs(every - 1))))


def _range(orbit: Orbit) -> float:
    return float(np.ptp(orbit.Y[:, :, 2]))


def stable_points(p: CycleProblem) -> Array:
    """The stable fixed points as of `spectrum.stable`; none for a model without steady states at the largest power."""
    from ..equilibria import spectrum
    from ..equilibria.steady import absorbable, internal

    try:
        at = internal(p.ring, p.model, absorbable(p.ring, p.power))
    except InputError:
        return np.full((1, 3), np.nan)
    shifts, unknown = np.array([p.at.detuning]), np.array([-1.0])
    return np.asarray(spectrum.stable(shifts, unknown, p.at.pump, *at[1:])[0])
