"""What a map costs: linear stability, its boundary curves and integration, with their agreement beside the time.

    python benchmarks/bench_maps.py [repeats]

Powers 3 to 10 dBm and detunings -30 to 30 GHz, after compilation. Peers in the same run: numpy.linalg.eigvals of
equal Jacobians for the stability map, and the integration of the same points by `pulsing_map`. Times are medians.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled.kernel.tableaus import Method
from coupled.kernel.units import single_ring

RING = coupled.borghi2021()
CASES = {
    "Newton": (RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)),
    "second order": (RING, surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)),
    "FEM, reduced": (RING, surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-4).model),
}


def grid(powers: int, detunings: int) -> tuple[np.ndarray, np.ndarray]:
    return 1e-3 * 10 ** np.linspace(0.3, 1, powers), np.linspace(-30e9, 30e9, detunings)


def seconds(run: Callable[[], object], repeats: int) -> float:
    run()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def numpy_eigenvalues(ring: coupled.RingResonator, model: th.Foster, points: int) -> None:
    """As many dense eigenvalue problems as the map has fixed points."""
    problem = single_ring(ring, model, 6e-3, 0.0, 1e-9, Method.RODAS4)
    y = np.array([-2.3, 2.85, 1.7, *np.full(model.order, 7.0 / model.order)])
    for _ in range(points):
        np.linalg.eigvals(problem.slopes(y)[1])


def main() -> None:
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    fine, coarse = grid(200, 200), grid(20, 20)
    print(f"{'':16}{'stability':>11}{'numpy':>9}{'Hopf':>8}{'fold':>8}{'integrated':>12}{'times':>8}{'overlap':>9}")
    print(f"{'':16}{'200 x 200':>11}{'x':>9}{'s':>8}{'s':>8}{'20 x 20, s':>12}{'a point':>8}{'':>9}")
    for name, (ring, model) in CASES.items():
        linear = coupled.stability_map(ring, model, *fine)
        count = int(linear.fixed_points.sum())
        stability = seconds(lambda r=ring, m=model: coupled.stability_map(r, m, *fine), repeats)
        dense = seconds(lambda r=ring, m=model: numpy_eigenvalues(r, m, 1000), repeats) * count / 1000
        hopf = seconds(lambda r=ring, m=model: coupled.hopf_curves(r, m, *fine), repeats)
        fold = seconds(lambda r=ring, m=model: coupled.fold_curves(r, m, *fine), repeats)
        integrated = seconds(lambda r=ring, m=model: coupled.pulsing_map(r, m, *coarse, duration=20e-6), repeats)
        same = coupled.maps.pulsing_map.overlap(
            coupled.pulsing_map(ring, model, *coarse, duration=20e-6), coupled.stability_map(ring, model, *coarse)
        )
        ratio = (integrated / 400) / (stability / 40_000)
        print(
            f"{name:16}{stability:9.2f} s{dense / stability:8.1f}x{hopf:8.3f}{fold:8.4f}"
            f"{integrated:12.2f}{ratio:7.0f}x{same:9.1%}"
        )


if __name__ == "__main__":
    main()
