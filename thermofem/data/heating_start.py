"""When the heating of a measured trace begins, and from which level: found in its rows.

A temperature. For a start t_0 the rows are the best sum of poles with fixed time constants tau_i and gains that are
not negative,

    y(t) = y_0 + sum_i r_i h_i(t - t_0),        h_i = exp(-t/tau_i)/tau_i * P

and the start is the one with the smallest sum of squares. Of a fall after a long heating the same holds for -y.

Light behind an interferometer. Heat turns a phase and the light follows its cosine, up or down or first the one and
then the other, so no sum of heating poles tells the start. A mean of some rows ahead is compared with the mean of all
rows before,

    |mean(y[i:i+8]) - mean(y[:i])| > 5 sigma sqrt(1/8 + 1/i),

which gives a last possible start, t[i+8]. Near an extremum of the cosine the light departs late, so the fit of the
poles finds the start in a range before it. A fall is a drive like any other: a long pulse, in whose heat the device was
at rest, and which ends at the start.
"""

import logging
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import nnls

from .. import checks
from ..algebra.pole_responses import pole_responses
from ..arrays import Array, independent, noise_of
from ..waveforms import Constant, Pulse, Sampled, Waveform
from . import dataset, quantity

log = logging.getLogger("thermofem")

SCANNED = 1500  # rows that the search for the start uses
STARTS = 24  # of each pass of the search; a pass lies between the neighbours of the best start of the one before
POLES = 10  # time constants in a decade of the grid
EXCLUDED = 25.0  # of the variance of a row: a start that raises the sum of squares by more is excluded
BASELINE_ROWS = 3  # before the heating: fewer make no baseline
NO_OFFSET = 0.005  # of the swing: an offset below it is none
BLOCK_ROWS = 8  # at most, in a block of rows before the start
LEAST_BLOCKS = 12
REST_SIGMAS = 6.0  # of the means of blocks: a last one beyond is no rest
REST_SHARE = 1e-3  # of the swing: a smaller departure does not matter
FOLLOWED = 1e-3  # of the swing: what the grid of time constants leaves of an exact sum of poles

