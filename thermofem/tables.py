"""Import of tables (a COMSOL probe table, an oscilloscope trace) as a Dataset with the layout of `thermofem.dataset`.

What is read: columns divided by commas, semicolons, tabs or spaces, after any header. The last header line with as many
cells as the table names its columns; a line of bare units below it counts too. Lines that begin with % or # are header.
A unit stands in the header, "Time (s)" or "CH1 [mV]", or is given in ``units``.
"""

from __future__ import annotations

import csv
import hashlib
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import checks, dataset, files, quantity
from .checks import InputError
from .waveforms import Constant, Sampled, Waveform

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

log = logging.getLogger("thermofem")

SPELLED = {
    "volt": "V", "volts": "V", "second": "s", "seconds": "s", "sec": "s", "kelvin": "K", "millivolt": "mV",
    "microsecond": "us", "microseconds": "us", "nanosecond": "ns", "nanoseconds": "ns", "millisecond": "ms",
    "celsius": "degC", "watt": "W", "watts": "W",
}  # fmt: skip
_ROLES = {"time": "s", "power": "W", "temperature": "K"}
_UNIT = re.compile(r"\s*[(\[]([^()\[\]]*)[)\]]")
_EXAMPLES = {"time": "us", "power": "mW", "temperature": "K"}
LARGEST = 1_000_000_000  # bytes of a table
STEEP = 0.5  # of the range of the power: a change by more within `EDGE_ROWS` intervals is an edge
FLANK = 0.1  # of the range, in one interval: less is noise beside an edge
EDGE_ROWS = 3
EDGES = ("row", "middle")
_ABSOLUTE = 100.0  # K; a record that begins further from rest is a temperature, or its ambient is in another unit


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of numbers with the names and units that their header gives.

    Attributes
    ----------
    names, units : tuple of str
        unit "" where the header states none.
    values : array, shape (rows, columns)
        nan where a cell is empty.
    lines : int array, shape (rows,)
        line of the file that each row stands on, from 1.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    lines: NDArray[np.int64]

    def column(self, argument: str, name: str) -> int:
        """Index of a column by its header, with or without what follows the unit."""
        short = [_UNIT.split(known)[0].strip() for known in self.names]
        if name in self.names:
            return self.names.index(name)
        if short.count(name) == 1:
            return short.index(name)
        if name in short:
            several = [full for full, known in zip(self.names, short, strict=True) if known == name]
            raise InputError(f"{argument} = {name!r} names {len(several)} columns; give one of {', '.join(several)}")
        checks.choice(f"{argument}: column", name, [*self.names, *short])
        return -1  # not reached: `choice` raises


def read_csv(
    path: str | Path,
    *,
    time: str,
    power: str | float | Waveform,
    temperature: str,
    units: Mapping[str, str] | None = None,
    ambient: str | float | None = None,
    start: str | float | None = None,
    edges: str | None = None,
) -> xr.Dataset:
    """Read a table of time, power and temperature into a Dataset that can be used for training.

        t = time - start,    delta_T = temperature - ambient

    Parameters
    ----------
    path : str or Path
        text with one row for each time.
    time, temperature : str
        headers of the columns; "1", "2", ... where the file has no header.
    power : str, float or Waveform
        header of the column with the absorbed power, a constant power in W, or the waveform that was applied.
    units : dict
        unit of one step of the column, by role: {"time": "us", "temperature": "0.12 K"}; it goes before the header's.
    ambient : str or float, K
        subtracted from the temperature; default 0, for a column that is a rise already.
    start : str or float, s
        when the heating began, on the file's clock; earlier rows are left out. Default 0.
    edges : "row" or "middle"
        a column of power is straight between its rows, so that an edge between two rows becomes a ramp, which
        shifts what is fitted. With ``edges`` a change by more than half the column's range within three rows is a jump:
        "row", at the first row with the new power, as in tables of a simulation that has a row at every edge;
        "middle", half-way, where it keeps the energy, as in traces of an oscilloscope that samples when it likes.
        Default: jumps only where a time stands twice; the log tells where that looks wrong.

    Returns
    -------
    Dataset
        schema of `thermofem.dataset`; the attributes name the file, its hash and the columns.

    Raises
    ------
    InputError
        no such file or table; a column that is missing (the nearest is named), without unit or with a wrong one;
        an empty cell, or a time before its predecessor (the line is named); an absolute temperature without ambient, or
        an ambient that is far from it.
    """
    path, given = checks.path("path", path), _given(units)
    content = files.read_bytes(path, "table", most=LARGEST)
    try:
        table = parse(content.decode("utf-8-sig", errors="replace"))
        t = _numbers(table, "time", time, given)
        rise = _numbers(table, "temperature", temperature, given) - (_scalar("ambient", ambient, "K") or 0.0)
        watts = _numbers(table, "power", power, given) if isinstance(power, str) else None
        t, first = _clock(table, t, _scalar("start", start, "s"))
        wave = _wave(power) if watts is None else _sampled(t, watts[first:], edges, path.name)
        if abs(rise[first]) > _ABSOLUTE:
            above = "" if ambient is None else f" above ambient = {ambient!r}"
            raise InputError(
                f"{temperature!r} begins at {rise[first]:g} K{above}, which is a temperature and no rise; "
                'give the one at rest, ambient = "293.15 K"'
            )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    columns = f"time: {time}, temperature: {temperature}" + (f", power: {power}" if isinstance(power, str) else "")
    origin = {"source": path.name, "source_sha256": hashlib.sha256(content).hexdigest(), "source_columns": columns}
    return dataset.build(t, rise[first:], wave, read=(temperature,), attributes=origin)


