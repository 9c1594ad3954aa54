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


def lowest_hopf(ring: RingResonator, model: ThermalModel) -> HopfPoint | None:
    """Return the point of least power on the Hopf curves that bound a stable region; None where there is none.

    Above a supercritical point the ring self-pulses. Where the curve is subcritical, it may do so below, too.
    Looked for between `LOWEST_POWER` and `HIGHEST_POWER`, within `LINEWIDTHS` of the cold resonance.

    Raises InputError: as `hopf_curves`.
    """
    curve = _leading(ring, model)
    if not curve.sizes["point"]:
        return None
    lowest = curve.isel(point=int(np.argmin(curve["power"].values)))
    return HopfPoint(lowest["power"].item(), lowest["detuning"].item(), lowest["frequency"].item())


def hopf_plane(ring: RingResonator, model: ThermalModel) -> Window | None:
    """Return a plane that the Hopf curve fills: from its least power P to `TIMES_THRESHOLD` P; None without a curve.

    Raises InputError: as `hopf_curves`.
    """
    curve = _leading(ring, model)
    if not curve.sizes["point"]:
        return None
    power = curve["power"].values
    least = float(power.min())
    highest = TIMES_THRESHOLD * least
    detunings = curve["detuning"].values[power <= highest]
    first = float(detunings.min())
    last = float(detunings.max())
    margin = MARGIN * (last - first)
    return Window((least, highest), (first - margin, last + margin))


def _leading(ring: RingResonator, model: ThermalModel) -> xr.Dataset:
    """Return the points of all Hopf curves at which no other mode grows, over point, maybe none."""
    reach = LINEWIDTHS * ring.linear_rate / np.pi
    curves = hopf_curves(ring, model, [LOWEST_POWER, HIGHEST_POWER], [-reach, reach])
    points = [curve[["power", "detuning", "frequency"]].isel(point=curve["leading"].values) for curve in curves]
    return xr.concat(points, dim="point", combine_attrs="drop") if points else xr.Dataset(coords={"point": []})
