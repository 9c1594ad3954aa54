"""What a release states in several places is the same everywhere."""

from __future__ import annotations

import re
import tomllib

from paths import ROOT

import thermofem

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CONDA = {"matplotlib": "matplotlib-base", "gmsh": "python-gmsh", "qdldl": "qdldl-python", "cvxpy": "cvxpy-base"}


def test_the_version_is_the_same_everywhere():
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    recipe = re.search(r'set version = "([^"]+)"', (ROOT / "recipe" / "meta.yaml").read_text())
    assert citation[1] == recipe[1] == PROJECT["version"] == thermofem.__version__
    assert f"\n## {PROJECT['version']} (" in (ROOT / "CHANGELOG.md").read_text()


def test_the_recipe_needs_what_the_project_needs():
    text = (ROOT / "recipe" / "meta.yaml").read_text()
    run = re.search(r"^  run:\n((?:    - .*\n)+)", text, re.MULTILINE)[1]
    recipe = {tuple(line.removeprefix("- ").split()) for line in map(str.strip, run.splitlines())} - {
        ("python", PROJECT["requires-python"])
    }
    names = (re.match(r"([\w-]+)(>=\S+)", text) for text in PROJECT["dependencies"])
    assert recipe == {(CONDA.get(name[1], name[1]), name[2]) for name in names}


def test_old_names_are_in_the_changelog():
    changes = (ROOT / "CHANGELOG.md").read_text()
    deprecated = changes.split("### Deprecated")[1].split("\n### ")[0]
    for old, new in thermofem._RENAMED.items():
        assert f"`th.{old}`" in deprecated
        assert f"`th.{new}`" in deprecated
