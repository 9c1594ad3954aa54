"""Section 7, the open problem: optics and carriers with the FEM itself in the loop. These runs play the experiment."""

import time
from itertools import product

import numpy as np

import coupled

from .maps import models_of
from .printed import (
    CENTRE, COLOURS, DETUNINGS, MARKED, NEWTON_FIT, POWERS, RING, RUN, at, describe, heat, label, legend, panel
)
from .report.study import Result, figure, study

POINTS = *MARKED, (5, 0), (8, 25), (10, 20), (6, 10), (10, -10), (9, 10), (6, 20), (7, 0), (9, -20)  # dBm and GHz
KEPT = ["energy", "carriers", "delta_T", "drop", "through", "absorbed", "passes", "discrepancy"]
SHORT = 2e-6  # s, of the run with a poor predictor


@study("FEM in the loop")
def loop(elements):
    """Co-simulations with the FEM from a cold start, and the error of the certified reduction at the same points."""
    data, numbers = {}, {}
    for point in POINTS:
        run = coupled.cosimulate(RING, heat(), **at(point), duration=RUN)
        reduced = coupled.simulate(RING, elements.models["reduction"], **at(point), duration=RUN)
        found = describe(run)
        data[label(point)] = run[KEPT].assign_attrs(regime=found["regime"])
        numbers[label(point)] = found | {
            "reduction_period_error": coupled.pulsing(reduced).period / found["period_s"] - 1,
            "passes_per_window": run.attrs["passes"] / run.attrs["windows"],
            "largest_discrepancy_K": run.attrs["largest_discrepancy"],
            "seconds_per_us": (run.attrs["cpu_optics"] + run.attrs["cpu_corrector"]) / (RUN * 1e6),
        }
    every = list(numbers.values())
    settled = data[label(CENTRE)]["carriers"].sel(time=slice(RUN / 2, None))
    numbers |= {"count": len(POINTS), "unknowns": heat().unknowns, "fastest_fca": RING.eta_fca * float(settled.max())}
    numbers |= {name: np.mean([one[name] for one in every]) for name in ("passes_per_window", "seconds_per_us")}
    for name in ("reduction_period_error", "largest_discrepancy_K"):
        numbers[f"worst_{name}"] = np.nanmax(np.abs([one[name] for one in every]))
    usual, newton = (  # a poor predictor comes to the same answer, in more passes
        coupled.cosimulate(RING, heat(), **at(CENTRE), duration=SHORT, predictor=model) for model in (None, NEWTON_FIT)
    )
    off = newton["delta_T"].interp(time=usual["time"]) - usual["delta_T"]
    numbers["predictors"] = {
        "usual_passes": usual.attrs["passes"], "newton_passes": newton.attrs["passes"],
        "difference_K": float(np.sqrt((off**2).mean())), "swing_K": np.ptp(usual["delta_T"].values),
    }
    return Result(numbers, data)


@study("FEM in the loop: a map")
def loop_map(elements):
    """A coarse map with the FEM itself in the loop, against that of its reduction."""
    powers, detunings = POWERS[::5], DETUNINGS[::5]
    reduced = coupled.pulsing_map(RING, elements.models["elements"], powers, detunings, duration=RUN)
    runs = [
        describe(coupled.cosimulate(RING, heat(), power=power, detuning=detuning, duration=RUN))
        for power, detuning in product(powers.tolist(), detunings.tolist())
    ]
    regime, period = (np.reshape([run[n] for run in runs], reduced["period"].shape) for n in ("regime", "period_s"))
    numbers = {"points": len(runs), "disagree": np.sum(regime != reduced["regime"].values)}
    numbers["period_difference_median"] = np.nanmedian(np.abs(reduced["period"].values / period - 1))
    return Result(numbers, {"elements": reduced[["regime"]].copy(data={"regime": regime})})


@study("what each model costs")
def cost(elements, training, second_order_fit, loop):
    """CPU seconds per simulated microsecond of every model at (8 dBm, 0 GHz), and the error of its period.

    Medians of runs taken in turn, so that a slow moment of the machine hits all of them.
    """
    cases, periods = models_of(elements, training, second_order_fit), {}
    spent = {name: [] for name in cases}
    for _, (name, case) in product(range(16), cases.items()):
        begin = time.process_time()
        run = coupled.simulate(*case, **at(CENTRE), duration=RUN)
        spent[name].append((time.process_time() - begin) / (RUN * 1e6))
        periods[name] = coupled.pulsing(run).period / loop.numbers[label(CENTRE)]["period_s"] - 1
    cost = {name: np.median(seconds[1:]) for name, seconds in spent.items()}
    return Result({name: {
        "period_error": periods[name], "seconds_per_us": s, "against_second_order": s / cost["second order"]
    } for name, s in cost.items()})


@figure
def costs(cost):
    ax = panel()
    for (name, row), marker in zip(cost.numbers.items(), "sv^oD", strict=True):
        error = 100 * abs(row["period_error"])
        ax.semilogy(row["seconds_per_us"] * 1e3, error, marker, color=COLOURS[name], markersize=8, label=name)
    widest = 1.4e3 * max(row["seconds_per_us"] for row in cost.numbers.values())
    ax.set(xlabel="CPU time per simulated µs (ms)", ylabel="error of the period (%)", xlim=(0, widest))
    return legend(ax, "above")
