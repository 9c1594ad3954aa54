"""Measured light on the command line: columns of tables in W, dBm, dB or arbitrary units, and deviations of numbers."""

import re
from pathlib import Path

import numpy as np
import xarray as xr

import coupled
from coupled import RingResonator
from coupled.unknowns import fitted_names, number_of
from thermofem import checks
from thermofem.arrays import Array
from thermofem.data import quantity
from thermofem.data.number_table import Column, NumberTable
from thermofem.errors import InputError

from ..console import note
from .drive_texts import assigned

DECIBELS = re.compile(r"(?<![A-Za-z])(dBm|dB)(?![A-Za-z])", re.IGNORECASE)
SPELLED = {"dbm": "dBm", "db": "dB"}
RELATIVE = "fraction"  # arbitrary unit of powers that were in dB


def picked(table: NumberTable, columns: str) -> tuple[Column, Column]:
    """Return two columns of a table by their numbers, counted from 1: "1,2"; InputError for others."""
    by_number = {str(column.number): column for column in table.columns}
    try:
        first_number, second_number = columns.split(",")
        first = by_number[first_number.strip()]
        second = by_number[second_number.strip()]
    except (KeyError, ValueError):
        raise InputError(f"--columns = {columns!r} must be two of the columns {', '.join(by_number)}") from None
    return first, second


def light_unit(column: Column) -> str:
    """Return the unit of a column of powers, decibels included, from its unit or its name; "" where it states none."""
    found = DECIBELS.search(column.unit) or DECIBELS.search(column.name)
    return SPELLED[found[1].lower()] if found else column.unit


def watts_of(name: str, values: Array, unit: str) -> tuple[Array, str]:
    """Return powers in W and "W"; those in dB as fractions, and others unchanged, with the arbitrary unit.

    Raises InputError: no unit, and numbers that are negative on average, as powers in decibels are.
    """
    decibels = SPELLED.get(unit.lower())
    if decibels is not None:
        fraction = 10 ** (values / 10)
        return (1e-3 * fraction, "W") if decibels == "dBm" else (fraction, RELATIVE)
    if np.mean(values) <= 0:
        raise InputError(
            f"{name} is negative on average, {np.mean(values):.3g}: no power of light", 'give --units "us,dBm"'
        )
    unit = unit or "arbitrary"
    try:
        return values * quantity.parse(f"1 {unit}", "W", name="--units"), "W"
    except InputError:
        return values, unit


def held_of(ring: RingResonator, held: list[str] | None) -> dict[str, float]:
    """Return standard deviations in SI of --held 'NAME=DEVIATION', a share in per cent of the number that is held."""
    known = {name: number_of(ring, name) for name in fitted_names(ring)} | {"power": 1.0}
    found = {}
    for name, text in assigned("--held", held or [], "fca_cross_section=5 %").items():
        checks.choice("--held", name, known)
        if not text.endswith("%"):
            raise InputError(f"--held {name} = {text!r} must be a share of the number", "such as '5 %'")
        share = quantity.positive(text.removesuffix("%").strip(), "", name=f"--held {name}") / 100
        found[name] = share * known[name]
    return found


def drop_table(path: Path, columns: str, units: str | None) -> xr.Dataset:
    """Return the drop power over time (s) in a table, in W, or in the arbitrary unit that the table states."""
    from thermofem.data.number_table import number_table

    table = number_table(path.read_bytes())
    time, signal = picked(table, columns)
    stated = units.split(",") if units else ["", ""]
    if len(stated) != 2:
        raise InputError(f"--units = {units!r} must be two units", 'such as "us,mV"')
    t = time.values
    time_unit = stated[0].strip() or time.unit
    if not time_unit and t[-1] - t[0] > 1.0:  # hardly seconds
        raise InputError(f"the times of {path} state no unit and span {t[-1] - t[0]:g}", 'give --units "us,mV"')
    t = t * quantity.parse(f"1 {time_unit or 's'}", "s", name="--units")
    drop, unit = watts_of(f"{path}: {signal.label}", signal.values, stated[1].strip() or light_unit(signal))
    if unit != "W":
        note(f"the drop of {path} is in an arbitrary unit ({unit}): its scale is free")
    return xr.Dataset({"drop": ("time", drop, {"units": unit})}, {"time": t})


NAMED_UNITS = re.compile(r"(?<![A-Za-z])(nm|um|µm|pm|m)(?![A-Za-z])")
PORTS = ("drop", "through")
WIDE = 30.0  # factor by which a rate may differ from its start


def sweep_table(path: Path, columns: str, units: str | None, port: str | None) -> xr.Dataset:
    """Return a table as a Dataset over step: wavelength (m), and the power at a port in the unit of the table."""
    from thermofem.data.number_table import number_table

    table = number_table(path.read_bytes())
    laser, light = picked(table, columns)
    stated = [text.strip() for text in units.split(",")] if units else ["", ""]
    if len(stated) != 2:
        raise InputError(f"--units = {units!r} must be two units", 'such as "nm,dBm"')
    shown = NAMED_UNITS.search(laser.name)
    unit = stated[0] or laser.unit or (shown[1] if shown else "")
    if not unit:
        raise InputError(f"{path}: {laser.label} states no unit", 'give --units "nm,dBm"')
    factor = quantity.parse(f"1 {unit}", "m", name=f"{path}: the unit of {laser.label}")
    name = port or next((name for name in PORTS if name in light.name.lower()), None)
    if name not in PORTS:
        what = f"--port = {port!r}" if port else f"the port of {path}, {light.label}"
        raise InputError(f"{what} is neither drop nor through", "give --port through")
    attributes = {"units": stated[1] or light_unit(light)} if stated[1] or light_unit(light) else {}
    wavelength = laser.values * factor
    return xr.Dataset({name: ("step", light.values, attributes), "wavelength": ("step", wavelength, {"units": "m"})})


def rate_bounds(ring: coupled.RingResonator, free: str) -> dict[str, tuple[float, float]]:
    """Return wide bounds of free rates: the split of the linewidth into bus and losses is not known before."""
    rates = [name.strip() for name in free.split(",") if name.strip().endswith("_rate")]
    return {name: (number_of(ring, name) / WIDE, number_of(ring, name) * WIDE) for name in rates}
