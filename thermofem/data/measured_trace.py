"""Measured traces: a table of time and temperature under a known power, as a Dataset of `thermofem.dataset`.

    t = time - start,    delta_T = temperature - baseline,    of a fall after a long heating  baseline - temperature

What the table does not say is found from the rows and listed in ``attrs["assumed"]``, or asked for in one line.
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from .. import checks
from ..arrays import Array
from ..checks import InputError, prefixed
from ..waveforms import Constant, Waveform
from . import column_units as units_of
from . import dataset, files, heating_start, quantity
from .column_units import BRACKETS, scale_of
from .number_table import NumberTable, number_table

LARGEST = 400_000_000  # bytes of a table
LONGEST = 1.0  # s; a column of time without unit that is longer may be in another unit
HOTTEST = 1e5  # K; beyond any temperature: the code of an overloaded instrument, such as 9.9E+37
REPEATED = 0.02  # share of the rows whose time may repeat the one before, as simulators write it at an edge
ROLES = ("time", "temperature", "power")
_TIMES = re.compile(r"\W*(?:t|x|X|s|t[_ /].*|(?i:time.*|.*\btimes?|zeit|seconds?))\W*")
_COUNTS = re.compile(r"(?i)(?:index|idx|no\.?|nr\.?|n|#|point|sample|row|step|samples_averaged|averages?)\W*")


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
    fall: bool | None = None,
    edges: str | None = None,
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
        of the heating, or of the fall, on the file's clock; default: found from the rows.
    baseline : str or float, K
        temperature at rest, or before a fall, to subtract; default: the mean before the start, or fitted.
    fall : bool
        whether the rows are the fall after a heating: a long one, or a `Pulse` of known width. Default: if it falls.
    edges : "row" or "middle"
        where the power of a column jumps between two rows, see `thermofem.data.sampled_power`; default: it is a ramp.

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
    content = files.read_bytes(path, "table", most=LARGEST)
    digest = hashlib.sha256(content).hexdigest()
    with prefixed(str(path)):
        table = number_table(content)
        del content
        said: list[str] = [f"{table.after} lines below the table are left out"] if table.after else []
        places, given = _columns(table, columns, time, temperature, power), _units(units)
        t = _times(table, places[0], given.get("time") or _named_unit(table, time), said)
        unit = given.get("temperature") or _named_unit(table, temperature)
        wave = watts = None
        if isinstance(power, str):
            watts = _power(table, places[2], given.get("power"))
        else:
            wave = power if isinstance(power, Waveform) else Constant(float(power))
        y, reading = _temperatures(table, places[1], unit, sensitivity, wave, said)
        t, (y, *more) = _distinct(table, t, [y] if watts is None else [y, watts], said)
        level = None if baseline is None else _level(baseline, *reading)
        first = quantity.parse(start, "s", name="--start") if isinstance(start, str) else start
        if wave is None:
            first = min(float(t[0]), 0.0) if first is None else first
            y, watts, t = y[t >= first], more[0][t >= first], t[t >= first]
            wave = heating_start.sampled_power(t - first, watts, edges)
        rows = heating_start.Rows(t, y, wave, units_of.unit_of(said), said)
        sampled = watts is not None
        times, rise, found = heating_start.rise_of(rows, first, level, False if sampled else fall, sampled)
    about = {
        "source": path.name,
        "source_sha256": digest,
        "source_columns": ", ".join(
            f"{role}: {table.names[k] or table.columns[k]}" for role, k in zip(ROLES, places, strict=False)
        ),
        "assumed": "\n".join(said),
        **found,
    }
    return dataset.build(times, rise, wave, read=(temperature or "core",), attributes=about)


def _columns(
    table: NumberTable, columns: Any, time: str | None, temperature: str | None, power: Any
) -> tuple[int, ...]:
    """Places of time and temperature, and of a column of power."""
    listed = ", ".join(f"{c} {name!r}" for c, name in zip(table.columns, table.names, strict=True))
    third = (_place(table, "power", power, listed),) if isinstance(power, str) else ()
    if columns is not None:
        known = [str(c) for c in table.columns]
        wanted = [str(c).strip() for c in (columns.split(",") if isinstance(columns, str) else columns)]
        if len(wanted) != 2 or not set(wanted) <= set(known):
            raise InputError(f"--columns = {checks.shown(columns)} must be two of the columns of numbers: {listed}")
        return (*map(known.index, wanted), *third)
    measures = [scale.dimensions if (scale := scale_of(unit)) else "" for unit in table.units]
    first = None if time is None else _place(table, "time", time, listed)
    second = None if temperature is None else _place(table, "temperature", temperature, listed)
    if first is None:
        free = [k for k in range(len(measures)) if k not in (second, *third)]
        likely = [k for k in free if measures[k] == units_of.TIME]
        likely = likely or [k for k in free if not table.units[k] and _TIMES.fullmatch(table.names[k])]
        if not likely and (len(free) <= 2 or not table.names[0]):
            likely = free[:1]
        first = likely[0] if len(likely) == 1 else None
    if second is None and first is not None:
        free = [k for k, name in enumerate(table.names) if k not in (first, *third) and not _COUNTS.fullmatch(name)]
        hot = [k for k in free if measures[k] in (units_of.TEMPERATURE, units_of.IMPEDANCE)]
        second = hot[0] if len(hot) == 1 else free[0] if len(free) == 1 else None
    if first is None or second is None or first == second:
        raise InputError(
            f"{len(measures)} columns of numbers ({listed}); say which are time and temperature: --columns "
            f"{table.columns[0]},{table.columns[1]}, or --time and --temperature"
        )
    return first, second, *third


def _place(table: NumberTable, role: str, name: str, listed: str) -> int:
    """Place of a column by its header, with or without its unit."""
    short = [BRACKETS.split(known)[0].strip() for known in table.names]
    for known, wanted in ((list(table.names), name), (short, BRACKETS.split(name)[0].strip())):
        if known.count(wanted) > 1:
            same = ",".join(str(c) for c, n in zip(table.columns, known, strict=True) if n == wanted)
            raise InputError(f"--{role} = {name!r} names the columns {same}; say which by number: --columns")
        if wanted in known:
            return known.index(wanted)
    raise InputError(f"--{role} = {checks.shown(name)} is none of the columns: {listed}")


def _named_unit(table: NumberTable, name: str | None) -> str:
    """The unit that a caller wrote behind the name of a column: "TIME (us)", where the header has none."""
    found = BRACKETS.findall(name or "")
    return found[-1] if found and name not in table.names and scale_of(found[-1]) else ""


def _units(units: str | Mapping[str, str] | None) -> dict[str, str]:
    """Units by role; each must be one."""
    given = dict(zip(ROLES, units.split(","), strict=False)) if isinstance(units, str) else dict(units or {})
    for role, unit in given.items():
        checks.choice("units", role, ROLES)
        if unit and scale_of(unit) is None:
            raise InputError(f"--units: {checks.shown(unit)} is not a unit of a {role}", "such as --units us,mV")
    return given


def _unit(table: NumberTable, k: int, given: str, dimensions: tuple[str, ...], said: list[str]) -> str:
    """The unit of a column: the caller's, that of its header, or that which a line above the table states."""
    if given:
        return given
    label, unit, hint = table.label(k), table.units[k], 'give its unit, such as --units "us,mV"'
    units_of.check_name(f"column {label}", table.names[k], unit, hint)
    above = [(scale, *a) for a in units_of.units_above(table.above) if (scale := scale_of(a[0]))]
    above = [a for a in above if a[0].dimensions in dimensions]
    stated = [a for a in above if a[3]]
    one = len({a[0] for a in stated}) == 1
    own = scale_of(unit) if unit else None
    open_line = ""
    if own is not None:
        if one and stated[0][0] != own and stated[0][0].dimensions == own.dimensions:
            open_line = stated[0][2]
    elif one:
        said.append(f"column {label} is in {stated[0][1]}, as {stated[0][2][:40]!r} above the table says")
        return stated[0][1]
    else:
        plain = [scale_of(si) for si in "sKV"]
        open_line = next((a[2] for a in above if a[3] or a[0] not in plain), "")
    if open_line:
        states = f"is in {unit}, but" if own else "states no unit, and"
        raise InputError(f"column {label} {states} {open_line[:40]!r} stands above the table", hint)
    return unit


