"""The whole reproduction: stages, figures, report, and the printed summary."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from ... import files
from ..output import console as terminal
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

    Raises InputError: ``out`` cannot be made or written, or another run is using it.
    """
    with files.folder_locked(files.make_folder(out)):
        return _run(out, settings or Settings(), processes)


def _run(out: Path, settings: Settings, processes: int) -> dict[str, Any]:
    console = terminal(err=False)
    data, figures = (files.make_folder(out / name) for name in ("data", "figures"))
    for folder in (out, data, figures):
        files.sweep(folder)
    project = Project(out, settings, stages_of(settings))
    with quiet():
        computed = _work_through(project, processes, console)
    results = project.given(project.keys)
    lead, sections = _words(settings, results)
    rows = [claim for claim in claims() if claim.known(results)]
    pictures = {name: (figures / f"{name}.svg").read_bytes() for name in _pictures(sections, results)}
    explorer = (out / "ring.html").read_text(encoding="utf-8")
    text = page(results, (lead, sections), rows, pictures, project.stages, explorer)
    report = files.write_whole(out / "report.html", lambda path: path.write_text(text, encoding="utf-8"))
    _write_table(rows, results, data / "table.json")
    console.print(_printed(rows, results))
    kept = len(project.stages) - computed
    console.print(
        f"{len(project.stages)} stages ({kept} taken from an earlier run), {len(pictures)} figures in {figures}/, "
        f"numbers, netCDF and models in {data}/"
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


def _pictures(sections: Sequence[Section], results: Mapping[str, Result]) -> dict[str, Picture]:
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


def _write_table(claims: Sequence[Claim], results: Mapping[str, Result], path: Path) -> None:
    """Write the table as JSON, for programs."""
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
    text = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
    files.write_whole(path, lambda target: target.write_text(text, encoding="utf-8"))


def _printed(claims: Sequence[Claim], results: Mapping[str, Result]) -> Table:
    """The rows that matter most."""
    table = Table("", "the paper", "here", title="Next to the paper (the whole table is in the report)")
    for claim in claims:
        if claim.key:
            table.add_row(claim.quantity, claim.paper, plain(claim.ours, results))
    return table
