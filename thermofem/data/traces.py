"""Measured traces: a table of time and temperature, and what was applied, as training data.

The trace has an offset and begins some time before the heating. Both are found from the trace itself: with the drive
known but for its start t0, the rise is a sum of heating poles,

    y(t) = b + sum_i R_i psi_i(t - t0),    R_i >= 0,

psi_i being the answers of poles on a logarithmic grid of time constants. For each t0 the best b and R_i are a
nonnegative least-squares problem; t0 is the start with the smallest misfit. What was assumed is said, in ``notes``.
A start and a baseline that were found have errors: the data carry how far the start may be off and how many rows the
baseline is the mean of, and a fit of poles fits both again.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..algebra.poles import pole_responses
from ..arrays import Array
from ..checks import InputError
from . import dataset, files, quantity
from .clipping import clipping
from .columns import Columns, in_si, measured, parse, text_of, times_in_si
from .header_units import OF_TEMPERATURES, OF_TIMES, VOLTS, check_scale, header_unit, unit_of
from .tables import LARGEST

if TYPE_CHECKING:
    import xarray as xr

    from ..waveforms import Waveform

SCANNED = 1500  # rows that the search for the start uses
STARTS = 24  # of each pass of the search
PASSES = 5
POLES = 30  # time constants of the grid: 12 put the start of two poles a third of a row late
FAR = 25.0  # of the variance of a row, by which a start that is out of the question raises the sum of squares
WIDEST = 64  # rows that a start may be off
FEWEST = 3  # rows before the heating that make a baseline
LONGEST = 1.0  # s; a column of time without unit that is longer is not in seconds
DRIFT = 0.05  # of the swing: more before the heating is no rest
NOTHING = 0.005  # of the swing: an offset below it is none


@dataclass(frozen=True, eq=False)
class Trace:
    """Training data of a measured trace, and what was assumed to make it.

    data: schema of `thermofem.dataset`; t = 0 at the start of the heating.
    start [s]: of the heating, on the file's clock.
    baseline [K]: that was subtracted.
    notes, warnings: what was assumed, in words; what makes the numbers doubtful.
    """

    data: xr.Dataset
    start: float
    baseline: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def read_trace(
    path: str | Path,
    wave: Waveform,
    *,
    time: str | None = None,
    temperature: str | None = None,
    units: Mapping[str, str] | None = None,
    sensitivity: float | None = None,
    start: float | None = None,
    baseline: float | None = None,
) -> Trace:
    """Read a table of time and temperature, measured under a known drive.

    path: text with one row for each time, after any header; see `thermofem.data.columns`.
    wave: the absorbed power, from its start on; straight between its breakpoints.
    time, temperature: headers of the columns, with or without the unit; a table of two columns needs none. Where the
        header has no unit, one may follow the name: "TIME (us)".
    units: {"time": "us", "temperature": "mV"}; goes before the header's. Without either, time is in s and temperature
        in K; without ``sensitivity`` a column in V counts as K.
    sensitivity [V/K]: of a thermometer whose voltage is the temperature column; negative for a diode.
    start [s]: of the heating on the file's clock; default: found from the trace.
    baseline [K]: to subtract; default: the mean before the start.
    Raises InputError: no table, columns that are not named, a wrong unit, no rise, or a trace that ends before its
        drive begins.
    """
    path = checks.path("path", path)
    content = files.read_bytes(path, "table", most=LARGEST)
    try:
        table = parse(text_of(content))
        (time, in_time), (temperature, in_rise) = (_split(table, name) for name in (time, temperature))
        columns = _columns(table, time, temperature)
        said: list[str] = []
        warned: list[str] = []
        t = _time(table, columns[0], (units or {}).get("time", in_time), said)
        y = _rise(table, columns[1], (units or {}).get("temperature", in_rise), sensitivity, said, warned)
        t0 = _start(t, y, wave, start, said)
        unit = unit_of(warned)
        level, rest = _baseline(t, y, wave, t0, baseline, said, unit)
        if baseline is None:
            _check_rest(t, y, t0, warned, unit)
        kept = t >= t0
        if clipped := clipping(y[~kept], unit):  # what is kept is judged with its drive, by `dataset.response_of`
            warned.append(f"before the heating {clipped}")
        if kept.sum() < dataset.FEWEST:
            raise InputError(
                f"{int(kept.sum())} rows after the start of the heating at {t0:g} s; at least 8 are needed"
            )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    about: dict[str, str | float] = {
        "source": path.name,
        "source_sha256": hashlib.sha256(content).hexdigest(),
        "source_columns": f"time: {table.names[columns[0]]}, temperature: {table.names[columns[1]]}",
        "assumed": "; ".join([*said, *warned]),
    }
    if start is None and (t < t0).any():  # else the file is taken to begin with the heating
        about[dataset.START] = _within(t, y, wave, t0)
    if np.isfinite(rest):
        about[dataset.REST] = rest
    data = dataset.build(t[kept] - t0, y[kept] - level, wave, attributes=about)
    return Trace(data, t0, level, tuple(said), tuple(warned))


def _columns(table: Columns, time: str | None, temperature: str | None) -> tuple[int, int]:
    """Places of the two columns; of a table of two the first is the time."""
    listed = ", ".join(table.names)
    if time is None and temperature is None:
        if len(table.names) != 2:
            raise InputError(f"{len(table.names)} columns ({listed}); name two with --time and --temperature")
        return 0, 1
    roles = (("time", time), ("temperature", temperature))
    chosen = [None if name is None else table.column(role, name) for role, name in roles]
    if None in chosen:
        if len(table.names) != 2:
            missing = "--time" if time is None else "--temperature"
            raise InputError(f"{len(table.names)} columns ({listed}); {missing} is missing")
        other = next(place for place in chosen if place is not None)
        chosen = [1 - other if place is None else place for place in chosen]
    first, second = chosen
    if first is None or second is None or first == second:
        raise InputError(f"--time and --temperature name the same column; the table has {listed}")
    return first, second


def _split(table: Columns, name: str | None) -> tuple[str | None, str]:
    """Header and unit of a column that is named as "CH1 (mV)", where the header itself states no unit."""
    match = None if name is None or name in table.names else re.fullmatch(r"(.*\S)\s*\(([^()]+)\)", name)
    if match and match[1] in table.names and not table.units[table.names.index(match[1])]:
        return match[1], match[2]
    return name, ""


def _time(table: Columns, place: int, given: str | None, said: list[str]) -> Array:
    """Times in s, increasing."""
    values, unit = table.numbers(place), header_unit(given or table.units[place])
    name = table.names[place]
    if not given:
        check_scale(name, unit, OF_TIMES, "--time")
    if not unit:
        if np.ptp(values) > LONGEST:
            raise InputError(
                f"column {name!r} states no unit and spans {np.ptp(values):g}; give it, such as --time '{name} (us)'"
            )
        said.append(f"column {name!r} states no unit: seconds")
    offset, factor = quantity.line(unit, "s", name=f"unit of {name!r}") if unit else (0.0, 1.0)
    t = times_in_si(name, values, offset, factor)
    back = np.flatnonzero(np.diff(t) <= 0)
    if back.size:
        line = table.lines[back[0] + 1]
        raise InputError(f"line {line}: time {t[back[0] + 1]:g} s is not after the row before; times must increase")
    return t


def _rise(
    table: Columns, place: int, given: str, sensitivity: float | None, said: list[str], warned: list[str]
) -> Array:
    """Temperatures in K; a voltage is divided by the sensitivity in V/K, and without one 1 V counts as 1 K."""
    values, unit = table.numbers(place), header_unit(given or table.units[place])
    name = table.names[place]
    if not given:
        check_scale(name, unit, OF_TEMPERATURES, "--temperature")
    if not unit:
        said.append(f"column {name!r} states no unit: {'kelvin' if sensitivity is None else 'volts'}")
        unit = "K" if sensitivity is None else "V"
    try:
        offset, factor = quantity.line(unit, "K", name=f"unit of {name!r}")
    except InputError:
        try:
            offset, factor = 0.0, quantity.line(unit, "V", name=f"unit of {name!r}")[1]
        except InputError:
            raise InputError(f"column {name!r} is in {checks.shown(unit)}, which is neither K nor V") from None
        if sensitivity is not None:
            said.append(f"column {name!r} is in {unit}: divided by {quantity.write(sensitivity, 'V/K')}")
            return measured(table, place, in_si(name, values, 0.0, factor / sensitivity))
        warned.append(
            f"column {name!r} is in {unit}: {VOLTS}, so R and R_th are in V/W; time constants are as "
            'measured; --sensitivity "10 mV/K" makes kelvin of it'
        )
    else:
        if sensitivity is not None:
            raise InputError(f"column {name!r} is in {unit}, which is a temperature; a sensitivity is for a voltage")
    return measured(table, place, in_si(name, values, offset, factor))


def _start(t: Array, y: Array, wave: Waveform, given: float | None, said: list[str]) -> float:
    """When the heating begins, on the file's clock."""
    if np.ptp(y) <= 0:
        raise InputError("the temperature is constant; training needs a temperature that varies")
    if given is not None:
        if given >= t[-1]:
            raise InputError(f"the heating begins at {given:g} s, after the end of the table at {t[-1]:g} s")
        if given < t[0]:
            said.append(f"the heating begins {_words(t[0] - given)} before the first row")
        return given
    step = float(np.median(np.diff(t)))
    found = _search(t, y, wave, step)
    if (
        t[0] <= 0 < t[-1]
        and abs(found) <= 1.5 * step
        and _misfit(t, y, wave, 0.0)[0] <= 1.05 * max(_misfit(t, y, wave, found)[0], 1e-9 * float(np.ptp(y)) ** 2)
    ):
        found = 0.0  # a trigger at zero
    elif found - t[0] < 0.5 * step:
        found = float(t[0])
    said.append(f"the heating begins at {_words(found)} on the file's clock")
    return found


