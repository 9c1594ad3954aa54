"""Measured light on the command line: columns of tables in W, dBm, dB or arbitrary units, and deviations of numbers."""

import re

import numpy as np

from coupled import RingResonator
from coupled.unknowns import fitted_names, number_of
from thermofem import checks
from thermofem.arrays import Array
from thermofem.data import quantity
from thermofem.data.number_table import Column, NumberTable
from thermofem.errors import InputError

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
