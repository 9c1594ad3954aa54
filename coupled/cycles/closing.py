"""The stable cycle near a trace that pulses: how many pulses it has, and Newton's method for that many.

The trace is followed from pulse to pulse. Where it is back after n of them, a cycle of n pulses is tried. One found for
n pulses may be a shorter one that goes round several times: its own states tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray

from .orbit import FINE_RTOL, TRACE_RTOL, CycleProblem, Orbit, around, closer, settle, shoot, until
from .scheme import scheme

DIFFER = 20  # pulses that a doubled cycle is left for: those that differ more make a better start
FLAT = 1e-5  # relative range of the carriers below which an orbit is a fixed point
MOST_PULSES = 8
BACK, REPEATS = 0.02, 1e-4  # of the largest heat, within which a trace is back, and repeats itself
REACH = 5.0  # of what deviations that shrink from turn to turn add up to
SAME = 1e-3  # of the period, by which a cycle and the rounds of a shorter one may differ
DIES = "the pulses die away"


class Settled(NamedTuple):
    """A limit cycle, its number of pulses, and the largest modulus of its multipliers but the trivial one."""

    orbit: Orbit
    pulses: int
    size: float = np.nan
    rough: bool = False  # on the mesh of a trace


def close(
    p: CycleProblem, y: Array, T: float, level: float, wary: bool = False, last: bool = False
) -> tuple[Settled | None, str, bool]:
    """The stable cycle near a trace that rises through ``level`` every ``T`` ns at the most; or why there is none.

    The orbit is `rough`, see `shoot`. The last value says whether an unstable one is there. Where that is known, only a
    trace that repeats itself is tried (``wary``). The ``last`` time precise orbits are tried too, which takes long.
    """
    met = until(p, y, 4 * T, level)
    if met is None:
        return None, "the pulses end", False
    off = _returns(p, met, T)
    said, unstable = "the pulses do not repeat", wary
    for pulses, rtol, rough in _ways(off, wary, last):
        found, why = _stable(p, met, T, pulses, rough, rtol)
        if why == DIES:
            return None, why, False
        if found is not None and _belongs(found, met, off.get(pulses)):
            return once(p, found), "", False
        said, unstable = why or said, unstable or bool(why)
    return None, said, unstable


def _returns(p: CycleProblem, y: Array, T: float) -> dict[int, float]:
    """How far a trace is off its beginning after one pulse, two and so on, until it repeats itself."""
    at, off = y, dict[int, float]()
    for pulses in range(1, MOST_PULSES + 1):
        met = around(p, at, T, 1)
        if met is None:
            break
        at = met[1]
        off[pulses] = _away(at, y)
        if off[pulses] <= REPEATS:
            break
    return off


def _ways(off: dict[int, float], wary: bool, last: bool) -> Iterator[tuple[int, float, bool]]:
    """What to try: how many pulses, the tolerance of the traces, and whether a rough orbit will do.

    First the fewest pulses among those after which the trace is about as near as it gets.
    """
    least = min(off.values(), default=np.inf)
    back = next((pulses for pulses in off if off[pulses] <= min(2 * least, BACK)), 0)
    if back:
        yield back, TRACE_RTOL, True
    if back != 1 and not wary:
        yield 1, TRACE_RTOL, True
    if least <= REPEATS:
        yield back, FINE_RTOL, True
        if last:
            yield back, TRACE_RTOL, False
            yield 2 * back, TRACE_RTOL, False  # twice round it, on another mesh


def _belongs(found: Settled, y: Array, off: float | None) -> bool:
    """Whether a trace that passes ``y`` and is then ``off`` it settles on the cycle, not beside it."""
    return off is None or _away(found.orbit.start, y) <= REACH * off / (1 - found.size) + REPEATS


def _stable(p: CycleProblem, y: Array, T: float, pulses: int, rough: bool, rtol: float) -> tuple[Settled | None, str]:
    """The stable cycle of ``pulses`` pulses, or of twice as many where that has doubled; or why there is none."""
    said = ""
    while pulses <= MOST_PULSES:
        orbit = shoot(p, y, T, pulses, rough, rtol=rtol)
        if orbit is None:
            return None, said
        if swing(orbit) <= FLAT * orbit.Y[:, :, 2].max():
            return None, DIES
        others = nontrivial(orbit)
        size = float(np.abs(others).max())
        if size < 1:
            return Settled(orbit, pulses, size, rough), ""
        worst = others[np.argmax(np.abs(others))]
        if worst.real > -1 or abs(worst.imag) > 0:
            return None, "the cycle there is unstable"
        said = f"a cycle of {pulses} has doubled, with a multiplier of {worst.real:.3g}"
        met = around(p, y, T, DIFFER)
        if met is None:
            return None, said
        y = met[1]
        pulses *= 2
    return None, said


def once(p: CycleProblem, found: Settled) -> Settled:
    """The shorter cycle where the ``found`` one goes round it several times."""
    from ..kernels import orbit_mesh

    start, Y, tau, T = found.orbit[:4]
    for pulses in range(1, found.pulses // 2 + 1):
        share = pulses / found.pulses
        if found.pulses % pulses or _away(_at(found.orbit, np.array([share]))[0], start) > BACK:
            continue
        mesh = np.append(tau[tau < share * (1 - 1e-9)] / share, 1.0)
        states = _at(found.orbit, share * orbit_mesh.stages(mesh, scheme().c))
        trial = Orbit(start, states.reshape(-1, *Y.shape[1:]), mesh, share * T, found.orbit.M, np.inf)
        orbit = closer(p, trial) if found.rough else settle(p, trial)
        if orbit is not None and _same(orbit, trial):
            size = float(np.abs(nontrivial(orbit)).max())
            return Settled(orbit, pulses, size, found.rough) if size < 1 else found
    return found


def refined(p: CycleProblem, found: Settled) -> Settled:
    """The same cycle on a mesh of its own; still ``rough`` where none resolves it, as where a pulse is very steep."""
    if not found.rough:
        return found
    orbit = shoot(p, found.orbit.start, found.orbit.T, found.pulses)
    if orbit is None or not _same(orbit, found.orbit):
        orbit = settle(p, found.orbit)
    if orbit is None or not _same(orbit, found.orbit):
        return found
    return Settled(orbit, found.pulses, float(np.abs(nontrivial(orbit)).max()))


def _same(orbit: Orbit, trial: Orbit) -> bool:
    """Whether an orbit that was closed from a trial one has its period."""
    return orbit.move < np.inf and abs(orbit.T - trial.T) <= SAME * trial.T


def _at(orbit: Orbit, shares: Array) -> Array:
    """States at increasing fractions of the period."""
    from ..kernels import orbit_mesh

    return np.asarray(orbit_mesh.interpolate(orbit.start, orbit.Y, orbit.tau, scheme(), shares))


def _away(y: Array, first: Array) -> float:
    """How far the heat of two states differs, of the largest."""
    return float(np.abs(y[3:] - first[3:]).max() / np.abs(first[3:]).max())


def nontrivial(orbit: Orbit) -> NDArray[np.complex128]:
    """The multipliers but the one of the orbit's own direction."""
    every = orbit.multipliers
    return np.delete(every, int(np.argmin(np.abs(every - 1))))


def swing(orbit: Orbit) -> float:
    """Range of the carriers."""
    return float(np.ptp(orbit.Y[:, :, 2]))
