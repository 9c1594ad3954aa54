"""Audit of the error bars of `coupled.identify`: pulls of synthetic cases, (found - true)/standard deviation.

    python tests/audit/pulls.py [count [first [optics]]]

Each case draws the four parameters of the second-order equation, two working points that pulse, and 2 % of noise. With
"optics" three parameters of the ring are free, too, and four working points are given: some directions are then hardly
determined. Least squares start at the truth, as the error bar is judged and not the search. The pulls of 50 cases have
a root mean square between 0.8 and 1.3.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

import coupled
import surrogate
from coupled.identification.matching import deviations, polished, targets_of
from coupled.unknowns import unknowns

NAMES = ("kappa", "tau_f", "tau_s", "eta")
OPTICS = ("bus_rate", "loss_rate", "fca_cross_section")
CENTRE = (7.45e5, 71e-9, 1030e-9, 0.29)  # the paper's, trained on measured traces
POINTS = ((5.01e-3, -10e9), (6.31e-3, 0.0), (5.6e-3, -5e9), (6.31e-3, -10e9))  # W and Hz
NOISE = 0.02  # of the largest drop power
TIMES = np.arange(0, 14e-6, 2e-9)


def pulls(seed: int, optics: tuple[str, ...] = ()) -> NDArray[np.float64]:
    """Pulls of the logarithms of the parameters; nan where a trace does not pulse."""
    rng = np.random.default_rng(seed)
    true = np.array(CENTRE) * np.exp(0.07 * rng.standard_normal(4))
    model = surrogate.second_order(**dict(zip(NAMES, true.tolist(), strict=True)))
    ring, traces = coupled.borghi2021(), []
    for k in rng.permutation(len(POINTS))[: 4 if optics else 2]:
        power, detuning = POINTS[k]
        run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=TIMES[-1], times=TIMES)
        noise = NOISE * float(run["drop"].max()) * rng.standard_normal(TIMES.size)
        traces.append(run[["drop"]].assign(drop=run["drop"] + noise))
    what, targets = unknowns(ring, (*NAMES, *optics), model), targets_of(traces)
    if not all(np.isfinite(target.observed.clock) for target in targets):
        return np.full(what.start.size, np.nan)
    found, _ = polished(what, targets, [t.observed.mean() for t in targets], what.start)
    return np.asarray((found - what.start) / deviations(what, targets, found))


def main(count: int, first: int, optics: tuple[str, ...]) -> int:
    """Print every case and the standard deviation of all; 1 where it is outside 0.8 to 1.3."""
    rows = []
    for seed in range(first, first + count):
        rows.append(pulls(seed, optics))
        print(seed, " ".join(f"{pull:+.2f}" for pull in rows[-1]), flush=True)
    kept = np.array([row for row in rows if np.isfinite(row).all()])
    each, whole = kept.std(axis=0), float(np.sqrt(np.mean(kept**2)))
    words = ", ".join(f"{name} {value:.2f}" for name, value in zip((*NAMES, *optics), each, strict=True))
    mean = " ".join(f"{value:+.2f}" for value in kept.mean(axis=0))
    print(f"{len(kept)} of {count} cases: root mean square {whole:.2f}; deviations {words}; means {mean}")
    return int(not 0.8 <= whole <= 1.3)


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:3]]
    sys.exit(main(*(numbers + [50, 0][len(numbers) :]), OPTICS if "optics" in sys.argv else ()))
