"""Heaters as a person writes them: powers, voltages and currents, constant or varying."""

import contextlib
import math
from typing import Any

import coupled
from thermofem import InputError
from thermofem.data import quantity

from .drive_texts import assigned, split_drive, varying


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
    amount = split_drive(text)[0]
    for unit in ("V", "A"):
        with contextlib.suppress(InputError):
            quantity.parse(amount, unit)
            return unit
    return "W"
