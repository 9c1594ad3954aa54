"""Circuits beside `simulate`, beside single rings, and beside SciPy's LSODA on the kernel's right-hand side.

python benchmarks/bench_circuit.py [--symbols 100] [--whole] [--peer]

CPU time. LSODA lands on every edge of the stream, as the kernel does. Errors are root mean squares of the energies of
all rings at the ends of the symbols, relative to the largest one, against a run at rtol = 1e-9.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import LSODA

import coupled
import surrogate
import thermofem as th
from coupled.circuit.system import system_of
from coupled.kernel.tableaus import Method

RINGS, PITCH = 16, 25e-6
PEER_SYMBOLS = 5  # LSODA runs so many; its time for more is in proportion
RING = coupled.borghi2021()
POLES = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])


def seconds(run: Callable[[], Any]) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start


def ratio(one: Callable[[], Any], other: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Median CPU seconds of two runs that take turns."""
    taken = [(seconds(one), seconds(other)) for _ in range(repeats)]
    return float(np.median([a for a, _ in taken])), float(np.median([b for _, b in taken]))


def lsoda(circuit: Any, thermal: Any, stream: th.Symbols, duration: float, rtol: float) -> np.ndarray:
    """Energies (J) at the ends of the symbols by LSODA, restarted at every edge."""
    n = len(circuit.names)
    problem, found = system_of(circuit, thermal, power={"in": stream}, duration=duration).problem(Method.RODAS5P), []
    edges, y, wanted = problem.edges, problem.zero(), stream.samples() * 1e9
    for piece in range(edges.size - 1):

        def f(t: float, y: np.ndarray, piece: int = piece) -> np.ndarray:
            return problem.slopes(y, piece, t)[0]

        solver = LSODA(f, edges[piece], y, edges[piece + 1], rtol=rtol, atol=rtol * 1e-3)
        while solver.status == "running":
            solver.step()
            here = wanted[(wanted > solver.t_old) & (wanted <= solver.t)]
            if here.size:
                at = solver.dense_output()(here)
                found.append(at[0 : 3 * n : 3] ** 2 + at[1 : 3 * n : 3] ** 2)
        y = solver.y
    return np.concatenate(found, axis=1) * 1e-15


def stream_of(symbols: int, rate: float) -> th.Symbols:
    return th.Symbols(np.random.default_rng(1).integers(0, 2, symbols), rate=rate, power=5e-3)


def run_stream(circuit: Any, thermal: Any, stream: th.Symbols, rtol: float) -> np.ndarray:
    run = coupled.simulate(
        circuit, thermal, power={"in": stream}, duration=stream.stop, times=stream.samples(), rtol=rtol
    )
    return run.energy.values


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one - other) ** 2)) / other.max())


def small(repeats: int) -> list[dict[str, Any]]:
    """One ring as a circuit, and sixteen rings that share nothing."""
    one, power = coupled.bus(RING), 6.31e-3
    names = [f"ring {k + 1}" for k in range(RINGS)]
    lasers = [coupled.LaserPort(name, f"{name}.in") for name in names]
    apart, inputs = coupled.Circuit([RING] * RINGS, lasers=lasers), dict.fromkeys(names, power)
    alone = lambda: coupled.simulate(RING, POLES, power=power, duration=200e-6)  # noqa: E731
    runs = {
        "one ring, 200 us": lambda: coupled.simulate(one, POLES, power={"in": power}, duration=200e-6),
        f"{RINGS} rings apart, 200 us": lambda: coupled.simulate(apart, POLES, power=inputs, duration=200e-6),
    }
    # of the energy after 2 us: later on the phase of the pulses is all that differs
    brief = {"duration": 2e-6, "times": [2e-6]}
    exact = float(coupled.simulate(RING, POLES, power=power, **brief, rtol=1e-11).energy[-1])
    errors = [
        float(np.abs(coupled.simulate(c, POLES, power=light, **brief).energy.values / exact - 1).max())
        for c, light in ((one, {"in": power}), (apart, inputs))
    ]
    found = []
    for (how, run), many, error in zip(runs.items(), (1, RINGS), errors, strict=True):
        run(), alone()
        ours, theirs = ratio(run, alone, repeats)
        row = {"who": "simulate", "how": f"{how}; 1 is {many} times simulate", "error": error}
        found.append(row | {"seconds": ours, "ratio": ours / (many * theirs)})
    return found


