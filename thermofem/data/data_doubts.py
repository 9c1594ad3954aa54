"""What makes a Dataset doubtful: it contradicts the thermal resistance that it states, or its trace was clipped.

A Dataset that was scaled, shifted or stored in another unit contradicts the ``thermal_resistance`` beside it. Where
no property depends on temperature, these hold for every geometry, the last where the heated part is read:

    the step response rises from 0 to R_th, so that     dT(t) <= R_th max P
    over one period of a periodic state                 mean dT = R_th mean P
    before any heat                                     dT = 0
    the step response of a heated part is concave       dT(t0) >= dT(t) t0 / t under constant power, t0 < t

What is left after a settled step has no such bound: a pole much slower than the record is possible. It is noted.

A trace is clipped where its instrument ran out of range at one end. In a settled trace, too, many rows hold the very
same extreme value, where noise is below the resolution. So they count as clipped only if the noise exceeds the
resolution, or if the trace came to them so fast that a sum of decays could not have stopped there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array
from ..checks import InputError
from ..geometry.cross_section import CrossSection
from ..piecewise import bounds
from ..waveforms import Waveform
from . import quantity

if TYPE_CHECKING:
    import xarray as xr
from numpy.typing import NDArray

from ..arrays import runs_of

WRONG = "is a unit, a scale or an offset of delta_T, power or thermal_resistance wrong?"


def static_gain(data: xr.Dataset) -> float | None:
    """The thermal resistance in K/W that belongs to ``delta_T``; None where the Dataset states none.

    Raises InputError: a thermal resistance that is not a positive number.
    """
    stated = data.attrs.get("thermal_resistance")
    if stated is None:
        return None
    return checks.positive("data.attrs['thermal_resistance']", np.asarray(stated).tolist(), unit="K/W")


def contradictions(data: xr.Dataset, wave: Waveform, times: Array, rise: Array, *, periodic: bool) -> tuple[str, ...]:
    """Doubts about a Dataset in words; InputError where it contradicts the thermal resistance that it states.

    wave, times, rise, periodic: the drive and the response, as `dataset.Response` has them.
    Raises InputError: a rise above R_th max P, or whose mean over a period is not R_th mean P, beyond the error of the
        solver, of the sampling and of the noise. Not where conductivity or specific heat depend on temperature.
    """
    swing = float(np.ptp(rise))
    # 6 sigmas of the noise of one sample: 1e-9 a sample
    noise = 6.0 * float(np.median(np.abs(np.diff(rise, 2)))) / (0.6745 * np.sqrt(6)) if rise.size > 4 else 0.0
    R = static_gain(data)
    notes = [] if periodic else _before_heat(wave, times, rise, noise + _rtol(data) * swing)
    if not periodic and data.attrs.get("heated") in (None, data.attrs.get("read")):
        notes += _cold(wave, times, rise, noise + _rtol(data) * swing)
    if R is None or _varies(data):
        return tuple(notes)
    pieces = wave.pieces(float(times[0]), float(times[-1]))
    most, slack = R * bounds(pieces)[1], 10.0 * _rtol(data)  # 10 rtol: errors of the solver add up to a few rtol
    if rise.max() > most * (1 + slack) + noise:
        raise InputError(
            f"delta_T reaches {rise.max():.4g} K, but thermal_resistance = {R:.5g} K/W allows {most:.4g} K at this "
            f"power; {WRONG}"
        )
    if periodic and abs(times[-1] - times[0] - (wave.period or 0.0)) < 1e-6 * (times[-1] - times[0]):
        length = float(times[-1] - times[0])
        mean, coarse = (float(np.trapezoid(rise[::k], times[::k])) / length for k in (1, 2))
        sampling = abs(mean - coarse) if times.size % 2 else swing / times.size
        due = R * pieces.integral() / length
        if abs(mean - due) > slack * most + noise + 2 * sampling:
            raise InputError(
                f"the mean of delta_T over its period is {mean:.4g} K, but thermal_resistance = {R:.5g} K/W makes "
                f"it {due:.4g} K; {WRONG}"
            )
    return (*notes, *_settled(wave, times, rise, R, noise + slack * most))


def _before_heat(wave: Waveform, times: Array, rise: Array, tolerance: float) -> list[str]:
    """A sentence where a transient from rest is warm before any heat."""
    heated = np.flatnonzero(wave(times) > 0)
    first = rise[: heated[0] + 1] if heated.size and times[0] == 0 else rise[:0]
    offset = float(np.abs(first).max()) if first.size else 0.0
    if offset <= max(tolerance, 0.01 * float(np.ptp(rise))):
        return []
    return [f"delta_T is {first[np.argmax(np.abs(first))]:.4g} K before any heat, 0 K is at rest; {WRONG}"]


def _cold(wave: Waveform, times: Array, rise: Array, tolerance: float) -> list[str]:
    """A sentence where a heated part is colder at the first sample than the power before it allows.

    Under constant power, and from period to period, the rise from rest is concave in time.
    """
    first, period = float(times[0]), wave.period
    if first <= 0:
        return []
    if period is None or first < period:
        try:
            low, high = bounds(wave.pieces(0.0, first))[0], bounds(wave.pieces(0.0, float(times[-1])))[1]
        except InputError:  # samples of the power that begin later say nothing about the time before
            return []
        due = float(np.max(rise * (first / times))) * (max(low, 0.0) / high if high > 0 else 0.0)
    else:
        before = first // period
        later = np.arange(1, min(1000, (times[-1] - first) // period + 1))
        due = float(np.max(np.interp(first + later * period, times, rise) * before / (before + later), initial=0))
    if rise[0] >= 0.5 * due - tolerance:
        return []
    return [
        f"delta_T is {rise[0]:.4g} K at the first sample, {quantity.rounded(first, 's')} after the power set in, which "
        f"heats to at least {due:.4g} K by then: does time begin where the power does?"
    ]


def _settled(wave: Waveform, times: Array, rise: Array, R: float, tolerance: float) -> list[str]:
    """A sentence where a step, or the mean of a square wave, has settled far below its static rise."""
    half, end = float(times[0] + times[-1]) / 2, float(times[-1])
    power = wave(times[times >= half][:-1])
    period = wave.period or 0.0
    if power.size > 1 and np.ptp(power) == 0 and power[0] > 0:
        due = R * float(power[0])
        late, early = (float(np.interp(t, times, rise)) for t in (end, half))
    elif 0 < 4 * period <= end - times[0] and times.size > 8 * (end - times[0]) / period:
        energy = np.append(0.0, np.cumsum(np.diff(times) * (rise[1:] + rise[:-1]) / 2))
        due = R * wave.mean(end - period, end)
        late, early = (
            float(np.diff(np.interp([stop - period, stop], times, energy))[0]) / period for stop in (end, half)
        )
        tolerance += float(np.ptp(rise)) * float(np.diff(times).max()) / period
    else:
        return []
    # 20.0: a rise that goes with log t gains as much in every octave; a million times longer are 20
    if due - late <= 20.0 * abs(late - early) + tolerance:
        return []
    return [
        f"delta_T has settled at {late:.4g} K, but thermal_resistance = {R:.5g} K/W ends at {due:.4g} K: only a pole "
        f"much slower than {quantity.rounded(end, 's')} explains it; {WRONG}"
    ]


def _rtol(data: xr.Dataset) -> float:
    """Relative error of the solver, as the Dataset states it."""
    stated: Any = data.attrs.get("rtol", 1e-3)  # 1e-3 for data that do not state the rtol of their solver
    return checks.between("data.attrs['rtol']", np.asarray(stated).tolist(), 0.0, 1.0)


def _varies(data: xr.Dataset) -> bool:
    """Whether a property of the geometry depends on temperature; R_th is then that of small powers."""
    text = data.attrs.get("geometry")
    if not text:
        return False
    try:
        geometry = CrossSection.from_toml_text(text)
    except InputError:
        return False  # of a newer version
    return any(geometry.material_of(name).varies for name in geometry.region_names)


FEWEST = 12  # rows at the extreme value
UNEVEN = 0.1  # differences of the steps in time, over their mean: larger ones bend what is a decay
DRIVEN = 0.3  # change of the power over that of the trace, both of their swing, from which the power made the gain


def clipping(y: Array, unit: str = "K", *, times: Array | None = None, power: Array | None = None) -> str:
    """A sentence where the largest or the smallest of the values looks clipped; else no text.

    y [shape (n,), unit]
    times, power [shape (n,)]: of the rows, and what drove them; without, rows are even and the power is constant.
    """
    swing = float(np.ptp(y)) if y.size else 0.0
    if swing <= 0:
        return ""
    y = np.round(y / swing, 9)  # 9 digits of the swing, to which values are told apart
    levels = np.unique(y)
    if levels.size < 3:
        return ""
    step = np.ones(y.size - 1) if times is None else np.diff(times)
    power = np.zeros_like(y) if power is None else power / (float(np.ptp(power)) or 1.0)
    resolution = float(np.min(np.diff(levels)))
    for extreme, beside, end in ((levels[-1], levels[-2], "largest"), (levels[0], levels[1], "smallest")):
        at = y == extreme
        piled = _piled(y, power, at, int(np.sum(y == beside)), resolution)
        if piled or _sudden(y, step, power, *_longest(at), resolution):
            return (
                f"{int(at.sum())} rows hold the {end} value, {extreme * swing:.6g} {unit}: the trace looks clipped; if "
                "it is, what is fitted to it is wrong: take a wider range of the instrument"
            )
    return ""


def _piled(y: Array, power: Array, at: NDArray[np.bool_], beside: int, resolution: float) -> bool:
    """Whether many rows stand at an end though noise exceeds the resolution: it would scatter them over values.

    at: which rows stand there.
    beside: how many rows have the value next to it.
    """
    if at.sum() < max(FEWEST, 3 * beside):  # 3 times the rows of the value next to it: noise leaves fewer at an end
        return False
    step, free = np.diff(y), ~at[1:] & ~at[:-1] & (np.abs(np.diff(power)) <= DRIVEN)
    each = free[1:] & free[:-1]  # neighbouring steps, of which neither is made by an edge of the power
    if each.sum() < FEWEST:
        return False
    turns = np.mean(step[1:][each] * step[:-1][each] < 0)
    # 0.25: share of the steps that go back: of noise two thirds, of a smooth trace none
    return bool(turns > 0.25 and np.median(np.abs(np.diff(step)[each])) / (0.6745 * np.sqrt(6)) > resolution)


def _longest(wanted: NDArray[np.bool_]) -> tuple[int, int]:
    """First row of the longest run of true values, and the row after its last."""
    return max(runs_of(wanted), key=lambda run: run[1] - run[0])


def _sudden(y: Array, step: Array, power: Array, first: int, stop: int, resolution: float) -> bool:
    """Whether what the trace gained before a run, continued as a decay, leads further than the run is.

    Gains that the power made by its own change tell nothing, nor do those between uneven rows.
    """
    most = min((stop - first) // 2, (first - 1) // 3) - 1
    # 50: resolutions of the swing, below which steps tell nothing of decays
    if stop - first < FEWEST or 50 * resolution > 1 or most < 1:
        return False
    # 60: lengths of the gains that are looked at
    for rows in np.unique(np.geomspace(1, most, 60).astype(int)).tolist():
        begin = first - 1 - 3 * rows
        early, before, last = np.diff(y[begin:first:rows]) * np.sign(y[first] - y[first - 1])
        # 8: resolutions: a gain of so many rows that it shows how fast the trace decays
        if last < 8 * resolution or np.ptp(power[begin : first + 1]) > DRIVEN * last:
            continue
        if np.ptp(step[begin:first]) > UNEVEN * np.mean(step[begin:first]):
            continue
        part = max(1, rows // 4)
        slow = abs(y[first - 1] - y[first - 1 - part]) + resolution < last * part / rows / 2
        off = 2 * resolution  # of a gain, at most
        # a ratio of two gains of 0.999 at most
        ratio = float(min((last - off) / (max(before, 0.0) + off), (before - off) / (max(early, 0.0) + off), 0.999))
        ahead = last * ratio / (1 - ratio) - abs(y[first] - y[first - 1])
        # 0.01 of the swing: what a trace must have had ahead when it stopped
        return not slow and bool(ahead > max(4 * resolution, 0.01))  # 4 resolutions, and 0.01
    return False
