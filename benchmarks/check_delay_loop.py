"""A ring in a delay loop against a general solver of delay equations: JiTCDDE (pip install jitcdde, and a C compiler).

    python benchmarks/check_delay_loop.py [duration in ns] [step of JiTCDDE in ns]     # 6 and 1e-4

The loop, the light and the heat are those of the test against the method of steps. The right-hand sides are written out
here as docs/equations.md and docs/circuits.md print them; from `coupled` come the parameters of the ring alone. JiTCDDE
takes fixed steps with its pair of Bogacki and Shampine, of which some end where the slope jumps; a run with steps twice
as long says how good it is. Differences are the largest at any time, relative to the largest value.
Units: ns, fJ, 1e21/m^3, K.
"""

from __future__ import annotations

import sys
from contextlib import chdir
from importlib.metadata import version
from itertools import pairwise
from math import cos, pi, sin, sqrt
from tempfile import TemporaryDirectory

import numpy as np
from jitcdde import jitcdde, t, y
from symengine import Symbol

import coupled
import surrogate

RING = coupled.borghi2021()
HEAT = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
POWER, DELAY, LOSS, PHASE = 3e-3, 1.0, 1.0, 0.4  # W, ns, dB, rad
NS, FJ, DENSITY = 1e-9, 1e-15, 1e21
BACK = Symbol("back")  # 0 until the light has gone round once, then 1


def right_hand_sides() -> list:
    """d/dt of Re a, Im a, N and the heat's poles, with the laser at the cold resonance."""
    ar, ai, N, poles = y(0), y(1), y(2), range(3, 3 + len(HEAT.tau))
    U, delta_T = ar**2 + ai**2, sum(y(k) for k in poles)
    source, into, other = sqrt(POWER * NS / FJ), sqrt(2 * RING.bus_rate * NS), sqrt(2 * RING.drop_bus_rate * NS)

    absorbing = NS * (RING.loss_rate + RING.eta_fca * DENSITY * N + RING.eta_tpa * FJ * U)
    gamma = NS * (RING.bus_rate + RING.drop_bus_rate) + absorbing
    index = RING.thermo_optic * delta_T + sum(c * (DENSITY * N) ** p for c, p in RING.fcd)
    D = -2 * pi * RING.frequency * NS / RING.refractive_index * index

    # through = source + i into a, one delay ago; add = 10^(-loss/20) exp(-i phase) through; i other add drives the ring
    left = BACK * 10 ** (-LOSS / 20)
    through_r, through_i = source - into * y(1, t - DELAY), into * y(0, t - DELAY)
    add_r = left * (cos(PHASE) * through_r + sin(PHASE) * through_i)
    add_i = left * (cos(PHASE) * through_i - sin(PHASE) * through_r)

    trap = RING.carriers
    lifetime = trap.tau0 / NS * (1 + trap.a * DENSITY * N) / (1 + trap.b * DENSITY * N)
    heat = 2 * absorbing * U * FJ / NS  # W
    return [
        -gamma * ar - D * ai - other * add_i,
        D * ar - gamma * ai + into * source + other * add_r,
        -N / lifetime + RING.g_tpa * FJ**2 * NS / DENSITY * U**2,
        *((R * heat - y(k)) * NS / tau for k, R, tau in zip(poles, HEAT.R, HEAT.tau, strict=True)),
    ]


def theirs(times: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """U in J and dT in K at the times in ns, one of which is the delay."""
    solver = jitcdde(right_hand_sides(), delays=[0, DELAY], control_pars=[BACK], verbose=False)
    with TemporaryDirectory() as folder, chdir(folder):  # else the compilation reads the pyproject.toml that is here
        solver.compile_C(simplify=False)
    solver.constant_past(np.zeros(solver.n))
    states = [np.zeros(solver.n)]
    for start, end in pairwise(times):
        if start in (0, DELAY):  # the slope jumps: 1e-10 ns with the state held, then the new slope
            solver.set_parameters(float(start == DELAY))
            solver.jump(0, start, width=1e-10)
        states.append(solver.integrate_blindly(end, step))
    found = np.array(states)
    return (found[:, 0] ** 2 + found[:, 1] ** 2) * FJ, found[:, 3:].sum(axis=1)


def main() -> None:
    duration, step = (float(given) for given in (sys.argv[1:] + ["6", "1e-4"][len(sys.argv) - 1 :]))
    times = np.arange(round(duration / 0.05) + 1) / 20
    loop = coupled.Waveguide("ring 1.through", "ring 1.add", LOSS, PHASE, DELAY * NS)
    run = coupled.simulate(
        coupled.Circuit([RING], [loop], [coupled.LaserPort("in", "ring 1.in")]), HEAT, power={"in": POWER},
        duration=times[-1] * NS, rtol=1e-9, times=times * NS,
    )  # fmt: skip
    ours = run.energy.values[0], run.delta_T.values[0]
    good, coarse = theirs(times, step), theirs(times, 2 * step)
    print(f"{times[-1]:g} ns, delay {DELAY:g} ns; jitcdde {version('jitcdde')}, steps of {step:g} ns")
    for name, unit, a, b, c in zip(("energy", "temperature"), "JK", ours, good, coarse, strict=True):
        ours_off, own = (np.abs(x - b).max() / b.max() for x in (a, c))
        print(f"{name:>11}: up to {b.max():.4g} {unit}; difference {ours_off:.1e}, steps twice as long {own:.1e}")


if __name__ == "__main__":
    main()
