"""Lasers and heaters of a ring as a person writes them: powers, detunings, sweeps, modulation, voltages, currents."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.constants import c

import coupled
from coupled import RingResonator
from coupled.maps.hopf_plane import Window
from coupled.resistive_heaters import check_drive
from thermofem import InputError, checks
from thermofem.data import quantity

from .drive_texts import RANGE, amount_of, assigned, reading, varying

LASER_INPUTS = {"Hz": "detuning", "W": "power"}
HEATER_INPUTS: dict[str, Any] = {"V": coupled.Volts, "A": coupled.Amperes, "W": lambda power: power}
PAIR = re.compile(r"([-+\d.eE]+\s*[^\s\d,]+)\s+([-+\d.eE]+\s*\S+)")


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


def light(
    ring: RingResonator, power: str, detuning: str, sweep: str | None, modulate: list[str] | None, duration: float
) -> dict[str, Any]:
    """Return ``power`` (W) and ``detuning`` (Hz) of the laser, each a number, a function of time, or a list of them."""
    inputs: dict[str, list[Any]] = {
        "power": [quantity.not_negative(power, "W", name="--power")],
        "detuning": [detuning_of(detuning, ring)],
    }
    if sweep is not None:
        with reading(f"--sweep = {sweep!r}", "two quantities or more, such as '20 GHz, -40 GHz'"):
            first, second, *others = sweep.split(",")
        unit, _ = amount_of("--sweep", first, *LASER_INPUTS)
        values = [quantity.parse(part.strip(), unit, name="--sweep") for part in (first, second, *others)]
        times = np.linspace(0.0, duration, len(values))
        inputs[LASER_INPUTS[unit]] = [coupled.Sweep(times, values)]
    for text in modulate or []:
        unit, _ = amount_of("--modulate", text, *LASER_INPUTS)
        inputs[LASER_INPUTS[unit]].append(varying("--modulate", text, unit, duration))
    return {name: parts if len(parts) > 1 else parts[0] for name, parts in inputs.items()}


def lasers(texts: list[str] | None, ring: RingResonator, duration: float = math.inf) -> list[coupled.Laser]:
    """Return the further lasers of --laser, of constant or varying power in a run of ``duration`` in s."""
    form = "POWER DETUNING [on OFFSET], such as '8 dBm 0 GHz' or '1 mW pulse 10 ns, -5 GHz on 1.5 THz'"
    further = []
    for text in texts or []:
        drive, _, offset = text.partition(" on ")
        with reading(f"--laser {text!r}", form):
            power, detuning = PAIR.sub(r"\1,\2", drive.strip()).rsplit(",", 1)
        mode = None  # of the ring at an offset, such as a free spectral range, that this laser excites
        if offset:
            mode = replace(ring, frequency=ring.frequency + detuning_of(offset.strip(), ring, "--laser"))
        watts = varying("--laser", power.strip(), "W", duration)
        hertz = detuning_of(detuning.strip(), mode or ring, "--laser")
        further.append(coupled.Laser(watts, hertz, mode))
    return further


def heater_powers(texts: list[str] | None, duration: float = math.inf) -> dict[str, Any]:
    """Return the drives of heaters by name, in W, V or A: numbers, or functions of time in a run of ``duration`` s.

    A text without a name is that of the part "heater".
    """
    named = [text if "=" in text else f"heater={text}" for text in texts or []]
    drives = {}
    for name, text in assigned("--heater", named, "heater=5 mW").items():
        option = f"--heater {name}"
        unit, value = amount_of(option, text, *HEATER_INPUTS)
        check_drive(option, value, unit)
        drives[name] = HEATER_INPUTS[unit](varying(option, text, unit, duration))
    return drives


def steady_heaters(texts: list[str] | None) -> dict[str, Any]:
    """Return the constant drives of heaters by name, in W, V or A."""
    drives = heater_powers(texts)
    for name, drive in drives.items():
        if not isinstance(getattr(drive, "wave", drive), float):
            raise InputError(f"--heater {name} varies in time, and this command takes constant drives")
    return drives