def _times(table: NumberTable, k: int, given: str, said: list[str]) -> Array:
    """Times in s."""
    values, label = _numbers(table, k), table.label(k)
    unit = _unit(table, k, given, (units_of.TIME,), said)
    if not unit:
        if np.ptp(values) > LONGEST:
            hint = 'give its unit, such as --units "us,K"'
            raise InputError(f"column {label} states no unit and spans {np.ptp(values):g}", hint)
        said.append(f"column {label} states no unit: seconds")
    scale = scale_of(unit or "s")
    if scale is None or scale.dimensions != units_of.TIME:
        raise InputError(f"column {label} is in {checks.shown(unit)}, which is no time", "give --units or --columns")
    return scale.factor * values


def _numbers(table: NumberTable, k: int) -> Array:
    """The numbers of a column; InputError where one is empty, not finite or the code of an overload."""
    values = table.values[:, k]
    bad = np.flatnonzero(~(np.abs(values) < 1e30))
    if bad.size:
        found = f"{bad.size} rows of column {table.label(k)} are empty, not finite or overloaded"
        raise InputError(f"{found}, the first is row {bad[0] + 1} after line {table.line - 1}", "take such rows out")
    return np.ascontiguousarray(values)


def _temperatures(
    table: NumberTable, k: int, given: str, sensitivity: str | float | None, wave: Waveform | None, said: list[str]
) -> tuple[Array, tuple[str, float]]:
    """Temperatures in K; the dimensions of the reading, and how many K are one of it in SI."""
    values, label = _numbers(table, k), table.label(k)
    unit = _unit(table, k, given, (units_of.TEMPERATURE, units_of.VOLTAGE, units_of.IMPEDANCE), said)
    if not unit:
        unit = "K" if sensitivity is None else "V"
        said.append(f"column {label} states no unit: {'kelvin' if sensitivity is None else 'volts'}")
    scale = scale_of(unit)
    if scale is None:
        raise InputError(f"column {label} is in {checks.shown(unit)}, which is not known", 'give --units "us,mV"')
    kelvin = 1.0
    if sensitivity is not None:
        size, dimensions = _sensitivity(sensitivity)
        if dimensions != scale.dimensions:
            wrong = f"column {label} is in {unit}, and the sensitivity {sensitivity!r} is of another"
            raise InputError(wrong, 'give --units "us,pm"')
        said.append(f"column {label} is in {unit}: divided by {sensitivity}")
        kelvin = 1 / size
    elif scale.dimensions == units_of.IMPEDANCE:
        if not isinstance(wave, Constant):
            raise InputError(f"column {label} is in {unit}, an impedance under a step", "give a constant --power")
        said.append(f"column {label} is in {unit}: multiplied by the power")
        kelvin = wave.power
    elif scale.dimensions == units_of.VOLTAGE:
        said.append(
            f"warning: column {label} is in {unit}: {units_of.VOLTS}, so R and R_th are in V/W and time constants are "
            'as measured, --sensitivity "10 mV/K" makes kelvin of it'
        )
    elif scale.dimensions != units_of.TEMPERATURE:
        raise InputError(f"column {label} is in {unit}, no temperature", f'give --sensitivity "... {unit}/K"')
    y = scale.offset + scale.factor * kelvin * values
    if (hot := np.flatnonzero(~(np.abs(y) <= HOTTEST))).size:
        raise InputError(f"{hot.size} rows of column {label} are beyond {HOTTEST:g} K: an overload, or another unit?")
    return y, (scale.dimensions, kelvin)


