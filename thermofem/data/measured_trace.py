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
from ..waveforms import Constant, Waveform
from . import dataset, files, heating_start, quantity
from .number_table import (
    BRACKETS,
    IMPEDANCE,
    POWER,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    Column,
    NumberTable,
    Scale,
    number_table,
    scale_of,
    units_above,
)  # fmt: skip
from .variables import VOLTS, unit_of

LONGEST = 1.0  # s; a column of time without unit that is longer may be in another unit
REPEATED = 0.02  # share of the rows whose time may repeat the one before, as simulators write it at an edge
READINGS: tuple[str, ...] = (TEMPERATURE, VOLTAGE, IMPEDANCE)
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
    fall: bool = False,
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
        whether the rows are the fall after a heating: a long one, or a `Pulse` of known width.

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
    content = files.read_bytes(path, "table", most=400_000_000)
    digest = hashlib.sha256(content).hexdigest()
    with checks.prefixed(str(path)):
        table = number_table(content)
        del content
        said: list[str] = [f"{table.after} lines below the table are left out"] if table.after else []
        found = _columns(table, columns, time, temperature, power)
        given = _units(units)
        unit = given.get("time") or _named_unit(found[0], time)
        t = _times(table, found[0], unit, said)
        wave = watts = None
        if isinstance(power, str):
            watts = _scaled(found[2], given.get("power") or found[2].unit, "power", (POWER,))[1]
        else:
            wave = power if isinstance(power, Waveform) else Constant(float(power))
        unit = given.get("temperature") or _named_unit(found[1], temperature)
        y = _temperatures(table, found[1], unit, sensitivity, wave, said)
        t, (y, *more) = _distinct(t, [y] if watts is None else [y, watts], said)
        level = quantity.parse(baseline, "K", name="--baseline") if isinstance(baseline, str) else baseline
        first = quantity.parse(start, "s", name="--start") if isinstance(start, str) else start
        if wave is None:
            first = min(float(t[0]), 0.0) if first is None else first
            y, watts, t = y[t >= first], more[0][t >= first], t[t >= first]
            wave = heating_start.sampled_power(t - first, watts)
        rows = heating_start.Rows(t, y, wave, unit_of(said), said)
        sampled = watts is not None
        times, rise, about = heating_start.rise_of(rows, first, level, fall, sampled)
    attributes = {
        "source": path.name,
        "source_sha256": digest,
        "source_columns": ", ".join(
            f"{role}: {column.name or column.number}" for role, column in zip(ROLES, found, strict=False)
        ),
        "assumed": "\n".join(said),
        **about,
    }
    return dataset.build(times, rise, wave, read=(temperature or "core",), attributes=attributes)


def _columns(
    table: NumberTable, columns: Any, time: str | None, temperature: str | None, power: Any
) -> tuple[Column, ...]:
    """Columns of time and temperature and, where ``power`` is the name of one, of power."""
    known = {str(column.number): column for column in table.columns}
    listed = ", ".join(f"{number} {column.name!r}" for number, column in known.items())
    third = (_named(table, "power", power),) if isinstance(power, str) else ()
    if columns is not None:
        wanted = [str(c).strip() for c in (columns.split(",") if isinstance(columns, str) else columns)]
        pair = [known[number] for number in wanted if number in known]
        if not len(wanted) == len(pair) == 2:
            raise checks.InputError(
                f"--columns = {checks.shown(columns)} must be two of the columns of numbers: {listed}"
            )
        return (*pair, *third)
    measures = {column: scale.dimensions for column in table.columns if (scale := scale_of(column.unit))}
    first = None if time is None else _named(table, "time", time)
    second = None if temperature is None else _named(table, "temperature", temperature)
    if first is None:
        free = [column for column in table.columns if column not in (second, *third)]
        likely = [column for column in free if measures.get(column) == TIME]
        likely = likely or [column for column in free if not column.unit and _TIMES.fullmatch(column.name)]
        if not likely and (len(free) <= 2 or not table.columns[0].name):
            likely = free[:1]
        first = likely[0] if len(likely) == 1 else None
    if second is None and first is not None:
        free = [c for c in table.columns if c not in (first, *third) and not _COUNTS.fullmatch(c.name)]
        hot = [column for column in free if measures.get(column) in (TEMPERATURE, IMPEDANCE)]
        second = hot[0] if len(hot) == 1 else free[0] if len(free) == 1 else None
    if first is None or second is None or first == second:
        raise checks.InputError(
            f"{len(known)} columns of numbers ({listed}); say which are time and temperature: --columns "
            f"{','.join([*known][:2])}, or --time and --temperature"
        )
    return first, second, *third


def _named(table: NumberTable, role: str, name: str) -> Column:
    """The column with this header, with or without its unit."""
    short = BRACKETS.split(name)[0].strip()
    found = [column for column in table.columns if column.name == name]
    found = found or [column for column in table.columns if BRACKETS.split(column.name)[0].strip() == short]
    if len(found) != 1:
        numbers = ",".join(str(column.number) for column in found)
        rule = f"names the columns {numbers}" if found else "is none of the columns"
        names = ", ".join(f"{column.number} {column.name!r}" for column in table.columns)
        raise checks.InputError(
            f"--{role} = {checks.shown(name)} {rule}", f"say which by number, --columns, of {names}"
        )
    return found[0]


def _named_unit(column: Column, name: str | None) -> str:
    """Unit that the caller wrote behind the name of a column, as in "TIME (us)", where the header has none; else ""."""
    found = BRACKETS.findall(name or "")
    return found[-1] if found and name != column.name and scale_of(found[-1]) else ""


