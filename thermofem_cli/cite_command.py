"""``thermofem cite`` and ``reproduce``: what to cite for a result, and the paper from our own FEM by ``paper/``."""

import importlib
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from . import options
from .console import say, settings, terminal

SOURCES = Path(__file__).parents[1]  # the folder of the packages: of the sources, if it is a checkout


def cite(
    file: Annotated[
        Path | None, typer.Argument(help="Data (netCDF) or model (JSON); default: the software alone.")
    ] = None,
    bibtex: bool = False,
) -> dict[str, Any]:
    """Print what to cite for a result: the software, the paper, and the sources of its materials.

    Options
    -------
    bibtex: As BibTeX.
    """
    from thermofem.errors import prefixed

    from .results.citations import provenance_of, references

    with prefixed(str(file)):
        works = references(provenance_of(file) if file else {})
    for work in works:
        for line in (work.bibtex() if bibtex else work.text()).splitlines():
            say(line)
    return {"works": [{"key": work.key, "kind": work.kind, **work.fields} for work in works]}


def reproduce(
    folder: options.Folder = Path("out"),
    quick: bool = False,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM, in a checkout: report.html with every figure and number, and their data.

    Where thermofem is installed outside of it, run this in the folder of the sources.

    Started again, it goes on where it was, however it ended. The exit code is 1 where a row has no number.

    Options
    -------
    quick: The one-minute version: no maps, no FEM in the loop.
    """
    from thermofem.errors import InputError

    checkouts = [folder for folder in (SOURCES, Path.cwd()) if (folder / "paper" / "report" / "runner.py").is_file()]
    if not checkouts:
        where = "run it, or make demo, in the folder of the sources, which has paper/"
        raise InputError("reproduce needs a checkout", where)
    if str(checkouts[0]) not in sys.path:  # that of an installed program has no working folder
        sys.path.append(str(checkouts[0]))
    runner = importlib.import_module("paper.report.runner")
    workers = settings.threads or len(os.sched_getaffinity(0))
    made: dict[str, Any] = runner.run(folder, quick=quick, workers=workers, console=terminal(err=settings.json))
    return made | {"passed": not made["incomplete"]}
