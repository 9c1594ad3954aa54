"""Stages that train models on the FEM's answers, by the paper's drives and by others, and judge them."""

from __future__ import annotations

from typing import Any

import numpy as np

import surrogate
from coupled.parameters import borghi2021 as paper
from surrogate.judging.ladder import shells
from surrogate.judging.validate import widest_range
from thermofem.data.dataset import build
from thermofem.models import Foster, StateSpace
from thermofem.waveforms import Constant, Pulse, SquareWave

from .heat_stages import PULSE, elements_of
from .settings import HEATING
from .stages import Job
from .store import Result, slug

PERIODS = np.geomspace(0.1e-6, 10e-6, 41)  # s, Fig. 7
PARAMETERS = ("kappa", "tau_f", "tau_s", "eta")
ORDERS = (2, 3, 4, 5, 6, 8)  # of Foster networks


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


def drives(job: Job) -> Result:
    """Dependence of the trained numbers on the drive, and the error left by every order of model.

    Drives go through the FEM's reduction to 1e-6 of R_th, in closed form.
    """
    model = job.inputs["elements"].models["elements"]

    def periodic(period: float) -> Any:
        wave = SquareWave(HEATING, period, 0.33)
        times = np.linspace(0, period, 301)
        return build(times, model.periodic_response(wave, 301), wave, periodic=True)

    def cold(wave: Any, times: np.ndarray) -> Any:
        return build(times, model.response(wave, times), wave)

    cases = {
        "joint": [periodic(period) for period in (0.5e-6, 1e-6, 2e-6)],
        "cold": cold(SquareWave(HEATING, 1e-6, 0.33), np.linspace(0, 20e-6, 4001)),
        "pulse": cold(Pulse(HEATING, width=PULSE), np.linspace(0, 2 * PULSE, 8001)),
    }
    numbers: dict[str, Any] = {}
    for name, data in cases.items():
        second, newton = surrogate.fit_second_order(data), surrogate.fit_newton(data)
        numbers[name] = {
            **{key: second.parameters[key] for key in PARAMETERS},
            "thermal_resistance": second.model.thermal_resistance,
            "newton_tau_s": newton.parameters["tau_th"],
            "newton_ratio": newton.parameters["heat_capacity_ratio"],
        }
    fast = periodic(paper.SECOND_ORDER_FEM.tau_f)
    newton = surrogate.fit_newton(fast)
    numbers["fast"] = {
        "misfit": newton.residual / float(np.ptp(fast["delta_T"].values)),
        "newton_ratio": newton.parameters["heat_capacity_ratio"],
    }
    numbers["literal_swing_K"] = float(np.ptp(_literal().periodic_response(SquareWave(HEATING, 0.8e-6, 0.33), 301)))
    times = np.geomspace(1e-9, 100e-6, 200)
    step = cold(Constant(HEATING), times)
    steady = HEATING * model.thermal_resistance
    decay = steady - step["delta_T"].values
    orders = {f"{n} poles": surrogate.fit_foster(step, n, thermal_resistance=model.thermal_resistance) for n in ORDERS}
    judged = surrogate.compare({k: f.model for k, f in orders.items()}, model, surrogate.square_waves(HEATING))
    numbers["orders"] = np.sqrt(np.mean(judged["rms_relative"].values ** 2, axis=1))
    numbers["exponentials"] = [
        float(np.max(np.abs(surrogate.fit_decay(times, decay, order=n)(times) - decay)) / steady) for n in range(1, 6)
    ]
    return Result(numbers)


def _literal() -> StateSpace:
    """Eq. 3 as printed, with the paper's FEM parameters: dP/dt is not divided by m c_p, and so has no effect.

    Its two modes have opposite signs, which is no Foster network.
    """
    p = paper.SECOND_ORDER_FEM
    fast, slow = 1 / p.tau_f, 1 / p.tau_s
    gain = p.kappa / p.heat_capacity / (fast - slow)
    return StateSpace(np.eye(2), -np.diag([fast, slow]), np.array([[-gain], [gain]]), np.ones((1, 2)))


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
        low, high = widest_range(curve)
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
