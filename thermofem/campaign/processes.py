"""Worker processes, each with one BLAS thread.

On Linux a server process imports the libraries once, and every worker begins as a copy of it (multiprocessing's
"forkserver"). Elsewhere every worker is a new process that imports them again ("spawn").
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.context import BaseContext
from threading import Lock

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
LOADED = ["thermofem.campaign.libraries", "thermofem.campaign.work"]
_environment = Lock()
COMMANDS = "thermofem_cli"  # imported again by every worker of a command, as part of its main module


def contexts(preload: tuple[str, ...] = ()) -> list[BaseContext]:
    """How this system starts worker processes, the best way first; "spawn" works everywhere.

    preload: what the server imports beside `LOADED`; the first one to start it decides.
    """
    spawn = multiprocessing.get_context("spawn")
    if sys.platform != "linux":
        return [spawn]
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload([*LOADED, *preload, *([COMMANDS] if COMMANDS in sys.modules else [])])
    return [server, spawn]


def cpus() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def begin(preload: tuple[str, ...] = ()) -> None:
    """Start the server process, so that it imports the libraries while this process reads files."""
    if contexts(preload)[0].get_start_method() == "forkserver":
        from multiprocessing import forkserver

        # without it workers start, too: a folder of temporary files whose name is too long for a socket
        with contextlib.suppress(OSError), one_thread(), _unheard():
            forkserver.ensure_running()


def deaf() -> None:
    """Have this thread, and the processes that it starts, not hear Ctrl-C: it leaves a traceback in their imports."""
    if hasattr(signal, "pthread_sigmask"):
        resource_tracker.ensure_running()  # its start would let the signal through
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


@contextlib.contextmanager
def _unheard() -> Iterator[None]:
    """Context that is `deaf`; Ctrl-C counts at its end."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ()) if hasattr(signal, "pthread_sigmask") else set()
    deaf()
    try:
        yield
    finally:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context in which new worker processes use one BLAS thread each."""
    with _environment:
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
