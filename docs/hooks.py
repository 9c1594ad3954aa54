"""Pages that mkdocs makes while it builds the site: the API, the tree of the sources, the tests behind the validation.

They are in no repository, so that no page can be older than the code.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import textwrap
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
PACKAGES = {"th": "thermofem", "surrogate": "surrogate", "coupled": "coupled"}
HEADS = {"Parameters": "Parameters", "Attributes": "Attributes", "Returns": "Returns", "Raises": "Raises"}


def on_files(files: Any, config: Any) -> Any:
    """Add the pages; mkdocs calls this before it reads the navigation."""
    from mkdocs.structure.files import File

    for name, text in {"api.md": api(), "where.md": where(), "tests.md": tests()}.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Let the links to tests lead to the page with their sources."""
    return re.sub(r'\(\.\./tests/\S+ "(\w+)"\)', lambda found: f"(tests.md#{found[1].lower()})", markdown)


def examples() -> dict[str, str]:
    """Example of each public name that `api_examples.py` has one for."""
    cells = (DOCS / "api_examples.py").read_text(encoding="utf-8").split("\n# %% ")[1:]
    found = {}
    for cell in cells:
        names, _, code = cell.partition("\n")
        found |= dict.fromkeys(names.split(), code.strip())
    return found


def groups() -> list[dict[str, Any]]:
    """The groups of `api_groups.toml`: title, text, and the names as a list."""
    found = tomllib.loads((DOCS / "api_groups.toml").read_text(encoding="utf-8"))["group"]
    return [{**group, "names": group["names"].split()} for group in found]


def where() -> str:
    """The tree of the sources: a sentence for each folder and each file, the first of its docstring."""
    text = "# Where is what\n\nEvery folder and file of the sources, with the first sentence of its docstring.\n"
    text += "`surrogate` and `coupled` know `thermofem`, not each other; `thermofem_cli` alone knows all three.\n"
    for package in ("thermofem", "surrogate", "coupled", "thermofem_cli", "paper"):
        for folder in sorted(path.parent for path in (DOCS.parent / package).rglob("__init__.py")):
            head = "##" if folder.name == package else "###"
            place = folder.relative_to(DOCS.parent).as_posix()
            text += f"\n{head} {place}\n\n{sentence(folder / '__init__.py')}\n\n| file | |\n|---|---|\n"
            for path in sorted(folder.glob("[!_]*.py")):
                text += f"| `{path.name}` | {sentence(path)} |\n"
    return text


def sentence(path: Path) -> str:
    """The first paragraph of a file's docstring on one line."""
    return " ".join((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n\n")[0].split())


def api() -> str:
    """Every public name with its signature, its docstring and an example, by who uses it."""
    cells = examples()
    text = "# API reference\n\nEvery public name, from its docstring, by what you want to do. "
    text += "`import thermofem as th, surrogate, coupled`; all numbers are in SI. "
    text += "Examples use the names of the examples before them.\n"
    for group in groups():
        text += f"\n## {group['title']}\n\n{group['text']}\n"
        for name in group["names"]:
            text += entry(name, thing_of(name), cells.get(name, ""))
    return text


def thing_of(name: str) -> Any:
    """What a name such as `th.solve` stands for."""
    short, _, inner = name.partition(".")
    return getattr(importlib.import_module(PACKAGES[short]), inner)


def entry(name: str, thing: Any, example: str) -> str:
    """One name."""
    text = f"\n### {name}\n\n"
    if callable(thing):
        try:
            signature = inspect.signature(thing)
        except (TypeError, ValueError):
            signature = None
        if signature is not None and not issubclass_of_exception(thing):
            text += f"```python\n{shortened(name, signature)}\n```\n\n"
    doc = inspect.getdoc(thing) if callable(thing) or inspect.ismodule(thing) else f"`{name} = {thing!r}`"
    text += markdown(doc or "")
    return text + (f"\n```python\n{example}\n```\n" if example and ">>>" not in (doc or "") else "")


def issubclass_of_exception(thing: Any) -> bool:
    """Whether it is an error or a warning, whose signature says nothing."""
    return inspect.isclass(thing) and issubclass(thing, BaseException)


def shortened(name: str, signature: inspect.Signature) -> str:
    """The call with its defaults and without types: those stand below."""
    words = []
    star = False
    for p in signature.parameters.values():
        if p.kind is p.KEYWORD_ONLY and not star:
            words.append("*")
        star |= p.kind in (p.KEYWORD_ONLY, p.VAR_POSITIONAL)
        mark = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "")
        default = "" if p.default is p.empty else f"={default_of(p.default)}"
        words.append(mark + p.name + default)
    return "\n".join(textwrap.wrap(f"{name}({', '.join(words)})", 100, subsequent_indent="    "))


def default_of(value: Any) -> str:
    """A default as one would type it."""
    text = " ".join(repr(value).split())
    return text if len(text) < 40 and "<" not in text else "..."


def markdown(doc: str) -> str:
    """A docstring: indented blocks and examples as code, sections in bold, their entries as a list."""
    out, section = [], ""
    for block in re.split(r"\n\s*\n", doc):
        lines = block.split("\n")
        if len(lines) > 1 and re.fullmatch(r"-{3,}", lines[1].strip()):
            section = HEADS.get(lines[0].strip(), lines[0].strip())
            out.append(f"**{section}**\n\n" + entries(lines[2:]))
        elif lines[0].startswith(">>>"):
            out.append("```pycon\n" + block + "\n```")
        elif all(line.startswith("    ") or not line for line in lines):
            out.append("```text\n" + textwrap.dedent(block) + "\n```")
        else:
            out.append(escaped(block))
    return "\n\n".join(out) + "\n"


def entries(lines: list[str]) -> str:
    """Names with what they are: a bullet each."""
    text, begun = "", False
    for line in lines:
        if line and not line.startswith(" "):
            name, colon, kind = line.partition(" : ")
            text += f"\n- `{name}`{': ' + escaped(kind) if colon else ''}"
            begun = False
        elif line.strip():
            text += f"{' ' if begun else ' — '}{escaped(line.strip())}"
            begun = True
    return text.strip("\n")


def escaped(text: str) -> str:
    """Double backquotes as single ones; no HTML, no emphasis by accident."""
    text = re.sub(r"``([^`]*)``", r"`\1`", text)
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        p if p.startswith("`") else p.replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_") for p in parts
    )


def tests() -> str:
    """The source of every test that makes a row of the validation page, under its name."""
    rows = json.loads((DOCS / "validation.json").read_text(encoding="utf-8"))
    text = (
        "# Tests behind the validation\n\nThe source of each test that a row of [validation](validation.md) names. The "
    )
    text += "fixture `validated` asserts that the error is within the tolerance, and records the row.\n"
    for name in sorted({row["test"] for row in rows if "test" in row}):
        file, _, function = name.partition("::")
        text += f"\n## {function}\n\n`{file}`\n\n```python\n{source(DOCS.parent / file, function)}\n```\n"
    return text


def source(path: Path, function: str) -> str:
    """Source of a function of a file, decorators included."""
    code = path.read_text(encoding="utf-8")
    node = next(n for n in ast.walk(ast.parse(code)) if isinstance(n, ast.FunctionDef) and n.name == function)
    first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
    return "\n".join(code.splitlines()[first - 1 : node.end_lineno])
