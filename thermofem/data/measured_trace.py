"""Measured traces: a table of time and temperature under a known power, as a Dataset of `thermofem.dataset`.

    t = time - start,    delta_T = temperature - baseline,    of a fall after a long heating  baseline - temperature

What the table does not say is found from the rows and listed in ``attrs["assumed"]``, or asked for in one line.
"""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from .. import checks
from ..arrays import Array
from ..waveforms import Constant, Waveform
from . import dataset, files, heating_start, light_start, quantity
from .column_units import IMPEDANCE, POWER, TEMPERATURE, TIME, VOLTAGE, scale_of
from .number_table import Column, NumberTable, name_and_unit, number_table
from .variables import VOLTS, unit_of

LONGEST_TIME = 1.0  # s; a column of time without unit that is longer may be in another unit
LEVEL, EDGES = 0.1, 0.02  # of the swing of a drive around each level; share of the rows that may lie between both
REPEATED = 0.02  # share of the rows whose time may repeat the one before, as simulators write it at an edge
READINGS: tuple[str, ...] = (TEMPERATURE, VOLTAGE, IMPEDANCE)
ROLES = ("time", "temperature", "power")
SI_NAMES = {  # headers that may stand without a unit where nothing stands above them; it is then that of SI
    "time": ("s", ("t", "time", "Time", "TIME", "Zeit")),
    "temperature": ("K", ("T", "dT", "delta_T", "temperature", "Temperature", "rise")),
}
ARRAYS = {".npz": "NumPy", ".npy": "NumPy", ".mat": "MATLAB", ".h5": "HDF5", ".hdf5": "HDF5"}  # endings, of what
ASK_UNITS = 'give the units of time and temperature, such as --units "us,mV"'


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
    with checks.prefixed(str(path)):
        table = number_table(content)
        said = [f"{table.after} lines below the table are left out"] if table.after else []
        chosen = _columns(table, columns, time, temperature, power)
        stated = _units(units, time, temperature)
        t = _times(table, chosen[0], stated["time"], said)
        wave = watts = None
        if isinstance(power, str):
            watts = _in_si(chosen[2], stated.get("power") or chosen[2].unit, "power", (POWER,))
        else:
            wave = power if isinstance(power, Waveform) else Constant(float(power))
        if light:
            y, light_unit = _light(chosen[1], stated["temperature"], said)
        else:
            y = _temperatures(table, chosen[1], stated["temperature"], sensitivity, wave, said)
        level = quantity.parse(baseline, "K", name="--baseline") if isinstance(baseline, str) else baseline
        first, within = _start(table, t, start, said)
        drives = _drives(table, chosen)
        if first is None and wave is not None and None not in (heated, read) and heated != read:
            raise checks.InputError(
                f"{heated} is heated and {read} is read: its rise begins late, by diffusion, so the start is not "
                "searched",
                f'give --start, such as --start "0 s"{"".join(f" or --start {name!r}" for name in drives)}',
            )
        if watts is None:  # a power column jumps at a time that stands twice
            t, y = _distinct(t, y, said)
        else:
            first = min(float(t[0]), 0.0) if first is None else first
            after = t >= first
            t = t[after]
            y = y[after]
            wave = heating_start.sampled_power(t - first, watts[after])
        assert wave is not None
        rows = heating_start.Rows(t, y, wave, unit_of(said), said)
        if light:
            times, rise, wave, about = light_start.light_of(rows, first, fall)
        else:
            times, rise, about = heating_start.rise_of(rows, first, level, fall, watts is not None)
        searched = "light" if light else "rise"
        about[dataset.START_FROM] = searched if first is None else "given"
        if first is None:
            said += [
                f"{name!r} has two levels, as a drive has: --start {name!r} takes its first edge" for name in drives
            ]
        if within:
            about[dataset.START] = within
    sources = [f"{role}: {column.header or column.number}" for role, column in zip(ROLES, chosen, strict=False)]
    attributes: dict[str, Any] = {"source": path.name, "source_sha256": hashlib.sha256(content).hexdigest()}
    attributes["source_columns"] = ", ".join(sources)
    attributes["assumed"] = "\n".join(said)
    if heated is not None:
        attributes["heated"] = heated
    if light:
        attributes[dataset.LIGHT_UNIT] = light_unit
    part = read or temperature or "core"
    return dataset.build(times, rise, wave, read=(part,), attributes=attributes | about)