def parse(text: str) -> Columns:
    """Find the table in a text; InputError when there are no numbers or a row breaks off.

    >>> parse("% Time (us)   T (K)\\n0   293.15\\n1   294.5").units
    ('us', 'K')
    """
    lines = text.splitlines()
    divider = _divider(lines)
    rows: list[list[float]] = []
    at: list[int] = []
    header: list[list[str]] = []
    for number, line in enumerate(lines, 1):
        cells = _cells(line, divider)
        values = _floats(cells, divider)
        if values is None and not rows:
            header.append(_cells(line.lstrip("%# "), divider))
        elif values is not None and (not rows or len(values) == len(rows[0])):
            rows.append(values)
            at.append(number)
        elif line.strip() and not line.lstrip().startswith(("%", "#")):
            raise InputError(f"line {number} = {line.strip()[:40]!r} is no row of {len(rows[0])} numbers")
    if not rows:
        raise InputError("no line of at least two numbers; a table of time and temperature is needed")
    names, units = _header(header, len(rows[0]))
    return Columns(names, units, np.array(rows), np.array(at))


def _given(units: Mapping[str, str] | None) -> dict[str, str]:
    """The units that the caller states, by role."""
    checks.has("units", units or {}, "items", hint='a mapping is needed, such as {"time": "us"}')
    for role, unit in (units or {}).items():
        checks.choice("units: key", role, _ROLES)
        if not isinstance(unit, str):
            raise InputError(f'units["{role}"] = {checks.shown(unit)} must be text, such as "{_EXAMPLES[role]}"')
    return dict(units or {})


def _divider(lines: list[str]) -> str:
    """Separator of the columns: tab, semicolon or comma if the last line then holds numbers; otherwise spaces."""
    last = [line for line in lines if line.strip()][-3:]
    for divider in ("\t", ";", ","):
        if any(_floats(_cells(line, divider), divider) is not None for line in last):
            return divider
    return " "


def _cells(line: str, divider: str) -> list[str]:
    """Cells of a line, unquoted; in a header with spaces, two of them or a closing bracket end a cell."""
    if divider != " ":
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=divider, skipinitialspace=True), [])]
        except csv.Error as error:  # a cell of more than 131072 characters
            raise InputError(f"a line of {len(line)} characters is no row of a table ({error})") from None
    line = line.strip()
    cells = line.split()
    return cells if _floats(cells, divider) is not None else re.split(r"\s{2,}|\t", line)


def _floats(cells: list[str], divider: str) -> list[float] | None:
    """The cells as numbers, nan where empty; None unless there are two cells or more, and a number among them."""
    if divider in (";", "\t"):
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        values = [quantity.number(cell) if cell and cell != "--" else np.nan for cell in cells]
    except ValueError:
        return None
    return values if len(values) > 1 and any(cells) else None


