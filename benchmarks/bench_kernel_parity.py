"""Every path of the kernel against another installation: largest difference and ratio of CPU times.

    python benchmarks/bench_kernel_parity.py OLD_PYTHON [CASES]

OLD_PYTHON is the interpreter of an environment with version 0.2. Both run the same random rings, drives, events,
heaters, lasers and circuits at rtol 1e-9 to the same times; the differences are relative to the largest value of a
trace. Times are those of a second call, at rtol 1e-6. Fixed points and settled cycles are compared, too; a ring that
rests is an error in either.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

CASES = 100
Call = Callable[[float], Any]


def circuit_run(coupled: Any) -> Callable[..., Any]:
    """`simulate` of a circuit in either version: 0.2 had a function for circuits, with ``inputs``."""
    of_circuits = getattr(coupled, "_".join(("simulate", "circuit")), None)
    if of_circuits:
        return lambda circuit, model, power, **more: of_circuits(circuit, model, inputs=power, **more)
    return lambda circuit, model, power, **more: coupled.simulate(circuit, model, power=power, **more)


def cases(count: int) -> Iterator[tuple[str, Call]]:
    """Name of the path, and a function of rtol."""
    import coupled
    import thermofem as th

    rng, base, run = np.random.default_rng(7), coupled.borghi2021(), circuit_run(coupled)
    for _ in range(count):
        ring = replace(
            base, bus_rate=base.bus_rate * rng.uniform(0.5, 2), loss_rate=base.loss_rate * rng.uniform(0.5, 2)
        )
        n = int(rng.integers(1, 15))
        model = th.Foster(R=rng.uniform(0.2, 1, n) * 8e3 / n, tau=np.sort(10 ** rng.uniform(-7.7, -5, n)))
        P, nu, end = 10 ** rng.uniform(-3.3, -2), rng.uniform(-30e9, 20e9), 1e-6
        t = np.linspace(0, end, 101)
        light = {"power": P, "detuning": nu, "duration": end, "times": t}
        still = {"power": P, "detuning": nu}
        yield "fixed points", lambda r, ring=ring, m=model, at=still: coupled.steady_states(ring, m, **at)
        yield "settled cycle", lambda r, ring=ring, m=model, at=still: coupled.limit_cycle(ring, m, **at)
        mapped = th.OutputMap(model, 1e-3)
        pulse = th.Pulse(power=P, width=0.1e-6, start=0.3e-6)
        square = th.SquareWave(power=P, period=0.1913e-6, duty=0.4)  # no front at an output time, where sides differ
        sweep = coupled.Sweep([0, end], [nu, nu + 10e9])
        yield "ring", lambda r, ring=ring, m=model, light=light: coupled.simulate(ring, m, rtol=r, **light)
        yield "output map", lambda r, ring=ring, m=mapped, light=light: coupled.simulate(ring, m, rtol=r, **light)
        driven = light | {"power": [P / 2, pulse], "detuning": sweep}
        yield "drive", lambda r, ring=ring, m=model, light=driven: coupled.simulate(ring, m, rtol=r, **light)
        event = light | {"event": coupled.Event("energy", 5e-15, stop=False)}
        yield "event", lambda r, ring=ring, m=model, light=event: coupled.simulate(ring, m, rtol=r, **light)
        A = -np.diag(1 / np.asarray(model.tau))
        both = th.StateSpace(
            np.eye(n), A, np.column_stack([model.gain, 0.3 * model.gain]), np.ones((1, n)),
            inputs=("core", "heater"), outputs=("core",),
        )  # fmt: skip
        heated = light | {"heaters": {"heater": square}}
        yield "heater", lambda r, ring=ring, m=both, light=heated: coupled.simulate(ring, m, rtol=r, **light)
        other = replace(ring, frequency=ring.frequency + 1.5e12)
        lasers = light | {"lasers": [coupled.Laser(P / 3, nu / 2, resonance=other)]}
        yield "two resonances", lambda r, ring=ring, m=model, light=lasers: coupled.simulate(ring, m, rtol=r, **light)
        beating = light | {"duration": 0.2e-6, "times": t / 5, "lasers": [coupled.Laser(P / 3, nu + 1e9)]}
        yield "beat", lambda r, ring=ring, m=model, light=beating: coupled.simulate(ring, m, rtol=r, **light)
        small = model.R[:2], model.tau[:2]
        H = np.zeros((len(small[0]),) * 3)
        for i in range(len(H)):
            H[i, i, i] = -2e-4 / small[1][i]
        quadratic = th.Quadratic(
            A=-np.diag(1 / np.asarray(small[1])), H=H, G=np.zeros_like(H[0]), B=np.asarray(small[0]) / small[1],
            C=np.ones(len(H)),
        )  # fmt: skip
        yield "quadratic", lambda r, ring=ring, m=quadratic, light=light: coupled.simulate(ring, m, rtol=r, **light)
        rings = [replace(ring, frequency=ring.frequency + f) for f in rng.normal(0, 5e9, 4)]
        at = {"detuning": nu, "duration": end / 2, "times": t / 2}
        loop = coupled.Waveguide("ring 1.through", "ring 1.add", loss=1.0, phase=0.4, delay=0.5e-9)
        circuits = {
            "bus": coupled.bus(rings, phase=1.0, loss=0.1),
            "loops": coupled.scissor(rings[:3], phase=1.0),
            "delay": coupled.bus(rings[:2], phase=1.0, delay=0.3e-9),
            "delay loop": coupled.Circuit([ring], [loop], [coupled.LaserPort("in", "ring 1.in")]),
        }
        for name, circuit in circuits.items():
            yield name, lambda r, c=circuit, m=model, P=P, at=at: run(c, m, {c.lasers[0].name: P}, rtol=r, **at)
        stream = {"average": True, **at}
        slow = replace(circuits["bus"], detectors=[replace(d, bandwidth=2e9) for d in circuits["bus"].detectors])
        yield "detectors", lambda r, c=slow, m=model, P=square, at=stream: run(c, m, {"in": P}, rtol=r, **at)
        pair = th.StateSpace(
            np.eye(2 * n), np.kron(np.eye(2), A), np.kron(np.eye(2), np.ones((n, 1))) * np.tile(model.gain, 2)[:, None],
            np.kron([[1, 0.1], [0.1, 1]], np.ones((1, n))), inputs=("ring 1", "ring 2"), outputs=("ring 1", "ring 2"),
        )  # fmt: skip
        two = coupled.bus(rings[:2])
        yield "heat between rings", lambda r, c=two, m=pair, P=P, at=at: run(c, m, {"in": P}, rtol=r, **at)


def work(out: str, count: int) -> None:
    """Run all cases in this installation."""
    found: list[tuple[str, dict[str, Any], float]] = []
    for name, call in cases(count):
        try:
            run = call(1e-9)
            call(1e-6)
            began = time.process_time()
            call(1e-6)
            spent = time.process_time() - began
            if name == "settled cycle":  # sampled otherwise: the numbers of the orbit
                kept = ("period", "duty", "swing")
                traces = {each: run.attrs[each] for each in kept if each in run.attrs}
            else:
                traces = {str(v): run[v].values for v in run.data_vars if run[v].dtype.kind in "fc"}
                traces["crossings"] = run.attrs.get("crossings", np.empty(0))
        except Exception as error:
            traces, spent = {"error": str(error)}, 0.0
        found.append((name, traces, spent))
    Path(out).write_bytes(pickle.dumps(found))


def main(old: str, count: int) -> None:
    """Compare the two installations."""
    results = []
    for python in (old, sys.executable):
        out = Path(f"parity_{len(results)}.pickle")
        subprocess.run([python, __file__, "--work", str(out), str(count)], check=True)
        results.append(pickle.loads(out.read_bytes()))
        out.unlink()
    table: dict[str, list[Any]] = {}
    for (name, before, t0), (_, now, t1) in zip(*results, strict=True):
        row = table.setdefault(name, [0.0, "", 0.0, 0.0, 0, []])
        row[4] += 1
        if "error" in before or "error" in now:
            reasons = tuple(str(each.get("error")).partition(": ")[0] for each in (before, now))  # without numbers
            if reasons[0] != reasons[1]:
                row[5].append(reasons)
            continue
        row[2], row[3] = row[2] + t0, row[3] + t1
        for key in before.keys() & now.keys():
            a, b = np.atleast_1d(before[key]), np.atleast_1d(now[key])
            if a.shape != b.shape:
                row[5].append((key, a.shape, b.shape))
            elif a.size and key not in ("phase",):
                away = float(np.abs(a - b).max() / max(np.abs(a).max(), 1e-300))
                row[0], row[1] = max((row[0], row[1]), (away, key))
    print(f"{'path':20} {'cases':>5} {'difference':>11} {'of':>12} {'CPU, new/old':>13}")
    for name, (away, key, t0, t1, number, errors) in table.items():
        print(f"{name:20} {number:5d} {away:11.1e} {key:>12} {t1 / max(t0, 1e-9):13.2f}", *errors[:2])


if __name__ == "__main__":
    if sys.argv[1] == "--work":
        work(sys.argv[2], int(sys.argv[3]))
    else:
        main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else CASES)
