"""When the heating of a measured trace begins, and from which temperature: found in its rows.

For a start t_0 the rows are the best sum of poles with fixed time constants tau_i and gains that are not negative,

    y(t) = y_0 + sum_i r_i h_i(t - t_0),        h_i = exp(-t/tau_i)/tau_i * P

and the start is the one with the smallest sum of squares. Of a fall after a long heating the same holds for -y.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import nnls

from .. import checks
from ..algebra.pole_responses import pole_responses
from ..arrays import Array, independent
from ..waveforms import Constant, Pulse, Sampled, Waveform
from . import dataset, quantity
from .data_doubts import clipping

log = logging.getLogger("thermofem")

SCANNED = 1500  # rows that the search for the start uses
STARTS, PASSES = 24, 5  # starts of each pass of the search, each pass as fine as two of the one before
POLES = 30  # time constants of the grid: 12 put the start of two poles a third of a row late
EXCLUDED = 25.0  # of the variance of a row: a start that raises the sum of squares by more is excluded
BASELINE_ROWS = 3  # before the heating: fewer make no baseline
NO_OFFSET = 0.005  # of the swing: an offset below it is none
EDGE_ROWS = 8  # in a block of rows before the start
LEAST_BLOCKS = 12
EDGE_SIGMAS = 6.0  # of the means of blocks: a last one beyond is no rest
EDGE_SHARE = 1e-3  # of the swing: a smaller departure does not matter
FOLLOWED = 1e-3  # of the swing: what the grid of time constants leaves of an exact sum of poles


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table under a power: times t (s), temperatures y (K, or V as ``unit`` says), and assumptions."""

    t: Array
    y: Array
    wave: Waveform
    unit: str
    said: list[str]

    @property
    def step(self) -> float:
        """Median step of the times, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def swing(self) -> float:
        """Largest minus smallest temperature."""
        return float(np.ptp(self.y))

    @property
    def noise(self) -> float:
        """Standard deviation of one row, from second differences."""
        second_differences = np.abs(np.diff(self.y, 2))
        return float(np.median(second_differences)) / (0.6745 * np.sqrt(6))

    @property
    def even(self) -> bool:
        """Whether the rows are about evenly spaced in time."""
        steps = np.diff(self.t)
        return bool(steps.max() < 3 * steps.min())

    def thin(self) -> Rows:
        """At most twice `SCANNED` rows, evenly picked."""
        every = max(1, self.t.size // SCANNED)
        return replace(self, t=self.t[::every], y=self.y[::every])


def rise_of(
    rows: Rows, start: float | None, level: float | None, fall: bool, sampled: bool
) -> tuple[Array, Array, dict[str, Any]]:
    """Times after the start of heating, the temperature rise, and attributes: start, baseline and their uncertainty.

    start [s], level [K]: start of heating and baseline, None to find them in the rows.
    sampled: whether the power comes from a column of the table.
    Raises InputError: rows that fall without ``fall``.
    """
    t = rows.t
    wave = rows.wave
    checks.enough("table", t.size, dataset.FEWEST, "rows")
    if not fall and isinstance(wave, Constant) and start is None and level is None:
        _check_no_fall(rows)
    sign = 1.0
    length = 0.0
    what = "heating"
    if fall and isinstance(wave, Pulse):
        length = wave.width
        cooling = replace(rows, y=-rows.y, wave=Constant(wave.power))
        end, _ = _start(cooling, start, "fall")
        start = end - length
    elif fall:
        if not isinstance(wave, Constant):
            raise checks.InputError(
                "--fall goes with a constant --power, or with --pulse and the length of the heating"
            )
        sign = -1.0
        what = "fall"
        rows = replace(rows, y=-rows.y)
    t0, at_rest = _start(rows, start, what)
    offset = 0.0
    independent_rows = np.inf
    if level is not None:
        offset = sign * level
    elif not at_rest:
        offset, independent_rows = _baseline(rows, t0, sampled, what)
        _check_rest(rows, t0)
        if start is None:
            _check_edge(rows, t0, what)
    after = t >= t0
    if clipped := clipping(rows.y[~after], rows.unit):  # the rows after it are judged with their drive: `response_of`
        rows.said.append(f"warning: before the heating {clipped}")
    words = f"rows after the start at {t0:g} s"
    checks.enough("table", int(after.sum()), dataset.FEWEST, words, hint="--start sets another")
    about: dict[str, Any] = {"start": t0 + length, "baseline": sign * offset}
    if start is None and not after.all():
        about[dataset.START] = _within(rows, t0)
    if np.isfinite(independent_rows):
        about[dataset.REST] = independent_rows
    before = rows.y[t < t0 - rows.step]
    if before.size >= dataset.FEWEST:
        about[dataset.NOISE] = float(before.std(ddof=1))
    return t[after] - t0, rows.y[after] - offset, about


def _check_no_fall(rows: Rows) -> None:
    """Raise InputError where the last tenth of the rows lies below the first."""
    tenth = max(1, rows.t.size // 10)
    first = np.median(rows.y[:tenth])
    last = np.median(rows.y[-tenth:])
    if first - last > 0.2 * rows.swing:
        raise checks.InputError("the rows fall: a fall after heating (--fall), or a diode (a negative --sensitivity)?")


def _start(rows: Rows, given: float | None, what: str) -> tuple[float, bool]:
    """Start of heating in s on the clock of the file, and whether the record begins at rest with no offset."""
    t = rows.t
    said = rows.said
    if given is not None:
        if given < t[0]:
            said.append(_late_words(what, float(t[0] - given)))
        return given, False
    best, least = _best(rows)
    few = rows.thin()
    swing = rows.swing
    first = abs(rows.y[0])
    unseen = few.t.size * (FOLLOWED * swing) ** 2
    most = least * (1 + EXCLUDED / few.t.size) + unseen
    if t[0] >= 0 and what == "heating" and first < swing:
        quiet = t[0] > 0 or first <= max(4 * rows.noise, NO_OFFSET * swing)
        if quiet and _misfit(few, 0.0, offset=False)[0] <= most:
            said.append(
                "no rows before the heating: the power sets in at t = 0, where the rise is zero, and nothing is "
                "subtracted (--start and --baseline say otherwise)"
            )
            return 0.0, True
    if what == "fall" and t[0] > 0 and _misfit(few, 0.0)[0] <= most:
        said.append(
            f"no rows before the fall: the power ends at t = 0 (--start says otherwise). {_late_words(what, t[0])}"
        )
        return 0.0, False
    if not rows.even and t[0] >= 0 and _misfit(few, 0.0)[0] <= least + unseen:
        best = 0.0
    elif t[0] <= 0 < t[-1] and abs(best) <= 1.5 * rows.step:
        misfit = max(_misfit(few, best)[0], 1e-9 * swing**2)
        if _misfit(few, 0.0)[0] <= 1.05 * misfit:
            best = 0.0
    if 0 < best - t[0] < 0.5 * rows.step:
        best = float(t[0])
    said.append(f"the {what} begins at {quantity.rounded(best, 's', 4)} on the file's clock")
    return best, False


def _late_words(what: str, late: float) -> str:
    """Words on a first row that is ``late`` s after the start; a fall shows no pole that has ended before it."""
    size = quantity.rounded(late, "s", 4)
    lacking = ": poles faster than that do not show, and R_th lacks them" if what == "fall" else ""
    return f"the {what} begins {size} before the first row{lacking}"


def _best(rows: Rows) -> tuple[float, float]:
    """Start in s with the smallest sum of squares, and that sum, by a scan that is refined around its best point."""
    first = float(rows.t[0])
    last = float(rows.t[-dataset.FEWEST])
    low = first
    high = last
    few = rows.thin()
    best = (first, np.inf)
    for _ in range(PASSES):
        starts = np.linspace(low, high, STARTS)
        misfits = [_misfit(few, float(s))[0] for s in starts]
        k = int(np.argmin(misfits))
        best = (float(starts[k]), misfits[k])
        width = (high - low) / (STARTS - 1)
        low = max(best[0] - width, first)
        high = min(best[0] + width, last)
        if width < 0.02 * rows.step:
            break
    return best


def _misfit(rows: Rows, start: float, *, offset: bool = True) -> tuple[float, float]:
    """Sum of squares of the best sum of heating poles that begins at ``start``, and its baseline."""
    t = rows.t
    y = rows.y
    u = t - start
    on = u >= 0
    span = float(t[-1] - t[0])
    if rows.even:
        shortest = max(rows.step, span * 1e-5)
        tau = np.geomspace(shortest, 3 * span, POLES)
    else:
        first = float(u[u > 0].min(initial=span))  # the start may lie behind every row
        shortest = max(first / 10, span * 1e-9)
        tau = np.geomspace(shortest, 3 * span, 2 * POLES)
    columns = np.zeros((t.size, tau.size + 2))
    if on.any():
        answers = pole_responses(1 / tau, rows.wave, u[on]) / tau
        scale = np.abs(answers).max(axis=0)
        columns[on, : tau.size] = answers / np.where(scale > 0, scale, 1.0)
    if offset:
        columns[:, tau.size :] = 1.0, -1.0  # a baseline of either sign
    level = float(y.mean()) if offset else 0.0
    weights, norm = nnls(columns, y - level)
    up, down = weights[tau.size :]
    return float(norm) ** 2, level + float(up - down)


def _within(rows: Rows, start: float) -> float:
    """How far from ``start`` in s the heating may begin as well, within the noise of the rows."""
    few = rows.thin()
    first = int(np.searchsorted(few.t, start))
    beside = few.t[max(first - BASELINE_ROWS, 0) : first + BASELINE_ROWS]
    step = float(np.median(np.diff(beside)))
    highest = _misfit(few, start)[0] * (1 + EXCLUDED / few.t.size)
    count = 1
    while count < 64:
        earlier, _ = _misfit(few, start - count * step)
        later, _ = _misfit(few, start + count * step)
        if min(earlier, later) >= highest:
            break
        count *= 2
    return count * step


def _baseline(rows: Rows, start: float, sampled: bool, what: str) -> tuple[float, float]:
    """Temperature at rest, and the number of independent rows it is the mean of: inf if it is known, 0 if fitted."""
    t = rows.t
    y = rows.y
    unit = rows.unit
    last = start - rows.step if rows.even else start  # the row at the edge may be half-way up
    before = y[t < last]
    if sampled and not before.size:
        heated = np.flatnonzero(rows.wave(t - start) > 0)
        before = y[: heated[0]] if heated.size else before
    sign = -1 if what == "fall" else 1
    if before.size >= BASELINE_ROWS:
        level = float(before.mean())
        mean = f"the mean of {before.size} rows before the {what}"
        rows.said.append(f"baseline {sign * level:.4g} {unit}, {mean}, is subtracted")
        return level, independent(before - level)
    first = int(np.searchsorted(t, start))
    offset_limit = NO_OFFSET * rows.swing
    quiet = rows.noise < offset_limit and 0 <= t[first] - start < 1e-6 * rows.step
    level = float(y[first]) if quiet else _misfit(rows.thin(), start)[1]  # at its start a rise is zero
    late = float(t[0] - start)
    unseen = abs(level - y[first])
    if late > 0 and unseen > rows.swing and rows.wave(late) > 0:
        raise checks.InputError(
            f"the heating begins {quantity.rounded(late, 's', 4)} before the first row, and the rise until "
            f"then, some {unseen:.2g} {unit}, is larger than the rows show",
            "give --baseline, or another --start",
        )
    if sign > 0 and abs(level) < max(offset_limit, 4 * rows.noise):
        rows.said.append("no rows before the heating and no offset: nothing is subtracted")
        return 0.0, np.inf
    words = f"baseline {sign * level:.4g} {unit}, from the rows themselves, is subtracted"
    rows.said.append(f"no rows before the start: {words}")
    return level, float(quiet)


def _check_rest(rows: Rows, start: float) -> None:
    """Warn where the rows before the heating drift, as in a settled square wave, which is never at rest."""
    before = rows.y[rows.t < start - rows.step]
    quarter = before.size // 4
    if quarter < BASELINE_ROWS:
        return
    first = before[:quarter].mean()
    last = before[-quarter:].mean()
    drift = float(last - first)
    noise = float(np.abs(np.diff(before)).mean()) / np.sqrt(quarter)
    if abs(drift) > max(0.05 * rows.swing, 4 * noise):
        rows.said.append(
            f"warning: the rows before the start drift by {drift:.3g} {rows.unit}: they are not at rest; for a settled "
            "square wave give --baseline and a --start whole periods before the file, such as ten time constants"
        )


def _check_edge(rows: Rows, start: float, what: str) -> None:
    """Warn where the last rows before the start that was found depart from rest.

    The rise of another part than the heated one begins late and slowly, so that its start is found too late. Blocks of
    `EDGE_ROWS` rows are compared: the mean of the last one with the means of those before.
    """
    before = rows.y[rows.t < start - rows.step]
    blocks = before.size // EDGE_ROWS
    if blocks < LEAST_BLOCKS:
        return
    means = before[-blocks * EDGE_ROWS :].reshape(blocks, EDGE_ROWS).mean(axis=1)
    departure = float(means[-1] - np.median(means))
    scatter = float(np.median(np.abs(np.diff(means[:-1])))) / (0.6745 * np.sqrt(2))
    if abs(departure) > max(EDGE_SIGMAS * scatter, EDGE_SHARE * rows.swing):
        rows.said.append(
            f"warning: the last {EDGE_ROWS} rows before the {what} that was found depart from rest by "
            f"{departure:.2g} {rows.unit}: if another part was read than heated, give --heated, --read and --start"
        )


def sampled_power(times: Array, power: Array) -> Waveform:
    """Waveform of a column of power (W): straight lines between its rows; from t = 0 to the first row constant."""
    jumps = np.abs(np.diff(power)) > 0.5 * np.ptp(power)
    steep = np.flatnonzero(jumps & (np.diff(times) > 0))
    if steep.size:
        log.warning(
            "the power changes by more than half its range between rows, %d times, first at t = %g s; these are taken "
            "as ramps; where they are edges, write a row for both sides of each at one time",
            steep.size,
            times[steep[0]],
        )
    if times[0] > 0:
        times = np.append(0.0, times)
        power = np.append(power[0], power)
    return Sampled(times, power)
