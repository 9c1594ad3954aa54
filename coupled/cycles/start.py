"""From a state of the ring to the cycle that it settles on: a transient as short as will do, then Newton's method.

A transient that has a few pulses starts Newton's method. What comes out counts if the ring can settle on it: it is
stable, and where a stable fixed point could win in the end it is as large as the pulses of the transient. Else the
transient goes on, up to twice as long every time, until it rests or pulses as the cycle does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from ..heaters import turned_by
from .orbit import FINE_RTOL, CycleProblem, Orbit, around, run, shoot

FIRST, LONGEST = 4e3, 2e6  # ns
SLOWEST = 30  # of the slowest heat, what a transient may take where that is longer
REST = 5e-3  # relative distance from a stable fixed point, and range of the carriers, from which a ring goes to rest
FALLING = 0.95  # of its amplitude, from one quarter of a transient to the next, an oscillation that dies away
AGREE = 0.2  # relative difference of two amplitudes that are taken for the same
DIFFER = 20  # pulses that a doubled cycle is left for: those that differ more make a better start
FLAT = 1e-5  # relative range of the carriers below which an orbit is a fixed point
MOST_PULSES = 4
BACK = 0.02  # of the largest heat, within which a trace that pulses unequally is back
AGAIN = 100.0  # ns, the longest first step of a transient that goes on: longer ones rest on an unstable fixed point


class RestError(InputError):
    """The ring comes to rest at a stable fixed point."""


class Settled(NamedTuple):
    """A cycle, how many pulses it has, and the largest modulus of a multiplier but the trivial one."""

    orbit: Orbit
    pulses: int
    size: float = np.nan


def settled(
    p: CycleProblem,
    y: Array,
    begin: str = "a cold ring",
    points: Array | None = None,
    rough: bool = False,
    longest: float = LONGEST,
) -> Settled:
    """Return the cycle on which a ring settles from the state ``y``.

    ``points`` are its stable fixed points where they are known, rows (U, N, dT) in internal units; ``rough`` is as for
    `shoot`, ``longest`` the longest transient in ns.

    Raises InputError: it comes to rest, or does not repeat itself within the longest transient.
    """
    from ..kernels import orbit_measure

    passed, duration, h, said, unstable = 0.0, FIRST, 0.0, "no pulse", False
    rest = points
    while passed < max(longest, SLOWEST * _slowest(p)):
        rows, y, _, h = run(p, y, duration, first=min(h, AGAIN))
        passed += duration
        low, high, third, fourth, ups, turn = orbit_measure.digest(rows, duration)
        if fourth < FALLING * third and (rest is None or rest.size):
            rest = stable_points(p) if rest is None else rest
        falls = rest is not None and rest.size > 0 and fourth < FALLING * third  # to rest, or to where it is soon
        if ups >= 3 and high - low > FLAT * high and not falls:
            found, said, met = _close(p, y, turn, (low + high) / 2, rough, rough and unstable)
            unstable = unstable or met
            if found is not None:
                if abs(_range(found.orbit) - (high - low)) <= AGREE * (high - low):
                    return found
                rest = stable_points(p) if rest is None else rest
                if rest.size == 0:
                    return found
                said = "the pulses still change"
        if high - low <= REST * high and fourth <= third + FLAT * high:
            rest = stable_points(p) if rest is None else rest
            last = np.array([rows[-1, 1] ** 2 + rows[-1, 2] ** 2, rows[-1, 3], rows[-1, 4]])
            for point in rest:
                if np.all(np.abs(last - point) <= REST * point):
                    raise RestError(
                        f"no limit cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz: within "
                        f"{passed / 1e3:.3g} us {begin} comes to rest at a stable fixed point, {point[0]:.4g} fJ and "
                        f"{point[2]:.4g} K; give guess= a cycle nearby where one may lie beside it"
                    )
        duration = min(2 * duration, 1e5)
    raise InputError(
        f"no settled cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz: {passed / 1e3:.4g} us from {begin} "
        f"do not lead to one ({said}); give guess= a cycle nearby"
    )


def _close(
    p: CycleProblem, y: Array, T: float, level: float, rough: bool, wary: bool
) -> tuple[Settled | None, str, bool]:
    """The stable cycle near a trace that pulses every ``T`` ns through ``level``, of one pulse or a few; or why not.

    The last value says whether an unstable one is there. Where that is known, only a trace that repeats itself is tried
    (``wary``).
    """
    _, y, met, _ = run(p, y, 4 * T, level)
    if not met:
        return None, "the pulses end", False
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
            return Settled(orbit, pulses, size), "", False
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


def _repeats(p: CycleProblem, y: Array, T: float, fewest: int = 2) -> int:
    """After how many pulses, ``fewest`` or more, a trace is nearly back; 0 where it is not within `MOST_PULSES`."""
    first = y[3:]
    for pulses in range(1, MOST_PULSES + 1):
        found = around(p, y, T, 1)
        if found is None:
            return 0
        y = found[1]
        if pulses >= fewest and np.abs(y[3:] - first).max() <= BACK * np.abs(first).max():
            return pulses
    return 0


def nontrivial(orbit: Orbit) -> NDArray[np.complex128]:
    """The multipliers but the one of the orbit's own direction."""
    every = orbit.multipliers
    return np.delete(every, int(np.argmin(np.abs(every - 1))))


def _range(orbit: Orbit) -> float:
    return float(np.ptp(orbit.Y[:, :, 2]))


def _slowest(p: CycleProblem) -> float:
    """The slowest time constant of heat in ns."""
    return float(1 / p.at.thermal.slowest)


def stable_points(p: CycleProblem, at: Any = None, pieces: Array | None = None) -> Array:
    """The stable fixed points, rows (U, N, dT) in internal units; ``at`` and ``pieces`` as `steady.fixed_points`."""
    from ..equilibria import balance, spectrum
    from ..equilibria.steady import absorbable, fixed_points, internal, kind_of

    at = at or internal(p.ring, p.model, absorbable(p.ring, p.power))
    U, D = fixed_points(p.ring, at, p.power, p.detuning + turned_by(p.rise, p.ring), pieces)
    N, _, dT, *_ = balance.balances(U, at.rates, at.fcd, at.static)
    stable = [kind_of(spectrum.dense(u, d, *at[1:]))[2] == "stable" for u, d in zip(U, D, strict=True)]
    return np.stack([U, N, dT], axis=1)[stable]
