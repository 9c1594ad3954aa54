"""Heaters as a person writes them: powers, voltages and currents, constant or varying."""

import contextlib
import math
from typing import Any

import coupled
from coupled.resistive_heaters import LARGEST_DRIVE, LARGEST_POWER
from thermofem import InputError, checks
from thermofem.data import quantity

from .drive_texts import assigned, split_drive, varying


def heater_powers(texts: list[str] | None, duration: float = math.inf) -> dict[str, Any]:
    """Return the drives of heaters by name, in W, V or A: numbers, or functions of time in a run of ``duration`` s."""
    drives = {}
    for name, text in _heater_texts(texts).items():
        unit = _checked_unit(name, text)
        drive = varying(f"--heater {name}", text, unit, duration)
        drives[name] = KINDS[unit](drive)
    return drives


def steady_heaters(texts: list[str] | None) -> dict[str, Any]:
    """Return the constant drives of heaters by name, in W, V or A."""
    drives = heater_powers(texts)
    for name, drive in drives.items():
        if not isinstance(getattr(drive, "wave", drive), float):
            raise InputError(f"--heater {name} varies in time, and this command takes constant drives")
    return drives


KINDS: dict[str, Any] = {"W": lambda power: power, "V": coupled.Volts, "A": coupled.Amperes}
LARGEST = {"W": LARGEST_POWER, "V": LARGEST_DRIVE, "A": LARGEST_DRIVE}


def _heater_texts(texts: list[str] | None) -> dict[str, str]:
    """Return the texts of heaters by name; a text without a name is that of the part "heater"."""
    named = [text if "=" in text else f"heater={text}" for text in texts or []]
    return assigned("--heater", named, "heater=5 mW")


def _checked_unit(name: str, text: str) -> str:
    """Return "V" or "A" where a text begins with a voltage or a current, else "W"; InputError for a larger amount."""
    amount = split_drive(text)[0]
    unit = "W"
    for other in ("V", "A"):
        with contextlib.suppress(InputError):
            quantity.parse(amount, other)
            unit = other
    value = quantity.parse(amount, unit, name=f"--heater {name}")
    least = 0.0 if unit == "W" else -LARGEST[unit]
    checks.between(f"--heater {name}", value, least, LARGEST[unit], unit=unit)
    return unit
