"""Ctrl-C and compiled code: an exception raised while a kernel hands its results over crashes the interpreter.

Python runs its signal handlers between two of its own instructions. A kernel contains none, but Numba executes some
when it turns the results into objects, and a KeyboardInterrupt raised there ends in a SystemError or a crash. The
interrupt must therefore be raised after the kernel, or in another thread.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiling import global_compiler_lock

LOOK = 0.1  # s between two looks at a kernel that runs


def new_watch(*kernels: int) -> NDArray[np.float64]:
    """Memory shared by a kernel and the waiting thread: a stop flag (0 or 1), and the time reached in ns.

    For several kernels at once a row each, as long as a cache line, so that none waits for what another writes.
    """
    return np.zeros((*kernels, 8))


def uninterrupted(kernel: Any, *arguments: Any) -> Any:
    """Call a short kernel, or a function that calls several; Ctrl-C takes effect when it returns.

    A second Ctrl-C, or one during a compilation, takes effect at once.
    """
    if threading.current_thread() is not threading.main_thread():  # signals go to the main thread only
        return kernel(*arguments)
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):  # nobody listens
        return kernel(*arguments)
    came: list[Any] = []

    def hold(number: int, frame: Any) -> None:
        if came or global_compiler_lock.is_locked():
            before(number, frame)
        came.append((number, frame))

    signal.signal(signal.SIGINT, hold)
    try:
        return kernel(*arguments)
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(*came[0])


def watched(kernel: Any, *arguments: Any, progress: Callable[[float], None] | None = None) -> Any:
    """Call a compiled kernel, whose last argument is a watch, in a thread of its own; Ctrl-C ends it within a step.

    ``progress`` is called with the time reached in ns about ten times a second; what it raises ends the kernel, too.
    """
    watch = arguments[-1]
    _compile(kernel, arguments)
    with ThreadPoolExecutor(1) as pool:
        try:
            job = pool.submit(kernel, *arguments)
            while True:
                try:
                    return job.result(LOOK)
                except TimeoutError:
                    if progress:
                        progress(float(watch[1]))
        finally:
            watch[0] = 1.0


def _compile(kernel: Any, arguments: tuple[Any, ...]) -> None:
    """Compile a kernel for the types of its arguments, unless that was done before; Ctrl-C works meanwhile."""
    kernel.compile(tuple(kernel.typeof_pyval(argument) for argument in arguments))
