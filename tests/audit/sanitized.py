"""The kernel under the address and undefined-behaviour sanitizers of g++: every kind of run, briefly.

    python tests/audit/sanitized.py

Builds a second library, starts itself with the sanitizer loaded, and ends with 1 at the first finding.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import coupled
import thermofem as th
from coupled.circuit.system import system_of
from coupled.kernel import integrator, shooting, units
from coupled.kernel.library import build
from coupled.kernel.tableaus import Method

RING, HEAT = coupled.borghi2021(), th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])


def runs() -> None:
    """Every kind of run."""
    short = {"duration": 20e-9, "rtol": 1e-6}
    wave = th.SquareWave(power=6e-3, period=5e-9, duty=0.5)
    one = {"power": 6e-3, "detuning": -5e9, **short}
    coupled.simulate(RING, HEAT, **one)
    coupled.simulate(RING, HEAT, **one, method="rodas5p", times=np.linspace(0, 20e-9, 7))
    coupled.simulate(RING, th.OutputMap(HEAT, 1e-3), power=wave, event=coupled.Event("energy", 1e-15), **short)
    coupled.simulate(RING, HEAT, **one, lasers=[coupled.Laser(1e-3, 1e9)])
    probe = coupled.Laser(1e-3, 1e9, resonance=RING.with_rates(thermal_shift=6e10))
    coupled.simulate(RING, HEAT, **one, lasers=[probe])
    three = [RING] * 3
    for circuit in (coupled.bus(three), coupled.scissor(three, phase=1.0), coupled.bus(three, delay=0.1e-9)):
        coupled.simulate(circuit, HEAT, power={"in": wave}, **short)
        coupled.simulate(circuit, HEAT, power={"in": wave}, average=True, times=np.linspace(0, 20e-9, 5), **short)
    bent = th.Quadratic(
        A=-np.diag(1 / HEAT.tau), H=np.full((2, 2, 2), -1e3), G=np.zeros((2, 2)), B=HEAT.R / HEAT.tau, C=np.ones(2)
    )
    coupled.simulate(RING, bent, **one)
    gain = np.kron(np.eye(2), (HEAT.R / HEAT.tau)[:, None])
    beside = th.StateSpace(
        np.eye(4), -np.kron(np.eye(2), np.diag(1 / HEAT.tau)), gain, np.kron([[1, 0.1], [0.1, 1]], np.ones((1, 2))),
        inputs=("ring 1", "ring 2"), outputs=("ring 1", "ring 2"),
    )  # fmt: skip
    coupled.simulate(coupled.bus(three[:2]), beside, power={"in": wave}, **short)
    circuit = system_of(coupled.bus(three), HEAT, power={"in": 6e-3}, duration=20e-9).problem(Method.RODAS5P)
    for problem in (
        units.single_ring(RING, HEAT, 6e-3, 0.0, 20e-9, Method.RODAS4),
        units.single_ring(RING, bent, 6e-3, 0.0, 20e-9, Method.RODAS5P),
        circuit,
    ):
        run = problem.integrate(problem.zero(), rtol=1e-5, keep_steps=True)
        for columns in (0, 2, problem.size):
            problem.follow(problem.zero(), run.steps, np.eye(problem.size)[:, :columns])
        problem.slopes(run.y)
    coupled.limit_cycle(RING, HEAT, power=6.31e-3)
    coupled.pulsing_map(RING, HEAT, [5e-3, 6.31e-3], [-5e9, 0.0])


if __name__ == "__main__":
    if len(sys.argv) > 1:
        loaded = ctypes.CDLL(sys.argv[1])
        integrator.library = shooting.library = lambda: loaded
        runs()
        sys.exit()
    with tempfile.TemporaryDirectory() as folder:
        flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-O1", "-g", "-Wno-psabi")
        made = build(Path(folder, "sanitized.so"), flags, ["g++"])
        found = [
            subprocess.check_output(["g++", f"-print-file-name={name}"], text=True).strip()
            for name in ("libasan.so", "libubsan.so")
        ]
        environment = os.environ | {"LD_PRELOAD": " ".join(found), "ASAN_OPTIONS": "detect_leaks=0"}
        sys.exit(subprocess.run([sys.executable, __file__, str(made)], env=environment, check=False).returncode)