# of light
AHEAD = 8  # rows whose mean is compared with the mean of all before
SIGMAS = 5.0  # of the noise of that difference: one in a million rows of white noise
LONG = 100.0  # of the length of the record: the heating before a fall, which the poles of the record follow to rest
AT_REST = 0.05  # of the rows: fewer at the level of rest do not tell a late departure from a late start
BEFORE = 1 / 7  # of the rows after the last possible start: how far before it the start is searched


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table under a power: times t (s), values y, and assumptions.

    unit: of y.
    said: sentences on what was assumed; more are appended.
    what: "heating" or "fall"; of a fall ``wave`` is the power that ends.
    """

    t: Array
    y: Array
    wave: Waveform
    unit: str
    said: list[str]
    what: str = "heating"

    @property
    def step(self) -> float:
        """Median step of the times, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def swing(self) -> float:
        """Largest minus smallest value."""
        return float(np.ptp(self.y))

    @property
    def even(self) -> bool:
        """Whether the rows are about evenly spaced in time."""
        steps = np.diff(self.t)
        return bool(steps.max() < 3 * steps.min())

    @property
    def scanned(self) -> slice:
        """At most twice `SCANNED` rows, evenly picked, for the search of the start."""
        return slice(None, None, max(1, self.t.size // SCANNED))

    @property
    def ended(self) -> Constant | Pulse:
        """The power before a fall; InputError for any but a constant one and a pulse."""
        if not isinstance(self.wave, Constant | Pulse):
            rule = "--fall goes with a constant --power, or with --pulse and the length of the heating"
            raise checks.InputError(rule)
        return self.wave

    def before(self, start: float) -> Array:
        """Values of the rows before the power sets in, without the last, which may be half-way up."""
        power = np.maximum(self.wave(np.maximum(self.t - start, 0)), self.wave(0.0))
        powered = (self.t >= start) & (power > 0)
        count = int(np.argmax(powered)) if powered.any() else self.t.size
        return self.y[: max(count - 1, 0)]


# times since the start, values then, the drive, and attributes: start, baseline and how far they may be off
Beginning: TypeAlias = tuple[Array, Array, Waveform, dict[str, Any]]


def rise_of(rows: Rows, start: float | None, level: float | None) -> Beginning:
    """The temperature rise from the start of the heating on, with start and baseline and their uncertainties.

    start [s], level [K]: start of the heating or of the fall, and baseline; None to find them in the rows.
    Raises InputError: rows that fall without a fall's being stated; too few rows.
    """
    checks.enough("table", rows.t.size, dataset.FEWEST, "rows")
    ended = rows.ended if rows.what == "fall" else None
    sign = -1.0 if isinstance(ended, Constant) else 1.0
    length = 0.0
    if ended:
        rows = replace(rows, y=-rows.y, wave=Constant(ended.power))
    elif isinstance(rows.wave, Constant) and start is None and level is None:
        _check_no_fall(rows)
    t0 = _start(rows, start)
    if isinstance(ended, Pulse):  # the rows are its heating, too, from its beginning on
        rows = replace(rows, y=-rows.y, wave=ended, what="heating")
        length = ended.width
        t0 -= length
        start = t0
    offset = 0.0
    independent_rows = np.inf
    before = rows.before(t0)
    if level is not None:
        offset = sign * level
    else:
        offset, independent_rows = _baseline(rows, t0, before)
        _check_rest(rows, before)
    about: dict[str, Any] = {"start": t0 + length, "baseline": sign * offset}
    if start is None and t0 > rows.t[0]:
        about[dataset.START] = _within(rows, t0)
    if np.isfinite(independent_rows):
        about[dataset.REST] = independent_rows
    if before.size >= dataset.FEWEST:
        about[dataset.NOISE] = float(before.std(ddof=1))
    times, rise = _from(rows, t0)
    return times, rise - offset, rows.wave, about


def light_of(rows: Rows, start: float | None) -> Beginning:
    """The light as it is from the earliest start on, with the range of the start.

    start [s]: of the heating or the fall, None to find it in the rows.
    Raises InputError: light that does not move; too few rows at rest.
    """
    wave = rows.wave
    length = 0.0
    if rows.what == "fall":
        longest = LONG * float(np.ptp(rows.t))
        length = rows.ended.width if isinstance(rows.ended, Pulse) else longest
        wave = Pulse(rows.ended.power, length)
    about: dict[str, Any] = {"start": start, "baseline": 0.0}
    if start is None:
        start, latest = _departure(rows)
        about |= {"start": start, dataset.START: latest - start}
    _say_late(rows, start)
    times, light = _from(rows, start)
    return times + length, light, wave, about


def _from(rows: Rows, start: float) -> tuple[Array, Array]:
    """Times since the start, and the values then."""
    after = rows.t >= start
    words = f"rows after the start at {start:g} s"
    checks.enough("table", int(after.sum()), dataset.FEWEST, words, hint="--start sets another")
    return rows.t[after] - start, rows.y[after]


def _say_late(rows: Rows, start: float) -> None:
    """Say where the first row is later than the start; a fall shows no pole that has ended before it."""
    if start < rows.t[0]:
        late = quantity.rounded(rows.t[0] - start, "s", 4)
        lacking = ": poles faster than that do not show, and R_th lacks them" if rows.what == "fall" else ""
        rows.said.append(f"the {rows.what} begins {late} before the first row{lacking}")


def _check_no_fall(rows: Rows) -> None:
    """Raise InputError where the last tenth of the rows lies below the first."""
    tenth = max(1, rows.t.size // 10)
    first = np.median(rows.y[:tenth])
    last = np.median(rows.y[-tenth:])
    if first - last > 0.2 * rows.swing:
        raise checks.InputError("the rows fall: a fall after heating (--fall), or a diode (a negative --sensitivity)?")


def _start(rows: Rows, given: float | None) -> float:
    """Start in s on the clock of the file: the given one, zero if the rows allow it, or that of the best poles."""
    start = given
    if start is None:
        first = float(rows.t[0])
        start, least = _best(rows)
        by_clock = abs(start) <= 1.5 * rows.step  # the clock of the file may count from the edge of the power
        if first > 0:
            by_clock = rows.what == "fall" or not rows.even or _has_no_offset(rows, 0.0)
        if by_clock and _misfit(rows, 0.0)[0] <= _allowed(rows, least):
            start = 0.0
        elif 0 < start - first < 0.5 * rows.step:
            start = first
        rows.said.append(f"the {rows.what} begins at {quantity.rounded(start, 's', 4)} on the file's clock")
    _say_late(rows, start)
    return start


def _allowed(rows: Rows, least: float) -> float:
    """Sum of squares up to which a start or a baseline is not excluded; ``least``: that of the best."""
    count = rows.t[rows.scanned].size
    unseen = count * (FOLLOWED * rows.swing) ** 2
    return least * (1 + EXCLUDED / count) + unseen


def _has_no_offset(rows: Rows, start: float) -> bool:
    """Whether a rise from zero at ``start`` follows the rows."""
    first = int(np.searchsorted(rows.t, start))
    value = abs(rows.y[first])
    if rows.what == "fall" or value >= rows.swing:
        return False
    if rows.t[first] - start < 1e-6 * rows.step:  # at its start a rise is zero
        return bool(value < max(4 * noise_of(rows.y), NO_OFFSET * rows.swing))
    least = _misfit(rows, start)[0]
    return _misfit(rows, start, offset=False)[0] <= _allowed(rows, least)


def _best(rows: Rows) -> tuple[float, float]:
    """Start in s with the smallest sum of squares, and that sum, by a scan that is refined around its best point."""
    first = float(rows.t[0])
    last = float(rows.t[-dataset.FEWEST])
    start = first
    width = last - first
    least = np.inf
    while width > 0.02 * rows.step:
        starts = np.linspace(max(start - width, first), min(start + width, last), STARTS)
        misfits = [_misfit(rows, candidate)[0] for candidate in starts.tolist()]
        start = float(starts[np.argmin(misfits)])
        least = min(misfits)
        width = float(starts[1] - starts[0])
    return start, least


def _misfit(rows: Rows, start: float, *, offset: bool = True) -> tuple[float, float]:
    """Sum of squares of the best sum of heating poles that begins at ``start``, and its baseline."""
    t = rows.t[rows.scanned]
    y = rows.y[rows.scanned]
    on = t >= start
    longest = 3 * float(np.ptp(t))
    shortest = max(float(np.diff(t).min()), 1e-9 * longest)
    count = int(POLES * np.log10(longest / shortest))
    tau = np.geomspace(shortest, longest, count)
    columns = np.zeros((t.size, count + 2))
    if on.any():
        answers = pole_responses(1 / tau, rows.wave, t[on] - start) / tau
        scale = np.abs(answers).max(axis=0)
        columns[on, :count] = answers / np.where(scale > 0, scale, 1.0)
    level = 0.0
    if offset:
        columns[:, count:] = 1.0, -1.0  # a baseline of either sign
        level = float(y.mean())
    weights, norm = nnls(columns, y - level)
    up, down = weights[count:]
    return float(norm) ** 2, level + float(up - down)


def _within(rows: Rows, start: float) -> float:
    """How far from ``start`` in s the heating may begin as well, within the noise of the rows."""
    t = rows.t[rows.scanned]
    first = int(np.searchsorted(t, start))
    beside = t[max(first - BASELINE_ROWS, 0) : first + BASELINE_ROWS]
    step = float(np.median(np.diff(beside)))
    highest = _misfit(rows, start)[0] * (1 + EXCLUDED / t.size)
    for width in step * 2.0 ** np.arange(7):
        earlier = _misfit(rows, start - width)[0]
        later = _misfit(rows, start + width)[0]
        if min(earlier, later) >= highest:
            break
    return float(width)


def _baseline(rows: Rows, start: float, before: Array) -> tuple[float, float]:
    """Temperature at rest, and the number of independent rows it is the mean of: inf if it is known, 0 if fitted."""
    sign = -1 if rows.what == "fall" else 1
    if before.size >= BASELINE_ROWS:
        level = float(before.mean())
        mean = f"the mean of {before.size} rows before the {rows.what}"
        rows.said.append(f"baseline {sign * level:.6g} {rows.unit}, {mean}, is subtracted")
        return level, independent(before - level)
    if _has_no_offset(rows, start):
        rows.said.append("no rows before the heating and no offset: nothing is subtracted (--baseline says otherwise)")
        return 0.0, np.inf
    first = int(np.searchsorted(rows.t, start))
    at_start = rows.t[first] - start < 1e-6 * rows.step
    quiet = at_start and noise_of(rows.y) < NO_OFFSET * rows.swing
    level = float(rows.y[first]) if quiet else _misfit(rows, start)[1]
    late = float(rows.t[0] - start)
    unseen = abs(level - rows.y[first])
    if late > 0 and unseen > rows.swing and rows.wave(late) > 0:
        raise checks.InputError(
            f"the heating begins {quantity.rounded(late, 's', 4)} before the first row, and the rise until "
            f"then, some {unseen:.2g} {rows.unit}, is larger than the rows show",
            "give --baseline, or another --start",
        )
    words = f"baseline {sign * level:.6g} {rows.unit}, from the rows themselves, is subtracted"
    rows.said.append(f"no rows before the start: {words}")
    return level, float(quiet)


def _check_rest(rows: Rows, before: Array) -> None:
    """Warn where the last rows before the heating depart from rest, in the scatter of the means of some rows each.

    The rise of another part than the heated one begins late and slowly, so that its start is found too late. A settled
    square wave is never at rest.
    """
    size = min(BLOCK_ROWS, before.size // LEAST_BLOCKS)
    if not size:
        return
    blocks = before.size // size
    means = before[-blocks * size :].reshape(blocks, size).mean(axis=1)
    departure = float(means[-1] - np.median(means))
    if abs(departure) > max(REST_SIGMAS * noise_of(means[:-1]), REST_SHARE * rows.swing):
        rows.said.append(
            f"warning: the last {size} rows before the {rows.what} depart from rest by {departure:.2g} {rows.unit}: if "
            "another part was read than heated, give --heated, --read and --start; of a settled square wave --baseline "
            "and a --start whole periods before the file, such as ten time constants"
        )


def _departure(rows: Rows) -> tuple[float, float]:
    """Earliest and latest start of light in s on the clock of the file."""
    t = rows.t
    y = rows.y
    checks.enough("table", t.size, 2 * AHEAD, "rows")
    sums = np.append(0.0, np.cumsum(y - y[0]))
    index = np.arange(BASELINE_ROWS, t.size - AHEAD)
    before = sums[index] / index
    ahead = (sums[index + AHEAD] - sums[index]) / AHEAD
    sigma = noise_of(y) * np.sqrt(1 / AHEAD + 1 / index)
    departs = index[np.abs(ahead - before) > SIGMAS * sigma]
    if not departs.size:
        raise checks.InputError("the light does not depart from its level at rest: is the power on in these rows?")
    first = int(departs[0])
    if first < max(2 * AHEAD, AT_REST * t.size):
        raise checks.InputError(
            f"the light moves from row {first + 1} on: too few rows show its level at rest, and so its start",
            'give --start, such as --start "0 s"',
        )
    latest = float(t[first + AHEAD])
    remaining = float(t[-1] - latest)
    earliest = max(float(t[0]), latest - BEFORE * remaining)
    span = f"{quantity.rounded(earliest, 's', 4)} and {quantity.rounded(latest, 's', 4)}"
    rows.said.append(
        f"the {rows.what} begins between {span} on the file's clock, by the first departure of the light: fitted with "
        "the poles, --start says it"
    )
    return earliest, latest


def sampled_power(times: Array, power: Array) -> Waveform:
    """Waveform of a column of power (W): straight lines between its rows from t = 0 on, constant before the first."""
    after = times >= 0
    times = times[after]
    power = power[after]
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
