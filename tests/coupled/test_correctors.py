"""Thermal solvers of one's own in the loop: in closed form, in another process, and those that cannot be followed."""

from __future__ import annotations

import multiprocessing
import re
import subprocess
import sys

import numpy as np
import pytest
from correctors import MW, NETWORK, RING, Exact, traces_apart
from paths import ROOT

import coupled
import surrogate


@pytest.mark.slow
def test_a_corrector_of_ones_own():
    drive = {"power": MW, "duration": 1e-6}
    corrector = Exact(NETWORK)
    run = coupled.cosimulate(RING, corrector, predictor=surrogate.newton(tau_th=275e-9), **drive)
    assert traces_apart(run, coupled.simulate(RING, NETWORK, **drive)) < 2e-3
    assert corrector.accepted == run.attrs["windows"]
    assert np.array_equal(run.delta_T, np.concatenate([corrector.said[0], *(rise[1:] for rise in corrector.said[1:])]))
    assert run.attrs["passes"] < 1000  # 435; with half of the discrepancy fed back 4590
    assert run.sizes["window"] == run.attrs["windows"]


def _serve(pipe):
    """Another process that owns the thermal model."""
    corrector = Exact(NETWORK)
    while (message := pipe.recv()) is not None:
        pipe.send(corrector.advance(*message) if message else corrector.accept())


class Remote:
    """A corrector at the other end of a connection of the standard library."""

    def __init__(self, pipe):
        self.pipe = pipe

    def advance(self, times, power):
        self.pipe.send((times, power))
        return self.pipe.recv()

    def accept(self):
        self.pipe.send(())
        self.pipe.recv()


def test_two_processes():
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,))
    process.start()
    try:
        drive = {"power": MW, "duration": 0.3e-6, "predictor": NETWORK}
        run = coupled.cosimulate(RING, Remote(here), **drive)
    finally:
        here.send(None)
        process.join(20)
    assert process.exitcode == 0
    assert np.array_equal(run.delta_T, coupled.cosimulate(RING, Exact(NETWORK), **drive).delta_T)


@pytest.mark.slow
def test_a_co_simulation_unit_in_another_process():
    """The example, whole: 22 passes, 4 mK of 10 K from the unit's constant power over steps of 0.1 ns."""
    example = ROOT / "examples" / "fmu_corrector.py"
    done = subprocess.run([sys.executable, str(example)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = re.search(r"(\d+) passes of (\d+) windows.*\nlargest rise (\S+) K, apart (\S+) mK", done.stdout)
    passes, windows, rise, apart = map(float, found.groups())
    assert rise > 10
    assert apart < 8
    assert windows > 1  # so that the unit went on from what it had accepted
    assert passes > 2 * windows  # and went back to it
