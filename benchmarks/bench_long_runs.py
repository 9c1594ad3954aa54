"""CPU time of long runs of `simulate` and of settled cycles against another installation.

    python benchmarks/bench_long_runs.py OLD_PYTHON [ROUNDS]

OLD_PYTHON is the interpreter of an environment with version 0.2. Both run every case in turns, ROUNDS times (3 by
default), each time after a first call that compiles or loads what is needed. `bench_kernel_parity.py` compares the
numbers of short runs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from bench_kernel_parity import circuit_run

WORK = 1.0  # s of calls that are timed of each case, or one call


def cases() -> dict[str, Callable[[], Any]]:
    """Name and call of every case."""
    import coupled
    import surrogate
    import thermofem as th

    ring, two = coupled.borghi2021(), th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    fem = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-4).model  # 14 poles
    shifts, run = np.random.default_rng(3).normal(0, 10e9, 16), circuit_run(coupled)
    many = coupled.bus([replace(ring, frequency=ring.frequency + f) for f in shifts], phase=1.0, loss=0.05)
    three = coupled.bus([replace(ring, frequency=ring.frequency + f) for f in shifts[:3]], phase=1.0)
    heat = th.assemble(th.strip_ring(outer_radius=135e-6))
    array = surrogate.reduce_array(heat, [(25e-6 * k, 0) for k in range(3)], tolerance=1e-3)
    symbols = th.Symbols(np.random.default_rng(1).integers(0, 2, 20_000), rate=1e8, power=5e-3)
    light, end = {"power": 6.31e-3, "duration": 20e-6}, np.linspace(0, 1e-3, 1001)
    other = coupled.Laser(1e-3, -5e9, resonance=replace(ring, frequency=194.4e12))
    found = {
        f"one ring, 20 us, {poles} poles, rtol {rtol:g}": lambda m=m, r=rtol: coupled.simulate(ring, m, rtol=r, **light)
        for rtol in (1e-6, 1e-8)
        for poles, m in ((2, two), (14, fem))
    }
    return found | {
        "one ring, 1 us": lambda: coupled.simulate(ring, two, power=6.31e-3, duration=1e-6),
        "two resonances, 20 us": lambda: coupled.simulate(ring, two, lasers=[other], **light),
        "16 rings on a bus, 20 us": lambda: run(many, two, {"in": 20e-3}, duration=20e-6),
        "3 rings on a bus, 1 ms": lambda: run(three, two, {"in": 10e-3}, duration=1e-3, times=end),
        "3 rings, heat between them, 20000 symbols": lambda: run(
            three, array, {"in": symbols}, duration=symbols.stop, times=symbols.samples()
        ),
        "settled cycle, 2 poles": lambda: coupled.limit_cycle(ring, two, power=6.31e-3),
        "settled cycle, 14 poles": lambda: coupled.limit_cycle(ring, fem, power=6.31e-3),
    }


def work() -> None:
    """Print the median CPU time in ms of every case in this installation."""
    found = {}
    for name, call in cases().items():
        call()
        taken: list[float] = []
        while not taken or sum(taken) < WORK:
            began = time.process_time()
            call()
            taken.append(time.process_time() - began)
        found[name] = 1e3 * float(np.median(taken))
    print(json.dumps(found))


def main(old: str, rounds: int) -> None:
    """Compare the two installations."""
    runs: dict[str, list[dict[str, float]]] = {old: [], sys.executable: []}
    for _ in range(rounds):
        for python, results in runs.items():
            done = subprocess.run([python, __file__, "--work"], check=True, capture_output=True, text=True)
            results.append(json.loads(done.stdout.splitlines()[-1]))
    print(f"{'case':44} {'now, ms':>9} {'old, ms':>9} {'ratio':>6}")
    for name in runs[old][0]:
        before, now = (float(np.median([one[name] for one in results])) for results in runs.values())
        print(f"{name:44} {now:9.2f} {before:9.2f} {now / before:6.2f}")


if __name__ == "__main__":
    if sys.argv[1] == "--work":
        work()
    else:
        main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3)
