"""What settled cycles, their branches and their maps cost, with an error beside each.

    python benchmarks/bench_cycles.py [repeats]

CPU time in ms after compilation, median and smallest, the models in turns. The period of the cycle is compared with
the last one of a run of 300 us at rtol 1e-8, the settled map with `limit_cycle` at a tenth of its pulsing points, the
fold of the branch with the curve of folds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import coupled
import surrogate
import thermofem as th

RING, POWER = coupled.borghi2021(), 10**0.8 * 1e-3
POWERS, DETUNINGS = 1e-3 * 10 ** np.linspace(0.3, 1, 20), np.linspace(-30e9, 30e9, 20)
MODELS = {
    "2 poles": surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12),
    "5 poles": th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6]),
    "reduced FEM": surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-4).model,
}


def cpu(run: Callable[[], Any]) -> float:
    """CPU time of one call in ms, of all threads."""
    start = time.process_time()
    run()
    return 1e3 * (time.process_time() - start)


def turns(runs: dict[str, Callable[[], Any]], repeats: int) -> dict[str, str]:
    """Median and smallest CPU time of every run, in turns."""
    for run in runs.values():
        run()
    taken = {name: [cpu(run) for run in runs.values()] for name in range(repeats)}
    columns = np.array([*taken.values()]).T
    return {name: f"{np.median(c):8.1f} ({c.min():.1f})" for name, c in zip(runs, columns, strict=True)}


def main(repeats: int) -> None:
    cycles = {name: (lambda m=m: coupled.limit_cycle(RING, m, power=POWER)) for name, m in MODELS.items()}
    given = {name: run() for name, run in cycles.items()}
    derivatives = {
        name: (lambda m=m, c=given[name]: coupled.cycles.derivatives.cycle_derivatives(RING, m, power=POWER, cycle=c))
        for name, m in MODELS.items()
    }
    maps = {name: (lambda m=m: coupled.pulsing_map(RING, m, POWERS, DETUNINGS)) for name, m in MODELS.items()}
    for words, runs, times in (
        ("limit_cycle", cycles, repeats), ("all derivatives", derivatives, 3), ("20 x 20 settled map", maps, 3),
    ):  # fmt: skip
        for name, text in turns(runs, times).items():
            print(f"{words:22}{name:14}{text} ms CPU   {error(words, name)}")
    lumped, newton = RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    branch = lambda: coupled.continue_cycle(lumped, newton, "detuning", (8e9, -2e9), power=5e-3, detuning=-2e9)  # noqa: E731
    folds = lambda: coupled.cycles.cycle_folds.cycle_fold_curves(lumped, newton, POWERS, DETUNINGS)  # noqa: E731
    for words, text in turns({"branch with its fold": branch, "curve of folds": folds}, 3).items():
        print(f"{words:36}{text} ms CPU")
    (curve,), one = folds(), branch()
    (fold,) = one["detuning"].values[one["special"].values == "fold"]
    curve = curve.sortby("power")
    off = np.interp(5e-3, curve["power"].values, curve["detuning"].values) - fold
    print(f"fold at 5 mW {fold * 1e-9:.6f} GHz; the curve, interpolated, differs by {off * 1e-6:.3f} MHz")


def error(words: str, name: str) -> str:
    """What is compared."""
    model = MODELS[name]
    if words == "limit_cycle":
        run = coupled.simulate(RING, model, power=POWER, duration=300e-6, rtol=1e-8)
        ratio = coupled.limit_cycle(RING, model, power=POWER).attrs["period"] / coupled.pulsing(run).period
        return f"period off a run of 300 us by {ratio - 1:.1e}"
    if words == "20 x 20 settled map":
        found = coupled.pulsing_map(RING, model, POWERS, DETUNINGS)["period"].values
        at = np.argwhere(np.isfinite(found))[::10]
        pairs = [(found[i, j], single(model, POWERS[i], DETUNINGS[j])) for i, j in at]
        worst = max((abs(a / b - 1) for a, b in pairs if np.isfinite(b)), default=np.nan)
        return f"periods off limit_cycle by at most {worst:.1e}"
    return ""


def single(model: th.Foster, power: float, detuning: float) -> float:
    """The period of one point, nan where a cold ring rests."""
    try:
        return float(coupled.limit_cycle(RING, model, power=power, detuning=detuning).attrs["period"])
    except th.InputError:
        return float("nan")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 15)
