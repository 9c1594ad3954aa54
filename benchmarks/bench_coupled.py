"""What an integrated microsecond costs: coupled.simulate's integrator against LSODA, error beside the time.

    python benchmarks/bench_coupled.py [repeats]

All integrate the same compiled right-hand side of the self-pulsing ring at (8 dBm, 0 GHz) over 20 us and give the same
2001 output times. The error is the root mean square over field, carriers and temperature, each in units of its maximum,
against Rodas5P at rtol = 1e-11. The candidates take turns, so that a busy machine slows them alike; times are medians
of CPU time. Tolerances are chosen to give nearly equal errors.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import coupled
import surrogate
import thermofem as th
from coupled.kernel.integrator import Problem
from coupled.kernel.tableaus import Method
from coupled.kernel.units import single_ring

Array = NDArray[np.float64]

DURATION = 20e3  # ns
TIMES = np.linspace(0, DURATION, 2001)
RING = coupled.borghi2021()
MODEL = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
POWER = 10**0.8 * 1e-3
SIXTEEN = th.Foster(R=np.repeat(MODEL.R, 8) / 8, tau=np.repeat(MODEL.tau, 8))  # the same physics in 16 poles


def problem(method: Method = Method.RODAS4, model: th.Foster = MODEL) -> Problem:
    return single_ring(RING, model, POWER, 0.0, DURATION * 1e-9, method)


def ours(method: Method, rtol: float, model: th.Foster = MODEL) -> Array:
    ring = problem(method, model)
    return ring.integrate(ring.zero(), rtol=rtol, times=TIMES).rows[:, 1:]


def columns(states: Array) -> Array:
    """Re a, Im a, N and dT out of (times, states)."""
    return np.column_stack([states[:, :3], states[:, 3:].sum(axis=1)])


def scipy_lsoda(rtol: float) -> Array:
    ring = problem()

    def f(_: float, y: Array) -> Array:
        return ring.slopes(y)[0]

    run = solve_ivp(f, (0, DURATION), np.zeros(5), method="LSODA", t_eval=TIMES, rtol=rtol, atol=1e-3 * rtol)
    return columns(run.y.T)


def candidates() -> dict[str, Callable[[], Array]]:
    """Name and run of each, at tolerances that give errors of about 1e-5."""
    table: dict[str, Callable[[], Array]] = {
        "Rodas4, rtol 1e-5, 2 poles": lambda: ours(Method.RODAS4, 1e-5),
        "Rodas4, rtol 1e-5, 16 poles": lambda: ours(Method.RODAS4, 1e-5, SIXTEEN),
        "Rodas5P, rtol 5e-7, 2 poles": lambda: ours(Method.RODAS5P, 5e-7),
        "Rodas5P, rtol 5e-7, 16 poles": lambda: ours(Method.RODAS5P, 5e-7, SIXTEEN),
        "solve_ivp LSODA, rtol 5e-8": lambda: scipy_lsoda(5e-8),
    }
    return table


def measure(repeats: int) -> tuple[dict[str, float], dict[str, float]]:
    """Error, and CPU milliseconds a microsecond, of every candidate."""
    reference = ours(Method.RODAS5P, 1e-11)
    table = candidates()
    size = np.abs(reference).max(axis=0)
    errors = {name: float(np.sqrt(np.mean(((run() - reference) / size) ** 2))) for name, run in table.items()}
    seconds: dict[str, list[float]] = {name: [] for name in table}
    for _ in range(repeats):
        for name, run in table.items():
            start = time.process_time()
            run()
            seconds[name].append(time.process_time() - start)
    return errors, {name: 1e3 * float(np.median(s)) / (DURATION / 1e3) for name, s in seconds.items()}


def rows(repeats: int) -> list[dict[str, object]]:
    """Rows of the table of peers: seconds for the whole 20 us."""
    errors, cost = measure(repeats)
    first, scale = next(iter(cost.values())), DURATION / 1e6
    found = []
    for name, ms in cost.items():
        who, _, how = name.partition(", ")
        row = {"who": who, "how": how, "error": errors[name], "seconds": ms * scale, "ratio": ms / first}
        found.append(row if who.startswith("solve") else row | {"who": f"thermofem {who}"})
    return found


def main() -> None:
    errors, cost = measure(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
    first = next(iter(cost))
    print(f"{'':32}{'rms error':>10}{'ms per us':>11}{'times the first':>17}")
    for name in cost:
        print(f"{name:32}{errors[name]:10.1e}{cost[name]:11.4f}{cost[name] / cost[first]:17.1f}")


if __name__ == "__main__":
    main()
