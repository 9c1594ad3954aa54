"""Processes that share the tasks: each takes, of those that are ready, the one with the longest chain behind it."""

from __future__ import annotations

import math
import multiprocessing
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from threading import current_thread, main_thread
from types import FrameType

from thermofem import checks

from .plan import stages_of
from .project import Project, WorkItem
from .settings import Settings

WORTH = 10.0  # s of work, from which on more processes, which begin with imports, end earlier
Workers = dict[Connection, SpawnProcess]


@contextmanager
def crew(project: Project, processes: int, left: Sequence[WorkItem]) -> Iterator[Workers]:
    """Processes that do what `share` sends them, until the end of the block or of this process.

    There are at most as many as the longest chain of tasks that are ``left`` leaves something to do, and none, so that
    this process works alone, where one is enough.
    """
    work = sum(task.weight for task in left)
    count = min(processes, math.ceil(work / max(chains_of(left).values()))) if work > WORTH else 1
    context = multiprocessing.get_context("spawn")
    workers: Workers = {}
    try:
        for _ in range(count if count > 1 else 0):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(project.out, project.settings, theirs), daemon=True)
            _start(process)
            workers[ours] = process
            theirs.close()
        yield workers
    finally:
        for process in workers.values():
            process.terminate()
        for process in workers.values():
            process.join()


def share(
    project: Project, tasks: Sequence[WorkItem], workers: Workers, tell: Callable[[WorkItem, float], None]
) -> None:
    """Do the tasks, each after its inputs, and call ``tell`` with a task and the finished share of it.

    Without workers, this process does them in order. The exception of a task is raised here.
    """
    if not workers:
        for task in tasks:
            tell(task, 0.0)
            getattr(project, task.kind)(task, partial(tell, task))
            tell(task, 1.0)
        return
    chains = chains_of(tasks)
    waiting = sorted(tasks, key=lambda task: -chains[task.name])
    unfinished, busy = set(chains), dict[Connection, WorkItem]()
    while unfinished:
        for worker in workers.keys() - busy.keys():
            ready = next((task for task in waiting if unfinished.isdisjoint(task.inputs)), None)
            if ready is not None:
                waiting.remove(ready)
                busy[worker] = ready
                tell(ready, 0.0)
                with suppress(BrokenPipeError):  # `_hear` then names the task
                    worker.send(ready)
        wait(list(busy))
        for worker in [worker for worker in busy if worker.poll()]:
            part = _hear(worker, busy[worker])
            tell(busy[worker], 1.0 if part is None else part)
            if part is None:
                unfinished.discard(busy.pop(worker).name)


def chains_of(tasks: Sequence[WorkItem]) -> dict[str, float]:
    """Weight of each task with the longest chain of tasks that wait for it, by name; inputs come first in ``tasks``."""
    chains: dict[str, float] = {}
    for task in reversed(tasks):
        chains[task.name] = task.weight + max((chains[t.name] for t in tasks if task.name in t.inputs), default=0.0)
    return chains


def _hear(worker: Connection, task: WorkItem) -> float | None:
    """Return the finished share of a task, None at its end, or raise the exception that ended it."""
    try:
        said = worker.recv()
    except (EOFError, ConnectionResetError):
        raise checks.InputError(
            f"the process of the step {task.name!r} was killed, as the system does when memory runs out",
            "what is finished is kept: start it again",
        ) from None
    if isinstance(said, Exception):
        raise said
    return None if said is None else float(said)


def _work(out: Path, settings: Settings, parent: Connection) -> None:
    """Do the tasks that the parent sends, and send their progress back, until the parent ends."""
    project = Project(out, settings, stages_of(settings))
    with suppress(EOFError, BrokenPipeError):  # the parent has gone
        while True:
            task = parent.recv()
            try:
                getattr(project, task.kind)(task, parent.send)
            except Exception as error:
                error.add_note(traceback.format_exc())
                parent.send(error)
            else:
                parent.send(None)


def _start(process: SpawnProcess) -> None:
    """Start a process that never hears Ctrl-C, not even in its imports; in this process it counts afterwards."""
    before, came = signal.getsignal(signal.SIGINT), list[tuple[int, FrameType | None]]()
    if not (hasattr(signal, "pthread_sigmask") and callable(before) and current_thread() is main_thread()):
        process.start()
        return
    resource_tracker.ensure_running()  # its start would let the signal through
    signal.signal(signal.SIGINT, lambda *signal: came.append(signal))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the process inherits this
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, before)
    if came:
        before(*came[0])
