"""Heaters as a person writes them: powers, voltages and currents, constant or varying."""

import math
from typing import Any

import coupled
from coupled.resistive_heaters import check_drive
from thermofem import InputError

from .drive_texts import amount_of, assigned, varying

KINDS: dict[str, Any] = {"V": coupled.Volts, "A": coupled.Amperes, "W": lambda power: power}


def heater_powers(texts: list[str] | None, duration: float = math.inf) -> dict[str, Any]:
    """Return the drives of heaters by name, in W, V or A: numbers, or functions of time in a run of ``duration`` s.

    A text without a name is that of the part "heater".
    """
    named = [text if "=" in text else f"heater={text}" for text in texts or []]
    drives = {}
    for name, text in assigned("--heater", named, "heater=5 mW").items():
        option = f"--heater {name}"
        unit, value = amount_of(option, text, *KINDS)
        check_drive(option, value, unit)
        drives[name] = KINDS[unit](varying(option, text, unit, duration))
    return drives


def steady_heaters(texts: list[str] | None) -> dict[str, Any]:
    """Return the constant drives of heaters by name, in W, V or A."""
    drives = heater_powers(texts)
    for name, drive in drives.items():
        if not isinstance(getattr(drive, "wave", drive), float):
            raise InputError(f"--heater {name} varies in time, and this command takes constant drives")
    return drives
