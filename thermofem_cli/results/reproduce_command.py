"""``thermofem reproduce``: the paper from our own FEM."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options
from ..console import settings


def reproduce(
    output: options.Folder = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="The one-minute version: no maps, no FEM in the loop.")
    ] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    seed: options.Seed = 0,
    threads: options.Threads = None,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM: report.html with every figure and number, and the data behind it.

    Started again, it goes on where it was, however it ended.
    """
    from ..reproduce import Settings, run

    return run(output, Settings(quick=quick), processes=settings.threads or len(os.sched_getaffinity(0)))
