"""Circuits beside SciPy's LSODA on the same compiled right-hand side, CPU time and error; and N rings beside N runs.

python benchmarks/bench_circuit.py [--rings 16] [--symbols 200]

LSODA lands on every edge of the stream, as the kernel does. Errors are those of the temperatures and energies against a
run at rtol = 1e-9, relative to their maxima.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.integrate import LSODA

import coupled
import surrogate
import thermofem as th
from coupled.circuit import integrate as compiled
from coupled.circuit.drive import detuning_of, internal_drive, powers_of
from coupled.circuit.heat import heater_offsets, ring_heat
from coupled.circuit.kernel import detunings_at, lasers_at
from coupled.circuit.network import light_of
from coupled.circuit.simulate import internal_heat, internal_network, internal_rings


def lsoda(circuit, thermal, inputs, duration, times, rtol):
    """Energies (J) at ``times`` by LSODA, restarted at every edge."""
    heat, light = ring_heat(thermal, len(circuit.names)), light_of(circuit)
    frame, _ = detuning_of(circuit, 0.0, duration)
    offsets = heater_offsets(heat, None, duration)
    drive = internal_drive(circuit, light, powers_of(circuit, inputs, duration), frame, offsets, duration)
    rings, states, net = (
        internal_rings(circuit, light, heat, drive.largest),
        internal_heat(heat),
        internal_network(light),
    )
    laser, slope = (np.zeros(len(circuit.lasers), dtype=complex) for _ in range(2))
    turned, bare = np.zeros(len(circuit.names)), np.zeros(len(circuit.names))
    none, found = np.zeros(0, dtype=complex), []
    y, wanted = np.zeros(len(circuit.names) * (3 + heat.gain.shape[1])), times * 1e9

    for piece in range(drive.edges.size - 1):
        lasers_at(drive, piece, drive.edges[piece], laser, slope)
        detunings_at(drive, piece, drive.edges[piece], turned, bare)

        def f(t, y):
            return compiled.right_hand_side(y, laser, none, turned, rings, states, net)

        solver = LSODA(f, drive.edges[piece], y, drive.edges[piece + 1], rtol=rtol, atol=rtol * 1e-3)
        while solver.status == "running":
            solver.step()
            here = wanted[(wanted > solver.t_old) & (wanted <= solver.t)]
            if here.size:
                between = solver.dense_output()(here)
                found.append(
                    between[0 : 3 * len(circuit.names) : 3] ** 2 + between[1 : 3 * len(circuit.names) : 3] ** 2
                )
        y = solver.y
    return np.concatenate(found, axis=1) * 1e-15


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rings", type=int, default=16)
    parser.add_argument("--symbols", type=int, default=200)
    parser.add_argument("--peer", action="store_true", help="LSODA, too: minutes")
    given = parser.parse_args()
    ring, n = coupled.borghi2021(), given.rings
    heat = th.assemble(th.strip_ring(outer_radius=25e-6 * n + 60e-6))
    array = surrogate.reduce_array(heat, [(25e-6 * k, 0) for k in range(n)], tolerance=1e-3)
    circuit = coupled.bus([ring] * n).scattered(10e9, seed=1)
    stream = th.Symbols(np.random.default_rng(1).integers(0, 2, given.symbols), rate=1e9, power=5e-3)
    times = stream.samples()
    arguments = {"inputs": {"in": stream}, "duration": stream.stop, "times": times}
    coupled.simulate_circuit(circuit, array, inputs={"in": 1e-3}, duration=1e-9)  # compiles
    reference = coupled.simulate_circuit(circuit, array, **arguments, rtol=1e-9).energy.values
    for rtol in (1e-4, 1e-5, 1e-6):
        start = time.process_time()
        run = coupled.simulate_circuit(circuit, array, **arguments, rtol=rtol)
        spent = time.process_time() - start
        error = float(np.sqrt(np.mean((run.energy.values - reference) ** 2)) / reference.max())
        per_100us = spent * 1e-4 / stream.stop
        print(
            f"{n} rings, rtol {rtol:g}: {spent:.3f} s, {run.attrs['steps']} steps, error {error:.1e}; "
            f"100 us: {per_100us:.1f} s"
        )
    if given.peer:
        for rtol in (1e-5, 1e-7):
            start = time.process_time()
            peer = lsoda(circuit, array, {"in": stream}, stream.stop, times, rtol)
            spent = time.process_time() - start
            error = float(np.sqrt(np.mean((peer - reference) ** 2)) / reference.max())
            print(f"LSODA, rtol {rtol:g}: {spent:.1f} s, error {error:.1e}")


if __name__ == "__main__":
    main()
