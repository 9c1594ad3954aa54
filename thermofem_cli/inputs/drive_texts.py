"""Drives as a person writes them: powers and detunings over time, and the heating of a ring.

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

import thermofem as th
from thermofem import InputError, checks
from thermofem.data import quantity

from ..options import listed, unused

NAMED = re.compile(r"^\s*([^=]*[^\s=])\s*=\s*(.*\S)\s*$")
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
    times = [quantity.parse(time, "s", name="--field-times") for text in texts or [] for time in listed(text)]
    return tuple(sorted(times))


def amount_of(option: str, text: str, *units: str) -> tuple[str, float]:
    """Return the unit of the amount with which a drive begins, one of ``units``, and that amount in SI."""
    amount = split_drive(text)[0]
    *others, last = units
    for unit in others:
        with contextlib.suppress(InputError):
            return unit, quantity.parse(amount, unit, name=option)
    return last, quantity.parse(amount, last, name=option)


def split_drive(text: str) -> tuple[str, str, str]:
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
    amount, word, rest = split_drive(text)
    first, _, second = rest.partition(" duty " if word == "square" else " at ")
    with reading(f"{option} = {text!r}", FORMS):
        if word and not rest:
            raise InputError(f"{option} = {text!r} ends before its time", FORMS)
        value = (quantity.not_negative if unit == "W" and word != "sine" else quantity.parse)(amount, unit, name=option)
        if not word:
            return float(value)
        if word == "sine":
            rate = quantity.positive(rest, "Hz", name=option)
            wave: Any = th.Function(lambda t: value * np.sin(2 * np.pi * rate * t), period=1 / rate)
        else:
            length = quantity.positive(first, "s", name=option)
            if word == "square":
                wave = th.SquareWave(1.0, length, float(second or 0.5))
            else:
                start = quantity.not_negative(second or "0 s", "s", name=option)
                if start >= duration:
                    raise InputError(f"{option} = {text!r} begins after the run of {quantity.write(duration, 's')}")
                wave = th.Pulse(1.0, length, start)
            if unit == "W":
                wave = replace(wave, power=value)
            else:
                edges = wave.whole.edges
                coefficients = value * wave.whole.coefficients
                wave = th.waveforms.PiecewiseCubic(edges, coefficients, repeat=word == "square")
        if duration < math.inf:
            wave.breakpoints(0.0, duration)  # refuses too many
        return wave


def wavelength_of(section: th.CrossSection, given: str | None) -> float:
    """Return the wavelength in m of --wavelength; by default that of [light], or 1550 nm."""
    if given is None and section.light is not None:
        return section.light.wavelength
    return quantity.positive(given or "1550 nm", "m", name="--wavelength")
