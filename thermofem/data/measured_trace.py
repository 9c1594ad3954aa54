"""Measured traces: a table of time and temperature under a known power, as a Dataset of `thermofem.dataset`.

    t = time - start,    delta_T = temperature - baseline,    of a fall after a long heating  baseline - temperature

What the table does not say is found from the rows and listed in ``attrs["assumed"]``, or asked for in one line.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from .. import checks
from ..algebra.autocorrelation import independent
from ..algebra.pole_responses import pole_responses
from ..arrays import Array
from ..checks import InputError
from ..waveforms import Constant, Pulse, Waveform
from . import dataset, files, quantity
from .column_units import (
    BRACKETS,
    IMPEDANCE,
    POWER,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    VOLTS,
    check_name,
    scale_of,
    unit_of,
    units_above,
)
from .data_doubts import clipping
from .number_table import NumberTable, number_table
from .sampled_power import sampled_power

LARGEST = 400_000_000  # bytes of a table
SCANNED = 1500  # rows that the search for the start uses
STARTS, PASSES = 24, 5  # starts of each pass of the search, each pass as fine as two of the one before
POLES = 30  # time constants of the grid: 12 put the start of two poles a third of a row late
FAR = 25.0  # of the variance of a row, by which a start that is out of the question raises the sum of squares
WIDEST = 64  # rows that a start may be off
FEWEST = 3  # rows before the heating that make a baseline
LONGEST = 1.0  # s; a column of time without unit that is longer may be in another unit
NOTHING = 0.005  # of the swing: an offset below it is none
FOLLOWED = 1e-3  # of the swing: what the grid of time constants leaves of an exact sum of poles
DRIFT = 0.05  # of the swing: more before the heating is no rest
HOTTEST = 1e5  # K; beyond any temperature: the code of an overloaded instrument, such as 9.9E+37
REPEATED = 0.02  # share of the rows whose time may repeat the one before, as simulators write it at an edge
UNEVEN = 3.0  # longest step over the shortest from which rows are no even samples
_TIMES = re.compile(r"\W*(?:t|x|X|s|t[_ /].*|(?i:time.*|.*\btimes?|zeit|seconds?))\W*")
_COUNTS = re.compile(r"(?i)(?:index|idx|no\.?|nr\.?|n|#|point|sample|row|step|samples_averaged|averages?)\W*")


class Rows(NamedTuple):
    """Times (s) and temperatures (K, or V) of a table under a power, as the search for the start takes them."""

    t: Array
    y: Array
    wave: Waveform

    @property
    def step(self) -> float:
        """Median step of the times, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def noise(self) -> float:
        """Standard deviation of one row, from second differences."""
        return float(np.median(np.abs(np.diff(self.y, 2)))) / (0.6745 * np.sqrt(6))

    @property
    def even(self) -> bool:
        """Whether the rows are even samples."""
        steps = np.diff(self.t)
        return bool(steps.max() < UNEVEN * steps.min())

    def thin(self) -> Rows:
        """At most twice `SCANNED` rows, evenly picked."""
        every = max(1, self.t.size // SCANNED)
        return Rows(self.t[::every], self.y[::every], self.wave)


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
    try:
        table = number_table(content)
        del content
        said: list[str] = [f"{table.after} lines below the table are left out"] if table.after else []
        places, given = _columns(table, columns, time, temperature, power), _units(units)
        t = _times(table, places[0], given.get("time") or _named_unit(table, time), said)
        unit = given.get("temperature") or _named_unit(table, temperature)
        watts = step = None
        if isinstance(power, str):
            watts = _power(table, places[2], given.get("power"))
        else:
            step = Constant(float(power)) if isinstance(power, int | float) else power
        y, to_kelvin = _temperatures(table, places[1], unit, sensitivity, step, said)
        t, (y, *more) = _distinct(table, t, [y] if watts is None else [y, watts], said)
        level = None if baseline is None else _level(baseline, to_kelvin)
        first = quantity.parse(start, "s", name="--start") if isinstance(start, str) else start
        if step is None:
            first = min(float(t[0]), 0.0) if first is None else first
            y, watts, t = y[t >= first], more[0][t >= first], t[t >= first]
            step = sampled_power(t - first, watts, edges)
        found = _found(Rows(t, y, step), first, level, fall, watts is not None, unit_of(said), said)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    names = zip(("time", "temperature", "power"), places, strict=False)
    about = {
        "source": path.name,
        "source_sha256": digest,
        "source_columns": ", ".join(f"{role}: {table.names[k] or table.columns[k]}" for role, k in names),
        "assumed": "\n".join(said),
        **found[3],
    }
    part = "core" if temperature is None else temperature
    return dataset.build(found[0], found[1], found[2], read=(part,), attributes=about)


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
        return (*(known.index(c) for c in wanted), *third)
    count = range(len(table.columns))
    first = None if time is None else _place(table, "time", time, listed)
    second = None if temperature is None else _place(table, "temperature", temperature, listed)
    if first is None:
        free = [k for k in count if k not in (second, *third)]
        likely = [k for k in free if (s := scale_of(table.units[k])) and s.dimensions == TIME]
        likely = likely or [k for k in free if not table.units[k] and _TIMES.fullmatch(table.names[k])]
        if not likely and (len(free) <= 2 or not table.names[0]):
            likely = free[:1]
        first = likely[0] if len(likely) == 1 else None
    if second is None and first is not None:
        others = [k for k in count if k not in (first, *third) and not _COUNTS.fullmatch(table.names[k])]
        hot = [k for k in others if (s := scale_of(table.units[k])) and s.dimensions in (TEMPERATURE, IMPEDANCE)]
        second = hot[0] if len(hot) == 1 else others[0] if len(others) == 1 else None
    if first is None or second is None or first == second:
        raise InputError(
            f"{len(count)} columns of numbers ({listed}); say which are time and temperature: --columns "
            f"{table.columns[0]},{table.columns[1]}, or --time and --temperature"
        )
    return first, second, *third


def _place(table: NumberTable, role: str, name: str, listed: str) -> int:
    """Place of a column by its header, with or without its unit."""
    short = [BRACKETS.split(known)[0].strip() for known in table.names]
    bare = BRACKETS.split(name)[0].strip()
    for known in (list(table.names), short, [s if not u else "" for s, u in zip(short, table.units, strict=True)]):
        wanted = name if known is not short or name in short else bare
        if known.count(wanted) > 1:
            same = ",".join(str(c) for c, n in zip(table.columns, known, strict=True) if n == wanted)
            raise InputError(f"--{role} = {name!r} names the columns {same}; say which by number: --columns")
        if wanted in known:
            return known.index(wanted)
    if bare in short and short.count(bare) == 1:
        return short.index(bare)
    raise InputError(f"--{role} = {checks.shown(name)} is none of the columns: {listed}")


def _named_unit(table: NumberTable, name: str | None) -> str:
    """The unit that a caller wrote behind the name of a column: "TIME (us)", where the header has none."""
    found = BRACKETS.findall(name or "")
    return found[-1] if found and name not in table.names and scale_of(found[-1]) else ""


def _units(units: str | Mapping[str, str] | None) -> dict[str, str]:
    """Units by role; each must be one."""
    roles = ("time", "temperature", "power")
    given = dict(zip(roles, units.split(","), strict=False)) if isinstance(units, str) else dict(units or {})
    for role, unit in given.items():
        checks.choice("units", role, roles)
        if unit and scale_of(unit) is None:
            raise InputError(f"--units: {checks.shown(unit)} is not a unit of a {role}", "such as --units us,mV")
    return given


def _unit(table: NumberTable, k: int, given: str, role: str, dimensions: tuple[str, ...], said: list[str]) -> str:
    """The unit of a column: the caller's, that of its header, or that which a line above the table states."""
    if given:
        return given
    label, hint = table.label(k), 'give its unit, such as --units "us,mV"'
    unit = table.units[k]
    check_name(f"column {label}", table.names[k], unit, hint)
    above = [(scale, *a) for a in units_above(table.above) if (scale := scale_of(a[0]))]
    above = [a for a in above if a[0].dimensions in dimensions]
    stated = [a for a in above if a[3]]
    scales = {a[0] for a in stated}
    own = scale_of(unit) if unit else None
    if own is not None:
        if len(scales) == 1 and own not in scales and stated[0][0].dimensions == own.dimensions:
            raise InputError(f"column {label} is in {unit}, but {stated[0][2][:40]!r} stands above the table", hint)
        return unit
    if len(scales) == 1:
        said.append(f"column {label} is in {stated[0][1]}, as {stated[0][2][:40]!r} above the table says")
        return stated[0][1]
    plain = [scale_of(si) for si in "sKV"]
    if odd := [a for a in above if a[3] or a[0] not in plain]:
        raise InputError(f"column {label} states no unit, and {odd[0][2][:40]!r} stands above the table", hint)
    return unit


def _times(table: NumberTable, k: int, given: str, said: list[str]) -> Array:
    """Times in s."""
    values, label = _numbers(table, k), table.label(k)
    unit = _unit(table, k, given, "time", (TIME,), said)
    if not unit:
        if np.ptp(values) > LONGEST:
            raise InputError(
                f"column {label} states no unit and spans {np.ptp(values):g}", 'give its unit, such as --units "us,K"'
            )
        said.append(f"column {label} states no unit: seconds")
    scale = scale_of(unit or "s")
    if scale is None or scale.dimensions != TIME:
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
) -> tuple[Array, tuple[str, float, float]]:
    """Temperatures in K, and dimensions, offset and factor that turn numbers of the column's dimension into K."""
    values, label = _numbers(table, k), table.label(k)
    unit = _unit(table, k, given, "temperature", (TEMPERATURE, VOLTAGE, IMPEDANCE), said)
    sense = None if sensitivity is None else _sensitivity(sensitivity)
    if not unit:
        unit = "K" if sense is None else "V"
        said.append(f"column {label} states no unit: {'kelvin' if sense is None else 'volts'}")
    scale = scale_of(unit)
    if scale is None:
        raise InputError(f"column {label} is in {checks.shown(unit)}, which is not known", 'give --units "us,mV"')
    offset, factor = scale.offset, scale.factor
    if sense is not None:
        if sense[1] != scale.dimensions:
            said_so = f"column {label} is in {unit}, and the sensitivity {sensitivity!r} is of another"
            raise InputError(said_so, 'give --units "us,pm"')
        said.append(
            f"column {label} is in {unit}: divided by {sensitivity if isinstance(sensitivity, str) else sense[0]}"
        )
        factor = factor / sense[0]
    elif scale.dimensions == IMPEDANCE:
        watts = wave.power if isinstance(wave, Constant) else None
        if watts is None:
            raise InputError(f"column {label} is in {unit}, an impedance under a step", "give a constant --power")
        said.append(f"column {label} is in {unit}: multiplied by the power")
        factor = factor * watts
    elif scale.dimensions == VOLTAGE:
        said.append(
            f"warning: column {label} is in {unit}: {VOLTS}, so R and R_th are in V/W and time constants are as "
            'measured, --sensitivity "10 mV/K" makes kelvin of it'
        )
    elif scale.dimensions != TEMPERATURE:
        raise InputError(f"column {label} is in {unit}, no temperature", f'give --sensitivity "... {unit}/K"')
    y = offset + factor * values
    if (hot := np.flatnonzero(~(np.abs(y) <= HOTTEST))).size:
        raise InputError(f"{hot.size} rows of column {label} are beyond {HOTTEST:g} K: an overload, or another unit?")
    return y, (scale.dimensions, offset, factor / scale.factor)


