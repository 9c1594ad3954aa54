"""Stages on heat alone: the FEM, its reduction, its answers to the paper's drives, and the models trained on them."""

from __future__ import annotations

import functools
import time
from typing import Any

import numpy as np

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper
from surrogate.ladder import shells

from ... import checks
from ...geometry import strip_ring
from ...heat import HeatProblem, assemble
from ...model import Foster, StateSpace, foster
from ...solve import solve, solve_periodic
from ...waveforms import Pulse, SquareWave
from .settings import CENTRE, HEATING, watts
from .stages import Job
from .store import Result, slug

PULSE = 20e-6  # s, Fig. 5(a)
PERIODS = np.geomspace(0.1e-6, 10e-6, 41)  # s, Fig. 7


@functools.lru_cache(2)
def elements_of(accuracy: float) -> HeatProblem:
    """The FEM of the reference strip: a ring of the same perimeter as the paper's racetrack."""
    return assemble(strip_ring(), accuracy)


def elements(job: Job) -> Result:
    """The FEM and its certified reductions: "reduction" to 1e-4, and "elements" to 1e-6, which maps use."""
    heat = elements_of(job.settings.accuracy)
    begin = time.process_time()
    rom = surrogate.reduce(heat.system, tolerance=1e-4)
    seconds = time.process_time() - begin
    fine = surrogate.reduce(heat.system, tolerance=1e-6)
    perimeter = 2 * np.pi * (heat.geometry.parts[0].inner_radius + heat.geometry.parts[0].outer_radius) / 2
    tau = foster(rom.model).tau if isinstance(rom.model, StateSpace) else rom.model.tau
    numbers = {
        "unknowns": heat.unknowns,
        "perimeter_m": perimeter,
        "thermal_resistance_K_per_W": heat.thermal_resistance(),
        "poles": rom.order,
        "bound": rom.error_bound,
        "reduction_seconds": seconds,
        "fine_poles": fine.order,
        "fine_bound": fine.error_bound,
        "shortest_tau_s": float(np.min(tau)),
        "longest_tau_s": float(np.max(tau)),
    }
    return Result(numbers, models={"reduction": rom.model, "elements": fine.model})


def oxide(job: Job) -> Result:
    """The ring under half the oxide, of which the paper does not say how thick it is; nothing where gmsh is missing."""
    try:
        heat = assemble(strip_ring(cladding=1e-6), job.settings.accuracy)
    except checks.MissingLibraryError as error:
        return Result({"thermal_resistance_K_per_W": None, "period_s": None, "reason": str(error)})
    model = surrogate.reduce(heat.system, tolerance=1e-4).model
    run = coupled.simulate(
        coupled.borghi2021(), model, power=watts(CENTRE[0]), detuning=CENTRE[1] * 1e9, duration=20e-6
    )
    return Result({"thermal_resistance_K_per_W": heat.thermal_resistance(), "period_s": coupled.pulsing(run).period})


def pulse(job: Job) -> Result:
    """Fig. 5(a): 2 mW for 20 us, and exponentials through its rise and fall, uniform samples so that no time counts
    more than another."""
    edge = np.geomspace(1e-9, 1e-6, 40)
    times = np.unique(np.concatenate([np.linspace(0, 2 * PULSE, 801), edge, PULSE + edge]))
    data = solve(elements_of(job.settings.accuracy), Pulse(HEATING, width=PULSE), times, field_times=[21e-6])
    rise = data.drop_dims("field_time").sel(time=np.linspace(0, PULSE, 401), method="nearest")
    fall = data.sel(time=np.linspace(PULSE, 2 * PULSE, 401), method="nearest")
    single = surrogate.fit_newton(rise)
    double = surrogate.fit_decay(fall["time"] - PULSE, fall["delta_T"])
    numbers = {
        "rise_K": float(data["delta_T"].max()),
        "rise_tau_s": single.parameters["tau_th"],
        "rise_misfit_K": single.residual,
        "fall_tau_s": double.tau,
        "fall_amplitude_K": double.amplitude,
        "fall_misfit_K": double.residual,
    }
    return Result(numbers, {"pulse": data}, {"rise": single.model})


