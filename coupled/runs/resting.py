"""The fixed points at which a run can come to rest, from the ring, thermal model and light in its attributes.

Slow modes may outlast a trace, so that a trace near an unstable fixed point may look like rest for long. Only the
eigenvalues at the fixed point decide whether it is stable.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import Foster, InputError, OutputMap
from thermofem.arrays import Array
from thermofem.ring_temperature import GuidedMode

from ..carriers import law_with
from ..equilibria.steady_states import steady_states
from ..heaters import turned_by
from ..resonator import RingResonator
from ..thermal import as_read

if TYPE_CHECKING:
    import xarray as xr

TINY = 1e-99  # J and K, of a dark ring


class Rest(NamedTuple):
    """All fixed points of a ring under one light; the arrays have an entry for each."""

    energy: Array
    """Light energy, J."""
    delta_T: Array
    """Temperature rise, K."""
    growth: Array
    """Largest real part of the eigenvalues, 1/s."""

    def nearest(self, energy: float, delta_T: float) -> tuple[int, float]:
        """Return the index of the fixed point nearest to a state, and the larger relative error of energy and rise."""
        points = np.array([self.energy, self.delta_T])
        state = np.array([[energy], [delta_T]])
        scale = np.maximum(np.abs(points), np.abs(state) + TINY)
        errors = (np.abs(points - state) / scale).max(axis=0)
        return int(errors.argmin()), float(errors.min())


def rest_of_run(run: xr.Dataset) -> Rest | None:
    """Return the fixed points under the light at the end of a run; None where its attributes do not determine them.

    This is so for traces that are not of `simulate`, for quadratic models, and for several lasers.
    """
    attrs = run.attrs
    if "lasers" in attrs:
        return None
    try:
        ring = ring_in(attrs["ring_parameters"])
        rise = float(attrs.get("heater_rise", 0.0))
        power = _at_end(run, "input_power")
        detuning = _at_end(run, "detuning") + turned_by(rise, ring)
        model: Any = Foster(np.atleast_1d(attrs["model_R"]), np.atleast_1d(attrs["model_tau"]))
        if "model_coefficient" in attrs:
            model = OutputMap(model, attrs["model_coefficient"])
        if power == 0:
            return Rest(np.zeros(1), np.array([rise]), np.array([-np.inf]))
        points = steady_states(as_read(ring, model), model, power=power, detuning=detuning)
        return Rest(points["energy"].values, points["delta_T"].values + rise, points["growth_rate"].values)
    except (InputError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None  # attributes that another program wrote


def _at_end(run: xr.Dataset, name: str) -> float:
    """Return a quantity of the light at the end of a run, from its trace or else its attribute."""
    return float(run[name].values[-1] if name in run.variables else run.attrs[name])


def ring_in(text: str) -> RingResonator:
    """Return the ring from the JSON text that `resonator.origin` wrote."""
    fields = json.loads(text)
    law = law_with(fields["carriers"])
    pairs = {name: tuple(tuple(pair) for pair in fields[name]) for name in ("fcd", "rates")}
    mode = GuidedMode(*fields["mode"]) if fields["mode"] else None
    return RingResonator(**fields | pairs | {"carriers": law(**fields["carriers"]), "mode": mode})
