"""The plane of power and detuning around the lowest point of the Hopf curve: where a ring begins to self-pulse."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from thermofem.models import ThermalModel

from ..equilibria.bifurcation_curves import hopf_curves
from ..resonator import RingResonator

LOWEST_POWER, HIGHEST_POWER = 1e-8, 1.0  # W, between which the curve is looked for
LINEWIDTHS = 10.0  # on either side of the cold resonance
TIMES_THRESHOLD = 5.0  # the highest power of the plane; the paper's maps reach that much above their threshold
BELOW_THRESHOLD = 0.5  # the lowest power of a plane that shows the threshold, as a share of it
MARGIN = 0.1  # of the plane's detunings beyond the curve


class HopfPoint(NamedTuple):
    """The lowest point of the Hopf curves: power (W), detuning (Hz) and frequency (Hz) of the growing oscillation."""

    power: float
    detuning: float
    frequency: float


class Window(NamedTuple):
    """First and last power (W) and detuning (Hz) of a plane."""

    powers: tuple[float, float]
    detunings: tuple[float, float]


class Threshold(NamedTuple):
    """Where self-pulsing begins, and a plane of which it is an inner point."""

    lowest: HopfPoint
    window: Window


def lowest_hopf(ring: RingResonator, model: ThermalModel) -> HopfPoint | None:
    """Return the point of least power on the Hopf curves that bound a stable region; None where there is none.

    Above a supercritical point the ring self-pulses. Where the curve is subcritical, it may do so below, too.
    Looked for between `LOWEST_POWER` and `HIGHEST_POWER`, within `LINEWIDTHS` of the cold resonance.

    Raises InputError: as `hopf_curves`.
    """
    threshold = threshold_plane(ring, model)
    return None if threshold is None else threshold.lowest


def hopf_plane(ring: RingResonator, model: ThermalModel) -> Window | None:
    """Return a plane that the Hopf curve fills: from its least power P to `TIMES_THRESHOLD` P; None without a curve.

    Raises InputError: as `hopf_curves`.
    """
    threshold = threshold_plane(ring, model)
    if threshold is None:
        return None
    _, highest = threshold.window.powers
    return Window((threshold.lowest.power, highest), threshold.window.detunings)


def threshold_plane(ring: RingResonator, model: ThermalModel) -> Threshold | None:
    """Return the lowest Hopf point and the plane of `hopf_plane` from `BELOW_THRESHOLD` of its power on; None without.

    Raises InputError: as `hopf_curves`.
    """
    curve = _leading(ring, model)
    if not curve.sizes["point"]:
        return None
    power = curve["power"].values
    point = curve.isel(point=int(np.argmin(power)))
    lowest = HopfPoint(point["power"].item(), point["detuning"].item(), point["frequency"].item())
    highest = TIMES_THRESHOLD * lowest.power
    detunings = curve["detuning"].values[power <= highest]
    first = float(detunings.min())
    last = float(detunings.max())
    margin = MARGIN * (last - first)
    powers = (BELOW_THRESHOLD * lowest.power, highest)
    return Threshold(lowest, Window(powers, (first - margin, last + margin)))


def _leading(ring: RingResonator, model: ThermalModel) -> xr.Dataset:
    """Return the points of all Hopf curves at which no other mode grows, over point, maybe none."""
    reach = LINEWIDTHS * ring.linear_rate / np.pi
    curves = hopf_curves(ring, model, [LOWEST_POWER, HIGHEST_POWER], [-reach, reach])
    points = [curve[["power", "detuning", "frequency"]].isel(point=curve["leading"].values) for curve in curves]
    return xr.concat(points, dim="point", combine_attrs="drop") if points else xr.Dataset(coords={"point": []})
