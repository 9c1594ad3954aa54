"""Audit of self-pulsing verdicts: random rings where their regime changes, judged by runs ten times as long.

    python tests/audit/verdicts.py 4000

The verdicts are those of a trace and of a map. The judge is a run of ten times the duration at a hundredth of
the tolerance: the carriers of its last tenth swing or they do not. "Slow transient" claims nothing. The map is that of
the transient (`duration` is given). Wrong verdicts whose reason says that something still moves count as flagged.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from time import process_time
from typing import NamedTuple

import numpy as np

import coupled
import thermofem as th

SWING = 0.02  # of the carriers' maximum: what counts as pulses
DURATIONS = (5e-6, 10e-6, 20e-6)  # s


class Cell(NamedTuple):
    """A ring, its thermal model, and laser power (W) and detuning (Hz) where its fixed points lose stability."""

    ring: coupled.RingResonator
    model: th.Foster
    power: float
    detuning: float


def random_ring(seed: int, most: int = 1) -> Iterator[Cell]:
    """Any ring and network, lit at up to ``most`` places at the edge of where its fixed points lose stability."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    ring = replace(
        coupled.borghi2021(),
        bus_rate=between(5e9, 80e9),
        drop_rate=float(rng.integers(2)) * between(5e9, 80e9),
        loss_rate=between(1e9, 15e9),
        scattering_rate=between(1e8, 1e10),
        fcd=((-between(1e-27, 1e-26), 1.0),),
        tpa_coefficient=between(4e-12, 2e-11),
        carriers=coupled.ConstantLifetime(between(2e-9, 60e-9)),
    )
    tau = [between(1e-8, 5e-6) for _ in range(rng.integers(1, 7))]
    model = th.Foster(R=between(2e3, 1.2e4) * rng.dirichlet(np.ones(len(tau))), tau=tau)
    powers, detunings = np.geomspace(0.5e-3, 15e-3, 12), np.linspace(-8, 3, 45) * ring.linear_rate / (2 * np.pi)
    pulses = coupled.stability_map(ring, model, powers, detunings).regime.values == "self-pulsing"
    edges = np.argwhere(pulses[:, 1:] != pulses[:, :-1])
    for _ in range(min(most, len(edges))):
        i, j = edges[rng.integers(len(edges))]
        yield Cell(ring, model, float(powers[i]), float(rng.uniform(detunings[j], detunings[j + 1])))


def swings(cell: Cell, duration: float) -> tuple[float, float]:
    """Swing of the carriers over their maximum, in the last tenth of a long run and in the tenth before it."""
    times = np.linspace(0.8 * duration, duration, 8001)
    run = coupled.simulate(
        cell.ring, cell.model, power=cell.power, detuning=cell.detuning, times=times, duration=duration, rtol=1e-8
    )
    carriers = run["carriers"].values
    before, last = carriers[:4001], carriers[4000:]
    return float(np.ptp(last) / last.max()), float(np.ptp(before) / before.max())


def wrong(regime: str, last: float, before: float) -> bool:
    """Whether a long run contradicts a verdict; pulses that still fall from tenth to tenth contradict no rest.

    A fall of 5 % counts: pulses that persist differ by less than 1e-4 between the tenths.
    """
    if regime == "self-pulsing":
        return last < SWING
    return regime == "stable" and last > SWING and last > 0.95 * before


def main(count: int, first: int = 0) -> int:
    """Judge ``count`` cells of the rings from seed ``first`` on; the number of wrong verdicts."""
    start, cells, said, broken, seed = process_time(), 0, Counter[str](), 0, first
    while cells < count:
        for cell in random_ring(seed, most=8):
            duration = DURATIONS[cells % len(DURATIONS)]
            drive = {"power": cell.power, "detuning": cell.detuning, "duration": duration}
            trace = coupled.pulsing(coupled.simulate(cell.ring, cell.model, **drive))
            grid = coupled.pulsing_map(cell.ring, cell.model, [cell.power], [cell.detuning], duration=duration)
            verdicts = {
                "trace": (str(trace.regime), trace.reason),
                "map": (grid["regime"].values.item(), grid["reason"].values.item()),
            }
            claims = any(regime in ("stable", "self-pulsing") for regime, _ in verdicts.values())
            judged = swings(cell, 10 * duration) if claims else (0.0, 0.0)
            for what, (regime, reason) in verdicts.items():
                said[f"{what}: {regime}"] += 1
                if not wrong(regime, *judged):
                    continue
                if "falling" in reason or "differ" in reason:
                    said[f"{what}: wrong, flagged"] += 1
                    continue
                broken += 1
                print(
                    f"BROKEN seed {seed}, {what} of {duration} s: {regime} ({reason}), swings {judged}, "
                    f"{cell.power} W, {cell.detuning} Hz",
                    flush=True,
                )
            cells += 1
        seed += 1
    print(f"{cells} cells, {process_time() - start:.0f} s: {broken} wrong verdicts; {dict(said)}")
    return broken


if __name__ == "__main__":
    sys.exit(bool(main(*(int(argument) for argument in sys.argv[1:3] or ["4000"]))))
