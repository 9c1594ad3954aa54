"""The contract of a waveform, and the checks that all waveforms share."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from .. import checks
from ..arrays import Array, ArrayLike

TIME_HINT = checks.Hint("times are in s (did you mean 1e-6 for 1 us?)")
MOST_CYCLES = 1e6  # that a call may span
MOST_EDGES = 1e7  # of all those cycles
SHORTEST, LONGEST = 1e-40, 1e12  # s, of an interval and of a time
KINDS: dict[str, type] = {}  # what a file can hold, by name; filled by `stored`
Kind = TypeVar("Kind", bound=type)


def stored(kind: Kind) -> Kind:
    """Class decorator: a dataclass whose fields are numbers and arrays, which datasets and plans may hold by name."""
    KINDS[kind.__name__] = kind
    return spans(kind)


def spans(kind: Kind) -> Kind:
    """Class decorator: ``start`` and ``stop`` of every method that takes them are checked to be times in s."""
    for name, shortest in (("breakpoints", -2 * LONGEST), ("mean", SHORTEST), ("pieces", 0.0), ("cubics", 0.0)):
        if hasattr(kind, name):
            setattr(kind, name, _checked(getattr(kind, name), shortest))
    return kind


def _checked(method: Callable[[Any, float, float], Any], shortest: float) -> Callable[[Any, float, float], Any]:
    @wraps(method)
    def checked(self: Any, start: float, stop: float) -> Any:
        a, b = (checks.between(name, t, -LONGEST, LONGEST, unit="s") for name, t in (("start", start), ("stop", stop)))
        if b - a < shortest:
            raise checks.InputError(f"start = {a:g} s must be before stop = {b:g} s")
        return method(self, a, b)

    return checked


def check_wave(name: str, value: Any) -> None:
    """Raise InputError for what is no waveform; a class is none either."""
    checks.has(name, value, "breakpoints", "mean", hint="a waveform is needed, such as th.SquareWave(1e-3, 1e-6, 0.3)")


def words(wave: Waveform) -> str:
    """A short description of a waveform for labels and tables: its own ``words``, or its kind."""
    return str(getattr(wave, "words", type(wave).__name__.lower()))


class Waveform(Protocol):
    """Absorbed power against time; help(thermofem.waveforms) lists what holds for every waveform."""

    piecewise_linear: ClassVar[bool]

    @property
    def period(self) -> float | None:
        """Period in s, or None when the waveform does not repeat."""

    def __call__(self, t: ArrayLike) -> Array:
        """Power in W at ``t``, continuous from the right."""

    def before(self, t: ArrayLike) -> Array:
        """Power in W just before ``t``."""

    def breakpoints(self, start: float, stop: float) -> Array:
        """Times of jumps and kinks strictly inside (start, stop)."""

    def mean(self, start: float, stop: float) -> float:
        """Exact mean power in W over [start, stop]."""


def inside(times: Array, start: float, stop: float) -> Array:
    """The times strictly inside (start, stop), with a tolerance for round-off."""
    slack = 1e-12 * max(abs(start), abs(stop))
    return times[(times > start + slack) & (times < stop - slack)]


def check_times(name: str, times: ArrayLike, hint: str = "") -> Array:
    """Times in s that do not fall, as floats, or InputError."""
    return checks.array(name, times, increasing=True, hint=hint, most=LONGEST)


def check_cycles(start: float, stop: float, period: float, edges: int = 1) -> None:
    """InputError where a call spans more than `MOST_CYCLES` periods, or `MOST_EDGES` edges in them."""
    count, most = (stop - start) / max(period, checks.SMALLEST), min(MOST_CYCLES, MOST_EDGES / max(edges, 1))
    if count > most:
        raise checks.InputError(
            f"{count:.2g} periods of {period:g} s are asked for at once, more than {most:g}",
            "take a shorter run, or solve_periodic for settled heat",
        )


def known(what: str, t: Array, first: float, last: float, hint: str = "") -> Array:
    """``t``, round-off moved into [first, last]; InputError for a time outside."""
    slack = 1e-9 * (last - first)
    outside = (t < first - slack) | (t > last + slack)
    if np.any(outside):
        at = np.atleast_1d(t)[np.atleast_1d(outside)][0]
        raise checks.InputError(f"{what} asked at t = {at:g} s, known from {first:g} to {last:g} s", hint)
    return np.clip(t, first, last)


def seconds(t: ArrayLike) -> Array:
    """The times that a waveform is asked for, as floats; InputError where they are none."""
    try:
        found = np.asarray(t)
    except (TypeError, ValueError, MemoryError):  # a list of lists, a Dataset, an endless range
        found = np.array(None)
    if found.dtype.kind not in "fiub":
        raise checks.InputError(f"t = {checks.shown(t)} is not a number or an array of numbers; {TIME_HINT}")
    if found.size > checks.LONGEST:
        raise checks.InputError(f"t holds {found.size} numbers; at most {checks.LONGEST:,} are taken at one go")
    with np.errstate(over="ignore"):  # of longdouble: inf
        found = np.asarray(found, dtype=float)
    if not np.isfinite(found).all():
        raise checks.InputError(f"t holds {found[~np.isfinite(found)][0]}, which is no time")
    return found


def wrapped(t: Array, period: float, *, before: bool) -> Array:
    """Times moved into one period: [0, period), or (0, period] for limits from the left; round-off goes to the ends."""
    hair = 4 * np.spacing(np.abs(t)) + 4 * np.spacing(period)
    u = np.mod(t, period)
    u = np.where((u <= hair) | (period - u <= hair), 0.0, u)
    return np.where(before & (u == 0), period, u)
