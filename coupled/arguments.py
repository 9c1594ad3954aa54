"""Checks of the numerical arguments of the package's functions."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike
from thermofem.piecewise import bounds

from .inputs import pieces
from .resonator import RingResonator

LONGEST = 1.0  # s, of a run
MOST_POINTS = 1_000_000  # of a map, a spectrum or a sweep: a point takes some 50 us, one of a circuit ten times that
MOST_TIMES = 10_000_000  # rows of a trace; .3 kB each while it is made (measured)
SHORTEST = 1e-15  # s; the equations hold for the envelope of the field, so not within an optical cycle

ROUND_OFF = 1e-7  # of the largest power: how far a cubic fit of a function may undershoot zero

SEVERAL = "for several: simulate(..., lasers=[coupled.Laser(power, detuning)]), whose run pulsing() classifies"

P = ParamSpec("P")
R = TypeVar("R")


def check_ring(ring: RingResonator) -> None:
    """Raise InputError unless this is a ring."""
    checks.instance("ring", ring, RingResonator, hint="it must be a RingResonator, such as borghi2021()")


def one_laser(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator for functions of one laser: with ``lasers=`` they raise InputError and name the function to use."""

    @functools.wraps(function)
    def call(*args: Any, **given: Any) -> R:
        if "lasers" in given:
            raise checks.InputError(f"{function.__name__} has one laser and no argument lasers; {SEVERAL}")
        return function(*args, **given)

    return call


def check_power(power: float, name: str = "power") -> float:
    """Return a bus power in W, or raise InputError."""
    _check_alone(name, power)
    return checks.positive(name, power, unit="W", at_most=1, hint="8 dBm is 6.31e-3, 6.31 mW is 6.31e-3")


def _check_alone(name: str, value: Any) -> None:
    """Raise InputError for a list of powers or detunings, which belong to several lasers."""
    several = isinstance(value, list | tuple | range)
    count = value.size if isinstance(value, np.ndarray) else len(value) if several else 1
    if count > 1:
        raise checks.InputError(f"{name} holds {count} values; there is one laser here; {SEVERAL}")


def check_detuning(detuning: float, name: str = "detuning") -> float:
    """Return a detuning in Hz, or raise InputError."""
    _check_alone(name, detuning)
    nu = checks.finite(name, detuning, unit="Hz")
    if 1 <= abs(nu) <= 1e3:
        raise checks.InputError(f"{name} = {nu:g} Hz is below any linewidth; it is in Hz (did you mean {nu:g}e9?)")
    return checks.between(name, nu, -5e12, 5e12, unit="Hz", hint="laser minus cold resonance, e.g. -10e9")


def check_axis(name: str, values: ArrayLike) -> Array:
    """Return the powers or detunings of a map, strictly increasing, or raise InputError naming the bad one."""
    axis = checks.array(name, values)
    for k in range(axis.size):
        (check_power if name == "powers" else check_detuning)(axis[k], f"{name}[{k}]")
        if k and axis[k] <= axis[k - 1]:
            raise checks.InputError(
                f"{name}[{k}] = {axis[k]:g} is not above {name}[{k - 1}] = {axis[k - 1]:g}; sort it"
            )
    return axis


def power_in_time(power: Any, duration: float) -> Any:
    """Return a constant power as a float and anything else as `Pieces`; InputError where it is out of range."""
    watt = "powers are in W: 8 dBm is 6.31e-3, 6.31 mW is 6.31e-3"
    if _is_number(power):
        return checks.between("power", power, 0, 1, unit="W", hint=watt)
    found = pieces("power", power, 0.0, float(duration))
    low, high = bounds(found)
    checks.between("power", low if low < -ROUND_OFF * high else 0.0, 0, 1, unit="W", hint=watt)
    checks.between("power", high, 0, 1, unit="W", hint=watt)
    return found


def detuning_in_time(detuning: Any, duration: float) -> Any:
    """Return a constant detuning as a float and anything else as `Pieces`; InputError where it is out of range."""
    found = None if _is_number(detuning) else pieces("detuning", detuning, 0.0, float(duration))
    if type(detuning) in (list, tuple) and sum(_is_number(part) for part in detuning) > 1:
        raise checks.InputError(
            f"detuning is a list of {len(detuning)} with several numbers; a list is one laser: give one number, with "
            "waveforms where it varies, and a second laser as lasers=[coupled.Laser(power, detuning)] of simulate"
        )
    ends = [detuning] if found is None else bounds(found)
    values = [checks.finite("detuning", nu, unit="Hz") for nu in ends]
    largest = max(values, key=abs)
    if 1 <= abs(largest) <= 1e3:
        raise checks.InputError(
            f"detuning = {largest:g} Hz is below any linewidth; detuning is in Hz (did you mean {largest:g}e9?)"
        )
    for nu in values:
        checks.between("detuning", nu, -5e12, 5e12, unit="Hz", hint="laser minus cold resonance, e.g. -10e9")
    return values[0] if found is None else found


def _is_number(value: Any) -> bool:
    """Whether an input is a constant; the caller reports everything that is neither a number nor a function of time."""
    return not (callable(value) or isinstance(value, list | tuple) or hasattr(value, "breakpoints"))


def check_run(ring: RingResonator, duration: float, rtol: float) -> tuple[float, float]:
    """Duration in s and rtol of a run as floats, or InputError unless they make sense in SI."""
    check_ring(ring)
    hint = "1e-6 gives traces and periods to better than 1e-5"
    return check_duration(duration), checks.between("rtol", rtol, 1e-13, 1e-1, hint=hint)


def check_times(times: ArrayLike, duration: float) -> Array:
    """Return the output times in s, or raise InputError unless they increase and lie within the run."""
    wanted = checks.array("times", times, increasing=True, hint="times are in s")
    if wanted.size > MOST_TIMES:
        raise checks.InputError(f"times holds {wanted.size} values; at most {MOST_TIMES} rows of a trace are kept")
    if wanted[0] < 0 or wanted[-1] > duration * (1 + 1e-12):
        bad = wanted[0] if wanted[0] < 0 else wanted[-1]
        raise checks.InputError(f"times reach {bad:g} s; they must lie between 0 and the duration of {duration:g} s")
    return wanted


def check_duration(duration: float) -> float:
    """Return a duration in s, or raise InputError unless it lies between a cycle of the light and a second."""
    hint = "times are in s (did you mean 20e-6 for 20 us?)"
    duration = checks.positive("duration", duration, unit="s", at_most=LONGEST, hint=hint)
    if duration < SHORTEST:
        raise checks.InputError(
            f"duration = {duration:g} s is shorter than a cycle of the light, {SHORTEST:g} s; {hint}"
        )
    return duration
