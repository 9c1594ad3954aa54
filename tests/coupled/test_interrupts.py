"""Ctrl-C while the kernel runs: a KeyboardInterrupt within a second, and nothing queued goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future
from importlib import import_module

import numpy as np
import pytest

import coupled
import thermofem as th
from coupled.maps.pulsing_map import pulse

pytestmark = pytest.mark.slow

RING = coupled.borghi2021()
MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])


@pytest.fixture(autouse=True)
def ctrl_c_is_heard():
    """A shell may have started the tests with the signal ignored, as for a job in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("duration", [9e-5, 5e-3], ids=["short", "long"])
def test_an_interrupted_run_is_a_keyboard_interrupt(duration):
    """In a process of its own, also where it is raised amid the hand-over of the results."""
    script = f"""
import os, signal, threading
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored
import coupled, thermofem as th
model = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
run = lambda duration: coupled.simulate(coupled.borghi2021(), model, power=6.31e-3, detuning=5e9, duration=duration)
run(1e-7)  # compiled
threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    while True:
        run({duration})
except KeyboardInterrupt:
    print("interrupted")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


def test_a_long_run_says_how_far_it_is_and_begins_as_a_short_one_does():
    seen: list[float] = []
    run = coupled.simulate(RING, MODEL, power=6.31e-3, duration=3e-3, progress=seen.append)
    assert seen[-1] == pytest.approx(3e-3, rel=1e-15, abs=0)
    assert len(seen) > 1
    assert all(np.diff(seen) >= 0)
    short = coupled.simulate(RING, MODEL, power=6.31e-3, duration=50e-6, progress=seen.append)
    assert seen[-1] == pytest.approx(50e-6, rel=1e-15, abs=0)
    before = slice(short.sizes["time"] - 1)  # its last step is cut short
    for name in ("energy", "carriers", "delta_T"):
        assert np.array_equal(run[name][before], short[name][before])


def test_an_interrupted_map_ends_the_runs_under_way(monkeypatch):
    """Rows of 20 points of 50 ms each in threads, minutes of work; Ctrl-C comes when each of them has begun."""
    ended, begun = [], threading.Barrier(3)

    def recorded(*arguments, **options):
        begun.wait(60)
        try:
            return pulse(*arguments, **options)
        except KeyboardInterrupt:
            ended.append(True)
            raise

    monkeypatch.setattr(import_module("coupled.maps.pulsing_map"), "pulse", recorded)
    monkeypatch.setattr("os.cpu_count", lambda: 2)

    def press_soon():
        begun.wait(60)
        time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press_soon).start()
    with pytest.raises(KeyboardInterrupt):
        coupled.pulsing_map(RING, MODEL, [6e-3, 6.1e-3], np.linspace(0, 1e9, 20), duration=50e-3)
    assert ended == [True, True]


class Interrupted(Executor):
    """Gives back the first job as interrupted; the others wait for ever."""

    def __init__(self) -> None:
        self.jobs: list[Future[object]] = []

    def submit(self, fn, /, *args, **kwargs):
        self.jobs.append(Future())
        if len(self.jobs) == 1:
            self.jobs[0].set_exception(KeyboardInterrupt())
        return self.jobs[-1]


def test_an_interrupted_map_leaves_nothing_queued():
    executor = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        coupled.pulsing_map(coupled.borghi2021(), MODEL, [1e-3, 2e-3, 3e-3], [0.0], duration=1e-6, executor=executor)
    assert [job.cancelled() for job in executor.jobs] == [False, True, True]
