"""Audit of settled cycles: their derivatives against differences, and those of a circuit of one ring against them.

    python tests/audit/cycles.py 200

Derivatives are compared with central differences of fourth order between cycles that Newton's method settles again, for
random parameters of random rings. A measure off by more than `OFF` of itself per relative change of the parameter
counts. A circuit of the ring on a bus must have the same cycle, or none.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
from verdicts import random_ring

import coupled
import thermofem as th
from coupled.cycles.derivatives import FINE
from coupled.cycles.guess import from_guess
from coupled.cycles.measures import measure
from coupled.cycles.orbit import CycleProblem, Orbit, problem, settle
from coupled.cycles.parameters import changed, parameter_names, value_of

MEASURES = ("period", "duty", "swing", "extinction")
OFF = np.array([1e-5, 1e-2, 1e-4, 1e-3])  # the duty cycle of short pulses is the difference of two moments
STEP, CHOSEN, AROUND = 1e-5, 4, 4  # relative step; parameters of each cycle; cycles tried with each ring
CIRCUIT = 1e-5  # of the period: what shooting at 1e-10 a step may differ


def measured(p: CycleProblem, orbit: Orbit) -> np.ndarray:
    """Period in s, duty cycle, swing in K and extinction in dB."""
    seen = measure(p, orbit)
    return np.array([orbit.T * 1e-9, seen.duty, seen.swing, seen.extinction])


def differences(p: CycleProblem, base: Orbit, name: str, relative: float) -> np.ndarray | None:
    """Derivatives of the measures by a parameter, of fourth order; None where a cycle beside is not found."""
    value = value_of(p, name)
    ends = []
    for k in (1, -1, 2, -2):
        beside = changed(p, name, value * (1 + k * relative))
        orbit = settle(beside, base, FINE)
        if orbit is None:
            return None
        ends.append(measured(beside, orbit))
    return (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * relative * value)


def compared(seed: int) -> Iterator[str]:
    """What holds and what does not at one random ring, in a word each."""
    rng = np.random.default_rng(seed)
    for edge in random_ring(seed, AROUND):  # and further in, where pulses are short
        width = edge.ring.linear_rate / (2 * np.pi)  # Hz
        cell = edge._replace(power=edge.power * rng.uniform(1, 4), detuning=edge.detuning + rng.uniform(-2, 2) * width)
        drive = {"power": cell.power, "detuning": cell.detuning}
        try:
            cycle = coupled.limit_cycle(cell.ring, cell.model, **drive)
        except th.InputError:
            continue
        yield "circuit " + circuit(cell.ring, cell.model, cycle.attrs["period"], drive)
        p = problem(cell.ring, cell.model, cell.power, cell.detuning)
        base = settle(p, from_guess(p, cycle).orbit, FINE)
        if base is None:
            yield "not settled"
            continue
        names = [n for n in parameter_names(cell.ring, cell.model) if value_of(p, n)]
        chosen = rng.permutation(names)[:CHOSEN].tolist()
        found = coupled.cycle_derivatives(cell.ring, cell.model, chosen, cycle=cycle, **drive)
        for name in chosen:
            want = differences(p, base, name, STEP)
            if want is None:
                yield "no neighbour"
                continue
            got = np.array([float(found[key].sel(parameter=name)) for key in MEASURES])
            off = np.abs((got - want) * value_of(p, name)) / np.abs(measured(p, base))
            bad = [f"{key} {x:.1e}" for key, x, most in zip(MEASURES, off, OFF, strict=True) if x > most]
            yield f"OFF by {name}: {', '.join(bad)} (duty {cycle.attrs['duty']:.1e})" if bad else "derivatives right"


def circuit(ring: coupled.RingResonator, model: th.Foster, period: float, drive: dict[str, float]) -> str:
    """How the cycle of a circuit of one ring compares."""
    try:
        cycle = coupled.limit_cycle(
            coupled.bus([ring]), model, power={"in": drive["power"]}, detuning=drive["detuning"]
        )
    except th.InputError:
        return "refused"
    off = abs(cycle.attrs["period"] / period - 1)
    return "equal" if off < CIRCUIT else f"OFF by {off:.1e}"


def main(rings: int) -> int:
    """Compare random rings and print the counts; the exit code is 1 where anything is off."""
    counts: Counter[str] = Counter()
    for seed in range(rings):
        for word in compared(seed):
            counts[word.split(" by ")[0]] += 1
            if "OFF" in word:
                print(f"seed {seed}: {word}", flush=True)
    print(dict(counts))
    return int(any("OFF" in word for word in counts))


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