def check_text(path: Path) -> None:
    """Raise InputError for a file of arrays by its ending: it is no table of text."""
    if program := ARRAYS.get(path.suffix.lower()):
        hint = "np.savetxt('trace.csv', np.column_stack([t, T]), delimiter=',', header='time (s),T (K)', comments='')"
        raise checks.InputError(f"{path} holds arrays of {program}, no table of text", f"write two of them: {hint}")


def _start(table: NumberTable, t: Array, start: str | float | None, said: list[str]) -> tuple[float | None, float]:
    """Start of heating in s, None where it is to be found, and how far it may be off: from a quantity or a column."""
    if not isinstance(start, str):
        return start, 0.0
    if all(start not in (column.header, column.name) for column in table.columns):
        try:
            return quantity.parse(start, "s", name="--start"), 0.0
        except checks.InputError as error:
            raise checks.InputError(str(error), f"or the header of a drive, of {table.listed}") from None
    column = _named(table, "start", start)
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
    low = column.values.min()
    swing = np.ptp(column.values)
    between = (column.values > low + LEVEL * swing) & (column.values < low + (1 - LEVEL) * swing)
    return bool(0 < swing < np.inf and between.mean() <= EDGES)


def _drives(table: NumberTable, chosen: Sequence[Column]) -> list[str]:
    """Headers of the columns of two levels beside the chosen ones."""
    others = [column for column in table.columns if column.header and column not in chosen]
    return [column.header for column in others if _has_two_levels(column)]


def _columns(
    table: NumberTable, columns: Any, time: str | None, temperature: str | None, power: Any
) -> tuple[Column, ...]:
    """Columns of time and temperature and, where ``power`` is the name of one, of power."""
    drive = (_named(table, "power", power),) if isinstance(power, str) else ()
    if columns is not None:
        return (*table.pair(columns), *drive)
    first = None if time is None else _named(table, "time", time)
    second = None if temperature is None else _named(table, "temperature", temperature)
    free = [column for column in table.columns if column not in (first, second, *drive)]
    if first is None:
        first = _only(free, "time", (TIME,)) or (free[0] if 0 < len(free) <= 2 else None)
    free = [column for column in free if column is not first]
    if second is None:
        second = _only(free, "temperature", (TEMPERATURE, IMPEDANCE)) or (free[0] if len(free) == 1 else None)
    if first is None or second is None or first is second:
        example = ",".join(str(column.number) for column in table.columns[:2])
        raise checks.InputError(
            f"{len(table.columns)} columns of numbers ({table.listed}); say which are time and temperature: --columns "
            f"{example}, or --time and --temperature"
        )
    return first, second, *drive


def _only(columns: Sequence[Column], role: str, dimensions: tuple[str, ...]) -> Column | None:
    """The one column whose unit, or without one whose name, says that it is a time or a temperature; else None."""
    names = SI_NAMES[role][1]
    likely = []
    for column in columns:
        measures = column.scale.dimensions in dimensions if column.scale else column.header in names
        if measures:
            likely.append(column)
    return likely[0] if len(likely) == 1 else None


def _named(table: NumberTable, role: str, name: str) -> Column:
    """The column with this header, with or without its unit."""
    short = name_and_unit(name)[0]
    same = [column for column in table.columns if column.header == name]
    same = same or [column for column in table.columns if column.name == short]
    if len(same) != 1:
        numbers = ",".join(str(column.number) for column in same)
        rule = f"names the columns {numbers}" if same else "is none of the columns"
        raise checks.InputError(
            f"--{role} = {checks.shown(name)} {rule}", f"say which by number, --columns, of {table.listed}"
        )
    return same[0]


def _units(units: str | Mapping[str, str] | None, time: str | None, temperature: str | None) -> dict[str, str]:
    """Units by role ("time", "temperature") from either form of ``units``, else from behind the names of columns."""
    given = dict(zip(ROLES, units.split(","), strict=False)) if isinstance(units, str) else dict(units or {})
    for role in given:
        checks.choice("units", role, ROLES)
    for role, name in (("time", time), ("temperature", temperature)):
        given[role] = given.get(role) or name_and_unit(name or "")[1]
    return given


def _unit(table: NumberTable, column: Column, role: str, said: list[str]) -> str:
    """Unit of a column: that of its header, the one that a line above states, or SI where the name says enough.

    Raises InputError: a name that does not say it, or lines above the table that may name another unit.
    """
    if column.unit:
        return column.unit
    if stated := table.stated_unit((TIME,) if role == "time" else READINGS):
        said.append(f"{column.label} is in {stated}, as a line above the table says")
        return stated
    unit, names = SI_NAMES[role]
    if table.above or column.header not in names:
        lines = f", and {table.above[0][:40]!r} stands above the table" if table.above else ""
        raise checks.InputError(f"{column.label} states no unit{lines}", ASK_UNITS)
    if role == "time":
        span = f"the span of {column.label}, which states no unit,"
        checks.between(span, np.ptp(column.values), 0, LONGEST_TIME, hint=ASK_UNITS)
    said.append(f"{column.label} states no unit: {unit}")
    return unit