def _header(header: list[list[str]], columns: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns from the lines above them."""
    fitting = [cells for cells in header if len(cells) == columns]
    if not fitting:
        return tuple(str(k + 1) for k in range(columns)), ("",) * columns
    names, below = fitting[-1], None
    if len(fitting) > 1 and all(_is_unit(cell) for cell in names):
        names, below = fitting[-2], names
    brackets = [_UNIT.search(name) for name in names]
    units = [match[1].strip() if match else "" for match in brackets]
    if below:
        units = [unit or cell.strip("()[] ") for unit, cell in zip(units, below, strict=True)]
    return tuple(names), tuple(units)


def _is_unit(cell: str) -> bool:
    """Whether a cell is a bare unit such as "(us)", "mV" or "Volt"."""
    bare = cell.strip("()[] ")
    if not bare:
        return False
    for text in (header_unit(bare), bare.lower()):  # scopes write "Volt"
        try:
            quantity.parse(f"1 {text}", "s")
        except InputError as error:
            if "wrong dimension" not in str(error):
                continue
        return True
    return False


def _numbers(table: Columns, role: str, name: str, given: Mapping[str, str]) -> Array:
    """A column in SI."""
    k = table.column(role, name)
    values = table.values[:, k]
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        more = f" ({bad.size} rows in all)" if bad.size > 1 else ""
        raise InputError(f"line {table.lines[bad[0]]}: {name!r} is empty or not finite{more}; take such rows out")
    offset, factor = _line(role, name, given.get(role, table.units[k]))
    return offset + factor * values


def _line(role: str, name: str, unit: str) -> tuple[float, float]:
    """Offset and factor from a column's numbers to SI; a unit may carry a factor, "0.12 K"."""
    si = _ROLES[role]
    if not unit:
        raise InputError(f'column {name!r} states no unit; give units = {{"{role}": ...}}, e.g. "{_EXAMPLES[role]}"')
    unit = header_unit(unit)
    split = re.match(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)$", unit, re.ASCII)
    scale, bare = (float(split[1]), split[2]) if split else (1.0, unit)
    checks.positive(f"{role}: factor of the unit {unit!r}", scale)
    offset, factor = quantity.line(bare, si, name=f"{role}: unit of {name!r}")
    return offset, scale * factor


def header_unit(text: str) -> str:
    """A unit as instruments write it in a header, as the unit layer reads it: "Volt" becomes "V"."""
    unit = text.strip().replace("°C", "degC").replace("µ", "u").replace("μ", "u")
    return SPELLED.get(unit.lower(), unit)


def _scalar(name: str, value: str | float | None, unit: str) -> float | None:
    if value is None:
        return None
    return quantity.parse(value, unit, name=name) if isinstance(value, str) else checks.finite(name, value, unit=unit)


def _clock(table: Columns, times: Array, start: float | None) -> tuple[Array, int]:
    """Times from the start of the heating on, and the first row that is kept."""
    back = np.flatnonzero(np.diff(times) < 0)
    if back.size:
        line, before = table.lines[back[0] + 1], table.lines[back[0]]
        raise InputError(
            f"line {line}: time {times[back[0] + 1]:g} s is before {times[back[0]]:g} s of line {before}; times must "
            "increase (one value of a parameter sweep in each file)"
        )
    shifted = times - (start or 0.0)
    slack = 1e-12 * max(abs(times[0]), abs(times[-1]))  # round-off of the subtraction
    first = int(np.searchsorted(shifted, -slack))
    if times.size - first < 2:
        raise InputError(f"start = {start or 0.0:g} s leaves {times.size - first} rows; the last is at {times[-1]:g} s")
    return np.maximum(shifted[first:], 0.0), first


def _wave(power: str | float | Waveform) -> Waveform:
    """A drive that is known without the table."""
    return Constant(float(power)) if isinstance(power, str | int | float) else power


def _sampled(times: Array, power: Array, edges: str | None, name: str) -> Waveform:
    """The drive of a column; it begins at t = 0 with its first value."""
    steep = _edges(times, power)
    if edges is not None:
        checks.choice("edges", edges, EDGES)
        times, power = _with_jumps(times, power, steep, edges)
    elif steep:
        log.warning(
            "%s: the power changes by more than half its range between rows, %d times, first at t = %g s; these are "
            'taken as ramps; where they are edges, give edges="row" or "middle"',
            name,
            len(steep),
            times[steep[0][0]],
        )
    if times[0] > 0:
        times, power = np.append(0.0, times), np.append(power[0], power)
    return Sampled(times, power)


def _edges(times: Array, power: Array) -> list[tuple[int, int]]:
    """First and last row of every change by more than `STEEP` of the range within at most `EDGE_ROWS` intervals."""
    change, range_ = np.diff(power), float(np.ptp(power))
    found: list[tuple[int, int]] = []
    k = 0
    while k < change.size:
        stop = k + 1
        if abs(change[k]) > FLANK * range_:
            on = change * change[k] > FLANK * range_ * abs(change[k])
            while stop < min(change.size, k + EDGE_ROWS) and on[stop]:
                stop += 1
            if abs(power[stop] - power[k]) > STEEP * range_ and times[stop] > times[k]:
                found.append((k, stop))
        k = stop
    return found


def _with_jumps(times: Array, power: Array, steep: list[tuple[int, int]], edges: str) -> tuple[Array, Array]:
    """Samples with every edge moved to one time: that of its last row, or the time that conserves the energy."""
    keep = np.ones(times.size, dtype=bool)
    jumps: list[tuple[float, float]] = []
    for a, b in steep:
        at = float(times[b])
        if edges == "middle":
            at -= float(np.trapezoid(power[a : b + 1] - power[a], times[a : b + 1]) / (power[b] - power[a]))
        keep[a + 1 : b + (edges == "row")] = False
        jumps += [(at, power[a]), (at, power[b])]
    t = np.concatenate([times[keep], [time for time, _ in jumps]])
    p = np.concatenate([power[keep], [watts for _, watts in jumps]])
    order = np.argsort(t, kind="stable")  # both sides of a jump stay in their order
    return t[order], p[order]
