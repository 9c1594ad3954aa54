"""``thermofem campaign | reproduce | doctor``: many geometries, the paper, this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")]


def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).")],
    output: Folder = Path("campaign"),
    workers: Annotated[int | None, typer.Option(help="Worker processes; default: one for each CPU.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to compute on.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Take geometries that failed again.")] = False,
) -> dict[str, Any]:
    """Solve many geometries: one netCDF file for each, one index, one training collection.

    Started again, it goes on where it was, however it ended.
    """
    from .campaign import run

    return run(file, output, workers=workers, scheduler=scheduler, retry_failed=retry_failed)


def reproduce(
    output: Folder = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="The one-minute version: no maps, no FEM in the loop.")
    ] = False,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM: report.html with every figure and number, and the data behind it.

    Started again, it goes on where it was, however it ended.
    """
    import os

    from .output import threads_wanted
    from .reproduce import Settings, run

    return run(output, Settings(quick=quick), processes=threads_wanted() or os.cpu_count() or 1)


def doctor() -> dict[str, Any]:
    """Say what works on this machine, and what is missing for what does not."""
    from .doctor import run

    return run()
