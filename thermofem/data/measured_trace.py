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
from ..arrays import Array, NDArray
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
SI_NAMES = {  # headers that may stand without a unit, which is then that of SI
    "time": ("t", "time", "Time", "TIME", "Zeit"),
    "temperature": ("T", "dT", "delta_T", "temperature", "Temperature", "rise"),
}
SI_UNITS = {"time": "s", "temperature": "K"}
KELVIN = ("K", "C", "degC", "deg C", "°C", "℃")  # behind the slash of a sensitivity
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
    digest = hashlib.sha256(content).hexdigest()
    with checks.prefixed(str(path)):
        table = number_table(content)
        del content
        said: list[str] = [f"{table.after} lines below the table are left out"] if table.after else []
        chosen = _columns(table, columns, time, temperature, power)
        given = _units(units, time, temperature)
        t = _times(table, chosen[0], given["time"], said)
        wave = watts = None
        if isinstance(power, str):
            watts = _scaled(chosen[2], given.get("power") or chosen[2].unit, "power", (POWER,))[1]
        else:
            wave = power if isinstance(power, Waveform) else Constant(float(power))
        if light:
            y = _light(chosen[1], given["temperature"], said)
        else:
            y = _temperatures(table, chosen[1], given["temperature"], sensitivity, wave, said)
        level = quantity.parse(baseline, "K", name="--baseline") if isinstance(baseline, str) else baseline
        first, within = _start(table, chosen, t, start, said)
        apart = heated is not None and read is not None and heated != read
        if apart and first is None and wave is not None:
            raise _no_search(table, chosen, str(heated), str(read))
        if watts is None:  # a power column jumps at a time that stands twice
            t, y = _distinct(t, y, said)
        if wave is None:
            if first is None:
                first = min(float(t[0]), 0.0)
            after = t >= first
            t = t[after]
            y = y[after]
            assert watts is not None
            wave = heating_start.sampled_power(t - first, watts[after])
        rows = heating_start.Rows(t, y, wave, unit_of(said), said)
        if light:
            times, rise, wave, about = light_start.light_of(rows, first, fall)
        else:
            times, rise, about = heating_start.rise_of(rows, first, level, fall, watts is not None)
        searched = "light" if light else "rise"
        about[dataset.START_FROM] = searched if first is None else "given"
        if within:
            about[dataset.START] = within
    sources = [f"{role}: {column.header or column.number}" for role, column in zip(ROLES, chosen, strict=False)]
    attributes: dict[str, Any] = {"source": path.name, "source_sha256": digest}
    attributes["source_columns"] = ", ".join(sources)
    attributes["assumed"] = "\n".join(said)
    if heated is not None:
        attributes["heated"] = heated
    attributes |= about
    part = read or temperature or "core"
    return dataset.build(times, rise, wave, read=(part,), attributes=attributes)


def check_text(path: Path) -> None:
    """Raise InputError for a file of arrays by its ending: it is no table of text."""
    if program := ARRAYS.get(path.suffix.lower()):
        raise checks.InputError(
            f"{path} holds arrays of {program}, no table of text",
            "write two of them as columns: np.savetxt('trace.csv', np.column_stack([t, T]), delimiter=',', "
            "header='time (s),T (K)', comments='')",
        )


def _start(
    table: NumberTable, chosen: Sequence[Column], t: Array, start: str | float | None, said: list[str]
) -> tuple[float | None, float]:
    """Start of heating in s, None where it is to be found, and how far it may be off: from a quantity or a column."""
    if not isinstance(start, str):
        return start, 0.0
    if all(start not in (column.header, column.name) for column in table.columns):
        return quantity.parse(start, "s", name="--start"), 0.0
    column = _named(table, "start", start)
    levels = _levels(column)
    if levels is None:
        rule = "has not two levels, as a drive that is switched has"
        raise checks.InputError(f"--start = {checks.shown(start)}: {column.label} {rule}", "give --start in s")
    edge = int(np.argmax(np.diff(levels)))
    middle = float(t[edge] + t[edge + 1]) / 2
    said.append(f"the heating begins at {quantity.rounded(middle, 's', 4)}, the first edge of {column.label}")
    return middle, float(t[edge + 1] - t[edge])


