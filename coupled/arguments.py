"""Checks of arguments that several functions share (powers, detunings, times), and a progress bar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import xarray as xr

from thermofem import InputError, checks
from thermofem.arrays import Array, ArrayLike
from thermofem.piecewise import bounds

from .inputs import pieces
from .resonator import RingResonator

LONGEST = 1.0  # s, of a run
MOST_POINTS = 1_000_000  # of a map, a spectrum or a sweep: a point takes some 50 us, one of a circuit ten times that

ROUND_OFF = 1e-7  # of the largest power: how far a cubic fit of a function may undershoot zero
WATT = "powers are in W: 8 dBm is 6.31e-3, 6.31 mW is 6.31e-3"


def check_ring(ring: RingResonator) -> None:
    """Raise InputError unless the argument is a RingResonator."""
    checks.instance("ring", ring, RingResonator, hint="it must be a RingResonator, such as borghi2021()")


def check_power(power: Any, name: str = "power") -> float:
    """Return a bus power in W as a float, or raise InputError if it is not in (0, 1] W; ``name`` is for the message."""
    return checks.positive(name, power, unit="W", at_most=1, hint=WATT)


def check_detuning(detuning: Any, name: str = "detuning") -> float:
    """Return a detuning in Hz as a float, or raise InputError if it is out of range; ``name`` is for the message."""
    nu = checks.finite(name, detuning, unit="Hz")
    if 1 <= abs(nu) <= 1e3:
        raise InputError(f"{name} = {nu:g} Hz is below any linewidth; {name} is in Hz (did you mean {nu:g}e9?)")
    return checks.between(name, nu, -5e12, 5e12, unit="Hz", hint="laser minus cold resonance, e.g. -10e9")


def check_axis(name: str, values: ArrayLike) -> Array:
    """Return powers (W) or detunings (Hz) of a map, shape (n,); InputError unless valid and strictly increasing."""
    axis = checks.array(name, values)
    for k in range(axis.size):
        (check_power if name == "powers" else check_detuning)(axis[k], f"{name}[{k}]")
        if k and axis[k] <= axis[k - 1]:
            raise InputError(f"{name}[{k}] = {axis[k]:g} is not above {name}[{k - 1}] = {axis[k - 1]:g}; sort it")
    return axis


def power_in_time(power: Any, duration: float, name: str = "power", most: float = 1.0, hint: str = WATT) -> Any:
    """Return a constant power (W) as a float, a function of time as `Pieces`; InputError outside 0 to ``most`` W."""
    found = None if _is_number(power) else pieces(name, power, 0.0, float(duration))
    low, high = (power, power) if found is None else bounds(found)
    if found is not None and -ROUND_OFF * high <= low < 0:
        low = 0.0
    values = [checks.between(name, value, 0, most, unit="W", hint=hint) for value in (low, high)]
    return values[0] if found is None else found


def detuning_in_time(detuning: Any, duration: float) -> Any:
    """Return a constant detuning (Hz) as a float, a function of time as `Pieces`; InputError if out of range."""
    if _is_number(detuning):
        return check_detuning(detuning)
    found = pieces("detuning", detuning, 0.0, float(duration))
    for nu in sorted(bounds(found), key=abs, reverse=True)[:1]:
        check_detuning(nu)
    return found


def _is_number(value: Any) -> bool:
    """Whether an input is to be treated as a constant: it is no function of time and no list of inputs."""
    return not (callable(value) or isinstance(value, list | tuple) or hasattr(value, "breakpoints"))


def check_run(duration: float, rtol: float) -> tuple[float, float]:
    """Return duration (s) and relative tolerance of a run as floats, or raise InputError if one is out of range."""
    hint = "1e-6 gives traces and periods to better than 1e-5"
    return check_duration(duration), checks.between("rtol", rtol, 1e-13, 1e-1, hint=hint)


def check_times(times: ArrayLike, duration: float) -> Array:
    """Return the output times in s, shape (n,); InputError unless they increase and lie in [0, duration]."""
    wanted = checks.array("times", times, increasing=True, hint="times are in s")
    for k in (0, -1):
        hint = f"they must lie between 0 and the duration of {duration:g} s"
        checks.between(f"times[{k}]", wanted[k], 0, duration * (1 + 1e-12), unit="s", hint=hint)
    return wanted


def datasets(name: str, given: Any) -> tuple[xr.Dataset, ...]:
    """Return one Dataset or several as a tuple; InputError, with ``name``, for an empty list or another type."""
    found = checks.instances(name, [given] if isinstance(given, xr.Dataset) else given, xr.Dataset)
    if not found:
        raise InputError(f"{name} is empty; give one Dataset, or a list of them")
    return found


def check_duration(duration: float) -> float:
    """Return a duration in s, or raise InputError unless it lies between an optical period (1e-15 s) and a second."""
    # 1e-15 s; the equations hold for the envelope of the field, so not within an optical cycle
    return checks.between(
        "duration", duration, 1e-15, LONGEST, unit="s", hint="times are in s (did you mean 20e-6 for 20 us?)"
    )


@contextmanager
def bar(name: str, total: int, show_bar: bool) -> Iterator[Callable[[], None]]:
    """Context manager of a progress bar on standard error: gives the function to call after each of ``total`` steps."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=not checks.flag("show_bar", show_bar)) as drawn:
        task = drawn.add_task(name, total=total)
        yield lambda: drawn.advance(task)