def _in_si(column: Column, unit: str, role: str, dimensions: tuple[str, ...]) -> Array:
    """Values of a column in SI by its unit; InputError for other dimensions, and numbers that are not finite."""
    scale = scale_of(unit)
    if scale is None or scale.dimensions not in dimensions:
        hint = 'give --units "us,mV" or --columns' + (f', or --sensitivity "... {unit}/K"' if role != "time" else "")
        raise checks.InputError(f"{column.label} is in {checks.shown(unit)}, no unit of its {role}", hint)
    # beyond 1e30 is the code of an overload; as the file writes it: 1e30 dBm overflows in W
    checks.numbers(column.label, column.values, most=1e30, hint="take such rows out")
    return scale.in_si(column.values)


def _times(table: NumberTable, column: Column, given: str, said: list[str]) -> Array:
    """Times in s, checked not to decrease."""
    t = _in_si(column, given or _unit(table, column, "time", said), "time", (TIME,))
    return checks.array(f"{column.label} in s", t, increasing=True, hint="one record in each file")


def _light(column: Column, given: str, said: list[str]) -> tuple[Array, str]:
    """Light in W, V, or the unit that the table counts in, and that unit: "W", "V", or "" of an arbitrary one."""
    unit = given or column.unit
    if not unit:
        said.append(f"{column.label} states no unit: light in an arbitrary one")
    scale = scale_of(unit or "W")
    if scale is None or scale.dimensions in (TIME, TEMPERATURE, IMPEDANCE):
        raise checks.InputError(f"{column.label} is in {checks.shown(unit)}, no unit of light", ASK_UNITS)
    light = checks.numbers(column.label, scale.in_si(column.values), most=1e30, hint="take such rows out")
    return light, {POWER: "W", VOLTAGE: "V"}.get(scale.dimensions, "") if unit else ""


def _temperatures(
    table: NumberTable, column: Column, given: str, sensitivity: str | float | None, wave: Waveform | None,
    said: list[str],
) -> Array:  # fmt: skip
    """Temperatures in K, or readings divided by the sensitivity."""
    unit = given or _unit(table, column, "temperature", said)
    if sensitivity is not None:
        size, measured = _sensitivity(sensitivity)
        said.append(f"{column.label} is in {unit}: divided by {sensitivity}")
        y = _in_si(column, unit, f"reading, whose sensitivity is {sensitivity}", (measured,)) / size
    else:
        y = _in_si(column, unit, "temperature", READINGS)
        scale = scale_of(unit)
        measured = scale.dimensions if scale else ""
    if sensitivity is None and measured == IMPEDANCE:
        if not isinstance(wave, Constant):
            rule = "an impedance under a step"
            raise checks.InputError(f"{column.label} is in {unit}, {rule}", "give a constant --power")
        said.append(f"{column.label} is in {unit}: multiplied by the power")
        y = y * wave.power
    elif sensitivity is None and measured == VOLTAGE:
        said.append(
            f"warning: {column.label} is in {unit}: {VOLTS}, so R and R_th are in V/W and time constants are as "
            'measured, --sensitivity "10 mV/K" makes kelvin of it'
        )
    # 1e5: beyond is the code of an overloaded instrument, such as 9.9E+37
    return checks.numbers(f"{column.label} in K", y, most=1e5, hint="an overload, or another unit?")


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


def _distinct(t: Array, y: Array, said: list[str]) -> tuple[Array, Array]:
    """Rows without repeated times: of two rows at one time the second is left out.

    InputError where there are many such rows, three at one time, or where their temperatures differ.
    """
    steps = np.diff(t)
    same = np.flatnonzero(steps == 0)
    apart = np.abs(np.diff(y)[same]) > 0.05 * np.ptp(y)
    thrice = np.diff(same) == 1
    if apart.any() or thrice.any() or same.size > max(2, REPEATED * t.size):
        raise checks.InputError(
            f"{same.size} times stand more than once, the first is {t[same[0]]:g} s: they are rounded, or two records "
            "in one file; write them with more digits"
        )
    if same.size:
        said.append(f"{same.size} rows that repeat a time are left out")
    first = np.append(True, steps > 0)
    return t[first], y[first]
