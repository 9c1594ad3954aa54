"""Arguments that the package's functions share: powers, detunings, times, and the bar that shows progress."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import xarray as xr

from thermofem import checks
from thermofem.arrays import Array, ArrayLike
from thermofem.piecewise import bounds

from .inputs import pieces
from .resonator import RingResonator

LONGEST = 1.0  # s, of a run
MOST_POINTS = 1_000_000  # of a map, a spectrum or a sweep: a point takes some 50 us, one of a circuit ten times that

ROUND_OFF = 1e-7  # of the largest power: how far a cubic fit of a function may undershoot zero
WATT = "powers are in W: 8 dBm is 6.31e-3, 6.31 mW is 6.31e-3"


def check_ring(ring: RingResonator) -> None:
    """Raise InputError unless this is a ring."""
    checks.instance("ring", ring, RingResonator, hint="it must be a RingResonator, such as borghi2021()")


def check_power(power: Any, name: str = "power") -> float:
    """Return a bus power in W, or raise InputError."""
    return checks.positive(name, power, unit="W", at_most=1, hint=WATT)


def check_detuning(detuning: Any, name: str = "detuning") -> float:
    """Return a detuning in Hz, or raise InputError."""
    nu = checks.finite(name, detuning, unit="Hz")
    if 1 <= abs(nu) <= 1e3:
        raise checks.InputError(f"{name} = {nu:g} Hz is below any linewidth; {name} is in Hz (did you mean {nu:g}e9?)")
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


def power_in_time(power: Any, duration: float, name: str = "power", most: float = 1.0, hint: str = WATT) -> Any:
    """Return a constant power as a float and anything else as `Pieces`; InputError where it is out of range."""
    found = None if _is_number(power) else pieces(name, power, 0.0, float(duration))
    low, high = (power, power) if found is None else bounds(found)
    if found is not None and -ROUND_OFF * high <= low < 0:
        low = 0.0
    values = [checks.between(name, value, 0, most, unit="W", hint=hint) for value in (low, high)]
    return values[0] if found is None else found


def detuning_in_time(detuning: Any, duration: float) -> Any:
    """Return a constant detuning as a float and anything else as `Pieces`; InputError where it is out of range."""
    if _is_number(detuning):
        return check_detuning(detuning)
    found = pieces("detuning", detuning, 0.0, float(duration))
    for nu in sorted(bounds(found), key=abs, reverse=True)[:1]:
        check_detuning(nu)
    return found


def _is_number(value: Any) -> bool:
    """Whether an input is a constant; the caller reports everything that is neither a number nor a function of time."""
    return not (callable(value) or isinstance(value, list | tuple) or hasattr(value, "breakpoints"))


def check_run(duration: float, rtol: float) -> tuple[float, float]:
    """Duration in s and rtol of a run as floats, or InputError unless they make sense in SI."""
    hint = "1e-6 gives traces and periods to better than 1e-5"
    return check_duration(duration), checks.between("rtol", rtol, 1e-13, 1e-1, hint=hint)


def check_times(times: ArrayLike, duration: float) -> Array:
    """Return the output times in s, or raise InputError unless they increase and lie within the run."""
    wanted = checks.array("times", times, increasing=True, hint="times are in s")
    for k in (0, -1):
        hint = f"they must lie between 0 and the duration of {duration:g} s"
        checks.between(f"times[{k}]", wanted[k], 0, duration * (1 + 1e-12), unit="s", hint=hint)
    return wanted


def datasets(name: str, given: Any) -> tuple[xr.Dataset, ...]:
    """One Dataset or several as a tuple, or InputError where there is none."""
    found = checks.instances(name, [given] if isinstance(given, xr.Dataset) else given, xr.Dataset)
    if not found:
        raise checks.InputError(f"{name} is empty; give one Dataset, or a list of them")
    return found


def check_duration(duration: float) -> float:
    """Return a duration in s, or raise InputError unless it lies between a cycle of the light and a second."""
    # 1e-15 s; the equations hold for the envelope of the field, so not within an optical cycle
    return checks.between(
        "duration", duration, 1e-15, LONGEST, unit="s", hint="times are in s (did you mean 20e-6 for 20 us?)"
    )


@contextmanager
def bar(name: str, total: int, show_bar: bool) -> Iterator[Callable[[], None]]:
    """A function to call after each of ``total`` pieces; it moves a bar on standard error where ``show_bar`` is set."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=not checks.flag("show_bar", show_bar)) as drawn:
        task = drawn.add_task(name, total=total)
        yield lambda: drawn.advance(task)
