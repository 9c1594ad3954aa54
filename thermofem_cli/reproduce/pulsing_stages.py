"""Stages with optics, carriers and heat together: traces, and the CPU time of each model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper
from thermofem.models import Foster, ThermalModel
from thermofem.solving import solve_periodic
from thermofem.waveforms import Sampled

from .heat_stages import elements_of
from .settings import CENTRE, MARKED, watts
from .stages import Job
from .store import Result, slug
from .training_stages import PARAMETERS, printed

if TYPE_CHECKING:
    import xarray as xr

    from coupled import RingResonator
    from coupled.runs.pulsing import Pulsing


def models_of(inputs: Mapping[str, Result]) -> dict[str, tuple[RingResonator, ThermalModel]]:
    """Every thermal model with the ring it belongs to, in the order of the report."""
    ring = coupled.borghi2021()
    reduced, trained = inputs["elements"].models, inputs["training"].models
    return {
        "Newton, the paper's": (ring.with_lumped_fcd(), newton_of(paper.NEWTON_MAPS)),
        "second order, the paper's": (ring, printed(paper.SECOND_ORDER_EXPERIMENT)),
        "second order": (ring, inputs["second_order_fit"].models["second_order"]),
        "SINDy": (ring, trained["sindy"]),
        "reduction": (ring, reduced["reduction"]),
    }


def newton_of(p: paper.NewtonParameters) -> Foster:
    """Newton's law with one of the paper's pairs."""
    return surrogate.newton(tau_th=p.tau_th, heat_capacity=p.heat_capacity)


def traces(job: Job) -> Result:
    """Every model at (8 dBm, 0 GHz) from a cold start, 20 us."""
    ring, reduced, trained = coupled.borghi2021(), job.inputs["elements"].models, job.inputs["training"].models
    models = {
        "Newton, the paper's fit": newton_of(paper.NEWTON_FIT),
        "Newton, 0.8 µs square": trained["newton_0.8us"],
        "second order, the paper's, FEM": printed(paper.SECOND_ORDER_FEM),
        "second order, the paper's, experiment": printed(paper.SECOND_ORDER_EXPERIMENT),
        "second order, 1 µs square": trained["second_order_1us"],
        "SINDy": trained["sindy"],
        "reduction": reduced["reduction"],
    }
    power, detuning = watts(CENTRE[0]), CENTRE[1] * 1e9
    runs, numbers = {}, {}
    for name, model in models.items():
        run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=20e-6)
        numbers[name] = describe(coupled.pulsing(run))
        runs[slug(name)] = _thin(run.assign_attrs(model=name))
    swapped = coupled.simulate(
        ring.with_swapped_srh(), reduced["reduction"], power=power, detuning=detuning, duration=20e-6
    )
    period = coupled.pulsing(swapped).period
    numbers["exchanged"] = {"period_s": period, "period_change": period / numbers["reduction"]["period_s"] - 1}
    return Result(numbers, runs)


def heating(job: Job) -> Result:
    """Fig. 5(b): the heat of a settled self-pulsing cycle given to the FEM, and one and two poles fitted to its answer.

    The absorbed power is that of Newton's law with the pair of the paper's caption, as in the paper.
    """
    n = job.settings.cycle
    wave, samples = heat_of_the_pair(n)
    times, power = np.asarray(wave.times), np.asarray(wave.power)
    period = float(times[-1])
    data = solve_periodic(elements_of(job.settings.accuracy), wave, samples)
    second, free = surrogate.fit_second_order(data), surrogate.fit_newton(data)
    one = _lifetime_of(data, paper.HEAT_CAPACITY)
    models = {
        "one_pole": one,
        "paper_pair": newton_of(paper.NEWTON_FIT),
        "paper_caption": surrogate.newton(tau_th=paper.NEWTON_FIT.tau_th, heat_capacity=paper.HEAT_CAPACITY),
        "second_order": second.model,
        "paper_second_order": printed(paper.SECOND_ORDER_FEM),
    }
    seen = data["delta_T"].values
    numbers: dict[str, Any] = {
        "period_s": period,
        "power_mean_W": float(np.trapezoid(power, times) / period),
        "power_max_W": float(power.max()),
        "swing_K": float(np.ptp(seen)),
        "one_pole_tau_s": float(np.max(one.tau)),
        "second_order": {name: second.parameters[name] for name in PARAMETERS},
        "newton": dict(free.parameters),
        "misfit_K": {
            name: float(np.std(model.periodic_response(wave, 2 * n) - seen)) for name, model in models.items()
        },
        "mean_off_K": {
            name: float(np.mean(model.periodic_response(wave, 2 * n) - seen)) for name, model in models.items()
        },
    }
    return Result(numbers, {"elements": data}, models)


def heat_of_the_pair(count: int) -> tuple[Sampled, int]:
    """The absorbed power of a settled cycle of Newton's law with the pair of Fig. 5(b), and samples of an answer."""
    run = coupled.simulate(
        coupled.borghi2021(), newton_of(paper.NEWTON_FIT), power=watts(CENTRE[0]), detuning=CENTRE[1] * 1e9,
        duration=20e-6,
    )  # fmt: skip
    period = coupled.pulsing(run).period
    times = np.linspace(0, period, count)
    power = np.interp(20e-6 - 1.5 * period + times, run["time"].values, run["absorbed"].values)
    power[-1] = power[0]
    return Sampled(times, power, repeat=True), 2 * count