def _levels(column: Column) -> NDArray[np.bool_] | None:
    """Whether each row of a column is at the upper of its two levels; None for a column that has not two."""
    swing = float(np.ptp(column.values))
    if not np.isfinite(swing) or swing == 0:
        return None
    share = (column.values - column.values.min()) / swing
    between = (share > LEVEL) & (share < 1 - LEVEL)
    return None if between.mean() > EDGES else share > 0.5


def _no_search(table: NumberTable, chosen: Sequence[Column], heated: str, read: str) -> checks.InputError:
    """Error of a trace of another part than the one that is heated, without a start; it offers columns of the drive."""
    drives = [column.header for column in table.columns if column not in chosen and _levels(column) is not None]
    offers = "".join(f" or --start {name!r}, the column of the drive" for name in drives if name)
    return checks.InputError(
        f"{heated} is heated and {read} is read: its rise begins late, by diffusion, so the start is not searched",
        f'give --start, such as --start "0 s"{offers}',
    )


def _columns(
    table: NumberTable, columns: Any, time: str | None, temperature: str | None, power: Any
) -> tuple[Column, ...]:
    """Columns of time and temperature and, where ``power`` is the name of one, of power."""
    drive = (_named(table, "power", power),) if isinstance(power, str) else ()
    if columns is not None:
        return (*_numbered(table, columns), *drive)
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
    likely = []
    for column in columns:
        measures = column.header in SI_NAMES[role] if column.scale is None else column.scale.dimensions in dimensions
        if measures:
            likely.append(column)
    return likely[0] if len(likely) == 1 else None


def _numbered(table: NumberTable, columns: Any) -> list[Column]:
    """The two columns of these numbers, "4,5" or (4, 5)."""
    texts = columns.split(",") if isinstance(columns, str) else columns
    numbers = [str(text).strip() for text in texts]
    by_number = {str(column.number): column for column in table.columns}
    pair = [by_number[number] for number in numbers if number in by_number]
    if not len(numbers) == len(pair) == 2:
        rule = f"must be two of the columns of numbers: {table.listed}"
        raise checks.InputError(f"--columns = {checks.shown(columns)} {rule}")
    return pair


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
    """Unit of a column: that of its header, the only one that a line above states, or SI where the name says enough.

    Raises InputError: a name that does not say it, or lines above the table that may name another unit.
    """
    if column.unit:
        return column.unit
    above = table.units_above((TIME,) if role == "time" else READINGS)
    stated = [unit for unit, line in above.items() if "unit" in line.lower()]
    if len(stated) == 1:
        said.append(f"{column.label} is in {stated[0]}, as {above[stated[0]][:40]!r} above the table says")
        return stated[0]
    lines = "".join(f", and {line[:40]!r} stands above the table" for line in list(above.values())[:1])
    if lines or column.header not in SI_NAMES[role]:
        raise checks.InputError(f"{column.label} states no unit{lines}", ASK_UNITS)
    if role == "time":
        span = f"the span of {column.label}, which states no unit,"
        checks.between(span, np.ptp(column.values), 0, LONGEST_TIME, hint=ASK_UNITS)
    said.append(f"{column.label} states no unit: {SI_UNITS[role]}")
    return SI_UNITS[role]


def _scaled(column: Column, unit: str, role: str, dimensions: tuple[str, ...]) -> tuple[str, Array]:
    """What a column in a unit measures, and its values in SI.

    Raises InputError: a unit of other dimensions, a number that is empty or not finite.
    """
    scale = scale_of(unit)
    if scale is None or scale.dimensions not in dimensions:
        hint = 'give --units "us,mV" or --columns' + (f', or --sensitivity "... {unit}/K"' if role != "time" else "")
        raise checks.InputError(f"{column.label} is in {checks.shown(unit)}, no unit of its {role}", hint)
    # beyond 1e30 is the code of an overload
    checks.numbers(column.label, column.values, most=1e30, hint="take such rows out")
    return scale.dimensions, column.in_si(unit)


