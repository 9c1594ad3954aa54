"""report.html: one file that needs nothing else, right on a phone and on paper."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

from thermofem.version import __version__

from .claims import Claim, marked_up, typeset
from .sections import Picture, Section
from .stages import Stage
from .store import Result

INDEPENDENT = "independent code"  # where those rows of table.toml say they come from
INTRODUCTION = """M. Borghi, D. Bazzanella, M. Mancinelli and L. Pavesi, “On the modeling of thermal and free carrier
nonlinearities in Silicon On Insulator microring resonators”, Opt. Express 29, 4363 (2021), from our own finite
elements: every figure that needs no laboratory, every number next to the paper's, and what it left open."""


def page(
    results: Mapping[str, Result],
    words: tuple[Sequence[Section], Sequence[Section]],
    claims: Sequence[Claim],
    pictures: Mapping[str, bytes],
    stages: Sequence[Stage],
    explorer: str = "",
) -> str:
    """The whole report as HTML; ``words`` are the boxes at its top and the sections.

    ``explorer`` is the text of the page that computes the reference ring, the first figure.
    """
    lead, sections = words
    style = (Path(__file__).parent / "report.css").read_text(encoding="utf-8")
    links = [(f"#{_anchor(section)}", section.title) for section in sections]
    links += [("#numbers", "Every number"), ("#data", "Data")]
    body = [
        "<h1>Thermal and free-carrier nonlinearities of a silicon microring, reproduced</h1>",
        f"<p>{html.escape(INTRODUCTION)}</p>",
        *(f'<p class="lead"><strong>{typeset(box.title)}</strong> {marked_up(box.text, results)}</p>' for box in lead),
        "<nav>" + "".join(f'<a href="{to}">{typeset(title)}</a> ' for to, title in links) + "</nav>",
        _explorer(explorer) if explorer else "",
        *(_section(section, results, pictures) for section in sections),
        _table(claims, results),
        _data(results, stages),
        f"<footer><p>thermofem {html.escape(__version__)}. Every number above is read from the files in data/; hover "
        "over one to see which.</p></footer>",
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>thermofem: the paper reproduced</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _explorer(text: str) -> str:
    """The page that computes, in a frame; paper gets a sentence instead."""
    return (
        '<section id="explorer"><h2>The ring at work</h2><p>This figure computes. Drag the laser on the plane of power '
        "and detuning, or move a slider: the ring is integrated in the page, with the same equations and coefficients "
        'as below. The same page on its own: <a href="ring.html">ring.html</a>.</p>'
        '<p class="paper">On paper this figure is left out.</p>'
        f'<figure class="explorer"><iframe title="The reference ring, computed in the page" loading="lazy" '
        f'src="data:text/html;charset=utf-8;base64,{base64.b64encode(text.encode()).decode()}"></iframe></figure></section>'
    )


def shown(section: Section, results: Container[str]) -> tuple[Picture, ...]:
    """The pictures of a section whose stages were run."""
    return tuple(p for p in section.pictures if all(stage in results for stage in p.stages))


def _section(section: Section, results: Mapping[str, Result], pictures: Mapping[str, bytes]) -> str:
    """Heading, text and panels."""
    figures = [
        f'<figure id="{p.name}"><h3>{typeset(p.title)}</h3>'
        f'<img alt="{html.escape(p.title, quote=True)}" src="data:image/svg+xml;base64,'
        f'{base64.b64encode(pictures[p.name]).decode()}">'
        f"<figcaption>{marked_up(p.caption, results)}</figcaption></figure>"
        for p in shown(section, results)
    ]
    return (
        f'<section id="{_anchor(section)}"><h2>{typeset(section.title)}</h2><p>{marked_up(section.text, results)}</p>'
        f'<div class="panels">{"".join(figures)}</div></section>'
    )


def _anchor(section: Section) -> str:
    """Text of the link to a section."""
    return re.sub(r"[^a-z]+", "-", section.title.lower()).strip("-")


def _table(claims: Sequence[Claim], results: Mapping[str, Result]) -> str:
    """Table of the paper's numbers, ours and the reason of the difference; then the one of an independent code."""
    other = [claim for claim in claims if claim.where == INDEPENDENT]
    paper = [claim for claim in claims if claim.where != INDEPENDENT]
    return (
        '<section id="numbers"><h2>The paper says, we get, why they differ</h2>'
        '<p class="soft">“Agrees” means within what the paper states: its error bar, or the rounding of its words. '
        f"Everything else is shown as differing.</p>{_rows('the paper', paper, results)}"
        "<h3>The same equations by an independent code</h3>"
        '<p class="soft">Written apart from this one, with other elements and integrators. “Agrees” means within the '
        "accuracy of our mesh and of the fits, or the last digit given.</p>"
        f"{_rows('the other code', other, results)}</section>"
    )


def _rows(who: str, claims: Sequence[Claim], results: Mapping[str, Result]) -> str:
    """A table of claims."""
    words = {True: ("agrees", "agrees"), False: ("differs", "differs"), None: ("open", "–")}
    rows = []
    for claim in claims:
        kind, verdict = words[claim.agrees(results)]
        where = "" if claim.where == INDEPENDENT else f'<span class="where">{html.escape(claim.where)}</span>'
        rows.append(
            f"<tr><td>{typeset(claim.quantity)}{where}</td>"
            f'<td data-label="{who}">{typeset(claim.paper)}</td>'
            f'<td data-label="we get">{marked_up(claim.ours, results)}</td>'
            f'<td class="tight {kind}">{verdict}</td>'
            f'<td class="soft">{marked_up(claim.why, results)}</td></tr>'
        )
    head = f"<tr><th>quantity</th><th>{who} says</th><th>we get</th><th></th><th>why</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>" if rows else ""


def _data(results: Mapping[str, Result], stages: Sequence[Stage]) -> str:
    """Links to the files, with the CPU time that each stage took when it was computed."""
    rows = []
    for stage in stages:
        result = results[stage.name]
        files = [f"{stage.name}.json", *(f"{stage.name}.{n}.nc" for n in result.data)]
        files += [f"{stage.name}.{n}.json" for n in result.models]
        links = ", ".join(f'<a href="data/{html.escape(n, quote=True)}">{html.escape(n)}</a>' for n in files)
        rows.append(
            f"<tr><td>{html.escape(stage.words)}</td><td>{links}</td>"
            f'<td class="tight" data-label="CPU time">{result.seconds:.1f} s</td></tr>'
        )
    total = sum(result.seconds for result in results.values())
    return (
        '<section id="data"><h2>Data</h2><p class="soft">netCDF for data, JSON for numbers and models, beside this '
        f"file; {total:.0f} s of CPU time when computed.</p>"
        "<table><thead><tr><th>stage</th><th>files</th><th>CPU</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></section>"
    )
