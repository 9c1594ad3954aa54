"""The whole reproduction: stages, figures, report, and the printed summary."""

from __future__ import annotations

import json
import logging
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from thermofem.data import files

from ..console import settings as output
from ..console import terminal
from .claims import Claim, claims, known, plain
from .page import page, shown
from .plan import stages_of
from .project import Project, WorkItem
from .sections import Picture, Section, read
from .settings import Settings
from .store import Result
from .workers import crew, share

EXPLORER, FIGURES = 1.0, 5.0  # s, about, for the page that computes and for all figures


def run(out: Path, settings: Settings | None = None, *, processes: int = 1) -> dict[str, Any]:
    """Reproduce the paper into ``out``: data/, figures/ and report.html; returns what was made.

    What an earlier run left there under the same settings and code is taken, not computed again.

    Raises InputError: ``out`` cannot be made or written, another run is using it, or it holds files of others.
    """
    settings = settings or Settings()
    project = Project(out, settings, stages_of(settings))
    names = _pictures([one for one in read()[1] if one.quick <= settings.quick], {one.name for one in project.stages})
    check = partial(project.check, [f"{name}.svg" for name in names])
    with files.own_folder(out, ("data", "figures"), check):
        return _run(project, processes)


def _run(project: Project, processes: int) -> dict[str, Any]:
    console, settings = terminal(err=output.json), project.settings
    with quiet():
        computed = _work_through(project, processes, console)
    results = project.given(project.keys)
    lead, sections = _words(settings, results)
    rows = [claim for claim in claims() if claim.known(results)]
    pictures = {name: project.figure(f"{name}.svg").read_bytes() for name in _pictures(sections, results)}
    explorer = project.ring.read_text(encoding="utf-8")
    text = page(results, (lead, sections), rows, pictures, project.stages, explorer)
    report = project.write(project.report, text.encode())
    project.write(project.table, _json(rows, results).encode())
    console.print(_printed(rows, results))
    kept = len(project.stages) - computed
    console.print(
        f"{len(project.stages)} stages ({kept} taken from an earlier run), {len(pictures)} figures in "
        f"{project.figure('')}/, numbers, netCDF and models in {project.store.folder}/"
    )
    console.print(f"report: {report}")
    compared = [agrees for agrees in (claim.agrees(results) for claim in rows) if agrees is not None]
    return {
        "report": report,
        "stages": len(project.stages),
        "kept": kept,
        "figures": len(pictures),
        "compared_with_the_paper": len(compared),
        "agree": sum(compared),
    }


def _work_through(project: Project, processes: int, console: Console) -> int:
    """Compute what is missing, and draw everything; returns how many stages were computed."""
    left = project.missing()
    columns = (TextColumn("{task.description:<44}", markup=False), BarColumn(), TimeElapsedColumn(), TextColumn("left"))
    bars = Progress(*columns, TimeRemainingColumn(), console=console)
    with bars as progress, crew(project, processes, left) as workers:
        done: dict[str, float] = {}
        bar = progress.add_task("", total=sum(task.weight for task in left) + EXPLORER + FIGURES)

        def tell(task: WorkItem, part: float) -> None:
            done[task.name] = part * task.weight
            progress.update(bar, description=task.words, completed=sum(done.values()))

        share(project, left, workers, tell)
        results = project.given(project.keys)
        pictures = _pictures(_words(project.settings, results)[1], results)
        drawn = [
            WorkItem("draw", f"{p.name}.svg", p.title, FIGURES / len(pictures), p.stages) for p in pictures.values()
        ]
        share(project, [WorkItem("explore", "ring.html", "the page that computes", EXPLORER), *drawn], workers, tell)
        progress.update(bar, description="done", completed=progress.tasks[bar].total)
    return len(left)


def _words(settings: Settings, results: Mapping[str, Result]) -> tuple[list[Section], list[Section]]:
    """The boxes at the top, and the sections that are not empty."""
    lead, sections = read()
    chosen = [section for section in sections if section.quick <= settings.quick]
    chosen = [section for section in chosen if known(section.text, results)]  # without gmsh some numbers are missing
    if settings.quick:
        chosen = [section for section in chosen if shown(section, results)]
    return [box for box in lead if known(box.text, results)], chosen


def _pictures(sections: Sequence[Section], results: Container[str]) -> dict[str, Picture]:
    """The panels by name."""
    return {picture.name: picture for section in sections for picture in shown(section, results)}


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warning on the finite domain: the reference stack ends where that of the paper does."""
    log = logging.getLogger("thermofem")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(before)


def _json(claims: Sequence[Claim], results: Mapping[str, Result]) -> str:
    """The table as JSON, for programs."""
    rows = [
        {
            "where": claim.where,
            "quantity": claim.quantity,
            "paper": claim.paper,
            "ours": plain(claim.ours, results),
            "agrees": claim.agrees(results),
            "why": plain(claim.why, results),
        }
        for claim in claims
    ]
    return json.dumps(rows, indent=1, ensure_ascii=False) + "\n"


def _printed(claims: Sequence[Claim], results: Mapping[str, Result]) -> Table:
    """The rows that matter most."""
    table = Table("", "the paper", "here", title="Next to the paper (the whole table is in the report)")
    for claim in claims:
        if claim.key:
            table.add_row(claim.quantity, claim.paper, plain(claim.ours, results))
    return table
