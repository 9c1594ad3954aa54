"""Worker processes, each with one BLAS thread.

On Linux a server process imports the libraries once, and every worker begins as a copy of it (multiprocessing's
"forkserver"). Elsewhere every worker is a new process that imports them again ("spawn").
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Iterator
from multiprocessing.context import BaseContext

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
LOADED = ["thermofem.campaign.libraries", "thermofem.campaign.work"]
COMMANDS = "thermofem.cli"  # imported again by every worker of a command, as part of its main module


def context() -> BaseContext:
    """How this system starts worker processes."""
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    found = multiprocessing.get_context("forkserver")
    found.set_forkserver_preload([*LOADED, *([COMMANDS] if COMMANDS in sys.modules else [])])
    return found


def cpus() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def begin() -> None:
    """Start the server process, so that it imports the libraries while this process reads files."""
    if context().get_start_method() == "forkserver":
        from multiprocessing import forkserver

        with one_thread():
            forkserver.ensure_running()


def wait_until_ready() -> None:
    """Wait for the server process to have its libraries: a worker that Ctrl-C finds in its start leaves a traceback."""
    if context().get_start_method() == "forkserver":
        first = context().Process(target=int)  # type: ignore[attr-defined]
        first.start()
        first.join()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context in which new worker processes use one BLAS thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
