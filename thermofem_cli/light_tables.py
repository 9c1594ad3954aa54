"""Tables of light: columns of a laser and of a port, powers in W, dBm, dB or arbitrary units."""

import re

import numpy as np

from thermofem.arrays import Array
from thermofem.data import quantity
from thermofem.data.number_table import Column, NumberTable
from thermofem.errors import InputError

DECIBELS = re.compile(r"(?<![A-Za-z])(dBm|dB)(?![A-Za-z])", re.IGNORECASE)
SPELLED = {"dbm": "dBm", "db": "dB"}
RELATIVE = "fraction"  # arbitrary unit of powers that were in dB


def picked(table: NumberTable, columns: str) -> tuple[Column, Column]:
    """Return two columns of a table by their numbers, counted from 1: "1,2"; InputError for others."""
    by_number = {str(column.number): column for column in table.columns}
    try:
        first, second = (by_number[text.strip()] for text in columns.split(","))
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
