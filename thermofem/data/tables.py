"""Import of tables (a COMSOL probe table, an oscilloscope trace) as a Dataset with the layout of `thermofem.dataset`.

`thermofem.data.columns` says what is read.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..arrays import Array
from ..checks import InputError
from ..waveforms import Constant, Sampled, Waveform
from . import dataset, files, quantity
from .columns import Columns, in_si, measured, parse, text_of, times_in_si
from .header_units import check_scale, header_unit

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("thermofem")

_ROLES = {"time": "s", "power": "W", "temperature": "K"}
_EXAMPLES = {"time": "us", "power": "mW", "temperature": "K"}
LARGEST = 400_000_000  # bytes of a table; reading takes about ten times as many
STEEP = 0.5  # of the range of the power: a change by more within `EDGE_ROWS` intervals is an edge
FLANK = 0.1  # of the range, in one interval: less is noise beside an edge
EDGE_ROWS = 3
EDGES = ("row", "middle")
_ABSOLUTE = 100.0  # K; a record that begins further from rest is a temperature, or its ambient is in another unit


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
        table = parse(text_of(content))
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
    origin = {
        "source": path.name,
        "source_sha256": hashlib.sha256(content).hexdigest(),
        "source_columns": columns,
    }
    return dataset.build(t, rise[first:], wave, read=(temperature,), attributes=origin)


def _given(units: Mapping[str, str] | None) -> dict[str, str]:
    """The units that the caller states, by role."""
    given = checks.mapping("units", units, hint='such as {"time": "us"}')
    for role, unit in given.items():
        checks.choice("units: key", role, _ROLES)
        if not isinstance(unit, str):
            raise InputError(f'units["{role}"] = {checks.shown(unit)} must be text, such as "{_EXAMPLES[role]}"')
    return given


def _numbers(table: Columns, role: str, name: str, given: Mapping[str, str]) -> Array:
    """A column in SI."""
    k = table.column(role, name)
    values = table.numbers(k, name)
    if role not in given:
        check_scale(table.names[k], table.units[k])
    offset, factor = _line(role, name, given.get(role, table.units[k]))
    if role == "time":
        return times_in_si(name, values, offset, factor)
    found = in_si(name, values, offset, factor)
    return measured(table, k, found) if role == "temperature" else found


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
            on = change * np.sign(change[k]) > FLANK * range_  # a product of powers may overflow
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
