"""Drives as a person writes them: heating, detunings, heaters, sweeps, modulation and further lasers.

AMOUNT                              constant
AMOUNT square PERIOD [duty SHARE]   on for a share of every period, one half by default
AMOUNT pulse WIDTH [at START]       one pulse
AMOUNT sine FREQUENCY               AMOUNT sin(2 pi FREQUENCY t)
"""

import contextlib
import math
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.constants import c

import coupled
import thermofem as th
from coupled import Laser, RingResonator
from thermofem import checks
from thermofem.data import quantity
from thermofem.errors import InputError, prefixed

PAIR = re.compile(r"([-+\d.eE]+\s*[^\s\d,]+)\s+([-+\d.eE]+\s*\S+)")
FORMS = "AMOUNT, AMOUNT square PERIOD [duty SHARE], AMOUNT pulse WIDTH [at START] or AMOUNT sine FREQUENCY"


def assigned(option: str, texts: Iterable[str], example: str) -> dict[str, str]:
    """Names and values of a repeatable option 'NAME=VALUE'; InputError for another form, or a name given twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        name = "/".join(part.strip() for part in name.split("/"))
        if not (name and equals and value):
            raise InputError(f"{option} {text!r} is not of the form NAME=VALUE, such as {example!r}")
        if name in found:
            raise InputError(f"{option} {name!r} is given twice; give it once")
        found[name] = value
    return found


def heating(power: str, pulse: str | None, square: str | None, duty: float | None) -> th.waveforms.Waveform:
    """Waveform of --power, --pulse, --square and --duty: a step, unless one of the others is given."""
    watts = quantity.not_negative(power, "W", name="--power")
    if pulse is not None and square is not None:
        raise InputError(f"--pulse {pulse} and --square {square} exclude each other; give one")
    if duty is not None and square is None:
        raise InputError(f"--duty {duty} goes with --square: a pulse or a step has no duty cycle")
    if duty is not None:
        checks.between("--duty", duty, 0, 1, hint="the duty cycle is the fraction of the period that is on")
    if pulse is not None:
        width = quantity.positive(pulse, "s", name="--pulse")
        with prefixed(f"--power {power} with --pulse {pulse}", text=True):
            return th.Pulse(watts, width)
    if square is not None:
        period, share = quantity.positive(square, "s", name="--square"), 1 / 3 if duty is None else duty
        with prefixed(f"--power {power} with --square {square}", text=True):
            return th.SquareWave(watts, period, share)
    with prefixed(f"--power {power}", text=True):
        return th.Constant(watts)


def times_of(texts: list[str] | None) -> tuple[float, ...]:
    """Times in s of --field-times '1 us, 5 us', which may be repeated; in order."""
    given = [part.strip() for text in texts or [] for part in text.split(",") if part.strip()]
    if texts and not given:
        raise InputError(f"--field-times {texts[0]!r} names no time; give '1 us' or '1 us, 5 us'")
    return tuple(sorted(quantity.parse(text, "s", name="--field-times") for text in given))


def detuning_of(text: str, ring: RingResonator, name: str = "--detuning") -> float:
    """Laser minus cold resonance in Hz, of a frequency "-10 GHz" or a distance in wavelength "80 pm".

        nu = c/(c/f + d) - f

    with the ring's resonance f and the distance d in wavelength: a longer wavelength is a negative detuning.

    Raises InputError: neither a frequency nor a length, or a wavelength that is no distance.
    """
    try:
        distance = quantity.parse(text, "m", name=name)
    except InputError:
        return quantity.parse(text, "Hz", name=name)
    wavelength = c / ring.frequency
    if not abs(distance) < 0.1 * wavelength:
        raise InputError(
            f"{name} = {text!r} must be a distance from the resonance at {wavelength * 1e9:.6g} nm, not a wavelength",
            'e.g. "80 pm"',
        )
    return float(c / (wavelength + distance) - ring.frequency)


def pair(text: str, name: str) -> list[str]:
    """The two texts of 'first, last'."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise InputError(f"{name} = {text!r} must be two quantities with a comma, such as '3 dBm, 10 dBm'")
    return parts


def grid(ring: RingResonator, power: str, detuning: str, points: str) -> tuple[Any, Any]:
    """Axes of a map: powers in W, evenly spaced in dBm, and detunings in Hz."""
    low, high = (quantity.positive(part, "W", name="--power") for part in pair(power, "--power"))
    if low >= high:
        raise InputError(f"--power = {power!r}: the first must be below the second")
    try:
        n, m = (int(part) for part in points.split(","))
    except ValueError:
        raise InputError(f"--points = {points!r} must be two whole numbers, such as '20, 20'") from None
    if not (2 <= n <= 2000 and 2 <= m <= 2000):
        raise InputError(f"--points = {points!r} must lie between 2 and 2000")
    ends = sorted(detuning_of(part, ring) for part in pair(detuning, "--detuning"))
    if ends[0] == ends[1]:
        raise InputError(f"--detuning = {detuning!r}: the two are equal")
    return np.geomspace(low, high, n), np.linspace(ends[0], ends[1], m)


def heater_powers(texts: list[str] | None, duration: float = math.inf) -> dict[str, Any]:
    """Powers of heaters by name in a run of some duration in s: numbers where constant, else waveforms."""
    given = assigned("--heater", texts or [], "heater=5 mW")
    return {name: varying("--heater", power, "W", duration) for name, power in given.items()}


