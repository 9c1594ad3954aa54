"""Measured traces: a table of time and temperature under a known power, as a Dataset of `thermofem.dataset`.

    t = time - start,    delta_T = temperature - baseline,    of a fall after a long heating  baseline - temperature

What the table does not say is found from the rows and listed in ``attrs["assumed"]``, or asked for in one line.
"""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from .. import checks
from ..arrays import Array, Mask
from ..waveforms import Constant, Waveform
from . import dataset, files, quantity
from .column_units import IMPEDANCE, POWERS, RISES, TEMPERATURE, TIMES, VOLTAGE, Column, scale_of, with_stated_units
from .heating_start import Rows, light_of, rise_of, sampled_power
from .number_table import NumberTable, number_table
from .variables import VOLTS

LEVEL, EDGES = 0.1, 0.02  # of the swing of a drive around each level; share of the rows that may lie between both
REPEATED = 0.02  # share of the rows whose time may repeat the one before, as simulators write it at an edge
ARRAYS = {".npz": "NumPy", ".npy": "NumPy", ".mat": "MATLAB", ".h5": "HDF5", ".hdf5": "HDF5"}  # endings, of what
ROLES = (TIMES, RISES, POWERS)


def read_trace(
    path: str | Path,
    power: float | str | Waveform,
    *,
    columns: str | Sequence[int] | None = None,
    time: str | None = None,
    temperature: str | None = None,
    units: str | Mapping[str, str] | None = None,
    sensitivity: str | float | None = None,
    start: str | float | None = None,
    baseline: str | float | None = None,
    fall: bool = False,
    light: bool = False,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Read a table of time and temperature that was measured or simulated under a known power.

    Parameters
    ----------
    path : str or Path
        text with one row for each time, after any header; see `thermofem.data.number_table`.
    power : float, Waveform or str
        absorbed power in W from the start on, the waveform that was applied, or the header of a column.
    columns : str or sequence of int
        numbers of the columns of time and temperature, counted from 1: "4,5". Default: by name or unit.
    time, temperature : str
        headers of the columns, with or without the unit; where the header has no unit it may follow: "TIME (us)".
    units : str or dict
        of the two columns, "us,mV" or {"time": "us", "temperature": "mV"}; they go before those of the file. K/W is
        multiplied by the power; without ``sensitivity`` a column in V counts as K.
    sensitivity : str or float
        of the thermometer: "10 mV/K", "75 pm/K", "3 ohm/K"; a number is in V/K. Negative for a diode.
    start : str or float, s
        of the heating, or of the fall, on the file's clock; or the header of a column of the drive, which has two
        levels. Default: found from the rows, unless another part is read than heated: its rise begins late by itself.
    baseline : str or float, K
        temperature at rest, or before a fall, to subtract; default: the mean before the start, or fitted.
    fall : bool
        whether the rows are the fall after a heating: a long one, or a `Pulse` of known width.
    light : bool
        whether the second column is light behind an interferometer, for ``fit_foster(..., readout=MZI(...))``: in any
        unit, without a baseline, and its start is a range.
    heated, read : str
        names of the parts that are heated and read.

    Returns
    -------
    Dataset
        schema of `thermofem.dataset`; ``attrs``: "assumed" in words, "start" (s), "baseline" (K), source and hash.

    Raises
    ------
    InputError
        no table, columns or units that the file leaves open (the line says which option to give), times that do not
        increase, no rise.
    """
    path = checks.path("path", path)
    check_text(path)
    content = files.read_bytes(path, "table", most=400_000_000)
    names = {"time": time, "temperature": temperature, "power": power if isinstance(power, str) else None}
    with checks.prefixed(str(path)):
        table = number_table(content)
        said = [f"{table.after} lines below the table are left out"] if table.after else []
        chosen = with_stated_units(_columns(table, columns, names), units)
        t = _times(table, chosen["time"], said)
        first, within = _given_start(table, t, start, said)
        drives = [column.header for column in table.beside(chosen) if column.header and _has_two_levels(column)]
        if isinstance(power, str):
            first = min(float(t[0]), 0.0) if first is None else first
            wave: Waveform = sampled_power(t - first, chosen["power"].in_si(POWERS))
            used = t >= first
        else:
            wave = power if isinstance(power, Waveform) else Constant(float(power))
        if light:
            y, unit = chosen["temperature"].light_in_si()
            if unit == "arbitrary":
                said.append(f"{chosen['temperature'].label} states no unit: light in an arbitrary one")
        else:
            y, unit = _temperatures(table, chosen["temperature"], sensitivity, wave, said)
        if not isinstance(power, str):  # a column of power jumps at a time that stands twice
            used = _distinct(t, y, said)
        if first is None and None not in (heated, read) and heated != read:
            starts = "".join(f" or --start {name!r}" for name in drives)
            rule = f"{heated} is heated, {read} is read: its rise begins late, by diffusion, so no start is searched"
            raise checks.InputError(rule, f'give --start, such as --start "0 s"{starts}')
        rows = Rows(t[used], y[used], wave, unit, said, "fall" if fall else "heating")
        level = quantity.parse(baseline, "K", name="--baseline") if isinstance(baseline, str) else baseline
        times, rise, wave, about = light_of(rows, first) if light else rise_of(rows, first, level)
    about[dataset.START_FROM] = "given"
    if first is None:
        about[dataset.START_FROM] = "light" if light else "rise"
        said += [f"{name!r} has two levels, as a drive has: --start {name!r} takes its first edge" for name in drives]
    if within:
        about[dataset.START] = within
    if heated is not None:
        about["heated"] = heated
    if light:
        about[dataset.LIGHT_UNIT] = unit if unit in ("W", "V") else ""
    sources = [f"{role}: {column.header or column.number}" for role, column in chosen.items()]
    about |= {"source": path.name, "source_sha256": hashlib.sha256(content).hexdigest()}
    about |= {"source_columns": ", ".join(sources), "assumed": "\n".join(said)}
    part = read or temperature or "core"
    return dataset.build(times, rise, wave, read=(part,), attributes=about)


def check_text(path: Path) -> None:
    """Raise InputError for a file of arrays by its ending: it is no table of text."""
    if program := ARRAYS.get(path.suffix.lower()):
        hint = "np.savetxt('trace.csv', np.column_stack([t, T]), delimiter=',', header='time (s),T (K)', comments='')"
        raise checks.InputError(f"{path} holds arrays of {program}, no table of text", f"write two of them: {hint}")


def _columns(
    table: NumberTable, columns: str | Sequence[int] | None, names: Mapping[str, str | None]
) -> dict[str, Column]:
    """The column of each role: by number, by name, or the one that measures it."""
    chosen = {role: table.named(role, name) for role, name in names.items() if name is not None}
    if columns is not None:
        first, second = table.pair(columns)
        chosen |= {"time": first, "temperature": second}
    for role, few in ((TIMES, 2), (RISES, 1)):
        if role.name not in chosen:
            free = table.beside(chosen)
            likely = [column for column in free if column.measures(role)]
            if len(likely) != 1 and len(free) <= few:
                likely = free[:1]
            if len(likely) == 1:
                chosen[role.name] = likely[0]
    if {"time", "temperature"} - chosen.keys() or chosen["time"].number == chosen["temperature"].number:
        example = ",".join(str(column.number) for column in table.columns[:2])
        raise checks.InputError(
            f"{len(table.columns)} columns of numbers ({table.listed}); say which are time and temperature: --columns "
            f"{example}, or --time and --temperature"
        )
    return {role.name: chosen[role.name] for role in ROLES if role.name in chosen}


def _times(table: NumberTable, column: Column, said: list[str]) -> Array:
    """Times in s, checked not to decrease."""
    t = table.with_assumed_unit(column, TIMES, said).in_si(TIMES)
    return checks.array(f"{column.label} in s", t, increasing=True, hint="one record in each file")


def _given_start(
    table: NumberTable, t: Array, start: str | float | None, said: list[str]
) -> tuple[float | None, float]:
    """Start of heating in s, None where it is to be found, and how far it may be off: from a quantity or a column."""
    if not isinstance(start, str):
        return start, 0.0
    if all(start not in (column.header, column.name) for column in table.columns):
        try:
            return quantity.parse(start, "s", name="--start"), 0.0
        except checks.InputError as error:
            raise checks.InputError(str(error), f"or the header of a drive, of {table.listed}") from None
    column = table.named("start", start)
    if not _has_two_levels(column):
        rule = "has not two levels, as a drive that is switched has"
        raise checks.InputError(f"--start = {checks.shown(start)}: {column.label} {rule}", "give --start in s")
    above = column.values > column.values.min() + np.ptp(column.values) / 2
    edge = int(np.argmax(np.diff(above)))
    middle = float(t[edge] + t[edge + 1]) / 2
    said.append(f"the heating begins at {quantity.rounded(middle, 's', 4)}, the first edge of {column.label}")
    return middle, float(t[edge + 1] - t[edge])


def _has_two_levels(column: Column) -> bool:
    """Whether nearly all rows are at the lowest or the highest value, as those of a drive that is switched."""
    swing = np.ptp(column.values)
    level = column.values - column.values.min()
    between = (level > LEVEL * swing) & (level < (1 - LEVEL) * swing)
    return bool(0 < swing < np.inf and between.mean() <= EDGES)


def _temperatures(
    table: NumberTable, column: Column, sensitivity: str | float | None, wave: Waveform, said: list[str]
) -> tuple[Array, str]:
    """Temperatures in K, or readings divided by the sensitivity, and "K"; or "V" of volts that count as kelvin."""
    column = table.with_assumed_unit(column, RISES, said)
    read_as = f"{column.label} is in {column.unit}"
    unit = "K"
    if sensitivity is not None:
        size, measured = _sensitivity(sensitivity)
        reading = RISES._replace(name=f"reading, whose sensitivity is {sensitivity}", dimensions=(measured,))
        y = column.in_si(reading) / size
        said.append(f"{read_as}: divided by {sensitivity}")
    else:
        y = column.in_si(RISES)
        measured = column.scale.dimensions if column.scale else ""
        if measured == IMPEDANCE:
            if not isinstance(wave, Constant):
                raise checks.InputError(f"{read_as}, an impedance under a step", "give a constant --power")
            y = y * wave.power
            said.append(f"{read_as}: multiplied by the power")
        elif measured == VOLTAGE:
            unit = "V"
            said.append(
                f"warning: {read_as}: {VOLTS}, so R and R_th are in V/W and time constants are as measured, "
                '--sensitivity "10 mV/K" makes kelvin of it'
            )
    # 1e5: beyond is the code of an overloaded instrument, such as 9.9E+37
    return checks.numbers(f"{column.label} in K", y, most=1e5, hint="an overload, or another unit?"), unit


def _sensitivity(given: str | float) -> tuple[float, str]:
    """A sensitivity in SI units of the reading per kelvin, and the dimensions of the reading."""
    if not isinstance(given, str):
        return checks.finite("sensitivity", given, unit="V/K"), VOLTAGE
    reading, _, kelvin = given.strip().rpartition("/")
    scale = scale_of(reading.lstrip("+-"))
    per = scale_of(kelvin)
    if not (scale and per and scale.factor and per.dimensions == TEMPERATURE) or scale.offset or scale.decibels:
        raise checks.InputError(
            f"--sensitivity = {given!r} must be a reading per kelvin", 'such as "10 mV/K" or "75 pm/K"'
        )
    sign = -1.0 if reading.startswith("-") else 1.0
    return sign * scale.factor / per.factor, scale.dimensions


def _distinct(t: Array, y: Array, said: list[str]) -> Mask:
    """Which rows do not repeat the time of the row before.

    InputError where there are many such rows, three at one time, or where their temperatures differ.
    """
    same, differ = dataset.repeats(t, y, 0.05)
    if differ.any() or same.size > max(2, REPEATED * t.size):
        raise checks.InputError(
            f"{same.size} times stand more than once, the first is {t[same[0]]:g} s: they are rounded, or two records "
            "in one file; write them with more digits"
        )
    if same.size:
        said.append(f"{same.size} rows that repeat a time are left out")
    return np.append(True, np.diff(t) > 0)
