"""What a release states in several places is the same everywhere."""

from __future__ import annotations

import re
import tomllib

import pytest
import rattler_build
from paths import ROOT

import thermofem

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CONDA = {"matplotlib": "matplotlib-base", "gmsh": "python-gmsh", "qdldl": "qdldl-python"}


@pytest.fixture(scope="module")
def recipe():
    """The conda recipe as rattler-build reads it: an unknown field, version rule or licence is an error there."""
    (rendered,) = rattler_build.Stage0Recipe.from_file(ROOT / "conda" / "recipe.yaml").render()
    return rendered.recipe.to_dict()


def test_the_version_is_the_same_everywhere(recipe):
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert citation[1] == recipe["package"]["version"] == PROJECT["version"] == thermofem.__version__
    assert f"\n## {PROJECT['version']} (" in (ROOT / "CHANGELOG.md").read_text()


def test_the_recipe_needs_what_the_project_needs(recipe):
    needs = {tuple(line.split()) for line in recipe["requirements"]["run"]} - {("python", PROJECT["requires-python"])}
    names = (re.match(r"([\w-]+)(>=\S+)", text) for text in PROJECT["dependencies"])
    assert needs == {(CONDA.get(name[1], name[1]), name[2]) for name in names}
    assert "noarch" not in recipe["build"]  # it holds a compiled library; pip writes the command
    assert recipe["about"]["license"] == PROJECT["license"]
