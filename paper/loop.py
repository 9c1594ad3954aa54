"""Section 7, the open problem: optics and carriers with the FEM itself in the loop. These runs play the experiment."""

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import xarray as xr

import coupled

from .maps import models_of
from .printed import (
    CENTRE, COLOURS, DETUNINGS, MARKED, NEWTON_FIT, POWERS, RING, RUN, at, describe, heat, label, legend_above, panel
)
from .report.study import OTHER, PAPER, Result, figure, study

POINTS = (  # dBm and GHz: the marked ones, and others spread over where the FEM-coupled ring pulses
    *MARKED, (5.0, 0.0), (8.0, 25.0), (10.0, 20.0), (6.0, 10.0), (10.0, -10.0), (9.0, 10.0), (6.0, 20.0), (7.0, 0.0),
    (9.0, -20.0),
)
KEPT = ["energy", "carriers", "delta_T", "drop", "through", "absorbed", "passes", "discrepancy"]
SHORT = 2e-6  # s, of the run with a poor predictor


@study("FEM in the loop", 7)
def loop(elements):
    """Co-simulations with the FEM from a cold start, and the error of the certified reduction at the same points."""
    data, numbers = {}, {}
    coupled.cosimulate(RING, heat(), **at(CENTRE), duration=1e-8)  # compiles what is timed below
    for point in POINTS:
        run = coupled.cosimulate(RING, heat(), **at(point), duration=RUN)
        reduced = coupled.simulate(RING, elements.models["reduction"], **at(point), duration=RUN)
        found = describe(run)
        numbers[label(point)] = found | {
            "reduction_period_error": coupled.pulsing(reduced).period / found["period_s"] - 1,
            "passes_per_window": run.attrs["passes"] / run.attrs["windows"],
            "largest_discrepancy_K": run.attrs["largest_discrepancy"],
            "seconds_per_us": (run.attrs["cpu_optics"] + run.attrs["cpu_corrector"]) / (RUN * 1e6),
        }
        data[label(point)] = run[KEPT].assign_attrs(regime=found["regime"])
    every = list(numbers.values())
    densest = max(float(run["carriers"].max()) for run in data.values())
    numbers |= {"count": len(POINTS), "unknowns": heat().unknowns, "fastest_fca": RING.eta_fca * densest}
    for name in ("passes_per_window", "seconds_per_us"):
        numbers[name] = np.mean([one[name] for one in every])
    for name in ("reduction_period_error", "largest_discrepancy_K"):
        numbers[f"worst_{name}"] = np.nanmax(np.abs([one[name] for one in every]))
    usual = coupled.cosimulate(RING, heat(), **at(CENTRE), duration=SHORT)
    newton = coupled.cosimulate(RING, heat(), **at(CENTRE), duration=SHORT, predictor=NEWTON_FIT)
    times = np.linspace(0, SHORT, 2001)
    rise = [np.interp(times, run["time"].values, run["delta_T"].values) for run in (usual, newton)]
    numbers["predictors"] = {  # a poor one comes to the same answer, in more passes
        "usual_passes": usual.attrs["passes"],
        "newton_passes": newton.attrs["passes"],
        "difference_K": np.sqrt(np.mean((rise[0] - rise[1]) ** 2)),
        "swing_K": np.ptp(rise[0]),
    }
    return Result(numbers, data)


@study("FEM in the loop: a map", 14)
def loop_map(elements):
    """A coarse map with the FEM itself in the loop, against that of its reduction."""
    powers, detunings = POWERS[::5], DETUNINGS[::5]
    reduced = coupled.pulsing_map(RING, elements.models["elements"], powers, detunings, duration=RUN)
    reduced = reduced.drop_vars("reason")

    def one(point):
        return coupled.pulsing(coupled.cosimulate(RING, heat(), power=point[0], detuning=point[1], duration=RUN))

    points = [(float(p), float(d)) for p in powers for d in detunings]
    found = [one(points[0])]  # fills what all share
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found += pool.map(one, points[1:])
    shape, over = (powers.size, detunings.size), ("power", "detuning")
    columns = {name: [getattr(f, name) for f in found] for name in ("period", "duty", "swing")}
    columns["regime"] = [str(f.regime) for f in found]
    variables = {n: (over, np.reshape(column, shape), reduced[n].attrs) for n, column in columns.items()}
    data = xr.Dataset(variables, reduced.coords)
    period = abs(reduced["period"] / data["period"] - 1).values
    pulses = data["regime"].values == "self-pulsing"
    disagree = pulses != (reduced["regime"].values == "self-pulsing")
    around = np.pad(pulses, 1, mode="edge")
    near = np.stack([around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]])
    numbers = {
        "points": len(points), "disagree": disagree.sum(),
        "disagree_at_border": np.sum(disagree & (near != pulses).any(axis=0)),
        "period_difference_median": np.nanmedian(period),
    }
    return Result(numbers, {"elements": data, "reduction": reduced})


@study("what each model costs", 0.5)
def cost(elements, training, second_order_fit, loop):
    """CPU seconds per simulated microsecond of every model at (8 dBm, 0 GHz), and the error of its period.

    Medians of runs taken in turn, so that a slow moment of the machine hits all of them.
    """
    truth, numbers = loop.numbers[label(CENTRE)]["period_s"], {}
    cases = models_of(elements, training, second_order_fit)
    spent = {name: [] for name in cases}
    for _ in range(16):
        for name, (ring, model) in cases.items():
            begin = time.process_time()
            run = coupled.simulate(ring, model, **at(CENTRE), duration=RUN)
            spent[name].append((time.process_time() - begin) / (RUN * 1e6))
            numbers[name] = {"period_error": coupled.pulsing(run).period / truth - 1}
    for name, seconds in spent.items():
        numbers[name]["seconds_per_us"] = np.median(seconds[1:])
    for row in numbers.values():
        row["against_second_order"] = row["seconds_per_us"] / numbers["second order"]["seconds_per_us"]
    return Result(numbers)


@figure
def costs(cost):
    ax = panel()
    for (name, row), marker in zip(cost.numbers.items(), "sv^oD", strict=True):
        error = 100 * abs(row["period_error"])
        ax.semilogy(row["seconds_per_us"] * 1e3, error, marker, color=COLOURS[name], markersize=8, label=name)
    ax.set(xlabel="CPU time per simulated µs (ms)", ylabel="error of the period (%)")
    ax.set_xlim(0, 1.5 * max(row["seconds_per_us"] for row in cost.numbers.values()) * 1e3)
    return legend_above(ax)


PAPER.update({"loop/8dBm_0GHz/period_s": (750e-9, 850e-9)})
OTHER.update({
    "loop/8dBm_0GHz/period_s": (678e-9, 682e-9), "loop/5dBm_0GHz/period_s": (775.7e-9, 780.3e-9),
    "loop/8dBm_25GHz/period_s": (1398e-9, 1406e-9), "loop/8dBm_0GHz/swing_K": (5.85, 5.89),
    "loop/fastest_fca": (44e9, 46e9),
})
