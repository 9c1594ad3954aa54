"""Rules of the house: who may import whom, no circles, and what the README shows is what happens."""

from __future__ import annotations

import ast
import contextlib
import doctest
import graphlib
import importlib
import io
import re
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT

PACKAGES = "thermofem", "surrogate", "coupled", "thermofem_cli"
SOURCES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
MODULES = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in SOURCES]


@cache
def tree(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_text())


def imported(path: Path) -> set[str]:
    """Top-level names of every absolute import anywhere in a file."""
    names: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


# library -> the only place that may import it
HOMES = {
    "matplotlib": re.compile(r"(.*/)?plot(\w*|/\w+)\.py"),
    "gmsh": re.compile(r"thermofem/mesh/gmsh_mesher\.py"),
    "pygmsh": re.compile(r"thermofem/mesh/gmsh_mesher\.py"),
    "pysindy": re.compile(r"surrogate/fitting/sindy\.py"),
    "surrogate": re.compile(r"surrogate/.*|thermofem_cli/.*"),
    "coupled": re.compile(r"coupled/.*|thermofem_cli/.*"),
    "thermofem_cli": re.compile(r"thermofem_cli/.*|thermofem/__main__\.py"),
}


def test_import_rules():
    """Each library and package is imported in its own place only."""
    broken = [
        f"{path.relative_to(ROOT)} imports {name}; only {HOMES[name].pattern} may"
        for path in SOURCES
        for name in sorted(imported(path) & HOMES.keys())
        if not HOMES[name].fullmatch(path.relative_to(ROOT).as_posix())
    ]
    assert not broken


@cache
def dependencies(path: Path, name: str) -> set[str]:
    """Modules of the project that a file imports, inside functions too; imports for annotations do not count."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*up, *([node.module] if node.module else [])])
            taken = [alias.name for alias in node.names if alias.name != "__version__"]  # stands before all imports
            found.update(f"{base}.{each}" if f"{base}.{each}" in MODULES else base for each in taken)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(tree(path))
    return {other for other in found if other in MODULES and other != name}


def own_root(path: Path, name: str) -> bool:
    """Whether a file imports from the root of its own package, which imports it, or a module by text."""
    by_text = re.search(rf"(import_module|__import__)\(\s*f?[\"'](\.|{'|'.join(PACKAGES)})", path.read_text())
    return bool(by_text) or name.partition(".")[0] in dependencies(path, name)


def test_no_import_circles():
    """No two files import each other, directly or around; `graphlib` names the circle it finds."""
    roots = {*PACKAGES}  # the packages themselves only collect the public names
    assert [name for path, name in zip(SOURCES, MODULES, strict=True) if own_root(path, name)] == []
    graph = {name: dependencies(path, name) - roots for path, name in zip(SOURCES, MODULES, strict=True)}
    assert list(graphlib.TopologicalSorter(graph).static_order())


@pytest.mark.parametrize("package", PACKAGES)
def test_no_circles_between_rooms(package):
    """No two folders of a package need each other; a module beside them counts as a room of its own."""
    graph: dict[str, set[str]] = {}
    for path, name in zip(SOURCES, MODULES, strict=True):
        if name.startswith(f"{package}."):
            rooms = {other.split(".")[1] for other in dependencies(path, name) if other.startswith(f"{package}.")}
            room = name.split(".")[1]
            graph.setdefault(room, set()).update(rooms - {room})
    assert list(graphlib.TopologicalSorter(graph).static_order())


def test_the_table_of_folders_is_the_tree():
    tables = (ROOT / "CONTRIBUTING.md").read_text().partition("## Where things are")[2].partition("\n## ")[0]
    rows = [line.split("|")[1:3] for line in tables.splitlines() if line.startswith("| `")]
    named = {name for cell, _ in rows for name in re.findall(r"`([\w/]+)`", cell)}
    folders = {path.parent.relative_to(ROOT).as_posix() for path in (*SOURCES, *(ROOT / "paper").rglob("*.py"))}
    assert named == {folder for folder in folders if "/" in folder}
    paths = re.findall(r"`(\w+/[\w/.]+)`", tables)
    assert len(paths) > 40
    assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    "name", [m for m in MODULES if not m.startswith("thermofem_cli") and not m.endswith("__main__")]
)
def test_docstring_examples_run(name):
    module = importlib.import_module(name)
    import thermofem as th

    globs = {**{k: getattr(th, k) for k in th.__all__}, **vars(module)}
    result = doctest.testmod(module, extraglobs=globs, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


def test_every_public_name_exists_and_is_documented():
    for package in ("thermofem", "surrogate", "coupled"):
        module = importlib.import_module(package)
        for name in module.__all__:
            assert getattr(module, name).__doc__, f"{package}.{name} has no docstring"


def readme_blocks() -> list[tuple[str, str]]:
    """Python blocks of the README, each with the text block that follows it: the printed output."""
    text = (ROOT / "README.md").read_text()
    return re.findall(r"```python\n(.*?)```\s+```text\n(.*?)```", text, flags=re.DOTALL)


def test_readme_script_prints_what_the_readme_says(tmp_path):
    blocks = readme_blocks()
    assert blocks
    for code, printed in blocks:
        with contextlib.chdir(tmp_path), contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(code, "README.md", "exec", dont_inherit=True), {"__name__": "__main__"})
        assert out.getvalue().strip() == printed.strip()


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_examples_compile(script):
    compile(script.read_text(), str(script), "exec")


def size(node: ast.AST) -> int:
    """Nodes of a statement's syntax tree, without the statements inside it."""
    inside = [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.stmt | ast.expr_context)]
    return 1 + sum(size(child) for child in inside)


def computed(node: ast.AST) -> bool:
    """Whether an expression does more than name something."""
    if isinstance(node, ast.UnaryOp):
        return computed(node.operand)
    if isinstance(node, ast.Subscript | ast.Attribute):
        return computed(node.value)
    return not isinstance(node, ast.Name | ast.Constant)


def statements(function: ast.FunctionDef) -> list[ast.stmt]:
    """The statements of a function, without docstrings, imports and the headers of functions inside it."""
    skipped = (ast.FunctionDef, ast.Import, ast.ImportFrom, ast.Pass)
    every = [node for node in ast.walk(function) if isinstance(node, ast.stmt) and not isinstance(node, skipped)]
    return [node for node in every if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))]


def test_a_line_says_one_thing():
    """At most 15 nodes a statement in the mean of a function, no several computed values and no unpacked generator."""
    dense = set()
    several = []
    for path in SOURCES:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef):
                sizes = [size(each) for each in statements(node)]
                if len(sizes) > 7 and sum(sizes) > 15 * len(sizes):
                    dense.add(f"{path.relative_to(ROOT)}: {node.name}")
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
                values = node.value.elts if isinstance(node.value, ast.Tuple) else []
                unpacked = isinstance(node.value, ast.GeneratorExp | ast.ListComp)
                if unpacked or sum(map(computed, values)) > 1:
                    several.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert dense == set()
    assert several == []