def _sensitivity(given: str | float) -> tuple[float, str]:
    """A sensitivity in SI units of the reading per kelvin, and the dimensions of the reading."""
    if not isinstance(given, str):
        return checks.finite("sensitivity", given, unit="V/K"), VOLTAGE
    match = re.fullmatch(r"\s*([+-]?)\s*(.*\S)\s*/\s*(?:K|deg\s?C|°C|C)\s*", given)
    scale = scale_of(match[2]) if match and match[2][:1].isdigit() else None
    if match is None or scale is None or scale.offset or scale.factor == 0:
        raise InputError(f"--sensitivity = {given!r} must be a reading per kelvin", 'such as "10 mV/K" or "75 pm/K"')
    return (-1 if match[1] == "-" else 1) * scale.factor, scale.dimensions


def _level(given: str | float, to_kelvin: tuple[str, float, float]) -> float:
    """A baseline in K, given in K or in the unit of the column."""
    if not isinstance(given, str):
        return checks.finite("baseline", given, unit="K")
    match = re.fullmatch(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(.*)", given)
    scale = scale_of(match[2]) if match else None
    if match is None or scale is None or scale.dimensions not in (to_kelvin[0], TEMPERATURE):
        raise InputError(f"--baseline = {given!r} must be a temperature or in the unit of the column")
    value = scale.offset + scale.factor * float(match[1])
    return value if scale.dimensions == TEMPERATURE else value * to_kelvin[2]


def _power(table: NumberTable, k: int, given: str | None) -> Array:
    """A column of power in W."""
    scale = scale_of(given or table.units[k])
    if scale is None or scale.dimensions != POWER:
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


def _found(
    rows: Rows, start: float | None, level: float | None, fall: bool | None, sampled: bool, unit: str, said: list[str]
) -> tuple[Array, Array, Waveform, dict[str, Any]]:
    """Times from the start on, rises, the power, and attributes: start, baseline and how well both are known."""
    if rows.t.size < dataset.FEWEST:
        raise InputError(f"{rows.t.size} rows; at least {dataset.FEWEST} are needed")
    t, y, wave = rows
    if sampled:
        fall = False
    if fall is None:
        fall = isinstance(wave, Constant) and start is None and level is None and _falls(rows, unit, said)
    sign, length = (-1.0, 0.0) if fall else (1.0, 0.0)
    if fall and isinstance(wave, Pulse):
        length = wave.width
        edge = _start(Rows(t, -y, Constant(wave.power)), start, said, "the fall")[0]
        start, sign = edge - length, 1.0
    elif fall and not isinstance(wave, Constant):
        raise InputError("--fall goes with a constant --power, or with --pulse and the length of the heating")
    rows = Rows(t, sign * y, wave)
    about: dict[str, Any] = {}
    t0, rest = _start(rows, start, said, "the fall" if sign < 0 else "the heating")
    if level is not None:
        off, known = sign * level, np.inf
    elif rest:
        off, known = 0.0, np.inf
    else:
        off, known = _baseline(rows, t0, sampled, unit, said, sign)
        _check_rest(rows, t0, unit, said)
    kept = t >= t0
    if clipped := clipping(y[~kept], unit):  # what is kept is judged with its drive, by `dataset.response_of`
        said.append(f"warning: before the heating {clipped}")
    if kept.sum() < dataset.FEWEST:
        raise InputError(
            f"{int(kept.sum())} rows after the start at {t0:g} s; at least {dataset.FEWEST} are needed; give --start"
        )
    if start is None and (t < t0).any():
        about[dataset.START] = _within(rows, t0)
    if np.isfinite(known):
        about[dataset.REST] = known
    before = rows.y[t < t0 - rows.step]
    if before.size >= dataset.FEWEST:
        about[dataset.NOISE] = float(before.std(ddof=1))
    return t[kept] - t0, rows.y[kept] - off, wave, {**about, "start": t0 + length, "baseline": sign * off}


def _falls(rows: Rows, unit: str, said: list[str]) -> bool:
    """Whether the rows fall as after a heating; of a voltage, which may fall when heated, InputError."""
    few = rows.thin()
    part = max(1, few.t.size // 10)
    if np.median(few.y[-part:]) >= np.median(few.y[:part]):
        return False
    rise, fall = (_best(Rows(few.t, sign * few.y, few.wave))[1] for sign in (1.0, -1.0))
    if fall > 0.1 * rise or fall > 0.1 * np.sum((few.y - few.y.mean()) ** 2):
        return False
    if unit == "V":
        raise InputError("the voltage falls: a fall after heating (--fall), or a diode (a negative --sensitivity)?")
    said.append("the temperature falls: taken as the fall after a long heating, as with --fall")
    return True


def _start(rows: Rows, given: float | None, said: list[str], what: str) -> tuple[float, bool]:
    """When the power sets in, on the file's clock, and whether the record begins at rest without an offset."""
    t, y = rows.t, rows.y
    if given is not None:
        if given >= t[-1]:
            raise InputError(f"--start: {what} begins at {given:g} s, after the end of the table at {t[-1]:g} s")
        if given < t[0]:
            said.append(f"{what} begins {_words(t[0] - given)} before the first row")
        return given, False
    best, least = _best(rows)
    few = rows.thin()
    swing = float(np.ptp(y))
    if t[0] >= 0 and what != "the fall" and abs(y[0]) < swing:
        loose = least * (1 + FAR / few.t.size) + few.t.size * (FOLLOWED * swing) ** 2
        quiet = abs(y[0]) <= max(4 * rows.noise, NOTHING * swing)
        if (quiet if t[0] == 0 else True) and _misfit(few, 0.0, offset=False)[0] <= loose:
            said.append(
                "no rows before the heating: the power sets in at t = 0, where the rise is zero, and nothing is "
                "subtracted (--start and --baseline say otherwise)"
            )
            return 0.0, True
    if not rows.even and t[0] >= 0 and _misfit(few, 0.0)[0] <= least + few.t.size * (FOLLOWED * swing) ** 2:
        best = 0.0
    elif t[0] <= 0 < t[-1] and abs(best) <= 1.5 * rows.step:
        floor = 1e-9 * swing**2
        best = 0.0 if _misfit(few, 0.0)[0] <= 1.05 * max(_misfit(few, best)[0], floor) else best
    if 0 < best - t[0] < 0.5 * rows.step:
        best = float(t[0])
    said.append(f"{what} begins at {_words(best)} on the file's clock")
    return best, False


def _best(rows: Rows) -> tuple[float, float]:
    """The start with the smallest misfit, and that misfit: a scan, made finer around its best point."""
    t, step = rows.t, rows.step
    low, high = float(t[0]), float(t[-dataset.FEWEST])
    few, best = rows.thin(), (low, np.inf)
    for _ in range(PASSES):
        starts = np.linspace(low, high, STARTS)
        misfits = [_misfit(few, float(s))[0] for s in starts]
        k = int(np.argmin(misfits))
        best = float(starts[k]), float(misfits[k])
        width = (high - low) / (STARTS - 1)
        low, high = max(best[0] - width, float(t[0])), min(best[0] + width, float(t[-dataset.FEWEST]))
        if width < 0.02 * step:
            break
    return best


def _misfit(rows: Rows, start: float, *, offset: bool = True) -> tuple[float, float]:
    """Sum of squares and baseline of the best sum of heating poles that begins at ``start``."""
    from scipy.optimize import nnls

    t, y, wave = rows
    u = t - start
    on = u >= 0
    span = float(t[-1] - t[0])
    tau = np.geomspace(max(rows.step if rows.even else np.diff(t).min() / 10, span * 1e-5), 3 * span, POLES)
    if not rows.even:
        first = float(u[u > 0].min(initial=span))  # the start may lie behind every row
        tau = np.geomspace(max(first / 10, span * 1e-9), 3 * span, 2 * POLES)
    columns = np.zeros((t.size, tau.size + 2))
    if on.any():
        answers = pole_responses(1 / tau, wave, u[on]) / tau
        scale = np.abs(answers).max(axis=0)
        columns[on, : tau.size] = answers / np.where(scale > 0, scale, 1.0)
    if offset:
        columns[:, tau.size], columns[:, tau.size + 1] = 1.0, -1.0  # a baseline of either sign
    level = float(y.mean()) if offset else 0.0
    weights, norm = nnls(columns, y - level)
    return float(norm) ** 2, level + float(weights[tau.size] - weights[tau.size + 1])


def _within(rows: Rows, start: float) -> float:
    """How far from the start that was found the heating may begin, in s: rows of noise around it do not tell."""
    few = rows.thin()
    at = int(np.searchsorted(few.t, start))
    step = float(np.median(np.diff(few.t[max(at - FEWEST, 0) : at + FEWEST])))
    highest = _misfit(few, start)[0] * (1 + FAR / few.t.size)
    count = 1
    while count < WIDEST and min(_misfit(few, start + side * count * step)[0] for side in (-1, 1)) < highest:
        count *= 2
    return count * step


def _baseline(rows: Rows, start: float, sampled: bool, unit: str, said: list[str], sign: float) -> tuple[float, float]:
    """The temperature at rest, and of how many rows it is the mean: infinite where it is known, 0 if fitted."""
    t, y, wave = rows
    before = y[t < start - rows.step] if rows.even else y[t < start]  # the row at the edge may be half-way up
    if sampled and not before.size:
        heated = np.flatnonzero(wave(t - start) > 0)
        before = y[: heated[0]] if heated.size else before
    if before.size >= FEWEST:
        level, where = float(before.mean()), "heating" if sign > 0 else "fall"
        said.append(
            f"baseline {sign * level:.4g} {unit}, the mean of {before.size} rows before the {where}, is subtracted"
        )
        return level, independent(before - level)
    first = int(np.searchsorted(t, start))
    quiet = rows.noise < NOTHING * float(np.ptp(y)) and 0 <= t[first] - start < 1e-6 * rows.step
    level = float(y[first]) if quiet else _misfit(rows.thin(), start)[1]  # at its start a rise is zero
    if start < t[0] and wave(float(t[0] - start)) > 0 and abs(level - y[first]) > np.ptp(y):
        raise InputError(
            f"the heating begins {_words(t[0] - start)} before the first row, and the rise until then, some "
            f"{abs(level - y[first]):.2g} {unit}, is larger than the rows show; give --baseline, or another --start"
        )
    if sign > 0 and abs(level) < max(NOTHING * float(np.ptp(y)), 4 * rows.noise):
        said.append("no rows before the heating and no offset: nothing is subtracted")
        return 0.0, np.inf
    said.append(
        f"no rows before the start: baseline {sign * level:.4g} {unit}, from the rows themselves, is subtracted"
    )
    return level, float(quiet)


def _check_rest(rows: Rows, start: float, unit: str, said: list[str]) -> None:
    """Warn where the rows before the heating drift, as those of a settled square wave do, which is never at rest."""
    before = rows.y[rows.t < start - rows.step]
    quarter = before.size // 4
    if quarter < FEWEST:
        return
    drift = float(before[-quarter:].mean() - before[:quarter].mean())
    noise = float(np.abs(np.diff(before)).mean()) / np.sqrt(quarter)
    if abs(drift) > DRIFT * np.ptp(rows.y) and abs(drift) > 4 * noise:
        said.append(
            f"warning: the rows before the start drift by {drift:.3g} {unit}: they are not at rest; for a settled "
            "square wave give --baseline and a --start whole periods before the file, such as ten time constants"
        )


def _words(seconds: float) -> str:
    return quantity.rounded(seconds, "s", 4)
