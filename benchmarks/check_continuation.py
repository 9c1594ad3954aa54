"""A branch of cycles against AUTO-07p: Hopf point, fold of cycles and the period there (pip install bifpy; gfortran).

    python benchmarks/check_continuation.py [mesh intervals of AUTO]     # 200

Newton's law of 275 ns at 7 dBm, against detuning. The right-hand side is written out as docs/equations.md prints it;
from `coupled` come the parameters of the ring alone. AUTO follows the fixed point, finds the Hopf point on it, changes
to the cycles there and finds their fold. `bifpy` carries AUTO's Fortran sources and compiles them; it also writes the
equations below as Fortran. Units: ns, fJ, 1e23/m^3, K, GHz.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from math import pi, sqrt

from bifpy import auto
from bifpy.results import PointType
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import coupled
import surrogate

RING, HEAT = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
POWER, FIRST, RANGE = 1e-3 * 10**0.7, 15.0, (-16.0, 20.0)  # W, GHz
NS, FJ, DENSITY = 1e-9, 1e-15, 1e23
COMMON = {"ndim": 4, "npar": 11, "jac": 0, "iad": 3, "epsl": 1e-9, "epsu": 1e-9, "epss": 1e-8, "itmx": 12, "itnw": 8}


def slopes(state, parameters) -> list:
    """d/dt of Re a, Im a, N and the temperature rise."""
    ar, ai, N, rise = state
    U, carriers, ((fcd, _),) = ar**2 + ai**2, RING.carriers, RING.fcd
    absorbing = NS * (RING.loss_rate + RING.eta_fca * DENSITY * N + RING.eta_tpa * FJ * U)
    gamma = NS * (RING.bus_rate + RING.drop_bus_rate) + absorbing
    index = RING.thermo_optic * rise + fcd * DENSITY * N
    D = -2 * pi * (RING.frequency * NS / RING.refractive_index * index + parameters[0])
    decay = N * (1 + carriers.b * DENSITY * N) / (carriers.tau0 / NS * (1 + carriers.a * DENSITY * N))
    return [
        -gamma * ar - D * ai,
        -gamma * ai + D * ar + sqrt(2 * RING.bus_rate * NS * POWER * NS / FJ),
        NS * FJ**2 / DENSITY * RING.g_tpa * U**2 - decay,
        (HEAT.R[0] * 2 * absorbing * U * FJ / NS - rise) / (HEAT.tau[0] / NS),
    ]


def main() -> None:
    intervals = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rest = solve_ivp(lambda _, y: slopes(y, [FIRST]), (0, 2e4), [0] * 4, "BDF", rtol=1e-8, atol=1e-10).y[:, -1]
    rest = [float(value) for value in fsolve(lambda y: slopes(y, [FIRST]), rest, xtol=1e-13)]

    def start(state, parameters, _) -> None:
        state[:4], parameters[0] = rest, FIRST

    search = {"rl0": RANGE[0], "rl1": RANGE[1], "ilp": 1, "isp": 2, "dsmin": 1e-6, **COMMON}
    steady = {"ips": auto.IPS_EQUILIBRIUM, "nmx": 4000, "ds": -0.01, "dsmax": 0.1, **search}
    found = auto.run(slopes, start, steady, icu=[1], transpile=True)
    (hopf,) = (q for part in found.branches for q in part.points if q.point_type == PointType.HOPF_BIFURCATION)
    cycles = {"ips": auto.IPS_PERIODIC_ORBIT, "nmx": 300, "ds": 0.02, "dsmax": 1.0, "ntst": intervals, **search}
    found = auto.restart(
        slopes, cycles, hopf, icu=[1, auto.PERIOD_INDEX], isw=auto.ISW_HOPF_TO_PERIODIC_ORBIT,
        source_ips=auto.IPS_EQUILIBRIUM, transpile=True,
    )  # fmt: skip
    (fold,) = (q for part in found.branches for q in part.points if q.point_type == PointType.FOLD)

    branch = coupled.continue_cycle(RING, HEAT, "detuning", (20e9, -15e9), power=POWER, detuning=-2e9)
    kinds, nu = branch["special"].values, branch["detuning"].values * 1e-9
    period = float(branch["period"].values[kinds == "fold"].item()) * 1e9
    print(f"AUTO-07p by bifpy {version('bifpy')}, {intervals} intervals")
    for name, theirs, ours, unit in (
        ("Hopf point", hopf.parameters[0], nu[kinds == "Hopf"].item(), "GHz"),
        ("fold of cycles", fold.parameters[0], nu[kinds == "fold"].item(), "GHz"),
        ("period at the fold", fold.periodic_orbit.period, period, "ns"),
    ):
        print(f"{name:20} {theirs:16.10f} {ours:16.10f} {unit:4} apart {abs(theirs - ours):.1e}")


if __name__ == "__main__":
    main()
