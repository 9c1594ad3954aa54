"""Long jobs: tasks in worker processes, and a store of their finished results in one folder.

A store holds a file for each key, and its hash in ``results.sha256``. Campaigns, maps, families and the paper keep
their results so. A file appears under its name when it is complete, its hash afterwards; a killed job goes on with
what has both, and a damaged file is computed again. A worker that dies costs its task one more try, alone; the others
go on.
"""

import contextlib
import logging
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from loky import ProcessPoolExecutor

from ..checks import InputError
from ..data import files


@dataclass(frozen=True)
class Store:
    """Store of finished results, one file for each key, in a folder.

    folder: holds ``results/KEY.ending`` and ``results.sha256``.
    ending: of the files, such as ".nc".
    """

    folder: Path
    ending: str

    @property
    def ledger(self) -> Path:
        """File with a line for each result: hash of its content, and its key."""
        return self.folder / "results.sha256"

    def path(self, key: str) -> Path:
        """File of one result."""
        return self.folder / "results" / f"{key}{self.ending}"

    @contextlib.contextmanager
    def opened(self, *inner: str) -> Iterator[None]:
        """Lock the folder of the store for this process as long as the with-block runs.

        The folder is made where there is none, and half-written files of a killed run are deleted.

        inner: names of folders to make in it beside "results".
        Raises InputError: it cannot be made or written, or another run is using it.
        """
        with files.own_folder(self.folder, ("results", *inner)):
            yield

    def hashes(self) -> dict[str, str]:
        """Hash of each result by key, from the ledger; the last line of a key counts, damaged lines are skipped."""
        if not self.ledger.is_file():
            return {}
        pairs = (line.split() for line in self.ledger.read_text(encoding="ascii", errors="replace").splitlines())
        return {pair[1]: pair[0] for pair in pairs if len(pair) == 2}

    def intact(self, keys: list[str]) -> set[str]:
        """Keys whose file exists with the content that was written."""
        hashes = self.hashes()
        unchanged = set()
        for key in keys:
            path = self.path(key)
            if key in hashes and path.is_file() and files.digest(path) == hashes[key]:
                unchanged.add(key)
        return unchanged

    def read(self, key: str) -> bytes | None:
        """Content of a result, or None where it is missing or damaged."""
        return files.read_bytes(self.path(key), "result") if self.intact([key]) else None

    def write(self, key: str, content: bytes) -> None:
        """Store a result."""
        files.write_whole(self.path(key), lambda temporary: temporary.write_bytes(content))
        self.enter(key)

    def enter(self, key: str) -> None:
        """Enter a result, whose file is complete, into the ledger; InputError where that cannot be written."""
        try:
            with self.ledger.open("a", encoding="ascii") as file:
                file.write(f"{files.digest(self.path(key))} {key}\n")
        except OSError as error:
            raise InputError(f"{self.ledger} cannot be written: {error.strerror}") from None


T = TypeVar("T")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerDiedError(RuntimeError):
    """A task killed its worker twice, as when memory runs out."""


def completed(
    function: Callable[[T], Any], tasks: Iterable[T], *, executor: Executor | None = None, workers: int | None = None
) -> Generator[tuple[T, Future[Any]]]:
    """Yield each task with its finished future, in the order of completion.

    executor: the caller's, left open; where it breaks, worker processes go on. None takes worker processes alone.
    workers: number of them; default one for each CPU.
    The future raises what ``function`` raised, or `WorkerDiedError` where a task killed two workers.
    """
    waiting = deque(tasks)
    count = min(workers or os.cpu_count() or 1, len(waiting))
    while waiting:
        suspects = deque[T]()
        for task, future in _in_pool(count, function, waiting, executor):
            if isinstance(future.exception(), BrokenExecutor):
                suspects.append(task)  # it killed a worker, or ran beside the one that did
            else:
                yield task, future
        executor = None
        while suspects:
            for task, future in _in_pool(1, function, deque([suspects.popleft()])):
                if isinstance(future.exception(), BrokenExecutor):
                    future = Future()
                    future.set_exception(WorkerDiedError("its worker process was killed twice; is memory short?"))
                yield task, future


def _in_pool(
    count: int, function: Callable[[T], Any], waiting: deque[T], executor: Executor | None = None
) -> Iterator[tuple[T, Future[Any]]]:
    """`_windowed` on the caller's executor, or in ``count`` worker processes."""
    with contextlib.nullcontext(executor) if executor else processes(count) as pool:
        # 64: tasks under way in a caller's executor, whose number of workers is unknown
        yield from _windowed(pool, function, waiting, 64 if executor else 2 * count)


@contextlib.contextmanager
def processes(count: int | None) -> Iterator[Executor]:
    """``count`` worker processes (None: one for each CPU); they end with the block, at once after an error."""
    # 10 s: an idle worker ends, also where its parent was killed
    pool = ProcessPoolExecutor(count or os.cpu_count(), timeout=10, env=ONE_THREAD, initializer=_begin)
    try:
        yield pool
    except BaseException:
        pool.shutdown(kill_workers=True)
        raise
    pool.shutdown()


def _begin() -> None:
    """Set up a worker process: ignore Ctrl-C, which the parent answers by ending its workers, and log errors only.

    Warnings of a worker are part of its result.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a process of our own
    logging.getLogger("thermofem").setLevel(logging.ERROR)


def _windowed(
    executor: Executor, function: Callable[[T], Any], waiting: deque[T], width: int
) -> Iterator[tuple[T, Future[Any]]]:
    """Submit at most ``width`` tasks at a time, so that memory does not grow with their number.

    Ends early where the executor breaks; ``waiting`` then holds what was not submitted.
    """
    under_way: dict[Future[Any], T] = {}
    try:
        while True:
            with contextlib.suppress(BrokenExecutor):
                while waiting and len(under_way) < width:
                    under_way[executor.submit(function, waiting[0])] = waiting[0]
                    waiting.popleft()
            if not under_way:
                return
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                yield under_way.pop(future), future
    finally:
        for future in under_way:
            future.cancel()
