"""``thermofem cite`` and ``reproduce``: what to cite for a result, and the paper from our own FEM by ``paper/``."""

import importlib
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import surrogate
import thermofem as th
from thermofem import __version__, checks
from thermofem.data import files
from thermofem.errors import InputError, one_line, prefixed
from thermofem.materials.material_library import VOID, find

from . import options
from .console import say, settings, terminal
from .inputs.command_files import expect

SOURCES = Path(th.__file__).parents[1]  # the folder of the packages: of the sources, if it is a checkout
_SPECIAL = {c: f"\\{c}" for c in "{}%#&_$"} | {"\\": "\\textbackslash{}", "^": "\\^{}", "~": "\\~{}"}
_LATEX = str.maketrans(_SPECIAL)


@dataclass(frozen=True)
class Citation:
    """One work to cite: BibTeX kind, key and fields."""

    kind: str
    key: str
    fields: dict[str, str]

    def text(self) -> str:
        """Return the citation as one line of text."""
        f = self.fields
        place = f.get("journal", f.get("note", ""))
        if "volume" in f:
            place += f" {f['volume']}, {f['pages']}"
        parts = [f.get("author", "").strip("{}").replace(" and ", ", "), f["title"], place]
        return ", ".join(part for part in parts if part) + (f" ({f['year']})" if "year" in f else "")

    def bibtex(self) -> str:
        """Return the citation as a BibTeX entry."""
        foreign = self.kind == "misc"  # text of a file, which is no LaTeX
        fields = {name: value.translate(_LATEX) if foreign else value for name, value in self.fields.items()}
        body = "".join(f"  {name} = {{{value}}},\n" for name, value in fields.items())
        return f"@{self.kind}{{{self.key},\n{body}}}\n"


SOFTWARE = Citation(
    "software",
    "thermofem",
    {
        "author": "{The thermofem developers}",
        "title": "thermofem: self-heating of silicon microring resonators",
        "version": __version__,
        "note": f"version {__version__}, BSD-3-Clause",
    },
)


def articles() -> dict[str, Citation]:
    """Return the articles of works.toml by citation key."""
    found = files.from_toml((Path(__file__).parent / "works.toml").read_text(encoding="utf-8"))
    return {key: Citation("article", key, fields) for key, fields in found.items()}


def cite(
    file: Annotated[
        Path | None, typer.Argument(help="Data (netCDF) or model (JSON); default: the software alone.")
    ] = None,
    bibtex: Annotated[bool, typer.Option("--bibtex", help="As BibTeX.")] = False,
) -> dict[str, Any]:
    """Print what to cite for a result: the software, the paper, and the sources of its materials."""
    with prefixed(str(file)):
        works = references(_provenance(file) if file else {})
    for work in works:
        for line in (work.bibtex() if bibtex else work.text()).splitlines():
            say(line)
    return {"works": [{"key": work.key, "kind": work.kind, **work.fields} for work in works]}


def references(provenance: dict[str, Any]) -> list[Citation]:
    """Return the works to cite for a result with this provenance."""
    known = articles()
    works = [SOFTWARE, known["borghi2021"]]
    if provenance.get("geometry"):
        works += [known["scikitfem"], known["gmsh"]]
    if provenance.get("kind") == "Network":
        works.append(known["pysindy"])
    for name, source in _materials(provenance).items():
        key = "material_" + re.sub(r"\W+", "_", name).strip("_").lower()
        works.append(Citation("misc", key, {"title": f"Material {name}", "note": source}))
    return works


def _materials(provenance: dict[str, Any]) -> dict[str, str]:
    """Return the source of every material by its name, as recorded in data or looked up in a model's geometry."""
    if provenance.get("materials"):
        hint = "the file's record of its materials is damaged; is it one of thermofem's?"
        found = checks.mapping("materials", files.from_json(str(provenance["materials"])), hint=hint)
        return {one_line(name): one_line(str(source)) for name, source in found.items()}
    if not provenance.get("geometry"):
        return {}
    section = th.CrossSection.from_toml_text(str(provenance["geometry"]))
    names = dict.fromkeys([layer.material for layer in section.layers] + [part.material for part in section.parts])
    return {name: one_line(find(name, section.materials).source) for name in names if name != VOID}


def _provenance(file: Path) -> dict[str, Any]:
    """Return the provenance that a file records: attributes of data, or the record and the kind of a model."""
    expect(file, "data", "result", "model")
    if file.suffix == ".json":
        return {**th.models.load_provenance(file), "kind": type(surrogate.load_model(file)).__name__}
    return dict(th.load(file).attrs)


def reproduce(
    output: options.Folder = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="The one-minute version: no maps, no FEM in the loop.")
    ] = False,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM, in a checkout: report.html with every figure and number, and their data.

    Where thermofem is installed outside of it, run this in the folder of the sources.

    Started again, it goes on where it was, however it ended. The exit code is 1 where a row has no number.
    """
    checkouts = [folder for folder in (SOURCES, Path.cwd()) if (folder / "paper" / "report" / "runner.py").is_file()]
    if not checkouts:
        where = "run it in the folder of the sources, which has paper/"
        raise InputError("reproduce needs a checkout", where)
    if str(checkouts[0]) not in sys.path:  # that of an installed program has no working folder
        sys.path.append(str(checkouts[0]))
    runner = importlib.import_module("paper.report.runner")
    workers = settings.threads or len(os.sched_getaffinity(0))
    made: dict[str, Any] = runner.run(output, quick=quick, workers=workers, console=terminal(err=settings.json))
    return made | {"passed": not made["incomplete"]}
