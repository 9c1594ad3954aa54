"""The plane of power and detuning around the lowest point of the Hopf curve, and errors of the period in it."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from thermofem import InputError
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..equilibria.bifurcation_curves import hopf_curves
from ..resonator import RingResonator
from .pulsing_map import pulsing_map

LOWEST_POWER, HIGHEST_POWER = 1e-8, 1.0  # W, between which the curve is looked for
LINEWIDTHS = 10.0  # on either side of the cold resonance
TIMES_THRESHOLD = 5.0  # the highest power of the plane; the paper's maps reach that much above their threshold
BELOW_THRESHOLD = 0.5  # the lowest power of a plane that shows the threshold, as a share of it
DUTIES = 0.2, 0.3  # of the points that the paper shows
POWERS, DETUNINGS = 12, 24  # points of the plane


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
    margin = 0.1 * (last - first)
    powers = (BELOW_THRESHOLD * lowest.power, highest)
    return Threshold(lowest, Window(powers, (first - margin, last + margin)))


def _leading(ring: RingResonator, model: ThermalModel) -> xr.Dataset:
    """Return the points of all Hopf curves at which no other mode grows, over point, maybe none."""
    reach = LINEWIDTHS * ring.linear_rate / np.pi
    curves = hopf_curves(ring, model, [LOWEST_POWER, HIGHEST_POWER], [-reach, reach])
    points = [curve[["power", "detuning", "frequency"]].isel(point=curve["leading"].values) for curve in curves]
    return xr.concat(points, dim="point", combine_attrs="drop") if points else xr.Dataset(coords={"point": []})


def period_points(
    ring: RingResonator,
    reference: ThermalModel,
    model: ThermalModel,
    plane: Window | None = None,
) -> xr.Dataset:
    """Return the period error of a model in a ring that self-pulses, at every point where both pulse.

        error = T_reference - T_model,   relative_error = error/T_reference

    `surrogate.period_error` takes a square wave in place of the light, and so does not know the Q of a ring. These
    points do.

    Parameters
    ----------
    ring : RingResonator
    reference, model : ThermalModel
    plane : Window, optional
        first and last power (W) and detuning (Hz); by default `hopf_plane` of the reference.

    Returns
    -------
    Dataset
        over point, where the duty cycle with the reference is between the two `DUTIES`: power (W), detuning (Hz),
        period (s, with the reference), period_model (s), error (s), relative_error and duty. attrs loaded_q, and
        missed: points at which only the reference pulses.

    Raises
    ------
    InputError
        as `pulsing_map`; no plane is given, and the ring has no Hopf curve.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 6 and Fig. 7.
    """
    window = hopf_plane(ring, reference) if plane is None else plane
    if window is None:
        raise InputError(f"ring {ring.name!r} has no Hopf curve with the reference", "it does not self-pulse")
    powers = np.geomspace(*window.powers, POWERS)
    detunings = np.linspace(*window.detunings, DETUNINGS)
    expected = pulsing_map(ring, reference, powers, detunings)
    found = pulsing_map(ring, model, powers, detunings)
    least, largest = DUTIES
    in_range = (expected["duty"] >= least) & (expected["duty"] <= largest)
    pulses = np.isfinite(found["period"])
    period = expected["period"].where(in_range & pulses)
    points = xr.Dataset({"period": period, "period_model": found["period"], "duty": expected["duty"]})
    points = points.stack(point=("power", "detuning")).dropna("point", subset=["period"]).reset_index("point")
    points = points.reset_coords(["power", "detuning"])
    points["error"] = points["period"] - points["period_model"]
    points["relative_error"] = points["error"] / points["period"]
    for name in points:
        points[name].attrs = dataset.describe(str(name))
    return points.assign_attrs(
        ring=ring.name, loaded_q=ring.loaded_q, missed=int((in_range & ~pulses).sum()), duties=list(DUTIES)
    )
