"""Results of the paper's own equations and parameters, and of other readings of the printed equations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.constants import c

import coupled
from coupled.parameters import borghi2021 as paper
from thermofem.models import Foster

from .pulsing_stages import describe, label, newton_of
from .settings import CENTRE, watts
from .stages import Job
from .store import Result
from .training_stages import printed

KAPPA_SQUARED = 0.063  # power coupling into each bus, Section 2
FAINT = 1e-7  # W: -40 dBm, too little for anything nonlinear
BISTABLE = (7.0, -28.0)  # power (dBm) and detuning (GHz) at which the second-order equation has three fixed points
RUNS = {  # model, dBm, GHz
    "second order, experiment": ((7.0, -10.0), (8.0, 0.0), (10.0, 20.0)),
    "second order, FEM": ((8.0, 0.0),),
    "Newton, maps": ((7.0, -10.0),),
    "Newton, fit": ((8.0, 0.0),),
}
WEAK = 0.02  # of the bus rate: a ring that keeps its total loss, of which all but this share of the couplers' is heat


def own_models() -> dict[str, tuple[coupled.RingResonator, Foster]]:
    """Ring and thermal model of each of the paper's parameter sets."""
    ring = coupled.borghi2021()
    return {
        "second order, experiment": (ring, printed(paper.SECOND_ORDER_EXPERIMENT)),
        "second order, FEM": (ring, printed(paper.SECOND_ORDER_FEM)),
        "Newton, maps": (ring.with_lumped_fcd(), newton_of(paper.NEWTON_MAPS)),
        "Newton, fit": (ring, newton_of(paper.NEWTON_FIT)),
    }


def ring(job: Job) -> Result:
    """Results that follow from the paper's tables of parameters alone."""
    own = coupled.borghi2021()
    perimeter = job.inputs["elements"].numbers["perimeter_m"]
    model = job.inputs["elements"].models["reduction"]
    last = coupled.simulate(own, model, power=FAINT, detuning=0.0, duration=40e-6).isel(time=-1)
    laws = {"printed": own.carriers, "exchanged": own.with_swapped_srh().carriers}
    shares = {
        name: np.asarray(model.R) / np.asarray(model.tau) * paper.HEAT_CAPACITY
        for name, (_, model) in own_models().items()
        if name.startswith("second")
    }
    return Result(
        {
            "loaded_q": own.loaded_q,
            "intrinsic_q": own.intrinsic_q,
            "bus_rate_from_kappa": KAPPA_SQUARED * c / (own.group_index * perimeter) / 2,
            "bus_rate": own.bus_rate,
            "thermal_shift": own.thermal_shift,
            "eta_fca": own.eta_fca,
            "eta_tpa": own.eta_tpa,
            "g_tpa": own.g_tpa,
            "heat_capacity": paper.HEAT_CAPACITY,
            "lifetimes": {name: {"tau0": law.tau0, "a": law.a, "b": law.b} for name, law in laws.items()},
            "shares": shares,
            "faint": {name: float(last[name]) / FAINT for name in ("drop", "through", "absorbed")},
        }
    )


def runs(job: Job) -> Result:
    """Single runs and fixed points of the paper's own models, which an independent code has run as well."""
    models, numbers = own_models(), {}
    for name, points in RUNS.items():
        own, model = models[name]
        for point in points:
            numbers[f"{name}, {label(point)}"] = _settled(own, model, point)
    own, model = models["second order, experiment"]
    p = paper.SECOND_ORDER_EXPERIMENT
    more = _settled(own, printed(replace(p, eta=1.02 * p.eta)), CENTRE)["period_s"]
    less = _settled(own, printed(replace(p, eta=0.98 * p.eta)), CENTRE)["period_s"]
    numbers["period_to_eta"] = np.log(more / less) / np.log(1.02 / 0.98)
    numbers["half_drive"] = _settled(own, models["Newton, fit"][1], CENTRE, factor=0.5)
    for name, point in (("centre", CENTRE), ("bistable", BISTABLE)):
        found = coupled.steady_states(own, model, power=watts(point[0]), detuning=point[1] * 1e9)
        kept = ("energy", "carriers", "delta_T", "growth_rate", "frequency")
        numbers[name] = {key: found[key].values for key in kept} | {"regime": found["regime"].values.tolist()}
    return Result(numbers)


def _settled(
    own: coupled.RingResonator, model: Any, point: tuple[float, float], factor: float = 1.0, **options: Any
) -> dict[str, Any]:
    """The last cycle of a run of 20 us from a cold start, at ``factor`` times the power of the point."""
    run = coupled.simulate(
        own, model, power=factor * watts(point[0]), detuning=point[1] * 1e9, duration=20e-6, rtol=1e-8, **options
    )
    late = run.isel(time=run["time"].values > 10e-6)
    return describe(coupled.pulsing(run)) | {
        "highest_K": float(late["delta_T"].max()),
        "absorbed_W": float(late["absorbed"].max()),
    }


def readings(job: Job) -> Result:
    """Pulsing points under other readings of the printed equations, and linear stability on the grid of the maps."""
    s, ring, models = job.settings, coupled.borghi2021(), own_models()
    second, newton = models["second order, experiment"][1], models["Newton, maps"][1]
    kept = 2 * ring.bus_rate * (1 - WEAK)  # of the amplitude, by both couplers, that becomes heat
    hot = replace(ring, bus_rate=2 * WEAK * ring.bus_rate, drop_rate=0.0, loss_rate=ring.loss_rate + kept)
    cases = {
        "all_heat_second_order": (hot, second, 1 / (2 * WEAK)),
        "all_heat_newton": (hot.with_lumped_fcd(), newton, 1 / (2 * WEAK)),
        "second_order_lumped": (ring.with_lumped_fcd(), second, 1.0),
        "newton_two_terms": (ring, newton, 1.0),
    }
    numbers: dict[str, Any] = {}
    for name, (own, model, factor) in cases.items():
        data = coupled.pulsing_map(own, model, s.powers[::3] * factor, s.detunings[::3], duration=10e-6)
        numbers[name] = int((data["regime"] == "self-pulsing").sum())
    numbers["points"] = int(data["regime"].size)
    numbers["coupling_share"] = 1 - WEAK
    return Result(numbers)
