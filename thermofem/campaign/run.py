"""The loop of a campaign: tasks go to an Executor, results come back and are written, by this process alone.

At most a few tasks for each worker are under way, so memory does not grow with the campaign. A worker that dies takes
the pool of processes with it: a new pool is made, and what was under way is then tried one by one, so that the geometry
that kills its worker is found and recorded while the others go on.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .. import checks
from ..checks import InputError, MissingLibraryError
from .collect import Row, write_collections
from .processes import begin, context, cpus, one_thread, wait_until_ready
from .store import ResultStore
from .work import Outcome, compute, prepare, ready

if TYPE_CHECKING:
    from .plan import Campaign, Case

DEATHS = 2  # of the worker that had a geometry to itself, before it is given up
FOREIGN = 64  # limit of pending tasks for a user-supplied executor
ROOM, PER_ROW = 100_000_000, 2_000  # bytes of rows kept for the index, and of one beside its numbers; others are read


@dataclass(frozen=True)
class Summary:
    """Progress of a campaign.

    Attributes
    ----------
    total, reused, finished, failed : int
        all geometries; with a result from earlier runs; with one from this run; without a result, now or earlier.
    seconds, cpu_seconds : float
        of this run: wall time of the solving, CPU time of the geometries in the workers.
    """

    total: int
    reused: int = 0
    finished: int = 0
    failed: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def done(self) -> int:
        """Geometries that need no more work."""
        return self.reused + self.finished + self.failed


def run(
    campaign: Campaign,
    directory: str | Path,
    executor: Executor | None = None,
    *,
    workers: int | None = None,
    retry_failed: bool = False,
    report: Callable[[Summary], None] | None = None,
) -> Summary:
    """Compute every geometry of a campaign that its folder does not hold yet, then write index and training data.

    Parameters
    ----------
    campaign : Campaign
    directory : str or Path
        made where it does not exist; finished geometries in it are kept and not computed again.
    executor : Executor
        anything that keeps the contract of `concurrent.futures`; default a pool of processes of its own. A script that
        takes the default needs ``if __name__ == "__main__":`` around the call.
    workers : int
        processes of the default pool; default one for each CPU.
    retry_failed : bool
        take geometries that failed in an earlier run again.
    report : callable
        gets a `Summary` after every geometry.

    Raises
    ------
    InputError
        no drive; the folder is not writable, full or in use; a base geometry that cannot be solved; workers that do
        not start. What is finished stays.
    MissingLibraryError
        meshes must be made and gmsh cannot be loaded.
    """
    if not campaign.drives:
        raise InputError(f"campaign {campaign.name!r} has no drive; add a [[drive]] table (a family needs none)")
    if workers is not None:
        checks.integer("workers", workers, 1, 1024)
    retry_failed = checks.flag("retry_failed", retry_failed)
    checks.progress(report, "report", "a Summary")
    checks.executor(executor)
    campaign.check_channels()
    store = ResultStore(checks.path("directory", directory))
    cases = campaign.cases()
    with store.opened():
        store.write_plan(campaign, cases)
        loop = _Loop(campaign, store, report or (lambda summary: None), Summary(len(cases)))
        waiting = loop.sort(cases, retry_failed)
        if waiting:
            count = workers or cpus()
            if executor is None:
                begin()
            with one_thread():
                loop.work(waiting, _Workers(campaign, executor, count))
        write_collections(store, loop.rows)
    return loop.summary


@dataclass
class _Workers:
    """An Executor, and how to get a new one when it breaks."""

    campaign: Campaign
    given: Executor | None
    count: int
    pool: Executor | None = None

    @property
    def width(self) -> int:
        """Number of tasks that are submitted at the same time."""
        return FOREIGN if self.given else 2 * self.count

    def start(self, *, trial: bool) -> Executor:
        """Start the workers; with ``trial``, the first one checks the base geometry."""
        if self.given:
            self.pool = self.given
        else:
            wait_until_ready()
            self.pool = ProcessPoolExecutor(self.count, mp_context=context(), initializer=prepare)
        base = self.campaign.base_task() if trial else None
        tests = [self.pool.submit(ready, base if k == 0 else None) for k in range(1 if self.given else self.count)]
        try:
            for test in tests:
                test.result()
        except BrokenExecutor as error:
            raise InputError(
                f"the worker processes do not start ({error}); a script calls run inside "
                'if __name__ == "__main__": and is a file on disk'
            ) from None
        return self.pool

    def stop(self) -> None:
        """Wait for running tasks and cancel the others; an Executor given by the user is not shut down."""
        if self.pool and not self.given:
            self.pool.shutdown(wait=True, cancel_futures=True)


@dataclass
class _Loop:
    """State of one run."""

    campaign: Campaign
    store: ResultStore
    report: Callable[[Summary], None]
    summary: Summary
    deaths: dict[str, int] = field(default_factory=dict)
    rows: dict[str, Row] = field(default_factory=dict)
    room: int = ROOM

    def sort(self, cases: list[Case], retry_failed: bool) -> deque[Case]:
        """The geometries that need work; a result whose hash is another one is made again."""
        waiting: deque[Case] = deque()
        hashes = self.store.hashes()
        for case, status in zip(cases, self.store.status([case.key for case in cases]), strict=True):
            if status == "finished" and self.store.finished(case.key, hashes):
                self.summary = replace(self.summary, reused=self.summary.reused + 1)
            elif status == "failed" and not retry_failed:
                self.summary = replace(self.summary, failed=self.summary.failed + 1)
            else:
                self.store.result(case.key).unlink(missing_ok=True)
                waiting.append(case)
        self.report(self.summary)
        return waiting

    def work(self, waiting: deque[Case], workers: _Workers) -> None:
        """Compute all of ``waiting``."""
        try:
            executor: Executor | None = workers.start(trial=True)
            begin = time.perf_counter()
            suspects: deque[Case] = deque()
            while waiting or suspects:
                executor = executor or workers.start(trial=False)
                alone = not waiting
                queue, width = (suspects, 1) if alone else (waiting, workers.width)
                lost = self._drain(executor, queue, width, begin)
                if not lost:
                    continue
                workers.stop()
                if workers.given:
                    raise InputError(
                        f"the executor broke; {self.summary.finished} geometries of this run are kept, run again "
                        "with a new one to go on"
                    )
                suspects.extend(case for case in lost if not (alone and self._give_up(case)))
                executor = None
        finally:
            workers.stop()

    def _drain(self, executor: Executor, queue: deque[Case], width: int, begin: float) -> list[Case]:
        """Submit all tasks of a queue; returns those that were running when the executor broke."""
        under_way: dict[Future[Outcome], Case] = {}
        lost: list[Case] = []
        try:
            while (queue and not lost) or under_way:
                while queue and not lost and len(under_way) < width:
                    case = queue.popleft()
                    try:
                        under_way[executor.submit(compute, self.campaign.task(case))] = case
                    except BrokenExecutor:
                        lost.append(case)
                for future in wait(under_way, return_when=FIRST_COMPLETED).done if under_way else ():
                    case = under_way.pop(future)
                    if isinstance(future.exception(), BrokenExecutor):
                        lost.append(case)
                    else:
                        self._settle(case, future, begin)
        finally:
            for future in under_way:
                future.cancel()
        return lost

    def _settle(self, case: Case, future: Future[Outcome], begin: float) -> None:
        """Write what came back."""
        error = future.exception()
        if isinstance(error, MissingLibraryError):
            raise error
        outcome = Outcome(case.key, b"", f"{type(error).__name__}: {error}", 0.0) if error else future.result()
        if outcome.reason:
            self._fail(case, outcome.reason)
        else:
            self._keep(lambda: self.store.write_result(case.key, outcome.content))
            if outcome.row and self.room > 0:
                self.rows[case.key] = outcome.row
                self.room -= sum(value.nbytes for value in outcome.row.values()) + PER_ROW
            self.summary = replace(self.summary, finished=self.summary.finished + 1)
        spent = self.summary.cpu_seconds + outcome.cpu
        self.summary = replace(self.summary, cpu_seconds=spent, seconds=time.perf_counter() - begin)
        self.report(self.summary)

    def _give_up(self, case: Case) -> bool:
        """Whether a geometry that was alone has killed its worker too often."""
        self.deaths[case.key] = self.deaths.get(case.key, 0) + 1
        if self.deaths[case.key] < DEATHS:
            return False
        self._fail(case, f"the worker process died {DEATHS} times while it had only this geometry (out of memory?)")
        self.report(self.summary)
        return True

    def _fail(self, case: Case, reason: str) -> None:
        values = {v.name: value for v, value in zip(self.campaign.variations, case.values, strict=True)}
        self._keep(lambda: self.store.write_failure(case.key, reason, values))
        self.summary = replace(self.summary, failed=self.summary.failed + 1)

    def _keep(self, write: Callable[[], None]) -> None:
        """Write into the folder; where that fails, say that nothing finished is lost."""
        try:
            write()
        except InputError as error:
            kept = self.summary.reused + self.summary.finished
            raise InputError(f"{error}; {kept} finished geometries are kept, run again to go on") from None
