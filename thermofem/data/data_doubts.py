"""What makes a Dataset doubtful: it contradicts the thermal resistance that it states, or its trace was clipped.

A Dataset that was scaled, shifted or stored in another unit contradicts the ``thermal_resistance`` beside it. Where
no property depends on temperature, these hold for every geometry:

    the step response rises from 0 to R_th, so that     dT(t) <= R_th max P
    over one period of a periodic state                 mean dT = R_th mean P
    before any heat                                     dT = 0

A trace is clipped where its instrument ran out of range at one end: many rows hold the very same extreme value. So do
rows of a settled trace, but a sum of decays approaches its end slowly: it has more rows within 2 % of the swing from
the end than between 2 and 10 %.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..arrays import Array, noise_of, runs_of
from ..piecewise import bounds
from ..waveforms import Waveform

if TYPE_CHECKING:
    import xarray as xr

WRONG = "is a unit, a scale or an offset of delta_T, power or thermal_resistance wrong?"


def contradictions(
    data: xr.Dataset, R: float | None, wave: Waveform, times: Array, rise: Array, *, periodic: bool
) -> list[str]:
    """Sentences on doubtful data; InputError where they contradict the thermal resistance that the Dataset states.

    R [K/W]: that resistance, None where there is none.
    wave, times, rise, periodic: the drive and the response, as `dataset.Response` has them.
    Raises InputError: a rise above R_th max P, or whose mean over a period is not R_th mean P, beyond the error of the
        solver, of the sampling and of the noise. Not where the attribute ``temperature_dependent`` says that
        conductivity or specific heat depend on temperature.
    """
    swing = float(np.ptp(rise))
    noise = 6.0 * noise_of(rise)  # 1e-9 a sample are beyond 6 sigmas
    # 1e-3: of data that do not state the relative error of their solver
    rtol = checks.between("data.attrs['rtol']", data.attrs.get("rtol", 1e-3), 0.0, 1.0)
    offset = 0.0 if periodic else _before_heat(wave, times, rise)
    shown = abs(offset) > max(noise + rtol * swing, 0.01 * swing)
    notes = [f"delta_T is {offset:.4g} K before any heat, 0 K is at rest; {WRONG}"] if shown else []
    if R is None or data.attrs.get("temperature_dependent"):
        return notes
    begin = float(times[0])
    end = float(times[-1])
    most = R * bounds(wave.pieces(begin, end))[1]
    slack = 10.0 * rtol  # 10 rtol: errors of the solver add up to a few rtol
    highest = rise.max()
    if highest > most * (1 + slack) + noise:
        raise checks.InputError(
            f"delta_T reaches {highest:.4g} K, but thermal_resistance = {R:.5g} K/W allows {most:.4g} K at this "
            f"power; {WRONG}"
        )
    length = end - begin
    if periodic and abs(length - (wave.period or 0.0)) < 1e-6 * length:
        mean = float(np.trapezoid(rise, times)) / length
        coarse = float(np.trapezoid(rise[::2], times[::2])) / length
        sampling = abs(mean - coarse) if times.size % 2 else swing / times.size
        due = R * wave.mean(begin, end)
        tolerance = slack * most + noise + 2 * sampling
        if abs(mean - due) > tolerance:
            raise checks.InputError(
                f"the mean of delta_T over its period is {mean:.4g} K, but thermal_resistance = {R:.5g} K/W makes "
                f"it {due:.4g} K; {WRONG}"
            )
    return notes


def _before_heat(wave: Waveform, times: Array, rise: Array) -> float:
    """The largest rise (K) of a transient from rest before its power begins, 0.0 where it shows no such time."""
    heated = np.flatnonzero(wave(times) > 0)
    if not heated.size or times[0] != 0:
        return 0.0
    first = rise[: heated[0] + 1]
    return float(first[np.argmax(np.abs(first))])


CLIPPED_ROWS = 12  # at the extreme value, at least


def clipping(y: Array, unit: str = "K") -> str:
    """A sentence where many values y (in ``unit``) equal the largest or the smallest one, as if clipped; else ""."""
    swing = float(np.ptp(y)) if y.size else 0.0
    if swing <= 0:
        return ""
    for sign, end in ((1, "largest"), (-1, "smallest")):
        upward = sign * y
        below = (np.max(upward) - upward) / swing
        extreme = below <= 1e-9
        first, stop = max(runs_of(extreme), key=lambda run: run[1] - run[0])
        far = np.append(True, below[:first] > 0.5)
        begin = int(np.flatnonzero(far)[-1])  # of the way to the end
        approach = below[begin:first][~extreme[begin:first]]
        last = int(np.sum(approach < 0.02))
        before = int(np.sum(approach < 0.1)) - last
        if stop - first >= CLIPPED_ROWS and before >= 3 and 2 * last < before:
            count = int(extreme.sum())
            return (
                f"{count} rows hold the {end} value, {y[first]:.6g} {unit}: the trace looks clipped; if it is, "
                "what is fitted to it is wrong: take a wider range of the instrument"
            )
    return ""
