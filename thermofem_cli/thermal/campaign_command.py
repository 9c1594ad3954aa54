"""``thermofem campaign``: many geometries in, one netCDF file for each and one index out."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import thermofem as th
from thermofem.errors import InputError

from .. import options
from ..command_files import expect
from ..console import bar, note, say, settings, wrote

if TYPE_CHECKING:
    from thermofem.campaign import Summary


def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).")],
    output: options.Folder = Path("campaign"),
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Take geometries that failed again.")] = False,
) -> dict[str, Any]:
    """Solve many geometries: one netCDF file for each, one index, one training collection.

    Started again, it goes on where it was, however it ended.
    """
    if scheduler and workers:
        raise InputError(f"--workers {workers} and --scheduler {scheduler} exclude each other; the cluster has its own")
    expect(file, "campaign")
    plan = th.Campaign.from_toml(file)
    count = workers if workers is not None or scheduler else settings.threads
    with options.executor_of(scheduler) as executor, bar("geometries") as progress:

        def report(summary: Summary) -> None:
            rate = f"{summary.finished / summary.seconds:.1f}/s" if summary.seconds else ""
            failed = f", {summary.failed} failed" if summary.failed else ""
            progress(summary.done, summary.total, f"{summary.done}/{summary.total} {rate}{failed}")

        summary = plan.run(output, executor, workers=count, retry_failed=retry_failed, report=report)
    found = f"{summary.finished} finished in {summary.seconds:.0f} s, {summary.reused} were there already"
    say(f"{summary.total} geometries: {found}, {summary.failed} failed")
    with th.campaign.open_campaign(output) as index:
        cut = int((index["domain_error"] > plan.accuracy).sum())
    if cut:
        note(
            f"{cut} have domain_error above accuracy = {plan.accuracy:g}: their bottom or outer side is too near: "
            'move it outwards, or make it "open" where the stack goes on'
        )
    if summary.failed:
        say(f"reasons are in {output / 'failures'} and in the index; --retry-failed takes them again")
    files = {"index": output / "index.nc", "training": output / "training.nc"}
    wrote(*files.values())
    return {**asdict(summary), "domain_too_small": cut, **files}