def steady_heaters(texts: list[str] | None) -> dict[str, float]:
    """Constant powers of heaters by name."""
    found = heater_powers(texts)
    for name, power in found.items():
        if not isinstance(power, float):
            raise InputError(f"--heater {name} varies in time; a map takes constant powers, such as '{name}=5 mW'")
    return found


def light(
    ring: RingResonator, power: str, detuning: str, sweep: str | None, modulate: list[str] | None, duration: float
) -> dict[str, Any]:
    """``power`` and ``detuning`` of the laser in a run of ``duration`` in s."""
    found: dict[str, Any] = {
        "power": quantity.not_negative(power, "W", name="--power"),
        "detuning": detuning_of(detuning, ring),
    }
    if sweep is not None:
        parts = [part.strip() for part in sweep.split(",")]
        swept = begins_with("--sweep", parts[0])
        values = [quantity.parse(part, "Hz" if swept == "detuning" else "W", name="--sweep") for part in parts]
        if len(values) < 2:
            raise InputError(f"--sweep = {sweep!r} must be two quantities or more, such as '20 GHz, -40 GHz'")
        found[swept] = coupled.Sweep([duration * k / (len(values) - 1) for k in range(len(values))], values)
    for text in modulate or []:
        name = begins_with("--modulate", text)
        added = varying("--modulate", text, "Hz" if name == "detuning" else "W", duration)
        found[name] = [*(found[name] if isinstance(found[name], list) else [found[name]]), added]
    return found


def lasers(texts: list[str] | None, ring: RingResonator, duration: float = math.inf) -> list[Laser]:
    """Further lasers, of constant or varying power, in a run of some duration in s."""
    from coupled import Laser

    found = []
    for text in texts or []:
        light, on, offset = (part.strip() for part in text.partition(" on "))
        both = light.rsplit(",", 1) if "," in light else (match.groups() if (match := PAIR.fullmatch(light)) else ())
        if len(both) != 2 or (on and not offset):
            raise InputError(
                f"--laser {text!r} is not of the form POWER DETUNING [on OFFSET], such as '8 dBm 0 GHz' or "
                "'1 mW pulse 10 ns, -5 GHz on 1.5 THz'"
            )
        at = replace(ring, frequency=ring.frequency + detuning_of(offset, ring, "--laser")) if on else None
        power = varying("--laser", both[0].strip(), "W", duration)
        found.append(Laser(power, detuning_of(both[1].strip(), at or ring, "--laser"), at))
    return found


def begins_with(option: str, text: str) -> str:
    """Whether a text begins with a "detuning" (a frequency) or a "power"."""
    amount = _split(text)[0]
    for name, unit in (("detuning", "Hz"), ("power", "W")):
        with contextlib.suppress(InputError):
            quantity.parse(amount, unit, name=option)
            return name
    raise InputError(f"{option} = {text!r} begins with neither a detuning, such as 20 GHz, nor a power, such as 1 mW")


def _split(text: str) -> tuple[str, str, str]:
    """Split "AMOUNT SHAPE REST" into its three parts; SHAPE is square, pulse, sine or empty."""
    for word in ("square", "pulse", "sine"):
        amount, found, rest = f"{text.strip()} ".partition(f" {word} ")
        if found:
            return amount.strip(), word, rest.strip()
    return text.strip(), "", ""


def varying(option: str, text: str, unit: str, duration: float = math.inf) -> Any:
    """A number, or a function of time, in W or Hz.

    Raises InputError: a text of another form, a quantity with another unit or out of range, or a pulse that begins when
        the run of ``duration`` in s is over.
    """
    with prefixed(f"{option} = {text!r}", text=True):
        return _varying(option, text, unit, duration)


def _varying(option: str, text: str, unit: str, duration: float) -> Any:
    amount, word, rest = _split(text)
    if word and not rest:
        raise InputError(f"{option} = {text!r} ends after {word!r}; the forms are {FORMS}")
    value = (quantity.not_negative if unit == "W" and word != "sine" else quantity.parse)(amount, unit, name=option)
    if not word:
        return float(value)
    if word == "sine":
        rate = quantity.positive(rest, "Hz", name=option)
        return _within(th.Function(lambda t: value * np.sin(2 * np.pi * rate * t), period=1 / rate), duration)
    first, _, second = rest.partition(" duty " if word == "square" else " at ")
    length = quantity.positive(first, "s", name=option)
    if word == "pulse":
        start = quantity.not_negative(second, "s", name=option) if second else 0.0
        if start >= duration:
            raise InputError(f"{option} = {text!r} begins after the run of {quantity.write(duration, 's')}")
        if unit == "W":
            return th.Pulse(value, length, start)
        edges = [start, start + length] if start else [length]
        return th.Function(lambda t: value * ((t >= start) & (t < start + length)), edges)
    share = _share(option, text, second)
    if unit == "W":
        return _within(th.SquareWave(value, length, share), duration)
    on = share * length
    return _within(th.Function(lambda t: value * ((t >= 0) & (t < on)), [on], period=length), duration)


def _within(wave: Any, duration: float) -> Any:
    """The wave, checked: InputError where it has too many breakpoints in a run of ``duration``."""
    if duration < math.inf:
        wave.breakpoints(0.0, duration)
    return wave


def _share(option: str, text: str, given: str) -> float:
    try:
        share = float(given) if given else 0.5
    except ValueError:
        raise InputError(f"{option} = {text!r} is not of the form {FORMS}") from None
    return checks.between(f"duty of {option}", share, 1e-6, 1 - 1e-6, hint="the share of the period that is on")
