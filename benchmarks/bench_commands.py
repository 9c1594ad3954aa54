"""What a command costs beside its work: CPU time of whole processes, in turns, medians.

    python benchmarks/bench_commands.py [repeats]

"work" is the CPU time of the same calls in a process where all is imported and compiled. "bare" is the start of Python
with NumPy and SciPy's linear algebra: the ratio to it carries over from a busy machine to an idle one.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import coupled
import surrogate
import thermofem as th
from thermofem_cli.inputs.page_models import models_of_geometry

STRIP = ["solve", "--pulse", "20 us", "-o", "heat.nc"]
RING = ["simulate", "model.json", "-o", "run.nc"]
PAGE = ["-o", "ring.html"]
BARE = "import numpy, scipy.linalg, scipy.sparse.linalg"


def process(arguments: list[str], folder: str) -> float:
    """CPU seconds of one process, user and system; wrong usage ends with 2."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *arguments], cwd=folder, check=False, capture_output=True, env=os.environ)
    if done.returncode != (2 if arguments[-1] == "solv" else 0):
        raise RuntimeError(f"{arguments} ended with {done.returncode}: {done.stderr.decode()}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def work(call: Callable[[], object], repeats: int) -> float:
    """CPU seconds of a call that has run before."""
    call()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return float(np.median(times))


def page_of_strip(ring: coupled.RingResonator) -> object:
    """The page of the reference strip, from the FEM on."""
    models, heat = models_of_geometry(None)
    return coupled.explore(ring, models, heat=heat)


def main(repeats: int) -> None:
    heat = th.assemble(th.strip_ring())
    model = surrogate.reduce(heat.system).model
    ring, pulse, times = coupled.borghi2021(), th.Pulse(2e-3, 20e-6), np.linspace(0, 40e-6, 801)
    data = th.solve(heat, pulse, times)
    own = {
        "solve": work(lambda: th.solve(th.assemble(th.strip_ring()), pulse, times), repeats),
        "fit": work(lambda: surrogate.fit_second_order(data), repeats),
        "simulate": work(lambda: coupled.simulate(ring, model, power=6.31e-3, duration=20e-6), repeats),
        "explore": work(lambda: coupled.explore(ring, {"model": model}), repeats),
        "explore FEM": work(lambda: page_of_strip(ring), repeats),
    }
    with tempfile.TemporaryDirectory() as folder:
        surrogate.save_model(model, Path(folder) / "model.json")
        runs = {
            "bare": ["-c", BARE],
            "--help": ["-m", "thermofem", "--help"],
            "wrong usage": ["-m", "thermofem", "solv"],
            "solve": ["-m", "thermofem", *STRIP],
            "fit": ["-m", "thermofem", "fit", "heat.nc", "-o", "fit.json"],
            "simulate": ["-m", "thermofem", *RING],
            "explore": ["-m", "thermofem", "explore", "model.json", *PAGE],
            "explore FEM": ["-m", "thermofem", "explore", *PAGE],
        }
        for arguments in runs.values():
            process(arguments, folder)  # writes what is cached
        seconds = {name: [] for name in runs}
        for _ in range(repeats):
            for name, arguments in runs.items():
                seconds[name].append(process(arguments, folder))
    median = {name: float(np.median(s)) for name, s in seconds.items()}
    print(f"{'command':12}{'CPU s':>8}{'times bare':>12}{'its work, CPU s':>18}")
    for name, value in median.items():
        print(f"{name:12}{value:8.2f}{value / median['bare']:12.2f}{own.get(name, float('nan')):18.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
