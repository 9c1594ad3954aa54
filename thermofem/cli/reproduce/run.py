"""The whole reproduction: stages, figures, report, and the printed summary."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.table import Table

from ... import files
from ..output import console as terminal
from .claims import Claim, claims, known, plain
from .page import page, shown
from .plan import stages_of
from .second import quiet, run_all
from .sections import Section, read
from .settings import Settings
from .store import Result, StageStore


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
    stages = stages_of(settings)
    with quiet():
        done = run_all(stages, settings, StageStore(data), console, processes)
    results = done.results
    lead, sections = _words(settings, results)
    rows = [claim for claim in claims() if claim.known(results)]
    pictures = _draw(sections, results, figures)
    text = page(results, (lead, sections), rows, pictures, stages, _explorer(out / "ring.html"))
    report = files.write_whole(out / "report.html", lambda path: path.write_text(text, encoding="utf-8"))
    _write_table(rows, results, data / "table.json")
    console.print(_printed(rows, results))
    kept = len(stages) - len(done.computed)
    console.print(
        f"{len(stages)} stages ({kept} taken from an earlier run), {len(pictures)} figures in {figures}/, "
        f"numbers, netCDF and models in {data}/"
    )
    console.print(f"report: {report}")
    compared = [agrees for agrees in (claim.agrees(results) for claim in rows) if agrees is not None]
    return {
        "report": report,
        "stages": len(stages),
        "kept": kept,
        "figures": len(pictures),
        "compared_with_the_paper": len(compared),
        "agree": sum(compared),
    }


def _explorer(path: Path) -> str:
    """Write the page that computes the reference ring, and return its text."""
    import coupled

    from ..explore import models_of_geometry

    models, heat = models_of_geometry(None)
    return coupled.explore(coupled.borghi2021(), models, path, heat=heat).html


def _words(settings: Settings, results: Mapping[str, Result]) -> tuple[list[Section], list[Section]]:
    """The boxes at the top, and the sections that are not empty."""
    lead, sections = read()
    chosen = [section for section in sections if section.quick <= settings.quick]
    chosen = [section for section in chosen if known(section.text, results)]  # without gmsh some numbers are missing
    if settings.quick:
        chosen = [section for section in chosen if shown(section, results)]
    return [box for box in lead if known(box.text, results)], chosen


def _draw(sections: Sequence[Section], results: Mapping[str, Result], folder: Path) -> dict[str, bytes]:
    """Every panel, also as a file."""
    from .plot_panels import draw

    pictures: dict[str, bytes] = {}
    for section in sections:
        for picture in shown(section, results):
            pictures[picture.name] = content = draw(picture.name, results)
            files.write_whole(folder / f"{picture.name}.svg", partial(Path.write_bytes, data=content))
    return pictures


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
