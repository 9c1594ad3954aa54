"""Drives as a person writes them: heating, detunings, heaters, sweeps, modulation and further lasers.

AMOUNT                              constant
AMOUNT square PERIOD [duty SHARE]   on for a fraction of every period, one half by default
AMOUNT pulse WIDTH [at START]       one pulse
AMOUNT sine FREQUENCY               AMOUNT sin(2 pi FREQUENCY t)
"""

import contextlib
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import typer
from scipy.constants import c

import coupled
import thermofem as th
from coupled import RingResonator
from coupled.maps.hopf_plane import Window
from thermofem import InputError, checks
from thermofem.data import quantity

from ..options import unused

NAMED = re.compile(r"^\s*([^=]*[^\s=])\s*=\s*(.*\S)\s*$")
PAIR = re.compile(r"([-+\d.eE]+\s*[^\s\d,]+)\s+([-+\d.eE]+\s*\S+)")
RANGE = "FIRST, LAST: two quantities, such as"
FORMS = "AMOUNT, AMOUNT square PERIOD [duty SHARE], AMOUNT pulse WIDTH [at START] or AMOUNT sine FREQUENCY"


@contextlib.contextmanager
def reading(option: str, form: str = "") -> Iterator[None]:
    """Put the option before an InputError of the block; a text that is not of the ``form`` raises one, too."""
    try:
        yield
    except ValueError as error:
        said = error.for_text() if isinstance(error, InputError) else f"not of the form {form}"
        raise InputError(said if said.startswith("--") else f"{option}: {said}") from None


def assigned(option: str, texts: Iterable[str], example: str) -> dict[str, str]:
    """Return the values of a repeatable option 'NAME=VALUE' by name; a name must not be repeated."""
    found = []
    for text in texts:
        with reading(f"{option} {text!r}", f"NAME=VALUE, such as {example!r}"):
            ((name, value),) = NAMED.findall(text)
        found.append((name, value))
    checks.unique(option, [name for name, _ in found])
    return dict(found)


def heating(
    context: typer.Context, power: str, pulse: str | None, square: str | None, duty: float | None
) -> th.waveforms.Waveform:
    """Return the heating of --power, --pulse, --square and --duty: a step, unless --pulse or --square is given."""
    if pulse is not None:
        unused(context, "and --pulse exclude each other", "square")
    if square is None:
        unused(context, "goes with --square: a pulse or a step has no duty cycle", "duty")
    watts = quantity.not_negative(power, "W", name="--power")
    with reading(f"--pulse {pulse}" if pulse else f"--square {square}" if square else f"--power {power}"):
        if pulse is not None:
            return th.Pulse(watts, quantity.positive(pulse, "s", name="--pulse"))
        if square is not None:
            share = 1 / 3 if duty is None else duty
            return th.SquareWave(watts, quantity.positive(square, "s", name="--square"), share)
        return th.Constant(watts)


def times_of(texts: list[str] | None) -> tuple[float, ...]:
    """Return the sorted times in s of --field-times '1 us, 5 us', an option that may be repeated."""
    given = [part.strip() for text in texts or [] for part in text.split(",")]
    return tuple(sorted(quantity.parse(text, "s", name="--field-times") for text in given))