def squares(job: Job) -> Result:
    """Square waves of 1 and 0.8 us, 2 mW, 33 %: the FEM's periodic state."""
    data, numbers = {}, {}
    for name, period in (("1us", 1e-6), ("0.8us", 0.8e-6)):
        data[name] = solve_periodic(elements_of(job.settings.accuracy), SquareWave(HEATING, period, 0.33))
        numbers[f"swing_{name}_K"] = float(np.ptp(data[name]["delta_T"].values))
    return Result(numbers, data)


def training(job: Job) -> Result:
    """Newton's law, the second-order equation and SINDy, trained on the FEM."""
    numbers: dict[str, Any] = {}
    models: dict[str, Any] = {}
    for name, data in job.inputs["squares"].data.items():
        for kind, fit in (("newton", surrogate.fit_newton(data)), ("second_order", surrogate.fit_second_order(data))):
            models[f"{kind}_{name}"] = fit.model
            numbers[f"{kind}_{name}"] = {
                **fit.parameters,
                "standard_errors": dict(fit.standard_errors),
                "misfit_K": fit.residual,
                "thermal_resistance": fit.model.thermal_resistance,
            }
    sindy = surrogate.fit_sindy(*shells(elements_of(job.settings.accuracy), "core", HEATING))
    models["sindy"] = sindy.model.poles
    numbers["sindy"] = {
        "states": sindy.model.order,
        "equations": sindy.equations,
        "thermal_resistance": sindy.model.thermal_resistance,
        "relative_misfit": sindy.relative_residual,
    }
    reference = job.inputs["elements"].models["elements"]
    trained = {name: models[name] for name in ("newton_1us", "second_order_1us", "sindy")}
    judged = surrogate.compare(trained, reference, surrogate.square_waves(HEATING))
    rms = np.sqrt(np.mean(judged["rms_relative"].values ** 2, axis=1))
    numbers["rms_over_swing"] = dict(zip(trained, rms, strict=True))
    return Result(numbers, models=models)


def periods(job: Job) -> Result:
    """Fig. 7: period error of every model against the FEM, by the paper's method, 0.1 to 10 us."""
    reference, trained = job.inputs["elements"].models, job.inputs["training"].models
    models = {
        "Newton": trained["newton_1us"],
        "second order": trained["second_order_1us"],
        "second order, the paper's": printed(paper.SECOND_ORDER_FEM),
        "SINDy": trained["sindy"],
        "reduction": reference["reduction"],
    }
    curves, numbers = {}, {}
    for name, model in models.items():
        curve = surrogate.period_error(model, reference["elements"], PERIODS, power=HEATING, duty=1 / 3)
        curves[slug(name)] = curve.assign_attrs(model=name)
        low, high = surrogate.valid_range(curve)
        error = curve["relative_error"]
        middle = error.sel(period=slice(0.4e-6, None))  # the paper's figure begins there
        chosen = error.interp(period=[0.5e-6, 1e-6, 2e-6, 3e-6]).values
        numbers[name] = {
            "within_10_percent_s": [low, high],
            "largest": float(np.max(np.abs(error.values))),
            "at_0.5us": chosen[0],
            "at_1us": chosen[1],
            "at_2us": chosen[2],
            "at_3us": chosen[3],
            "smallest_at_s": float(middle["period"].values[np.abs(middle.values).argmin()]),
        }
    return Result(numbers, curves)


def printed(p: paper.SecondOrderParameters) -> Foster:
    """The second-order equation with one of the paper's sets."""
    return surrogate.second_order(kappa=p.kappa, tau_f=p.tau_f, tau_s=p.tau_s, eta=p.eta, heat_capacity=p.heat_capacity)
