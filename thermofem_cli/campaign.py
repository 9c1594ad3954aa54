"""``thermofem campaign``: many geometries in, one netCDF file for each and one index out."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from thermofem.campaign import Campaign, Summary, open_campaign
from thermofem.checks import InputError, MissingLibraryError

from .kinds import expect
from .output import console, note, say, threads_wanted


def run(file: Path, output: Path, *, workers: int | None, scheduler: str | None, retry_failed: bool) -> dict[str, Any]:
    """Read the campaign, run it with a progress bar, and say what came out."""
    if scheduler and workers:
        raise InputError(f"--workers {workers} and --scheduler {scheduler} exclude each other; the cluster has its own")
    expect(file, "campaign")
    campaign = Campaign.from_toml(file)
    terminal = console()
    what, rate = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[rate]}")
    columns = (what, BarColumn(), MofNCompleteColumn(), rate)
    progress = Progress(*columns, TimeRemainingColumn(), console=terminal)
    bar = progress.add_task("geometries", total=len(campaign), rate="")
    with _executor(scheduler) as executor, contextlib.closing(_Shown(progress, bar)) as shown:
        summary = campaign.run(
            output,
            executor,
            workers=workers if workers is not None or scheduler else threads_wanted(),
            retry_failed=retry_failed,
            report=shown,
        )
    found = f"{summary.finished} finished in {summary.seconds:.0f} s, {summary.reused} were there already"
    say(f"{summary.total} geometries: {found}, {summary.failed} failed")
    cut = int((open_campaign(output)["domain_error"] > campaign.accuracy).sum())
    if cut:
        note(
            f"{cut} have domain_error above accuracy = {campaign.accuracy:g}: their bottom or outer side is too near: "
            'move it outwards, or make it "open" where the stack goes on'
        )
    if summary.failed:
        say(f"reasons are in {output / 'failures'} and in the index; --retry-failed takes them again")
    files = {"index": output / "index.nc", "training": output / "training.nc"}
    say(f"wrote {files['index']} and {files['training']}")
    return {**asdict(summary), "domain_too_small": cut, **files}


@dataclass
class _Shown:
    """A bar that begins with the first summary: what is refused before prints one line."""

    progress: Progress
    bar: TaskID

    def __call__(self, summary: Summary) -> None:
        rate = f"{summary.finished / summary.seconds:.1f}/s" if summary.seconds else ""
        failed = f", {summary.failed} failed" if summary.failed else ""
        self.progress.update(self.bar, completed=summary.done, total=summary.total, rate=rate + failed)
        self.progress.start()

    def close(self) -> None:
        """Leave the bar as it is."""
        if self.progress.live.is_started:
            self.progress.stop()


@contextlib.contextmanager
def _executor(scheduler: str | None) -> Iterator[Executor | None]:
    """The Dask cluster at an address as an Executor; None, for processes of our own, where no address is given."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise MissingLibraryError('--scheduler needs Dask: pip install "thermofem[dask]"') from None

    class Connection(Client):
        """A client that ends with its block alone: one that never reached its cluster waits for 20 s in `__del__`."""

        def __del__(self) -> None:
            pass

    try:
        client = Connection(scheduler, timeout="10s", set_as_default=False)
    except Exception as error:  # TypeError, too, of protocols that are not set up
        raise InputError(f"--scheduler = {scheduler!r} does not answer: {' '.join(str(error).split())}") from None
    with client:
        yield client.get_executor(pure=False)
