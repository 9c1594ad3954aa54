"""Certified reduction against pyMOR's balanced truncation and IRKA on the same matrices, error beside the time.

    python benchmarks/bench_reduce.py [accuracy] [--pymor]

The reference strip at a mesh accuracy (default 3e-5: about 11k unknowns). Errors are the largest of |H - H_r| / R_th
over 60 frequencies from 1 kHz to 100 GHz against full-order solves. pyMOR takes minutes; without --pymor only the
reduction is timed. Times are CPU seconds of one run each, pyMOR's own logging switched off.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import surrogate
import thermofem as th

FREQUENCY = np.geomspace(1e3, 1e11, 60)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def main(accuracy: float, pymor: bool) -> None:
    system = th.assemble(th.strip_ring(), accuracy=accuracy).system
    exact, static = system.impedance(FREQUENCY), system.thermal_resistance
    print(f"{system.order} unknowns\n{'':36}{'order':>6}{'error/R_th':>12}{'bound':>10}{'CPU s':>9}{'over 1e-4':>11}")
    own = {}
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6):
        rom, _ = timed(lambda t=tolerance: surrogate.reduce(system, t))
        own[tolerance] = float(np.median([timed(lambda t=tolerance: surrogate.reduce(system, t))[1] for _ in range(5)]))
        error = np.abs(rom.model.impedance(FREQUENCY) - exact).max() / static
        print(f"{f'reduce to {tolerance:g}':36}{rom.order:6d}{error:12.1e}{rom.error_bound:10.1e}{own[tolerance]:9.3f}")
    if pymor:
        compare_pymor(system, exact, static, own[1e-4])


def rows(accuracy: float, repeats: int) -> list[dict[str, Any]]:
    """Rows of the table of peers."""
    system = th.assemble(th.strip_ring(), accuracy=accuracy).system
    exact, static = system.impedance(FREQUENCY), system.thermal_resistance
    rom, _ = timed(lambda: surrogate.reduce(system, 1e-4))
    own = float(np.median([timed(lambda: surrogate.reduce(system, 1e-4))[1] for _ in range(repeats)]))
    error = float(np.abs(rom.model.impedance(FREQUENCY) - exact).max() / static)
    how = f"{rom.order} poles, proven below {rom.error_bound:.0e}"
    found = [{"who": "thermofem reduce to 1e-4", "how": how, "error": error, "seconds": own, "ratio": 1.0}]
    return found + compare_pymor(system, exact, static, own)


def compare_pymor(system: th.StateSpace, exact: Any, static: float, own: float) -> list[dict[str, Any]]:
    from pymor.core.logger import set_log_levels
    from pymor.models.iosys import LTIModel
    from pymor.reductors.bt import BTReductor
    from pymor.reductors.h2 import IRKAReductor

    set_log_levels({"pymor": "ERROR"})
    unit = 1e-7  # s: pyMOR's shifts want rates of order one
    model = LTIModel.from_matrices(unit * system.A.tocsc(), system.B, system.C, E=system.E.tocsc())
    found = []
    for name, reductor, order in (("BT(14)", BTReductor, 14), ("IRKA(10)", IRKAReductor, 10)):
        small, seconds = timed(lambda r=reductor, n=order: r(model).reduce(n))
        response = np.array([unit * small.transfer_function.eval_tf(2j * np.pi * f * unit)[0, 0] for f in FREQUENCY])
        error = np.abs(response - exact).max() / static
        print(
            f"{'pyMOR ' + name:36}{small.order:6d}{error:12.1e}{'':10}{seconds:9.3f}{seconds / own:11.0f}",
            file=sys.stderr,
        )
        row = {"who": f"pyMOR {name}", "how": f"{small.order} states", "error": float(error), "seconds": seconds}
        found.append(row | {"ratio": seconds / own})
    return found


if __name__ == "__main__":
    numbers = [a for a in sys.argv[1:] if not a.startswith("-")]
    main(float(numbers[0]) if numbers else 3e-5, "--pymor" in sys.argv)
