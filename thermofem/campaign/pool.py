"""An Executor of processes that survives the death of any of them, as when memory runs out.

A thread of this process stands behind every worker and talks to it through a pipe of its own. A worker that dies closes
its pipe and takes nothing along but its task, which is tried again, alone: no lock and no queue is shared, which a dead
process could hold or leave torn. (`concurrent.futures.ProcessPoolExecutor` waits for ever where a worker is killed in
the middle of a result, and it needs semaphores, which a killed parent leaves behind.)
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import ProcessError
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from threading import Condition, Lock
from typing import Any

from ..checks import InputError
from .processes import contexts, deaf, one_thread

DEATHS = 2  # of the worker that had a task to itself, before the task is given up
STARTS = 6  # of a worker that is killed before it is there
SERVER_GONE = 255  # multiprocessing's exit code of processes whose server was killed


class WorkerDiedError(RuntimeError):
    """A task whose worker died again and again; other tasks go on."""


class WorkersDoNotStartError(InputError):
    """No worker process can be had."""


@dataclass(frozen=True, eq=False)
class _Worker:
    """A process, and this end of its pipe."""

    process: BaseProcess
    pipe: Connection


class Pool(Executor):
    """Worker processes, started when there is something to do.

    Parameters
    ----------
    count : int
        of processes.
    prepare : callable
        runs in every worker before its first task.
    preload : modules that the server process imports once for all workers, where there is one.
    """

    def __init__(self, count: int, prepare: Callable[[], None], preload: tuple[str, ...] = ()) -> None:
        self.prepare, self.preload = prepare, preload
        self._threads = ThreadPoolExecutor(count, initializer=deaf)
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._gate = _Gate()
        self._lock = Lock()  # of the lists above, and of every process: two threads that wait for one lose its end
        self._stopped = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function in a worker; its Future raises `WorkerDiedError` where that kills the worker every time."""
        return self._threads.submit(self._run, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """End all workers at once, and whatever they do."""
        with self._lock:
            self._stopped = True
            for worker in self._all:
                _kill(worker.process)
        self._threads.shutdown(wait=wait, cancel_futures=True)
        with self._lock:
            for worker in self._all:
                worker.pipe.close()
                worker.process.join()
            self._all.clear()
            self._idle.clear()

    def _run(self, *task: Any) -> Any:
        """Result of a task, in the thread of its worker."""
        whole = ForkingPickler.dumps(task)
        for deaths in range(1 + DEATHS):  # the first one while others were at work: memory may suffice without them
            with self._gate(alone=deaths > 0), self._worker() as worker:
                try:
                    worker.pipe.send_bytes(whole)
                    answer = worker.pipe.recv_bytes()
                except (EOFError, OSError):
                    self._bury(worker)
                    continue
            fine, found = pickle.loads(answer)
            if not fine:
                raise found
            return found
        raise WorkerDiedError(f"the worker process died {DEATHS} times while it had only this to do (out of memory?)")

    @contextlib.contextmanager
    def _worker(self) -> Iterator[_Worker]:
        """A worker that has nothing to do, until the end of the block."""
        with self._lock:
            worker = self._idle.pop() if self._idle else None
        worker = worker or self._new()
        yield worker
        with self._lock:
            if worker in self._all:
                self._idle.append(worker)

    def _new(self) -> _Worker:
        """Start a worker and wait until it is there."""
        reason: object = ""
        for number in range(STARTS):
            try:
                worker = self._start(number)
            except (OSError, EOFError, ProcessError) as error:  # no server, as with too long a name of its socket
                reason = error
                continue
            try:
                worker.pipe.recv_bytes()
                return worker
            except (EOFError, OSError):
                code = self._bury(worker)
                reason = f"exit code {code}"
                if code == 1:  # an exception, as of a script that runs again
                    break
        raise WorkersDoNotStartError(
            f"the worker processes do not start ({reason}); a script calls run inside "
            'if __name__ == "__main__": and is a file on disk'
        )

    def _start(self, number: int) -> _Worker:
        """A process that imports what it needs; without the server where that failed twice."""
        with self._lock:
            if self._stopped:
                raise WorkersDoNotStartError("the worker processes have been ended")
            context = contexts(self.preload)[0 if number < 2 else -1]
            ours, theirs = context.Pipe()
            try:
                process = context.Process(target=_serve, args=(theirs, self.prepare), daemon=True)  # type: ignore[attr-defined]
                with one_thread():
                    process.start()
            except BaseException:
                ours.close()
                raise
            finally:
                theirs.close()
            worker = _Worker(process, ours)
            self._all.add(worker)
            return worker

    def _bury(self, worker: _Worker) -> int | None:
        """Forget a worker that has closed its pipe, and return its exit code."""
        with self._lock:
            self._all.discard(worker)
            worker.pipe.close()
            worker.process.join(1.0)  # for its exit code
            _kill(worker.process)
            worker.process.join()
            return worker.process.exitcode


class _Gate:
    """Lets many through at once, or one alone."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._inside = 0
        self._waiting = 0  # for being alone

    @contextlib.contextmanager
    def __call__(self, *, alone: bool) -> Iterator[None]:
        with self._changed:
            if alone:
                self._waiting += 1
                self._changed.wait_for(lambda: not self._inside)
                self._waiting -= 1
            else:
                self._changed.wait_for(lambda: not self._waiting and self._inside >= 0)
            self._inside = -1 if alone else self._inside + 1
        try:
            yield
        finally:
            with self._changed:
                self._inside = 0 if alone else self._inside - 1
                self._changed.notify_all()


def _kill(process: BaseProcess) -> None:
    """End a process, also where the server that started it has gone: nobody hears of its end then."""
    process.kill()
    if process.exitcode == SERVER_GONE and process.pid is not None:
        with contextlib.suppress(OSError):
            os.kill(process.pid, signal.SIGKILL)


def _serve(parent: Connection, prepare: Callable[[], None]) -> None:
    """In a worker: do what the parent sends, until it closes the pipe."""
    prepare()
    with contextlib.suppress(EOFError, OSError):  # the parent has gone
        parent.send_bytes(b"")
        while True:
            parent.send_bytes(_answer(parent.recv_bytes()))


def _answer(task: bytes) -> bytes:
    """What a task returns or raises, as bytes."""
    try:
        function, arguments, named = pickle.loads(task)
        return bytes(ForkingPickler.dumps((True, function(*arguments, **named))))
    except Exception as error:
        error.add_note(traceback.format_exc())
        with contextlib.suppress(Exception):
            text = bytes(ForkingPickler.dumps((False, error)))
            pickle.loads(text)  # some exceptions cannot be made again
            return text
        return bytes(ForkingPickler.dumps((False, RuntimeError(f"{type(error).__name__}: {error}"))))
