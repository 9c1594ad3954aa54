"""The loop of a campaign: tasks go to an Executor, results come back and are written, by this process alone.

At most a few tasks for each worker are under way, so memory does not grow with the campaign. A geometry that kills its
worker again and again is recorded while the others go on (`pool`).
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .. import checks
from ..checks import InputError, MissingLibraryError
from .collect import Row, write_collections
from .pool import Pool, WorkerDiedError, WorkersDoNotStartError
from .processes import begin, cpus
from .store import ResultStore
from .work import Outcome, compute, prepare, ready

if TYPE_CHECKING:
    from .plan import Campaign, Case

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
        gets a `Summary` when the base geometry is checked, and after every geometry.

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
    campaign.check_channels()
    store = ResultStore(checks.path("directory", directory))
    cases = campaign.cases()
    with store.opened():
        store.write_plan(campaign, cases)
        loop = _Loop(campaign, store, report or (lambda summary: None), Summary(len(cases)))
        waiting = loop.sort(cases, retry_failed)
        if not waiting:
            loop.report(loop.summary)
        else:
            with contextlib.ExitStack() as stack:
                count = workers or cpus()
                if executor is None:
                    begin()
                    pool = stack.enter_context(Pool(count, prepare))
                loop.start(executor or pool, 1 if executor else count)
                loop.report(loop.summary)
                loop.work(waiting, executor or pool, FOREIGN if executor else 2 * count)
        write_collections(store, loop.rows)
    return loop.summary


@dataclass
class _Loop:
    """State of one run."""

    campaign: Campaign
    store: ResultStore
    report: Callable[[Summary], None]
    summary: Summary
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
        return waiting

    def start(self, executor: Executor, count: int) -> None:
        """Have the first worker check the base geometry, and the others load their libraries."""
        base = self.campaign.base_task()
        try:
            tests = [executor.submit(ready, base if k == 0 else None) for k in range(count)]
            for test in tests:
                test.result()
        except WorkerDiedError as error:
            raise InputError(f"the base geometry cannot be solved: {error}") from None
        except BrokenExecutor as error:
            raise InputError(f"the executor breaks at the base geometry ({error}); give one that works") from None

    def work(self, waiting: deque[Case], executor: Executor, width: int) -> None:
        """Compute all of ``waiting``, ``width`` of them under way at the same time."""
        begin = time.perf_counter()
        under_way: dict[Future[Outcome], Case] = {}
        try:
            while waiting or under_way:
                while waiting and len(under_way) < width:
                    case = waiting.popleft()
                    under_way[executor.submit(compute, self.campaign.task(case))] = case
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    self._settle(under_way.pop(future), future, begin)
        except BrokenExecutor:
            for future in [future for future in under_way if future.done() and not future.cancelled()]:
                if future.exception() is None:
                    self._settle(under_way.pop(future), future, begin)
            raise InputError(
                f"the executor broke; {self.summary.finished} geometries of this run are kept, run again "
                "with a new one to go on"
            ) from None
        finally:
            for future in under_way:
                future.cancel()

    def _settle(self, case: Case, future: Future[Outcome], begin: float) -> None:
        """Write what came back."""
        error = future.exception()
        if isinstance(error, MissingLibraryError | WorkersDoNotStartError | BrokenExecutor):
            raise error
        if error is None:
            outcome = future.result()
        else:
            kind = "" if isinstance(error, WorkerDiedError) else f"{type(error).__name__}: "
            outcome = Outcome(case.key, b"", f"{kind}{error}", 0.0)
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
