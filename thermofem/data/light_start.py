"""When the light behind an interferometer begins to move: the first departure from its level at rest, either way.

Heat turns a phase and the light follows its cosine, up or down or first the one and then the other, so no sum of
heating poles tells the start. A mean of some rows ahead is compared with the mean of all rows before,

    |mean(y[i:i+8]) - mean(y[:i])| > 5 sigma sqrt(1/8 + 1/i),

which gives a last possible start, t[i+8]. Near an extremum of the cosine the light departs late, so the fit of the
poles finds the start in a range before it. A fall is a drive like any other: a long pulse, in whose heat the device was
at rest, and which ends at the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import checks
from ..arrays import Array
from ..waveforms import Constant, Pulse, Waveform
from . import dataset, quantity
from .heating_start import BASELINE_ROWS, Rows

AHEAD = 8  # rows whose mean is compared with the mean of all before
SIGMAS = 5.0  # of the noise of that difference: one in a million rows of white noise
SMALLEST = 1e-6  # of the swing: noise of rows without noise
LONG = 100.0  # of the length of the record: the heating before a fall, which the poles of the record follow to rest
REST = 0.05  # of the rows: fewer at the level of rest do not tell a late departure from a late start
BEFORE = 1 / 7  # of the rows after the last possible start: how far before it the start is searched


def light_of(rows: Rows, start: float | None, fall: bool) -> tuple[Array, Array, Waveform, dict[str, Any]]:
    """Times since the earliest start, the light as it is, the drive, and attributes: start and its range.

    start [s]: of the heating or the fall, None to find it in the rows.
    Raises InputError: light that does not move; too few rows at rest; a fall after neither a constant power nor a
        pulse.
    """
    wave = _ended(rows) if fall else rows.wave
    length = wave.width if fall and isinstance(wave, Pulse) else 0.0
    what = "fall" if fall else "heating"
    if start is None:
        earliest, latest = _departure(rows, what)
    else:
        earliest = latest = start
        if start < rows.t[0]:
            late = quantity.rounded(rows.t[0] - start, "s", 4)
            rows.said.append(f"the {what} begins {late} before the first row")
    after = rows.t >= earliest
    checks.enough("table", int(after.sum()), dataset.FEWEST, f"rows after the start at {earliest:g} s")
    about: dict[str, Any] = {"start": earliest, "baseline": 0.0}
    if latest > earliest:
        about[dataset.START] = latest - earliest
    times = rows.t[after] - earliest + length
    return times, rows.y[after], wave, about


def _ended(rows: Rows) -> Pulse:
    """The power before a fall: the pulse that is given, or a long one."""
    if isinstance(rows.wave, Pulse):
        return rows.wave
    if not isinstance(rows.wave, Constant):
        raise checks.InputError("--fall goes with a constant --power, or with --pulse and the length of the heating")
    return Pulse(rows.wave.power, LONG * float(np.ptp(rows.t)))


def _departure(rows: Rows, what: str) -> tuple[float, float]:
    """Earliest and latest start in s on the clock of the file."""
    t = rows.t
    y = rows.y
    checks.enough("table", t.size, 2 * AHEAD, "rows")
    sums = np.append(0.0, np.cumsum(y - y[0]))
    index = np.arange(BASELINE_ROWS, t.size - AHEAD)
    before = sums[index] / index
    ahead = (sums[index + AHEAD] - sums[index]) / AHEAD
    noise = max(rows.noise, SMALLEST * rows.swing)
    sigma = noise * np.sqrt(1 / AHEAD + 1 / index)
    departure = np.abs(ahead - before)
    departs = np.flatnonzero(departure > SIGMAS * sigma)
    if not departs.size:
        raise checks.InputError("the light does not depart from its level at rest: is the power on in these rows?")
    first = int(index[departs[0]])
    if first < max(2 * AHEAD, REST * t.size):
        raise checks.InputError(
            f"the light moves from row {first + 1} on: too few rows show its level at rest, and so its start",
            'give --start, such as --start "0 s"',
        )
    latest = float(t[first + AHEAD])
    remaining = float(t[-1] - latest)
    earliest = max(float(t[0]), latest - BEFORE * remaining)
    span = f"{quantity.rounded(earliest, 's', 4)} and {quantity.rounded(latest, 's', 4)}"
    rows.said.append(
        f"the {what} begins between {span} on the file's clock, by the first departure of the light: fitted with the "
        "poles, --start says it"
    )
    return earliest, latest
