"""Full-order transient: this package against fixed-step Crank-Nicolson on the same matrices, at the same error.

The task is a user's: reference strip at accuracy 1e-4 (about 6k unknowns), 2 mW for 20 us, 40 us recorded, error below
1e-3 of the largest rise. The peer is what one writes by hand with scikit-fem: constant step, Crank-Nicolson started by
four backward Euler quarter steps after each edge (Rannacher), SciPy's splu with its default ordering, factorized once
for each step size. Its step is the largest that meets the error. Ours are the closed form that such a power allows and
the integrator for any other, each from the matrices on, factors and all. They take turns in one process, CPU time,
medians; the reference for the errors is the integrator at rtol 1e-7.

Then what one more geometry costs: from its TOML text to R_th and the step response over 20 us, at accuracy 1e-3, with
gmsh's mesh and the estimates of the errors; twelve rings that differ in radius and width.
"""

from __future__ import annotations

import subprocess
import sys
import time
from statistics import median

import numpy as np
from scipy.sparse.linalg import splu

import thermofem as th
from thermofem.mesh import make
from thermofem.transient import integrate
from thermofem.transient.modal import Modal

RUNS = 5
PULSE = th.Pulse(2e-3, 20e-6)
TIMES = np.concatenate([np.geomspace(1e-9, 20e-6, 100), 20e-6 + np.geomspace(1e-9, 20e-6, 100)])


def crank_nicolson(system: th.StateSpace, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and rise with ``steps`` equal steps in each half of 20 us."""
    h = 20e-6 / steps
    E, A, b, c = system.E.tocsc(), system.A.tocsc(), system.B[:, 0], system.C[0]
    half, quarter = splu(E - h / 2 * A), splu(E - h / 4 * A)
    x, times, rise = np.zeros(system.order), [0.0], [0.0]
    for power in (2e-3, 0.0):
        for k in range(steps):
            if k == 0:
                for _ in range(4):
                    x = quarter.solve(E @ x + h / 4 * b * power)
            else:
                x = half.solve(E @ x + h / 2 * (A @ x) + h * b * power)
            times.append(times[-1] + h)
            rise.append(c @ x)
    return np.array(times), np.array(rise)


def error(times: np.ndarray, rise: np.ndarray, reference: np.ndarray) -> float:
    """Largest error at `TIMES` relative to the largest rise; cubic through the samples, one side of the edge each."""
    from scipy.interpolate import CubicSpline

    edge = np.searchsorted(times, 20e-6 * (1 - 1e-9))
    found = np.empty_like(reference)
    for part, inside in ((slice(0, edge + 1), TIMES <= 20e-6), (slice(edge, None), TIMES > 20e-6)):
        found[inside] = CubicSpline(times[part], rise[part])(TIMES[inside])
    return float(np.abs(found - reference).max() / reference.max())


def cpu(action) -> tuple[float, object]:
    start = time.process_time()
    result = action()
    return time.process_time() - start, result


def startup(*arguments: str) -> float:
    """Wall seconds of a fresh interpreter with these arguments, median."""
    walls = []
    for _ in range(RUNS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        walls.append(time.perf_counter() - start)
    return median(walls)


def new_strip(rtol: float) -> float:
    """CPU seconds from the TOML text of a strip to its R_th and 20 us step, median of twelve strips after one."""
    took = []
    for i in range(13):
        text = th.strip_ring(radius=8e-6 + i * 37e-9, width=(450 + i) * 1e-9).to_toml()
        start = time.process_time()
        heat = th.assemble(th.CrossSection.from_toml_text(text), accuracy=1e-3)
        heat.thermal_resistance("core")
        th.solve(heat, PULSE, times=np.geomspace(1e-9, 20e-6, 200), rtol=rtol)
        took.append(time.process_time() - start)
    return median(took[1:])


def main() -> None:
    geometry = th.strip_ring()
    heat = th.assemble(geometry, accuracy=1e-4)
    reference = integrate(heat.system, PULSE, TIMES, rtol=1e-7).outputs[:, 0]
    steps = 100
    while error(*crank_nicolson(heat.system, steps), reference) > 1e-3:
        steps = int(steps * 1.25)
    whole, solved, stepped, peer = [], [], [], []
    for _ in range(RUNS):
        seconds, _ = cpu(lambda: th.fem.discretize(make(geometry, 1e-4), 1.0, 1.0, th.fem.Surfaces()))
        took, run = cpu(lambda: Modal(heat.system).run(heat.system.C, PULSE, TIMES, rtol=1e-3))
        whole.append(seconds + took)
        solved.append(took)
        took, steps_taken = cpu(lambda: integrate(heat.system, PULSE, TIMES, rtol=1e-3))
        stepped.append(took)
        peer.append(cpu(lambda: crank_nicolson(heat.system, steps))[0])
    ours, stepping = (float(np.abs(r.outputs[:, 0] - reference).max() / reference.max()) for r in (run, steps_taken))
    theirs = error(*crank_nicolson(heat.system, steps), reference)
    print(f"reference strip, {heat.unknowns} unknowns, 20 us pulse and 20 us of cooling, CPU seconds, median of {RUNS}")
    print(f"{'':44}{'CPU s':>8}{'error':>10}{'ratio':>8}")
    print(f"{f'thermofem: closed form, {run.solves} solves':44}{median(solved):8.3f}{ours:10.1e}{1.0:8.1f}")
    ratio = median(p / s for p, s in zip(stepped, solved, strict=True))
    words = f"thermofem: ESDIRK4(3), {steps_taken.solves} solves"
    print(f"{words:44}{median(stepped):8.3f}{stepping:10.1e}{ratio:8.1f}")
    ratio = median(p / s for p, s in zip(peer, solved, strict=True))
    print(f"{f'Crank-Nicolson, {2 * steps} fixed steps, splu':44}{median(peer):8.3f}{theirs:10.1e}{ratio:8.1f}")
    print(f"{'thermofem with meshing and assembly':44}{median(whole):8.3f}{ours:10.1e}")
    for rtol in (1e-3, 1e-4):
        print(f"{f'new strip, TOML to R_th and step, rtol {rtol:g}':44}{new_strip(rtol):8.3f}")
    print("wall seconds of a fresh process:")
    for arguments in (("-c", "import thermofem"), ("-m", "thermofem", "--help"), ("-c", "import numpy")):
        print(f"    python {' '.join(arguments):32}{startup(*arguments):8.2f}")


if __name__ == "__main__":
    main()
