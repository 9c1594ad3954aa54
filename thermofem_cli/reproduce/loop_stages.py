"""The FEM-coupled runs, which play the experiment: optics and carriers with the full-order FEM in the loop."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper

from .heat_stages import elements_of
from .pulsing_stages import describe, label
from .settings import CENTRE, MARKED, watts
from .stages import Job
from .store import Result

if TYPE_CHECKING:
    import xarray as xr

    from coupled.runs.pulsing import Pulsing

# dBm and GHz, spread over where the FEM-coupled ring pulses; taken in this order
SPREAD = (
    (5.0, 0.0), (8.0, 25.0), (10.0, 20.0), (6.0, 10.0), (10.0, -10.0), (9.0, 10.0), (6.0, 20.0), (7.0, 0.0),
    (9.0, -20.0), (7.0, 15.0), (10.0, 0.0), (9.0, 25.0), (8.0, 10.0), (6.0, -5.0), (9.0, -5.0),
)  # fmt: skip
KEPT = ("energy", "carriers", "delta_T", "drop", "through", "absorbed", "passes", "discrepancy")
SHORT = 2e-6  # s, of the run with a poor predictor


def loop(job: Job) -> Result:
    """Co-simulations with the FEM from a cold start, and the error of the certified reduction at the same points."""
    points = [*MARKED, *SPREAD[: job.settings.fitted - len(MARKED)]]
    data: dict[str, xr.Dataset] = {}
    numbers: dict[str, Any] = {}
    fem_run(job, CENTRE, duration=1e-8)  # compiles what is timed below
    for k, point in enumerate(points):
        job.done(k / len(points))
        run, reduced = fem_run(job, point), _reduced(job, point)
        found, other = describe(coupled.pulsing(run)), coupled.pulsing(reduced)
        numbers[label(point)] = found | {
            "reduction_period_error": other.period / found["period_s"] - 1,
            "passes_per_window": run.attrs["passes"] / run.attrs["windows"],
            "largest_discrepancy_K": run.attrs["largest_discrepancy"],
            "fem_solves": run.attrs["fem_solves"],
            "seconds_per_us": (run.attrs["cpu_optics"] + run.attrs["cpu_corrector"]) / (job.settings.run * 1e6),
        }
        data[label(point)] = run[list(KEPT)].assign_attrs(regime=found["regime"])
    rows = list(numbers.values())
    numbers["predictors"] = _predictors(job)
    numbers["count"] = len(points)
    numbers["unknowns"] = elements_of(job.settings.accuracy).unknowns
    densest = max(float(run["carriers"].max()) for run in data.values())
    numbers["fastest_fca"] = coupled.borghi2021().eta_fca * densest
    for name in ("passes_per_window", "seconds_per_us"):
        numbers[name] = float(np.mean([row[name] for row in rows]))
    for name in ("reduction_period_error", "largest_discrepancy_K"):
        numbers[f"worst_{name}"] = float(np.nanmax(np.abs([row[name] for row in rows])))
    return Result(numbers, data)


def loop_map(job: Job) -> Result:
    """A coarse map with the FEM itself in the loop, and how far the map of its fine reduction agrees with it."""
    import xarray as xr

    s, ring = job.settings, coupled.borghi2021()
    powers, detunings = s.powers[:: s.loop_every], s.detunings[:: s.loop_every]
    reduced = coupled.pulsing_map(
        ring, job.inputs["elements"].models["elements"], powers, detunings, duration=s.run
    ).drop_vars("reason")
    heat, points = elements_of(s.accuracy), [(float(p), float(d)) for p in powers for d in detunings]

    def one(point: tuple[float, float]) -> Pulsing:
        return coupled.pulsing(coupled.cosimulate(ring, heat, power=point[0], detuning=point[1], duration=s.run))

    found = [one(points[0])]  # fills what all share
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for k, result in enumerate(pool.map(one, points[1:]), 1):
            found.append(result)
            job.done(k / len(points))
    shape = (powers.size, detunings.size)
    variables = {
        name: (("power", "detuning"), np.array([getattr(f, name) for f in found]).reshape(shape), reduced[name].attrs)
        for name in ("period", "duty", "swing")
    }
    regimes = (("power", "detuning"), np.array([str(f.regime) for f in found]).reshape(shape), reduced["regime"].attrs)
    data = xr.Dataset({"regime": regimes, **variables}, coords=reduced.coords)
    period = abs(reduced["period"] / data["period"] - 1).values
    pulses = data["regime"].values == "self-pulsing"
    disagree = pulses != (reduced["regime"].values == "self-pulsing")
    around = np.pad(pulses, 1, mode="edge")
    near = np.stack([around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]])
    numbers = {
        "points": len(points),
        "pulsing": int(pulses.sum()),
        "disagree": int(disagree.sum()),
        "disagree_at_border": int(np.sum(disagree & (near != pulses).any(axis=0))),
        "period_difference_median": float(np.nanmedian(period)),
        "period_difference_largest": float(np.nanmax(period)),
    }
    return Result(numbers, {"elements": data, "reduction": reduced})


def fem_run(job: Job, point: tuple[float, float], **options: Any) -> xr.Dataset:
    """One FEM-coupled run."""
    settings = {"power": watts(point[0]), "detuning": point[1] * 1e9, "duration": job.settings.run} | options
    return coupled.cosimulate(coupled.borghi2021(), elements_of(job.settings.accuracy), **settings)


def _reduced(job: Job, point: tuple[float, float]) -> xr.Dataset:
    """The run with the certified reduction in the FEM's place."""
    model, (dbm, ghz) = job.inputs["elements"].models["reduction"], point
    return coupled.simulate(
        coupled.borghi2021(), model, power=watts(dbm), detuning=ghz * 1e9, duration=job.settings.run
    )


def _predictors(job: Job) -> dict[str, float]:
    """A poor predictor, Newton's law, against the usual one: the same answer, more passes."""
    poor = surrogate.newton(tau_th=paper.NEWTON_FIT.tau_th, heat_capacity=paper.NEWTON_FIT.heat_capacity)
    usual, newton = fem_run(job, CENTRE, duration=SHORT), fem_run(job, CENTRE, duration=SHORT, predictor=poor)
    times = np.linspace(0, SHORT, 2001)
    rise = [np.interp(times, run["time"].values, run["delta_T"].values) for run in (usual, newton)]
    return {
        "usual_passes": usual.attrs["passes"],
        "newton_passes": newton.attrs["passes"],
        "difference_K": float(np.sqrt(np.mean((rise[0] - rise[1]) ** 2))),
        "swing_K": float(np.ptp(rise[0])),
    }