def _times(table: NumberTable, column: Column, given: str, said: list[str]) -> Array:
    """Times in s, checked not to decrease."""
    unit = given or _unit(table, column, "time", said)
    _, t = _scaled(column, unit, "time", (TIME,))
    return checks.array(f"{column.label} in s", t, increasing=True, hint="one record in each file")


def _light(column: Column, given: str, said: list[str]) -> Array:
    """Light in W, V, or the unit that the table counts in."""
    unit = given or column.unit
    if not unit:
        said.append(f"{column.label} states no unit: light in an arbitrary one")
    scale = scale_of(unit or "W")
    if scale is None or scale.dimensions in (TIME, TEMPERATURE, IMPEDANCE):
        raise checks.InputError(f"{column.label} is in {checks.shown(unit)}, no unit of light", ASK_UNITS)
    return checks.numbers(column.label, scale.in_si(column.values), most=1e30, hint="take such rows out")


def _temperatures(
    table: NumberTable, column: Column, given: str, sensitivity: str | float | None, wave: Waveform | None,
    said: list[str],
) -> Array:  # fmt: skip
    """Temperatures in K, or readings divided by the sensitivity."""
    unit = given or _unit(table, column, "temperature", said)
    kelvin = 1.0
    if sensitivity is not None:
        size, measured = _sensitivity(sensitivity)
        kelvin = 1 / size
        said.append(f"{column.label} is in {unit}: divided by {sensitivity}")
        _, y = _scaled(column, unit, f"reading, whose sensitivity is {sensitivity}", (measured,))
    else:
        measured, y = _scaled(column, unit, "temperature", READINGS)
        if measured == IMPEDANCE and not isinstance(wave, Constant):
            raise checks.InputError(
                f"{column.label} is in {unit}, an impedance under a step", "give a constant --power"
            )
        if measured == IMPEDANCE and isinstance(wave, Constant):
            said.append(f"{column.label} is in {unit}: multiplied by the power")
            kelvin = wave.power
        elif measured == VOLTAGE:
            said.append(
                f"warning: {column.label} is in {unit}: {VOLTS}, so R and R_th are in V/W and time constants are as "
                'measured, --sensitivity "10 mV/K" makes kelvin of it'
            )
    # 1e5: beyond is the code of an overloaded instrument, such as 9.9E+37
    return checks.numbers(f"{column.label} in K", kelvin * y, most=1e5, hint="an overload, or another unit?")


def _sensitivity(given: str | float) -> tuple[float, str]:
    """A sensitivity in SI units of the reading per kelvin, and the dimensions of the reading."""
    if not isinstance(given, str):
        return checks.finite("sensitivity", given, unit="V/K"), VOLTAGE
    reading, _, kelvin = given.strip().rpartition("/")
    scale = scale_of(reading.lstrip("+-"))
    if scale is None or scale.offset or scale.decibels or scale.factor == 0 or kelvin.strip() not in KELVIN:
        raise checks.InputError(
            f"--sensitivity = {given!r} must be a reading per kelvin", 'such as "10 mV/K" or "75 pm/K"'
        )
    sign = -1.0 if reading.startswith("-") else 1.0
    return sign * scale.factor, scale.dimensions


def _distinct(t: Array, y: Array, said: list[str]) -> tuple[Array, Array]:
    """Rows without repeated times: of two rows at one time the second is left out.

    InputError where there are many such rows, or where their temperatures differ.
    """
    steps = np.diff(t)
    same = np.flatnonzero(steps == 0)
    if not same.size:
        return t, y
    jumps = np.abs(np.diff(y)[same])
    apart = np.any(jumps > 0.05 * np.ptp(y))
    thrice = np.any(np.diff(same) == 1)
    if apart or thrice or same.size > max(2, REPEATED * t.size):
        raise checks.InputError(
            f"{same.size} times stand more than once, the first is {t[same[0]]:g} s: they are rounded, or two records "
            "in one file; write them with more digits"
        )
    said.append(f"{same.size} rows that repeat a time are left out")
    first = np.append(True, steps > 0)
    return t[first], y[first]
