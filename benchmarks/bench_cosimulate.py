"""What FEM in the loop costs: coupled.cosimulate against one stiff integration of everything, error beside the time.

    python benchmarks/bench_cosimulate.py [accuracy]     # default 1e-4, 6253 unknowns

The strip ring at (8 dBm, 0 GHz), cold start. SciPy's BDF takes light, carriers and every temperature as one system with
a sparse analytic Jacobian; it knows no mass matrix, so both sides get the capacities lumped onto the diagonal (each
row's share of the diagonal, the total kept), which is the same problem for both. The error is the largest difference of
the temperature to a run of cosimulate at a hundredth of its tolerance, at 3000 times; CPU times of one process, taken
in turns. Last line: what the certified reduction costs with the same light, against the second-order model.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.sparse import bmat, csr_matrix, diags

import coupled
import surrogate
import thermofem as th
from coupled.kernel import units as eq
from coupled.kernel.tableaus import Method

Array = NDArray[np.float64]

RING, POWER = coupled.borghi2021(), 10**0.8 * 1e-3
SHORT, LONG = 1.5e-6, 20e-6


def lumped(system: th.StateSpace) -> th.StateSpace:
    """The same with a diagonal E of the same sum."""
    own = system.E.diagonal()
    return replace(system, E=csr_matrix(diags(own * system.E.sum() / own.sum())))


def monolithic(system: th.StateSpace, times: Array, rtol: float) -> Array:
    """dT by BDF on everything at once, in the internal units of coupled."""
    unit_gain = th.Foster(R=[1 / (eq.UW * eq.NS)], tau=[1.0])  # dx/dt = P - 1e-9 x
    optics = eq.single_ring(RING, unit_gain, POWER, 0.0, 1e-9, Method.RODAS4)
    capacity = system.E.diagonal() / (eq.UW * eq.NS)
    A, b = diags(1 / capacity) @ csr_matrix(system.A) / eq.UW, system.B[:, 0] / capacity
    C = system.C[0]

    def light(y: Array) -> Array:
        """Optics alone under the temperature of the field."""
        return np.append(y[:3], C @ y[3:])

    def right(_: float, y: Array) -> Array:
        at = light(y)
        slopes = optics.slopes(at)[0]
        return np.concatenate([slopes[:3], A @ y[3:] + b * (slopes[3] + 1e-9 * at[3])])

    def jacobian(_: float, y: Array) -> Any:
        J = optics.slopes(light(y))[1]
        read, heated = csr_matrix(np.outer(J[:3, 3], C)), csr_matrix(np.outer(b, J[3, :3]))
        return bmat([[csr_matrix(J[:3, :3]), read], [heated, A]], format="csc")

    start = np.zeros(3 + system.order)
    options = {"jac": jacobian, "rtol": rtol, "atol": 1e-3 * rtol}
    return solve_ivp(right, (0, times[-1] / eq.NS), start, "BDF", times / eq.NS, **options).y[3:].T @ C


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def trace(run: Any, times: Array) -> Array:
    return CubicSpline(run["time"], run["delta_T"])(times)


def main() -> None:
    accuracy = float(sys.argv[1]) if len(sys.argv) > 1 else 1e-4
    heat = th.assemble(th.strip_ring(), accuracy)
    coupled.cosimulate(RING, heat, power=POWER, duration=10e-9)  # compiles

    seconds, run = timed(lambda: coupled.cosimulate(RING, heat, power=POWER, duration=LONG, max_discrepancy=1e-3))
    found = coupled.pulsing(run)
    print(f"{heat.unknowns} unknowns, (8 dBm, 0 GHz): period {found.period * 1e9:.2f} ns, swing {found.swing:.3f} K")
    print(
        f"cosimulate, 1e-3 K: {seconds / LONG * 1e-6:.3f} s of CPU a simulated us; {run.attrs['passes']} passes of "
        f"{run.attrs['windows']} windows, {run.attrs['fem_solves']} solves, "
        f"{run.attrs['cpu_corrector'] / (run.attrs['cpu_optics'] + run.attrs['cpu_corrector']):.0%} of it in the FEM"
    )

    silicon, oxide = th.materials.find("Si"), th.materials.find("SiO2")
    warm = replace(
        th.strip_ring(),
        materials=(
            replace(silicon, conductivity_law=th.materials.PowerLaw(-1.3)),
            replace(oxide, conductivity_law=th.materials.PowerLaw(0.33), specific_heat_law=th.materials.PowerLaw(0.5)),
        ),
    )
    hot = th.assemble(warm, accuracy)
    seconds, run = timed(lambda: coupled.cosimulate(RING, hot, power=POWER, duration=LONG, max_discrepancy=1e-3))
    print(
        f"k(T), c_p(T): {seconds / LONG * 1e-6:.3f} s of CPU a simulated us; {run.attrs['passes']} passes of "
        f"{run.attrs['windows']} windows, {run.attrs['fem_solves']} solves"
    )

    system, times = lumped(heat.system), np.linspace(0, SHORT, 3001)
    drive = {"power": POWER, "duration": SHORT}
    reference = trace(coupled.cosimulate(RING, system, max_discrepancy=1e-5, rtol=1e-9, **drive), times)
    print(f"\n{SHORT * 1e9:.0f} ns from cold, the same lumped matrices:")
    ours, run = timed(lambda: coupled.cosimulate(RING, system, max_discrepancy=1e-3, **drive))
    print(f"  cosimulate, 1e-3 K         {ours:8.2f} s   error {np.abs(trace(run, times) - reference).max():.0e} K")
    for rtol in (1e-4, 1e-6, 1e-7):  # the last two bracket the error of cosimulate
        theirs, rise = timed(lambda rtol=rtol: monolithic(system, times, rtol))
        error = np.abs(rise - reference).max()
        print(f"  BDF, sparse Jacobian, {rtol:.0e} {theirs:7.2f} s   error {error:.0e} K   {theirs / ours:.0f} times")

    second = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
    models = {
        "second order": second,
        **{f"{tol:.0e}": surrogate.reduce(heat.system, tol).model for tol in (1e-3, 1e-4)},
    }
    cost: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(7):
        for name, model in models.items():
            cost[name].append(timed(lambda m=model: coupled.simulate(RING, m, power=POWER, duration=LONG))[0])
    for name, model in models.items():
        ratio = median(cost[name]) / median(cost["second order"])
        print(f"simulate, {name:>12}: {model.order:2d} poles, {ratio:.2f} times the second-order ODE")


if __name__ == "__main__":
    main()