def _search(t: Array, y: Array, wave: Waveform, step: float) -> float:
    """The start with the smallest misfit: a scan, made finer around its best point."""
    thin = max(1, t.size // SCANNED)
    low, high = float(t[0]), float(t[-1]) - dataset.FEWEST * step
    best = low
    rows = slice(None, None, thin)
    for _ in range(PASSES):
        starts = np.linspace(low, high, STARTS)
        misfits = [_misfit(t[rows], y[rows], wave, float(s))[0] for s in starts]
        best = float(starts[int(np.argmin(misfits))])
        width = (high - low) / (STARTS - 1)
        low, high = max(best - width, float(t[0])), min(best + width, float(t[-1]) - dataset.FEWEST * step)
        if width < 0.02 * step:
            break
    return best


def _misfit(t: Array, y: Array, wave: Waveform, start: float) -> tuple[float, float]:
    """Sum of squares and baseline of the best sum of heating poles that begins at ``start``."""
    from scipy.optimize import nnls

    u = t - start
    on = u >= 0
    span, step = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    tau = np.geomspace(max(step, span * 1e-5), 3 * span, POLES)
    columns = np.zeros((t.size, POLES + 2))
    if on.any():
        answers = pole_responses(1 / tau, wave, u[on]) / tau
        scale = np.abs(answers).max(axis=0)
        columns[on, :POLES] = answers / np.where(scale > 0, scale, 1.0)
    columns[:, POLES], columns[:, POLES + 1] = 1.0, -1.0  # a baseline of either sign
    level = float(y.mean())
    weights, norm = nnls(columns, y - level)
    return float(norm) ** 2, level + float(weights[POLES] - weights[POLES + 1])


def _within(t: Array, y: Array, wave: Waveform, start: float) -> float:
    """How far from the start that was found the heating may begin, in s: rows of noise around it do not tell."""
    thin = max(1, t.size // SCANNED)
    t, y = t[::thin], y[::thin]
    at = int(np.searchsorted(t, start))
    step = float(np.median(np.diff(t[max(at - FEWEST, 0) : at + FEWEST])))
    least = _misfit(t, y, wave, start)[0]
    highest = least * (1 + FAR / t.size)
    rows = 1
    while rows < WIDEST and min(_misfit(t, y, wave, start + side * rows * step)[0] for side in (-1, 1)) < highest:
        rows *= 2
    return rows * step


def _baseline(
    t: Array, y: Array, wave: Waveform, start: float, given: float | None, said: list[str], unit: str
) -> tuple[float, float]:
    """The temperature at rest, and of how many rows it is the mean: infinite where it is known, 0 of the whole rise."""
    if given is not None:
        return given, np.inf
    step = float(np.median(np.diff(t)))
    before = y[t < start - step]  # the row at the edge may be half-way up
    if before.size >= FEWEST:
        level = float(before.mean())
        said.append(f"baseline {level:.4g} {unit}, the mean of {before.size} rows before the heating, is subtracted")
        return level, float(before.size)
    thin = max(1, t.size // SCANNED)
    noise = float(np.median(np.abs(np.diff(y, 2)))) / (0.6745 * np.sqrt(6))  # of one row, from second differences
    first = int(np.searchsorted(t, start))
    quiet = noise < NOTHING * float(np.ptp(y)) and t[first] - start < 1e-6 * step
    level = float(y[first]) if quiet else _misfit(t[::thin], y[::thin], wave, start)[1]  # at its start a rise is zero
    if start < t[0] and abs(level - y[first]) > np.ptp(y):
        raise InputError(
            f"the heating begins {_words(t[0] - start)} before the first row, and the rise until then, some "
            f"{abs(level - y[first]):.2g} {unit}, is larger than the rows show; give --baseline, or another --start"
        )
    if abs(level) < max(NOTHING * float(np.ptp(y)), 4 * noise):
        said.append("no rows before the heating and no offset: nothing is subtracted")
        return 0.0, np.inf
    said.append(f"no rows before the heating: baseline {level:.4g} {unit}, from the rise itself, is subtracted")
    return level, float(quiet)


def _check_rest(t: Array, y: Array, start: float, warned: list[str], unit: str) -> None:
    """Warn where the rows before the heating drift, as those of a settled square wave do, which is never at rest."""
    before = y[t < start - float(np.median(np.diff(t)))]
    quarter = before.size // 4
    if quarter < FEWEST:
        return
    drift = float(before[-quarter:].mean() - before[:quarter].mean())
    if abs(drift) > DRIFT * np.ptp(y) and abs(drift) > 4 * float(np.abs(np.diff(before)).mean()) / np.sqrt(quarter):
        warned.append(
            f"the rows before the heating drift by {drift:.3g} {unit}: they are not at rest; for a settled square "
            "wave give --baseline and a --start that lies whole periods before the file, such as ten time constants"
        )


def _words(seconds: float) -> str:
    return quantity.rounded(seconds, "s", 4)
