"""What a user installs: the files in the wheel, and that it works away from the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from paths import ROOT

COMPILER = {} if find_spec("ziglang") else {"CXX": "c++"}
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(COMPILER) and shutil.which("c++") is None, reason="neither ziglang nor a C++ compiler"),
]

USE = """
import thermofem as th
from coupled.kernel.tableaus import Method, tableau
print(th.__file__, th.assemble(th.strip_ring(), accuracy=1e-3).unknowns, tableau(Method.RODAS4).order)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built from the source distribution."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "-d", folder]
    subprocess.run([*build, "-t", "sdist"], cwd=ROOT, check=True, capture_output=True)
    (sdist,) = folder.glob("*.tar.gz")
    subprocess.run([sys.executable, "-m", "tarfile", "-e", sdist, folder / "source"], check=True)
    (source,) = (folder / "source").iterdir()
    subprocess.run([*build, "-t", "wheel"], cwd=source, check=True, capture_output=True, env=os.environ | COMPILER)
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_the_packages_and_nothing_else(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    libraries = {
        name for name in names if name.startswith("coupled/kernel/ring")
    }  # one, or one for newer processors, too
    packages = ("thermofem", "surrogate", "coupled", "thermofem_cli")
    found = [p for package in packages for p in (ROOT / package).rglob("*")]
    compiled = {*ROOT.glob("coupled/kernel/cpp/*.cpp"), *ROOT.glob("coupled/explore/page/*.cpp")}  # into libraries
    paths = [p for p in found if p.is_file() and p.parent.name != "__pycache__" and p not in compiled]
    files = {str(p.relative_to(ROOT)) for p in paths}
    files = {file for file in files if not file.startswith("coupled/kernel/ring")} | libraries
    files |= {f"thermofem/meshes/{p.name}" for p in (ROOT / "meshes").iterdir()}
    assert {f"{package}/py.typed" for package in packages[:3]} < files
    assert libraries
    assert {name for name in names if ".dist-info/" not in name} == files


def test_the_wheel_finds_its_meshes_and_tables_away_from_the_checkout(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    where, unknowns, order = done.stdout.split()
    assert Path(where).is_relative_to(tmp_path)
    assert (unknowns, order) == ("2508", "4")  # of the committed mesh, of the committed table
