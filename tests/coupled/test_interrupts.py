"""Ctrl-C while compiled code runs: a KeyboardInterrupt, late but whole, and nothing queued goes on."""

from __future__ import annotations

import signal
import subprocess
import sys
from concurrent.futures import Executor, Future

import pytest

import coupled
import thermofem as th
from coupled.kernels.interrupts import uninterrupted

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])


class Kernel:
    """Stands for compiled code: hears ``signals`` Ctrl-C, then goes on to its end."""

    signatures = ("compiled",)

    def __init__(self, signals: int) -> None:
        self.signals, self.done = signals, False

    def __call__(self, value: int) -> int:
        for _ in range(self.signals):
            signal.raise_signal(signal.SIGINT)
        self.done = True
        return value


@pytest.mark.parametrize(("signals", "done"), [(1, True), (2, False)])
def test_an_interrupt_waits_for_the_kernel_and_a_second_one_does_not(signals, done):
    kernel, before = Kernel(signals), signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        uninterrupted(kernel, 3)
    assert kernel.done is done
    assert signal.getsignal(signal.SIGINT) is before


def test_without_an_interrupt_the_answer_comes_back():
    assert uninterrupted(Kernel(0), 3) == 3


def test_an_interrupted_run_is_a_keyboard_interrupt():
    """In a process of its own: raised amid the hand-over of the results it was a SystemError or a crash."""
    script = """
import os, signal, threading
import coupled, thermofem as th
model = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
run = lambda duration: coupled.simulate(coupled.borghi2021(), model, power=6.31e-3, detuning=5e9, duration=duration)
run(1e-7)  # compiled
threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    run(5e-3)  # most of a second
except KeyboardInterrupt:
    print("interrupted")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (0, "interrupted\n"), done.stderr


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
