"""The options --heater, --sweep, --modulate and --laser: powers and detunings that vary in time.

AMOUNT                              constant
AMOUNT square PERIOD [duty SHARE]   on for a share of every period, one half by default
AMOUNT pulse WIDTH [at START]       one pulse
AMOUNT sine FREQUENCY               AMOUNT sin(2 pi FREQUENCY t)
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import quantity

from .detuning import detuning_of
from .values import assigned, naming

if TYPE_CHECKING:
    from coupled import Laser, RingResonator


HEATER = "Power of another part: 'heater=5 mW', 'heater=5 mW square 1 us duty 0.3' or 'heater=5 mW pulse 1 us at 2 us'."
SWEEP = "Detunings (or powers) to go through at a constant rate, '20 GHz, -40 GHz, 20 GHz', over the whole run."
MODULATE = "Adds to power or detuning: '1 mW square 1 us', '1 mW pulse 10 ns at 5 us' or '2 GHz sine 1 MHz'."
LASER = (
    "A further laser, POWER DETUNING [on OFFSET]: '1 mW 4 GHz' beats with the first; '1 uW -5 GHz on 1.5 THz' is near "
    "the resonance 1.5 THz above. Repeatable."
)
PAIR = re.compile(r"([-+\d.eE]+\s*[^\s\d,]+)\s+([-+\d.eE]+\s*\S+)")
FORMS = "AMOUNT, AMOUNT square PERIOD [duty SHARE], AMOUNT pulse WIDTH [at START] or AMOUNT sine FREQUENCY"


def heaters(texts: list[str], duration: float = math.inf) -> dict[str, Any]:
    """Powers of heaters in a run of some duration: numbers where constant, else waveforms."""
    given = assigned("--heater", texts, "heater=5 mW")
    return {name: varying("--heater", power, "W", duration) for name, power in given.items()}


def steady_heaters(texts: list[str]) -> dict[str, float]:
    """Heater powers for maps, which take constants only."""
    found = heaters(texts)
    for name, power in found.items():
        if not isinstance(power, float):
            raise InputError(f"--heater {name} varies in time; a map takes constant powers, such as '{name}=5 mW'")
    return found


def channel(picked: str | None, heated: str | None, read: str | None) -> tuple[str | None, str | None]:
    """The parts that the light heats and that detunes it."""
    if picked and (heated or read):
        raise InputError(f"--channel {picked} names both parts; give it without --heated and --read")
    return (picked, picked) if picked else (heated, read)


def light(
    ring: RingResonator, power: str, detuning: str, sweep: str | None, modulate: list[str], duration: float
) -> tuple[dict[str, Any], str | None]:
    """Power and detuning of the laser, and which of them is swept."""
    import coupled

    found: dict[str, Any] = {
        "power": quantity.not_negative(power, "W", name="--power"),
        "detuning": detuning_of(detuning, ring),
    }
    swept = None
    if sweep is not None:
        parts = [part.strip() for part in sweep.split(",")]
        swept = kind("--sweep", parts[0])
        values = [quantity.parse(part, "Hz" if swept == "detuning" else "W", name="--sweep") for part in parts]
        if len(values) < 2:
            raise InputError(f"--sweep = {sweep!r} must be two quantities or more, such as '20 GHz, -40 GHz'")
        found[swept] = coupled.Sweep([duration * k / (len(values) - 1) for k in range(len(values))], values)
    for text in modulate:
        name = kind("--modulate", text)
        added = varying("--modulate", text, "Hz" if name == "detuning" else "W", duration)
        found[name] = [*(found[name] if isinstance(found[name], list) else [found[name]]), added]
    return found, swept


def lasers(texts: list[str], ring: RingResonator, duration: float = math.inf) -> list[Laser]:
    """Further lasers, of constant or varying power, in a run of some duration.

    Raises InputError: a text of another form, a quantity with another unit, or a resonance that is not above 0 Hz.
    """
    from coupled import Laser

    found = []
    for text in texts:
        light, on, offset = (part.strip() for part in text.partition(" on "))
        pair = light.rsplit(",", 1) if "," in light else (match.groups() if (match := PAIR.fullmatch(light)) else ())
        if len(pair) != 2 or (on and not offset):
            raise InputError(
                f"--laser {text!r} is not of the form POWER DETUNING [on OFFSET], such as '8 dBm 0 GHz' or "
                "'1 mW pulse 10 ns, -5 GHz on 1.5 THz'"
            )
        at = replace(ring, frequency=ring.frequency + detuning_of(offset, ring, "--laser")) if on else None
        power = varying("--laser", pair[0].strip(), "W", duration)
        found.append(Laser(power, detuning_of(pair[1].strip(), at or ring, "--laser"), at))
    return found


def kind(option: str, text: str) -> str:
    """Whether a text begins with a frequency (a detuning) or a power."""
    amount = _split(text)[0]
    for name, unit in (("detuning", "Hz"), ("power", "W")):
        try:
            quantity.parse(amount, unit, name=option)
        except InputError:
            continue
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
    with naming(f"{option} = {text!r}"):
        return _varying(option, text, unit, duration)


def _varying(option: str, text: str, unit: str, duration: float) -> Any:
    from thermofem.waveforms import Function, Pulse, SquareWave

    amount, word, rest = _split(text)
    if word and not rest:
        raise InputError(f"{option} = {text!r} ends after {word!r}; the forms are {FORMS}")
    value = (quantity.not_negative if unit == "W" and word != "sine" else quantity.parse)(amount, unit, name=option)
    if not word:
        return float(value)
    if word == "sine":
        import numpy as np

        rate = quantity.positive(rest, "Hz", name=option)
        return _within(Function(lambda t: value * np.sin(2 * np.pi * rate * t), period=1 / rate), duration)
    first, _, second = rest.partition(" duty " if word == "square" else " at ")
    length = quantity.positive(first, "s", name=option)
    if word == "pulse":
        start = quantity.not_negative(second, "s", name=option) if second else 0.0
        if start >= duration:
            raise InputError(f"{option} = {text!r} begins after the run of {quantity.write(duration, 's')}")
        if unit == "W":
            return Pulse(value, length, start)
        edges = [start, start + length] if start else [length]
        return Function(_between(value, start, start + length), edges)
    share = _share(option, text, second)
    if unit == "W":
        return _within(SquareWave(value, length, share), duration)
    return _within(Function(_between(value, 0.0, share * length), [share * length], period=length), duration)


def _within(wave: Any, duration: float) -> Any:
    """A wave whose edges in a run of ``duration`` are not too many, or InputError."""
    if duration < math.inf:
        wave.breakpoints(0.0, duration)
    return wave


def _share(option: str, text: str, given: str) -> float:
    try:
        share = float(given) if given else 0.5
    except ValueError:
        raise InputError(f"{option} = {text!r} is not of the form {FORMS}") from None
    return checks.between(f"duty of {option}", share, 1e-6, 1 - 1e-6, hint="the share of the period that is on")


def _between(value: float, start: float, stop: float) -> Callable[[Any], Any]:
    """``value`` from ``start`` to ``stop``, else 0."""
    return lambda t: value * ((t >= start) & (t < stop))
