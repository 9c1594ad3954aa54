"""CPU time of a wheel for x86-64 beside that wheel without its second library, and beside this installation.

    python benchmarks/bench_wheel.py WHEEL [ROUNDS]

WHEEL is a file that `make wheels` has written. It is unpacked twice, once without the library for x86-64-v3, and both
run with the other packages of this installation: a trace, a settled cycle and a map, in turns, the best of ROUNDS.
Measured on an AMD EPYC that others were using, CPU time in ms, the best of six; last a build by zig at home:

    case             first library   second library   at home
    trace of 20 us             6.6              5.7       6.5
    settled cycle             15.3             12.7      14.2
    6 x 6 map                 85.3             69.4      78.0
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np

from coupled.kernel import library

ROUNDS = 5
OWN = Path(library.HERE).parents[1]  # this installation


def work() -> None:
    """Print the library and the CPU time in s of a trace, a cycle and a map, as JSON."""
    import coupled
    import thermofem as th

    ring = coupled.borghi2021()
    model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    power = 6.31e-3
    powers = 1e-3 * 10 ** np.linspace(0.3, 1, 6)
    detunings = np.linspace(-30e9, 30e9, 6)
    calls = {
        "trace of 20 us": lambda: coupled.simulate(ring, model, power=power, duration=20e-6),
        "settled cycle": lambda: coupled.limit_cycle(ring, model, power=power),
        "6 x 6 map": lambda: coupled.pulsing_map(ring, model, powers, detunings),
    }
    seconds = {}
    for name, call in calls.items():
        call()
        start = time.process_time()
        call()
        seconds[name] = time.process_time() - start
    print(json.dumps({"library": Path(library.library()._name).name, "seconds": seconds}))


def timed(folder: Path) -> dict[str, float]:
    """CPU times in s of `work` with the packages of a folder; says once which library was loaded."""
    paths = [str(folder), *(path for path in sys.path if path.endswith("-packages"))]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run(
        [sys.executable, "-P", __file__, "--work"], env=environment, capture_output=True, text=True, check=True
    )
    answer = json.loads(done.stdout)
    print(f"{folder.name}: {answer['library']}", file=sys.stderr)
    seconds: dict[str, float] = answer["seconds"]
    return seconds


def main(wheel: Path, rounds: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name, "wheel")
        first = Path(name, "without the second library")
        for folder in (whole, first):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(folder)
        own = first / "coupled" / "kernel" / library.NAME
        library.second_of(own).unlink()
        folders = {"first library": first, "second library": whole, "this installation": OWN}
        times = {who: [] for who in folders}
        for _ in range(rounds):
            for who, folder in folders.items():
                times[who].append(timed(folder))
    for case in times["first library"][0]:
        best = {who: min(each[case] for each in runs) for who, runs in times.items()}
        ratio = best["first library"] / best["second library"]
        text = ", ".join(f"{who} {seconds * 1e3:.1f} ms" for who, seconds in best.items())
        print(f"{case:16}{text}: the second takes 1/{ratio:.2f}")


if __name__ == "__main__":
    if sys.argv[1] == "--work":
        work()
    else:
        main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else ROUNDS)