def bus_of_sixteen() -> tuple[Any, Any]:
    """Sixteen rings with scattered resonances on one bus, 25 um apart, with full crosstalk."""
    heat = th.assemble(th.strip_ring(outer_radius=PITCH * RINGS + 60e-6))
    array = surrogate.reduce_array(heat, [(PITCH * k, 0) for k in range(RINGS)], tolerance=1e-3)
    return coupled.bus([RING] * RINGS).scattered(10e9, seed=1), array


def against_lsoda(symbols: int, peer: bool, whole: bool) -> list[dict[str, Any]]:
    """Sixteen rings under 1 GHz symbols: our time for 100 us, and LSODA's in proportion."""
    circuit, array = bus_of_sixteen()
    few, stream = stream_of(PEER_SYMBOLS, 1e9), stream_of(100_000 if whole else symbols, 1e9)
    run_stream(circuit, array, few, 1e-3)
    exact, found = run_stream(circuit, array, few, 1e-10), []
    for rtol in (1e-2, 1e-3, 1e-4):
        spent = seconds(lambda rtol=rtol: run_stream(circuit, array, stream, rtol)) * 1e-4 / stream.stop
        error = difference(run_stream(circuit, array, few, rtol), exact)
        how = f"{RINGS} rings on a bus, {array.order} states of heat, 100 us at 1 GHz, rtol {rtol:g}"
        found.append({"who": "simulate", "how": how, "error": error, "seconds": spent, "ratio": 1.0})
        print(found[-1], flush=True)
    if peer:  # compiles
        lsoda(circuit, array, few, 1e-9, 1e-2)
    for rtol in (1e-3, 1e-4, 1e-5) if peer else ():
        begin = time.process_time()
        error = difference(lsoda(circuit, array, few, few.stop, rtol), exact)
        spent = (time.process_time() - begin) * 1e-4 / few.stop
        equal = min(found[:3], key=lambda row: abs(np.log(row["error"] / error)))
        how = f"the same, rtol {rtol:g}, from {PEER_SYMBOLS} symbols; 1 is ours of the nearest error"
        found.append(
            {"who": "SciPy LSODA", "how": how, "error": error, "seconds": spent, "ratio": spent / equal["seconds"]}
        )
        print(found[-1], flush=True)
    return found


def long_run() -> dict[str, Any]:
    """A millisecond of three rings at 100 MHz."""
    heat = th.assemble(th.strip_ring(outer_radius=150e-6))
    array = surrogate.reduce_array(heat, [(PITCH * k, 0) for k in range(3)], tolerance=1e-3)
    circuit, stream = coupled.scissor([RING] * 3, phase=0.5), stream_of(100_000, 1e8)
    few, rtol = stream_of(200, 1e8), 1e-2
    error = difference(run_stream(circuit, array, few, rtol), run_stream(circuit, array, few, 1e-9))
    spent = seconds(lambda: run_stream(circuit, array, stream, rtol))
    how = f"three-ring SCISSOR, {array.order} states of heat, 1 ms at 100 MHz, rtol {rtol:g}"
    return {"who": "simulate", "how": how, "error": error, "seconds": spent, "ratio": 1.0}


def rows(repeats: int) -> list[dict[str, Any]]:
    """Rows of the table of benchmarks."""
    return [*small(2 * repeats + 1), *against_lsoda(500, True, False), long_run()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--symbols", type=int, default=100)
    parser.add_argument("--whole", action="store_true", help="all 100 us of the sixteen rings")
    parser.add_argument("--peer", action="store_true", help="LSODA, too: minutes")
    given = parser.parse_args()
    for row in small(3):
        print(row, flush=True)
    print(long_run(), flush=True)
    against_lsoda(given.symbols, given.peer, given.whole)


if __name__ == "__main__":
    main()
