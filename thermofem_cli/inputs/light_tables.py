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
from thermofem.data.column_units import LENGTH, POWER, RATIO, TIME, scale_of
from thermofem.data.measured_trace import LONGEST_TIME
from thermofem.data.number_table import Column
from thermofem.errors import InputError

from ..console import note
from ..options import listed
from .drive_texts import assigned

DECIBELS = re.compile(r"(?<![a-z])dbm?(?![a-z])", re.IGNORECASE)
RELATIVE = "fraction"  # arbitrary unit of powers that were in dB
PORTS = ("drop", "through")
WIDE = 30.0  # factor by which a rate may differ from its start


def watts_of(name: str, values: Array, unit: str) -> tuple[Array, str]:
    """Return powers in W and "W"; those in dB as fractions, and others unchanged, with the arbitrary unit.

    Raises InputError: no decibels, and numbers that are negative on average, as powers in decibels are.
    """
    scale = scale_of(unit)
    if not (scale and scale.decibels) and np.mean(values) <= 0:
        raise InputError(
            f"{name} is negative on average, {np.mean(values):.3g}: no power of light", 'give --units "us,dBm"'
        )
    if scale is None or scale.dimensions not in (POWER, RATIO):
        return values, unit or "arbitrary"
    return scale.in_si(values), "W" if scale.dimensions == POWER else RELATIVE


def held_of(ring: RingResonator, held: list[str] | None) -> dict[str, float]:
    """Return standard deviations in SI of --held 'NAME=DEVIATION', a share in per cent of the number that is held."""
    numbers = {name: number_of(ring, name) for name in fitted_names(ring)} | {"power": 1.0}
    deviations = {}
    for name, text in assigned("--held", held or [], "fca_cross_section=5 %").items():
        checks.choice("--held", name, numbers)
        if not text.endswith("%"):
            raise InputError(f"--held {name} = {text!r} must be a share of the number", "such as '5 %'")
        share = quantity.positive(text.removesuffix("%").strip(), "", name=f"--held {name}") / 100
        deviations[name] = share * numbers[name]
    return deviations


def drop_table(path: Path, columns: str, units: str | None) -> xr.Dataset:
    """Return the drop power over time (s) in a table, in W, or in the arbitrary unit that the table states."""
    time, signal, time_unit, light_unit = _two_columns(path, columns, units, "us,mV")
    span = float(time.values[-1] - time.values[0])
    if not time_unit and span > LONGEST_TIME:
        raise InputError(f"the times of {path} state no unit and span {span:g}", 'give --units "us,mV"')
    t = _si_values(path, time, time_unit or "s", TIME, "us,mV")
    drop, unit = watts_of(f"{path}: {signal.label}", signal.values, light_unit)
    if unit != "W":
        note(f"the drop of {path} is in an arbitrary unit ({unit}): its scale is free")
    return xr.Dataset({"drop": ("time", drop, {"units": unit})}, {"time": t})


def sweep_table(path: Path, columns: str, units: str | None, port: str | None) -> xr.Dataset:
    """Return a table as a Dataset over step: wavelength (m), and the power at a port in the unit of the table."""
    laser, light, laser_unit, light_unit = _two_columns(path, columns, units, "nm,dBm")
    if not laser_unit:
        raise InputError(f"{path}: {laser.label} states no unit", 'give --units "nm,dBm"')
    wavelength = _si_values(path, laser, laser_unit, LENGTH, "nm,dBm")
    name = port or next((name for name in PORTS if name in light.name.lower()), None)
    if name not in PORTS:
        what = f"--port = {port!r}" if port else f"the port of {path}, {light.label}"
        raise InputError(f"{what} is neither drop nor through", "give --port through")
    attributes = {"units": light_unit} if light_unit else {}
    return xr.Dataset({name: ("step", light.values, attributes), "wavelength": ("step", wavelength, {"units": "m"})})


def _two_columns(path: Path, columns: str, units: str | None, example: str) -> tuple[Column, Column, str, str]:
    """Two columns of a table, and the unit of each: that of ``units``, else that of its header.

    Of light, decibels in the name of the column count, too.
    """
    from thermofem.data.number_table import number_table

    first, second = number_table(path.read_bytes()).pair(columns)
    stated = listed(units) or ["", ""]
    if len(stated) != 2:
        raise InputError(f"--units = {units!r} must be two units", f'such as "{example}"')
    named = DECIBELS.search(second.name)  # "through_dBm" has no unit in brackets, and is no linear scale
    light_unit = second.unit or (named[0] if named else "")
    return first, second, stated[0] or first.unit, stated[1] or light_unit


def _si_values(path: Path, column: Column, unit: str, dimensions: str, example: str) -> Array:
    """Values of a column in SI; InputError for a unit that is unknown or measures something else."""
    scale = scale_of(unit)
    if scale is None or scale.dimensions != dimensions:
        raise InputError(f"{path}: {column.label} is in {unit!r}, no unit of {dimensions}", f'give --units "{example}"')
    return scale.in_si(column.values)


def rate_bounds(ring: coupled.RingResonator, free: str) -> dict[str, tuple[float, float]]:
    """Return wide bounds of free rates: the split of the linewidth into bus and losses is not known before."""
    rates = {name: number_of(ring, name) for name in listed(free) if name.endswith("_rate")}
    return {name: (rate / WIDE, rate * WIDE) for name, rate in rates.items()}