def _units(units: str | Mapping[str, str] | None) -> dict[str, str]:
    """Units by role ("time", "temperature") from either form of ``units``."""
    given = dict(zip(ROLES, units.split(","), strict=False)) if isinstance(units, str) else dict(units or {})
    for role in given:
        checks.choice("units", role, ROLES)
    return given


def _unit(table: NumberTable, column: Column, dimensions: tuple[str, ...], said: list[str]) -> str:
    """Unit of a column as text, from its header or from a line above the table; "" where neither states one."""
    unit, hint = column.unit, 'give its unit, such as --units "us,mV"'
    column.check_name(hint)
    above = [(scale, *a) for a in units_above(table.above) if (scale := scale_of(a[0]))]
    above = [a for a in above if a[0].dimensions in dimensions]
    stated = [a for a in above if a[3]]
    one = len({a[0] for a in stated}) == 1
    own = scale_of(unit) if unit else None
    open_line = ""
    if own is not None:
        if one and stated[0][0] != own and stated[0][0].dimensions == own.dimensions:
            open_line = stated[0][2]
    elif one:
        said.append(f"{column.label} is in {stated[0][1]}, as {stated[0][2][:40]!r} above the table says")
        return stated[0][1]
    else:
        plain = [scale_of(si) for si in "sKV"]
        open_line = next((a[2] for a in above if a[3] or a[0] not in plain), "")
    if open_line:
        states = f"is in {unit}, but" if own else "states no unit, and"
        raise checks.InputError(f"{column.label} {states} {open_line[:40]!r} stands above the table", hint)
    return unit


def _scaled(column: Column, unit: str, role: str, dimensions: tuple[str, ...]) -> tuple[Scale, Array]:
    """Scale of a column in a unit, and its values in SI.

    Raises InputError: a unit of other dimensions, a number that is empty or not finite.
    """
    scale = scale_of(unit)
    if scale is None or scale.dimensions not in dimensions:
        hint = 'give --units "us,mV" or --columns' + (f', or --sensitivity "... {unit}/K"' if role != "time" else "")
        raise checks.InputError(f"{column.label} is in {checks.shown(unit)}, no unit of its {role}", hint)
    # beyond 1e30 is the code of an overload
    values = checks.numbers(column.label, column.values, most=1e30, hint="take such rows out")
    return scale, scale.offset + scale.factor * values


def _times(table: NumberTable, column: Column, given: str, said: list[str]) -> Array:
    """Times in s, checked not to decrease."""
    unit = given or _unit(table, column, (TIME,), said)
    if not unit:
        span = f"the span of {column.label}, which states no unit,"
        checks.between(span, np.ptp(column.values), 0, LONGEST, hint='give its unit, such as --units "us,K"')
        said.append(f"{column.label} states no unit: seconds")
    _, t = _scaled(column, unit or "s", "time", (TIME,))
    return checks.array(f"{column.label} in s", t, increasing=True, hint="one record in each file")


def _temperatures(
    table: NumberTable, column: Column, given: str, sensitivity: str | float | None, wave: Waveform | None,
    said: list[str],
) -> Array:  # fmt: skip
    """Temperatures in K, or readings divided by the sensitivity."""
    readings, unit = READINGS, given or _unit(table, column, READINGS, said)
    if not unit:
        unit = "K" if sensitivity is None else "V"
        said.append(f"{column.label} states no unit: {'kelvin' if sensitivity is None else 'volts'}")
    size, role = 1.0, "temperature"
    if sensitivity is not None:
        size, measured = _sensitivity(sensitivity)
        readings = (measured,)
        role = f"reading, whose sensitivity is {sensitivity}"
        said.append(f"{column.label} is in {unit}: divided by {sensitivity}")
    scale, y = _scaled(column, unit, role, readings)
    kelvin = 1 / size
    if sensitivity is None and scale.dimensions == IMPEDANCE:
        if not isinstance(wave, Constant):
            raise checks.InputError(
                f"{column.label} is in {unit}, an impedance under a step", "give a constant --power"
            )
        said.append(f"{column.label} is in {unit}: multiplied by the power")
        kelvin = wave.power
    elif sensitivity is None and scale.dimensions == VOLTAGE:
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
    match = re.fullmatch(r"\s*([+-]?)\s*(\d.*\S|\d)\s*/\s*(?:K|deg\s?C|°C|C)\s*", given)
    scale = scale_of(match[2]) if match else None
    if match is None or scale is None or scale.offset or scale.factor == 0:
        raise checks.InputError(
            f"--sensitivity = {given!r} must be a reading per kelvin", 'such as "10 mV/K" or "75 pm/K"'
        )
    return (-1 if match[1] == "-" else 1) * scale.factor, scale.dimensions


def _distinct(t: Array, values: list[Array], said: list[str]) -> tuple[Array, list[Array]]:
    """Rows without repeated times: of two rows at one time the second is left out.

    InputError where there are many such rows, or where their temperatures differ.
    """
    steps = np.diff(t)
    same = np.flatnonzero(steps == 0)
    if not same.size or len(values) > 1:  # a power column jumps at a time that stands twice
        return t, values
    apart = np.abs(np.diff(values[0])[same]) > 0.05 * np.ptp(values[0])
    if same.size > max(2, REPEATED * t.size) or apart.any() or np.any(np.diff(same) == 1):
        raise checks.InputError(
            f"{same.size} times stand more than once, the first is {t[same[0]]:g} s: they are rounded, or two records "
            "in one file; write them with more digits"
        )
    said.append(f"{same.size} rows that repeat a time are left out")
    keep = np.append(True, steps > 0)
    return t[keep], [v[keep] for v in values]