def _lifetime_of(data: xr.Dataset, heat_capacity: float) -> Foster:
    """Newton's law with a given m c_p and the time constant that fits a periodic state best."""
    from scipy.optimize import minimize_scalar

    from thermofem.data.dataset import response_of

    response = response_of(data)

    def misfit(log_tau: float) -> float:
        model = surrogate.newton(tau_th=float(np.exp(log_tau)), heat_capacity=heat_capacity)
        return float(np.mean((model.periodic_response(response.wave, response.rise.size) - response.rise) ** 2))

    best = minimize_scalar(misfit, bounds=(np.log(5e-9), np.log(2e-6)), method="bounded")
    return surrogate.newton(tau_th=float(np.exp(best.x)), heat_capacity=heat_capacity)


def marked(job: Job) -> Result:
    """Traces at the marked points with every model: Figs. 4(c) and 6(c), and the same with SINDy and reduction."""
    ring, fitted = coupled.borghi2021(), job.inputs["newton_fits"].models
    data: dict[str, xr.Dataset] = {}
    numbers: dict[str, Any] = {}
    for point in MARKED:
        models = {
            **models_of(job.inputs),
            "Newton, fitted to this trace": (ring, fitted[label(point)]),
        }
        numbers[label(point)] = {}
        for name, (own, model) in models.items():
            run = coupled.simulate(
                own, model, power=watts(point[0]), detuning=point[1] * 1e9, duration=job.settings.run
            )
            numbers[label(point)][name] = describe(coupled.pulsing(run))
            data[f"{label(point)}.{slug(name)}"] = _thin(run.assign_attrs(model=name, point=label(point)))
    return Result(numbers, data)


def cost(job: Job) -> Result:
    """CPU seconds per simulated microsecond of every model at (8 dBm, 0 GHz), and the error of its period.

    Medians of runs taken in turn, so that a slow moment of the machine hits all of them.
    """
    cases = models_of(job.inputs)
    power, detuning, duration = watts(CENTRE[0]), CENTRE[1] * 1e9, job.settings.run
    truth = job.inputs["loop"].numbers[label(CENTRE)]["period_s"]
    spent: dict[str, list[float]] = {name: [] for name in cases}
    numbers: dict[str, Any] = {}
    for turn in range(job.settings.repeats + 1):
        for name, (ring, model) in cases.items():
            begin = time.process_time()
            run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=duration)
            spent[name].append(time.process_time() - begin)
            if not turn:
                period = coupled.pulsing(run).period
                numbers[name] = {"period_s": period, "period_error": period / truth - 1}
    for name, seconds in spent.items():
        numbers[name]["seconds_per_us"] = float(np.median(seconds[1:])) / (duration * 1e6)
    base = numbers["second order"]["seconds_per_us"]
    for row in numbers.values():
        row["against_second_order"] = row["seconds_per_us"] / base
    return Result(numbers)


def describe(found: Pulsing) -> dict[str, Any]:
    """Regime, period, duty cycle, swing and number of cycles of a run, for JSON."""
    return {
        "regime": str(found.regime),
        "period_s": found.period,
        "duty": found.duty,
        "swing_K": found.swing,
        "cycles": found.cycles,
    }


def label(point: tuple[float, float]) -> str:
    """Name of a point of the map, as in files: '8dBm_-10GHz'."""
    return f"{point[0]:g}dBm_{point[1]:g}GHz"


def _thin(run: xr.Dataset) -> xr.Dataset:
    """The last five microseconds of a run, all a figure needs."""
    return run.isel(time=np.flatnonzero(run["time"].values >= run["time"].values[-1] - 5e-6))