def detuning_of(text: str, ring: RingResonator, name: str = "--detuning") -> float:
    """Return the detuning in Hz of a text, a frequency such as "-10 GHz" or a difference in wavelength such as "80 pm".

        nu = c/(c/f + d) - f

    with the ring's resonance f and the difference d in wavelength: a longer wavelength is a negative detuning.

    Raises InputError: neither a frequency nor a length, or an absolute wavelength.
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


def grid(ring: RingResonator, power: str, detuning: str, points: str) -> tuple[Any, Any]:
    """Return the axes of a map, shape (n,) and (m,): powers in W, evenly spaced in dBm, and detunings in Hz."""
    with reading(f"--power = {power!r}", f"{RANGE} '3 dBm, 10 dBm'"):
        low, high = sorted(quantity.positive(part.strip(), "W", name="--power") for part in power.split(","))
    with reading(f"--detuning = {detuning!r}", f"{RANGE} '-30 GHz, 30 GHz'"):
        first, last = sorted(detuning_of(part.strip(), ring) for part in detuning.split(","))
    with reading(f"--points = {points!r}", "N, M: two whole numbers, such as '20, 20'"):
        of_powers, of_detunings = points.split(",")
        n = checks.integer("--points", int(of_powers), 2, 2000)
        m = checks.integer("--points", int(of_detunings), 2, 2000)
    return np.geomspace(low, high, n), np.linspace(first, last, m)


def plane_words(plane: Window) -> str:
    """Return in words a plane of powers and detunings."""
    low, high = plane.powers
    first, last = plane.detunings
    powers = f"{quantity.rounded(low, 'W')} to {quantity.rounded(high, 'W')}"
    return f"{powers}, {quantity.rounded(first, 'Hz')} to {quantity.rounded(last, 'Hz')}, about the Hopf curve"


def heater_powers(texts: list[str] | None, duration: float = math.inf) -> dict[str, Any]:
    """Return the drives of heaters by name, in W, V or A: numbers, or functions of time in a run of ``duration`` s."""
    found = {}
    for name, text in _heater_texts(texts).items():
        unit = _unit_of_drive(text)
        drive = varying("--heater", text, unit, duration)
        found[name] = DRIVES[unit](drive)
    return found


def steady_heaters(texts: list[str] | None) -> dict[str, Any]:
    """Return the constant drives of heaters by name, in W, V or A."""
    found = {}
    for name, text in _heater_texts(texts).items():
        unit = _unit_of_drive(text)
        drive = quantity.not_negative(text, unit, name=f"--heater {name}")
        found[name] = DRIVES[unit](drive)
    return found


DRIVES: dict[str, Any] = {"W": lambda power: power, "V": coupled.Volts, "A": coupled.Amperes}


def _heater_texts(texts: list[str] | None) -> dict[str, str]:
    """Return the texts of heaters by name; a text without a name is that of the part "heater"."""
    named = [text if "=" in text else f"heater={text}" for text in texts or []]
    return assigned("--heater", named, "heater=5 mW")


def _unit_of_drive(text: str) -> str:
    """Return "V" or "A" where a text begins with a voltage or a current, else "W"."""
    amount = _split(text)[0]
    for unit in ("V", "A"):
        with contextlib.suppress(InputError):
            quantity.parse(amount, unit)
            return unit
    return "W"


def light(
    ring: RingResonator, power: str, detuning: str, sweep: str | None, modulate: list[str] | None, duration: float
) -> dict[str, Any]:
    """Return ``power`` (W) and ``detuning`` (Hz) of the laser, each a number, a function of time, or a list of them."""
    found: dict[str, Any] = {
        "power": quantity.not_negative(power, "W", name="--power"),
        "detuning": detuning_of(detuning, ring),
    }
    if sweep is not None:
        with reading(f"--sweep = {sweep!r}", "two quantities or more, such as '20 GHz, -40 GHz'"):
            first, second, *others = sweep.split(",")
        swept = begins_with("--sweep", first.strip())
        unit = "Hz" if swept == "detuning" else "W"
        values = [quantity.parse(part.strip(), unit, name="--sweep") for part in (first, second, *others)]
        found[swept] = coupled.Sweep([duration * k / (len(values) - 1) for k in range(len(values))], values)
    for text in modulate or []:
        name = begins_with("--modulate", text)
        added = varying("--modulate", text, "Hz" if name == "detuning" else "W", duration)
        found[name] = [*(found[name] if isinstance(found[name], list) else [found[name]]), added]
    return found


def lasers(texts: list[str] | None, ring: RingResonator, duration: float = math.inf) -> list[coupled.Laser]:
    """Return the further lasers of --laser, of constant or varying power in a run of ``duration`` in s."""
    form = "POWER DETUNING [on OFFSET], such as '8 dBm 0 GHz' or '1 mW pulse 10 ns, -5 GHz on 1.5 THz'"
    found = []
    for text in texts or []:
        light, _, offset = text.partition(" on ")
        with reading(f"--laser {text!r}", form):
            first, second = PAIR.sub(r"\1,\2", light.strip()).rsplit(",", 1)
        at = replace(ring, frequency=ring.frequency + detuning_of(offset.strip(), ring, "--laser")) if offset else None
        found.append(
            coupled.Laser(
                varying("--laser", first.strip(), "W", duration), detuning_of(second.strip(), at or ring, "--laser"), at
            )
        )
    return found


def begins_with(option: str, text: str) -> str:
    """Return "detuning" where a text begins with a frequency, "power" where it begins with a power."""
    amount = _split(text)[0]
    with contextlib.suppress(InputError):
        quantity.parse(amount, "Hz", name=option)
        return "detuning"
    quantity.parse(amount, "W", name=option)
    return "power"


def _split(text: str) -> tuple[str, str, str]:
    """Split "AMOUNT SHAPE REST" into its three parts; SHAPE is square, pulse, sine or empty."""
    for word in ("square", "pulse", "sine"):
        amount, found, rest = f"{text.strip()} ".partition(f" {word} ")
        if found:
            return amount.strip(), word, rest.strip()
    return text.strip(), "", ""


def varying(option: str, text: str, unit: str, duration: float = math.inf) -> Any:
    """Return the number (W or Hz) or function of time of a text, for a run of ``duration`` in s.

    Raises InputError: a text of another form, a quantity with another unit or out of range, too many breakpoints, or a
        pulse that begins when the run is over.
    """
    amount, word, rest = _split(text)
    first, _, second = rest.partition(" duty " if word == "square" else " at ")
    with reading(f"{option} = {text!r}", FORMS):
        value = (quantity.not_negative if unit == "W" and word != "sine" else quantity.parse)(amount, unit, name=option)
        if not word:
            return float(value)
        if word == "pulse":
            start = quantity.not_negative(second or "0 s", "s", name=option)
            length = quantity.positive(first, "s", name=option)
            if start >= duration:
                raise InputError(f"{option} = {text!r} begins after the run of {quantity.write(duration, 's')}")
            if unit == "W":
                return th.Pulse(value, length, start)
            edges = [start, start + length] if start else [length]
            return th.Function(lambda t: value * ((t >= start) & (t < start + length)), edges)
        if word == "sine":
            rate = quantity.positive(rest, "Hz", name=option)
            wave: Any = th.Function(lambda t: value * np.sin(2 * np.pi * rate * t), period=1 / rate)
        else:
            period = quantity.positive(first, "s", name=option)
            share = checks.between("duty", float(second or 0.5), 1e-6, 1 - 1e-6, hint="the share that is on")
            on = share * period
            wave = th.Function(lambda t: value * ((t >= 0) & (t < on)), [on], period=period)
            wave = th.SquareWave(value, period, share) if unit == "W" else wave
        if duration < math.inf:
            wave.breakpoints(0.0, duration)  # refuses too many
        return wave
