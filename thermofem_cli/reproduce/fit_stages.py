"""Stages that fit thermal models to drop traces of the FEM in the loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper

from .pulsing_stages import label, newton_of
from .settings import MARKED
from .stages import Job
from .store import Result
from .training_stages import PARAMETERS

if TYPE_CHECKING:
    import xarray as xr

LIFETIMES = (150e-9, 600e-9)  # s, searched for Newton's law with silicon's c_p; a second basin lies at 80 ns


def newton_fits(job: Job) -> Result:
    """Fig. 4(d): Newton's law fitted to every trace that pulses; and to one of them with silicon's own c_p."""
    ring, runs = coupled.borghi2021(), job.inputs["loop"].data
    pulsing = {name: run for name, run in runs.items() if run.attrs["regime"] == "self-pulsing"}
    single = coupled.identification.newton_traces.fit_newton_per_trace(ring, list(pulsing.values()))
    job.done(0.75)
    lumped = coupled.identify(
        ring.with_lumped_fcd(), _marked(job)[:1], free=["tau_th"], model=newton_of(paper.NEWTON_MAPS),
        bounds={"tau_th": LIFETIMES}, runs=1,
    )  # fmt: skip
    tau, capacity = single["tau_th"].values, single["heat_capacity"].values
    ratio = capacity / paper.HEAT_CAPACITY
    models = {
        name: surrogate.newton(tau_th=float(t), heat_capacity=float(c))
        for name, t, c in zip(pulsing, tau, capacity, strict=True)
    }
    numbers = {
        "count": len(pulsing),
        "tau_th_s": [tau.min(), tau.max()],
        "heat_capacity_ratio": [ratio.min(), ratio.max()],
        "heat_capacity_ratio_mean": ratio.mean(),
        "correlation": single.attrs["correlation"],
        "tau_mean_s": tau.mean(),
        "correlation_ratio_power": np.corrcoef(ratio, single["power"].values)[0, 1],
        "correlation_tau_period": np.corrcoef(tau, single["period"].values)[0, 1],
        "q_over_q0": np.mean(ratio) * paper.NEWTON_MAPS.tau_th / np.mean(tau),
        "lumped": {**lumped.parameters, "shape_error": float(lumped.residuals["shape_error"][0])},
    }
    return Result(numbers, {"newton": single}, {**models, "lumped": lumped.model})


def second_order_fit(job: Job) -> Result:
    """The training of Fig. 6: the second-order equation fitted to three traces at once."""
    found = coupled.identify(coupled.borghi2021(), _marked(job), free=PARAMETERS, runs=job.settings.runs)
    numbers = {
        "runs": job.settings.runs,
        "parameters": found.parameters,
        "deviations": found.standard_deviations,
        "shape_error": found.residuals["shape_error"].values,
    }
    return Result(numbers, models={"second_order": found.model})


def _marked(job: Job) -> list[xr.Dataset]:
    """The FEM's traces at the marked points."""
    return [job.inputs["loop"].data[label(point)] for point in MARKED]
