"""Works to cite for a result: the software, the paper, and the sources of its materials."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import thermofem as th
from thermofem import __version__, checks
from thermofem.data import files
from thermofem.errors import one_line
from thermofem.materials.material_library import VOID, find
from thermofem.models import load_model

from ..inputs.command_files import expect

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


def provenance_of(file: Path) -> dict[str, Any]:
    """Return the provenance that a file records: attributes of data, or the record and the kind of a model."""
    expect(file, "data", "result", "model")
    if file.suffix == ".json":
        return {**th.models.load_provenance(file), "kind": type(load_model(file)).__name__}
    return dict(th.load(file).attrs)