def _sensitivity(given: str | float) -> tuple[float, str]:
    """A sensitivity in SI units of the reading per kelvin, and the dimensions of the reading."""
    if not isinstance(given, str):
        return checks.finite("sensitivity", given, unit="V/K"), units_of.VOLTAGE
    match = re.fullmatch(r"\s*([+-]?)\s*(\d.*\S|\d)\s*/\s*(?:K|deg\s?C|°C|C)\s*", given)
    scale = scale_of(match[2]) if match else None
    if match is None or scale is None or scale.offset or scale.factor == 0:
        raise InputError(f"--sensitivity = {given!r} must be a reading per kelvin", 'such as "10 mV/K" or "75 pm/K"')
    return (-1 if match[1] == "-" else 1) * scale.factor, scale.dimensions


def _level(given: str | float, dimensions: str, kelvin: float) -> float:
    """A baseline in K, given in K or in the unit of the column, of which one in SI is ``kelvin`` K."""
    if not isinstance(given, str):
        return checks.finite("baseline", given, unit="K")
    match = re.fullmatch(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(.*)", given)
    scale = scale_of(match[2]) if match else None
    if match is None or scale is None or scale.dimensions not in (dimensions, units_of.TEMPERATURE):
        raise InputError(f"--baseline = {given!r} must be a temperature or in the unit of the column")
    value = scale.offset + scale.factor * float(match[1])
    return value if scale.dimensions == units_of.TEMPERATURE else value * kelvin


def _power(table: NumberTable, k: int, given: str | None) -> Array:
    """A column of power in W."""
    scale = scale_of(given or table.units[k])
    if scale is None or scale.dimensions != units_of.POWER:
        raise InputError(f"column {table.label(k)} states no unit of a power", 'give it, units = {"power": "mW"}')
    return scale.factor * _numbers(table, k)


def _distinct(table: NumberTable, t: Array, values: list[Array], said: list[str]) -> tuple[Array, list[Array]]:
    """Rows with increasing times: the second of two at one time is left out, if few are and the temperature agrees."""
    steps = np.diff(t)
    if (back := np.flatnonzero(steps < 0)).size:
        raise InputError(
            f"row {back[0] + 2} after line {table.line - 1}: time {t[back[0] + 1]:g} s is before the row above; times "
            "must increase, one record in each file"
        )
    same = np.flatnonzero(steps == 0)
    if not same.size or len(values) > 1:  # a power column jumps at a time that stands twice
        return t, values
    apart = np.abs(np.diff(values[0])[same]) > 0.05 * np.ptp(values[0])
    if same.size > max(2, REPEATED * t.size) or apart.any() or np.any(np.diff(same) == 1):
        raise InputError(
            f"{same.size} times stand more than once, the first is {t[same[0]]:g} s: they are rounded, or two records "
            "in one file; write them with more digits"
        )
    said.append(f"{same.size} rows that repeat a time are left out")
    keep = np.append(True, steps > 0)
    return t[keep], [v[keep] for v in values]
