"""Period of a ring with a reference minus that with a model, at many points: Fig. 7 of the paper, for any ring.

Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 6.
"""

import numpy as np
import xarray as xr

from thermofem import InputError
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..resonator import RingResonator
from .hopf_plane import Window, hopf_plane
from .pulsing_map import pulsing_map

DUTIES = 0.2, 0.3  # of the points that the paper shows
POWERS, DETUNINGS = 12, 24  # points of the plane


def period_points(
    ring: RingResonator,
    reference: ThermalModel,
    model: ThermalModel,
    plane: Window | None = None,
    *,
    duties: tuple[float, float] = DUTIES,
    duration: float | None = None,
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
    duties : tuple of two floats
        least and largest duty cycle, with the reference, of the points that are kept.
    duration : float, s, optional
        of traces from a cold ring, as of `pulsing_map`; by default settled cycles.

    Returns
    -------
    Dataset
        over point: power (W), detuning (Hz), period (s, with the reference), period_model (s), error (s),
        relative_error and duty. attrs loaded_q, and missed: points at which only the reference pulses.

    Raises
    ------
    InputError
        as `pulsing_map`; no plane is given, and the ring has no Hopf curve.
    """
    window = hopf_plane(ring, reference) if plane is None else plane
    if window is None:
        raise InputError(f"ring {ring.name!r} has no Hopf curve with the reference", "it does not self-pulse")
    powers = np.geomspace(*window.powers, POWERS)
    detunings = np.linspace(*window.detunings, DETUNINGS)
    expected = pulsing_map(ring, reference, powers, detunings, duration=duration)
    found = pulsing_map(ring, model, powers, detunings, duration=duration)
    least, largest = duties
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
        ring=ring.name, loaded_q=ring.loaded_q, missed=int((in_range & ~pulses).sum()), duties=list(duties)
    )
