"""Rules of the house: who may import whom, what stays light, what the README shows is what happens."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT

SOURCES = [path for package in ("thermofem", "surrogate", "coupled") for path in sorted((ROOT / package).rglob("*.py"))]
MODULES = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in SOURCES]


def imported(path: Path) -> set[str]:
    """Top-level names of every absolute import anywhere in a file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("path", SOURCES, ids=MODULES)
def test_import_rules(path):
    names, inside = imported(path), path.relative_to(ROOT)
    command_line = inside.parts[:2] == ("thermofem", "cli")
    if not command_line:
        for package in {"surrogate", "coupled"} - {inside.parts[0]}:
            assert package not in names, f"{inside} imports {package}; only thermofem/cli may"
    if not inside.name.startswith("plot"):
        assert "matplotlib" not in names, f"{inside} imports matplotlib; only plot modules may"
    if inside != Path("thermofem/mesh/generate.py"):
        assert not {"gmsh", "pygmsh"} & names, f"{inside} imports gmsh; only thermofem/mesh/generate.py may"
    if inside != Path("surrogate/sindy.py"):
        assert "pysindy" not in names, f"{inside} imports pysindy; only surrogate/sindy.py may"


def test_imports_stay_light():
    """A bare import loads none of the heavy libraries, so that scripts and --help answer at once."""
    heavy = "gmsh, pygmsh, meshio, skfem, shapely, matplotlib, pint, xarray, numba, pysindy, pymoo, dask"
    code = f"import sys, thermofem, thermofem.cli; print([m for m in '{heavy}'.split(', ') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [m for m in MODULES if ".cli" not in m])
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
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == printed.strip()


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_examples_compile(script):
    compile(script.read_text(), str(script), "exec")
