"""The stable cycle on which a system settles: a transient, then shooting for as many pulses as repeat themselves.

The transient is integrated in parts until three pulses are seen or a stable fixed point is reached. Its pulses are
followed until the trace is back where it was; a cycle of so many pulses is closed. One that is unstable with a
multiplier below -1 has doubled, and twice as many pulses are tried. The cycle is accepted if the trace comes nearer to
it by further turns, and, where a stable fixed point exists, if it is as large as the pulses of the trace.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from .return_map import FINE, FLAT, MIDDLE, ROUGH, Flow, Orbit, close

FIRST_PART, LONGEST_PART, LONGEST_SEEN = 4e3, 1e5, 1e6  # ns; the last without three pulses in it
REST = 5e-3  # relative distance from a stable fixed point, and range of the carriers, from which a ring goes to rest
FALLING = 0.95  # of its amplitude, from one quarter of a part to the next: an oscillation that dies away
FIRST_STEP = 100.0  # ns, of a part: longer ones rest on an unstable fixed point
MOST_PULSES = 8
BACK, REPEATS = 0.02, 1e-4  # of the largest heat, within which a trace is back, and repeats itself
DIFFER = 20  # pulses after which those of a doubled cycle differ clearly
AGREE = 0.2  # relative difference of two amplitudes that are taken for the same
PATIENT = 30  # turns at most by which a trace must have come nearer to its cycle
SLOW = ", such as that of a model without its slowest pole"


class RestError(InputError):
    """The system comes to rest at a stable fixed point."""


class Part(NamedTuple):
    """What the watched quantity does late in a part of a transient."""

    low: float  # in the second half
    high: float
    third: float  # range in the third quarter
    fourth: float
    rises: int  # through the middle, after the first quarter
    longest: float  # ns between two of them
    moved: float  # relative range in the whole part

    def pulses(self, points: Callable[[], Array]) -> bool:
        """Whether there are pulses that do not die away, which they may where there are stable fixed points."""
        moves = self.rises >= 3 and self.high - self.low > FLAT * self.high
        return moves and (self.fourth >= FALLING * self.third or not len(points()))

    @property
    def rests(self) -> bool:
        """Whether it moves little, and no more than before."""
        return self.high - self.low <= REST * self.high and self.fourth <= self.third + FLAT * self.high

    def following(self, duration: float, longest: float) -> float:
        """How long the next part is after this one of ``duration`` ns: longer where it moves without pulses."""
        patient = self.rises < 3 and self.moved > REST
        return min(2 * duration, max(LONGEST_PART, min(LONGEST_SEEN, longest)) if patient else LONGEST_PART)


def measured(t: Array, q: Array, duration: float) -> Part:
    """Measure a part of a transient."""
    half, last = np.searchsorted(t, [duration / 2, 0.75 * duration])
    lows, highs = [], []
    for part in (q[half:last], q[last:], q[:half]):
        lows.append(float(part.min()) if part.size else np.inf)
        highs.append(float(part.max()) if part.size else -np.inf)
    low, high = min(lows[:2]), max(highs[:2])
    above = q > 0.5 * (low + high)
    ups = t[1 + np.flatnonzero(above[1:] & ~above[:-1])]
    ups = ups[np.searchsorted(ups, duration / 4) :]
    gap = float((ups[1:] - ups[:-1]).max()) if ups.size > 1 else 0.0
    third, fourth = (max(highs[k] - lows[k], 0.0) for k in (0, 1))
    top = max(highs)
    return Part(low, high, third, fourth, ups.size, gap, (top - min(lows)) / max(top, 1e-300))


def transient(
    run: Callable[[Array, float, float], tuple[Array, float, Array, Array]], y: Array, points: Callable[[], Array],
    longest: float, look: Callable[[], None],
) -> Iterator[tuple[Array, Part, Array | None, float]]:  # fmt: skip
    """Yield the parts of a transient: its end, what it does, the stable fixed point it is at, and the ns passed.

    run: integrates from a state for a time in ns with a first step; returns the end, the next step, rows, and the
        watched quantity along them.
    look: called before each part; it may raise.
    """
    passed, duration, step = 0.0, FIRST_PART, 0.0
    while passed < longest:
        look()
        y, step, rows, q = run(y, duration, min(step, FIRST_STEP))
        passed += duration
        seen = measured(rows[:, 0], q, duration)
        yield y, seen, resting(rows[-1], points()) if seen.rests else None, passed
        duration = seen.following(duration, longest)


def settled(
    flow: Flow, y: Array, points: Callable[[], Array], longest: float, *, begin: str = "a cold ring", where: str = "",
    slow: bool = False, rtol: float = FINE, look: Callable[[], None] = lambda: None,
) -> Orbit:  # fmt: skip
    """Return the cycle on which the state ``y`` settles.

    points: returns the stable fixed points, rows (U, N, dT); most cycles are found without them.
    longest [ns]: of the transient; ``slow`` says that it is short for the system's heat.
    where: the power and detuning, for messages.
    look: called between the parts of the transient; it may raise.

    Raises InputError: it comes to rest (RestError), or does not repeat itself within ``longest``.
    """
    passed, said, wary = 0.0, "no pulse", False

    def run(y: Array, duration: float, first_step: float) -> tuple[Array, float, Array, Array]:
        part = flow.run(y, duration, first_step=first_step)
        return part.y, part.step, part.rows, flow.seen(part.rows)

    for end, seen, at, passed in transient(run, y, points, longest, look):
        if seen.pulses(points):
            found, said, unstable = pulse_train(flow, end, seen, wary, passed >= longest, rtol)
            wary = wary or unstable
            if found is not None:
                swing = float(np.ptp(flow.seen(found.trace.rows)))
                if abs(swing - (seen.high - seen.low)) <= AGREE * (seen.high - seen.low) or not len(points()):
                    return found
                said = "the pulses still change"
        if at is not None:
            raise RestError(rest_words(where, passed, at, begin))
    raise InputError(
        f"no settled cycle{where}: {passed / 1e3:.4g} us from {begin} do not lead to one ({said}); give guess= a cycle "
        "nearby" + (SLOW if slow else "")
    )


def rest_words(where: str, passed: float, at: Array, begin: str = "a cold ring") -> str:
    """Say that a system rests at a stable fixed point after ``passed`` ns."""
    return (
        f"no limit cycle{where}: within {passed / 1e3:.3g} us {begin} comes to rest at a stable fixed point, "
        f"{at[0]:.4g} fJ and {at[2]:.4g} K; give guess= a cycle nearby where one may lie beside it"
    )


def resting(row: Array, points: Array) -> Array | None:
    """The stable fixed point that the last row of a part is at."""
    here = np.array([row[1] ** 2 + row[2] ** 2, row[3], row[4]])
    return next((point for point in points if np.all(np.abs(here - point) <= REST * np.abs(point))), None)


def pulse_train(
    flow: Flow, y: Array, seen: Part, wary: bool, last: bool, rtol: float
) -> tuple[Orbit | None, str, bool]:
    """The stable cycle near a trace that pulses, or why there is none; and whether an unstable one is there.

    Where that is known, only a trace that repeats itself is tried (``wary``); precisely the ``last`` time.
    """
    run = flow.run(y, 4 * seen.longest, level=(seen.low + seen.high) / 2)
    met = run.y
    if run.crossings.size == 0:
        return None, "the pulses end", False
    reach = 30 * seen.longest
    off = _distances(flow, met, reach)
    said, unstable = "the pulses do not repeat", wary
    for pulses, precisely in _tries(off, wary, last):
        found, why = _stable(flow, met, reach, pulses, FINE if precisely else MIDDLE)
        if found is not None:
            shortest = once(flow, found, reach)
            if comes_nearer(flow, met, shortest, reach):
                closed: Orbit | None = shortest
                if rtol < MIDDLE and not (precisely and shortest is found):
                    closed = close(flow, shortest.start, shortest.pulses, reach, rtol=rtol, beside=shortest)
                if closed is not None:
                    return closed, "", False
        said, unstable = why or said, unstable or bool(why)
    return None, said, unstable


def _distances(flow: Flow, y: Array, reach: float) -> dict[int, float]:
    """How far a trace is off its beginning after one pulse, two and so on, until it repeats itself."""
    trace, off = flow.trace(y, ROUGH, MOST_PULSES, reach), dict[int, float]()
    if trace is None:
        trace = flow.trace(y, ROUGH, 1, reach)
    for pulses, at in enumerate([*trace.crossings[1:], trace.end] if trace else [], 1):
        off[pulses] = distance(flow, at, y)
        if off[pulses] <= REPEATS:
            break
    return off


def _tries(off: dict[int, float], wary: bool, last: bool) -> Iterator[tuple[int, bool]]:
    """How many pulses to try, and whether precisely: the fewest first, after which the trace is nearest."""
    least = min(off.values(), default=np.inf)
    back = next((pulses for pulses in off if off[pulses] <= min(2 * least, BACK)), 0)
    if back:
        yield back, False
    if back != 1 and not wary:
        yield 1, False
    if least <= REPEATS or (last and back):
        yield back, True


def _stable(flow: Flow, y: Array, reach: float, pulses: int, rtol: float) -> tuple[Orbit | None, str]:
    """The stable cycle of ``pulses`` pulses, or of twice as many where that has doubled; or why there is none."""
    said = ""
    while pulses <= MOST_PULSES:
        orbit = close(flow, y, pulses, reach, rtol=rtol)
        if orbit is None:
            return None, said
        if orbit.size < 1:
            return orbit, ""
        worst = orbit.others[0]
        if worst.real > -1 or abs(worst.imag) > 0:
            return None, "the cycle there is unstable"
        said = f"a cycle of {pulses} has doubled, with a multiplier of {worst.real:.3g}"
        later = flow.trace(y, ROUGH, DIFFER, reach)
        if later is None:
            return None, said
        y, pulses = later.end, 2 * pulses
    return None, said


def once(flow: Flow, orbit: Orbit, reach: float) -> Orbit:
    """The shorter cycle where the orbit goes round it several times."""
    for pulses in range(1, orbit.pulses // 2 + 1):
        if orbit.pulses % pulses == 0 and distance(flow, orbit.trace.crossings[pulses], orbit.start) <= BACK:
            shorter = close(flow, orbit.start, pulses, reach, rtol=MIDDLE)
            share = pulses / orbit.pulses
            if shorter is not None and abs(shorter.T - share * orbit.T) <= 1e-3 * orbit.T and shorter.size < 1:
                return shorter
    return orbit


def comes_nearer(flow: Flow, y: Array, orbit: Orbit, reach: float) -> bool:
    """Whether the trace through ``y`` is nearer to the orbit after as many turns as halve a small deviation."""
    run = flow.run(y, reach, level=flow.value(orbit.start))
    at = run.y
    if run.crossings.size == 0:
        return False
    starts = [orbit.trace.crossings[k] for k in range(orbit.pulses)]
    first = [distance(flow, at, start) for start in starts]
    if min(first) <= REPEATS:
        return True
    turns = int(np.clip(np.ceil(np.log(0.5) / np.log(max(orbit.size, 1e-3))), 2, PATIENT))
    later = flow.trace(at, ROUGH, turns * orbit.pulses, reach)
    return later is not None and min(distance(flow, later.end, start) for start in starts) < max(
        0.9 * min(first), REPEATS
    )


def distance(flow: Flow, y: Array, other: Array) -> float:
    """How far the heat of two states differs, of the largest."""
    heat = flow.rough.rings * flow.rough.block
    return float(np.abs(y[heat:] - other[heat:]).max() / max(np.abs(other[heat:]).max(), 1e-300))
