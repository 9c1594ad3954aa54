"""``thermofem reproduce``: the paper from our own FEM, by the scripts of a checkout's ``paper/``."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Annotated, Any

import typer

import thermofem
from thermofem.checks import InputError

from . import options
from .console import settings, terminal


def reproduce(
    output: options.Folder = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="The one-minute version: no maps, no FEM in the loop.")
    ] = False,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM, in a checkout: report.html with every figure and number, and their data.

    Started again, it goes on where it was, however it ended.
    """
    if not Path(thermofem.__file__).parents[1].joinpath("paper", "report", "runner.py").is_file():
        where = "it stands in paper/ of the sources: `make demo` there installs and runs it"
        raise InputError("reproduce needs a checkout", where)
    runner = importlib.import_module("paper.report.runner")
    workers = settings.threads or len(os.sched_getaffinity(0))
    made: dict[str, Any] = runner.run(output, quick=quick, workers=workers, console=terminal(err=settings.json))
    return made
