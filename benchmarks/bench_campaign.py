"""What a geometry of a campaign costs, and how much of two processes it keeps busy.

    python benchmarks/bench_campaign.py [geometries] [workers]

A Latin hypercube over radius, width and oxide thickness, each geometry meshed and driven by a step to 20 us at accuracy
1e-3, with the error of the first geometry's R_th and step against accuracy 1e-4. CPU time is that of parent and
workers: over wall time times workers, what is missing to 1 on an idle machine is start, waiting and the index. Memory
is the largest resident set of the parent process.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time

import numpy as np

import thermofem as th
from thermofem.campaign import Drive, Variation


def campaign(count: int) -> th.Campaign:
    times = (0.0, *np.geomspace(1e-9, 20e-6, 80).tolist())
    variations = (
        Variation("radius", ("part.core.radius",), "m", low=4e-6, high=12e-6),
        Variation("width", ("part.core.width",), "m", low=400e-9, high=600e-9),
        Variation("oxide", ("layer.box.thickness",), "m", low=1e-6, high=3e-6),
    )
    step = Drive("step", th.Constant(1e-3), times)
    return th.Campaign(th.strip_ring().to_toml(), variations, (step,), samples=count)


def error(plan: th.Campaign, folder: str) -> tuple[float, float]:
    """Relative errors of R_th and of the step of the first geometry against a finer mesh."""
    with th.campaign.open_campaign(folder) as data:
        rise, resistance = data.delta_T_step[0, :, 0].values, float(data.thermal_resistance[0, 0])
    heat = th.assemble(th.CrossSection.from_toml_text(plan.geometry_of(plan.cases()[0].values)), accuracy=1e-4)
    fine = th.solve(heat, th.Constant(1e-3), plan.drives[0].kept, rtol=1e-6)
    exact = heat.thermal_resistance()
    step = np.max(np.abs(rise - fine.delta_T.values)[1:] / fine.delta_T.values[1:])
    return abs(resistance / exact - 1), float(step)


def cpu() -> float:
    """CPU seconds of this process and of its finished children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    plan = campaign(count)
    with tempfile.TemporaryDirectory() as folder:
        begin, used = time.perf_counter(), cpu()
        summary = plan.run(folder, workers=workers)
        wall, used = time.perf_counter() - begin, cpu() - used
        resistance, step = error(plan, folder)
    rate = summary.finished / wall
    print(f"{summary.finished} geometries, {summary.failed} failed, {workers} workers, {wall:.1f} s")
    print(f"{rate:.2f} geometries/s; 1000 would take {1000 / rate / 60:.1f} min")
    print(f"CPU {1e3 * used / summary.finished:.0f} ms a geometry, {used / (workers * wall):.1%} of the workers' time")
    print(f"error against accuracy 1e-4: R_th {resistance:.1e}, step {step:.1e} (promised 1e-3)")
    print(f"parent's memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
