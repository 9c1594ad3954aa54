"""Measured light on the command line: columns of tables in W, dBm, dB or arbitrary units, and deviations of numbers."""

from pathlib import Path

import numpy as np
import xarray as xr

import coupled
from coupled import RingResonator
from coupled.unknowns import fitted_names, number_of
from thermofem import checks
from thermofem.data import quantity
from thermofem.data.column_units import TIMES, WAVELENGTHS, Column, with_stated_units
from thermofem.data.number_table import NumberTable, number_table
from thermofem.errors import InputError

from ..console import note
from ..options import listed
from .drive_texts import assigned

PORTS = ("drop", "through")
WIDE = 30.0  # factor by which a rate may differ from its start


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
    """Return the drop power over time (s) in a table, in W, or in the arbitrary unit that the table states.

    Raises InputError: no decibels, and numbers that are negative on average, as powers in decibels are.
    """
    said: list[str] = []
    with checks.prefixed(str(path)):
        table, time, light = _columns(path, columns, units)
        t = table.with_assumed_unit(time, TIMES, said).in_si(TIMES)
        drop, unit = light.light_in_si()
        if np.mean(drop) <= 0:
            rule = f"{light.label} is negative on average, {np.mean(drop):.3g}: no power of light"
            raise InputError(rule, 'give --units "us,dBm"')
    if unit != "W":
        said.append(f"the drop of {path} is in an arbitrary unit ({unit}): its scale is free")
    for line in said:
        note(line)
    return xr.Dataset({"drop": ("time", drop, {"units": unit})}, {"time": t})


def sweep_table(path: Path, columns: str, units: str | None, port: str | None) -> xr.Dataset:
    """Return a table as a Dataset over step: wavelength (m), and the power at a port in the unit of the table."""
    with checks.prefixed(str(path)):
        _, laser, light = _columns(path, columns, units)
        wavelength = laser.in_si(WAVELENGTHS)
    name = port or next((name for name in PORTS if name in light.name.lower()), None)
    if name not in PORTS:
        what = f"--port = {port!r}" if port else f"the port of {path}, {light.label}"
        raise InputError(f"{what} is neither drop nor through", "give --port through")
    attributes = {"units": light.unit} if light.unit else {}
    return xr.Dataset({name: ("step", light.values, attributes), "wavelength": ("step", wavelength, {"units": "m"})})


def _columns(path: Path, columns: str, units: str | None) -> tuple[NumberTable, Column, Column]:
    """A table and two columns of it, in the units that are stated or else in those of their headers."""
    table = number_table(path.read_bytes())
    swept, light = table.pair(columns)
    both = with_stated_units({"swept": swept, "light": light}, units)
    return table, both["swept"], both["light"]


def rate_bounds(ring: coupled.RingResonator, free: str) -> dict[str, tuple[float, float]]:
    """Return wide bounds of free rates: the split of the linewidth into bus and losses is not known before."""
    rates = {name: number_of(ring, name) for name in listed(free) if name.endswith("_rate")}
    return {name: (rate / WIDE, rate * WIDE) for name, rate in rates.items()}
