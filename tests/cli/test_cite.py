"""thermofem cite: the works behind a result, from the file alone."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

from paths import ROOT
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem_cli import app


def cited(*arguments):
    done = CliRunner().invoke(app, ["cite", *map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.output


def test_without_a_file_the_software_and_the_paper():
    lines = cited().splitlines()
    assert len(lines) == 2
    assert f"version {th.__version__}" in lines[0]
    assert "Opt. Express 29, 4363 (2021)" in lines[1]


def test_data_name_the_sources_of_their_materials(tmp_path):
    heat = th.assemble(th.strip_ring())
    th.save(th.solve(heat, th.Constant(1e-3), [1e-7, 1e-6]), tmp_path / "data.nc")
    text = cited(tmp_path / "data.nc")
    assert "scikit-fem" in text
    assert th.materials.find("SiO2").source in text
    assert "TiN" not in text


def test_a_model_names_those_of_its_geometry_as_bibtex(tmp_path):
    geometry = th.strip_ring().to_toml()
    model = th.Foster(R=[7e3], tau=[1e-6])
    surrogate.save_model(model, tmp_path / "model.json", provenance={"geometry": geometry})
    text = cited(tmp_path / "model.json", "--bibtex")
    assert re.findall(r"^@(\w+)\{(\w+),$", text, re.MULTILINE) == [
        ("software", "thermofem"),
        ("article", "borghi2021"),
        ("article", "scikitfem"),
        ("article", "gmsh"),
        ("misc", "material_si"),
        ("misc", "material_sio2"),
    ]
    assert text.count("{") == text.count("}")


def test_the_citation_file_names_this_version():
    text = (ROOT / "CITATION.cff").read_text()
    assert f"version: {th.__version__}\n" in text


def test_text_of_a_file_is_one_printable_line_and_no_latex(tmp_path):
    """A material's source could send commands to the terminal, and commands of LaTeX into a bibliography."""
    times = [k * 1e-7 for k in range(20)]
    data = th.dataset.build(times, [1 - 0.5**k for k in range(20)], th.Constant(1e-3))
    data.attrs |= {"geometry": "x", "materials": json.dumps({"Si": "a\x1b[31m\nb \\\\write18{rm} 5 %}"})}
    th.save(data, tmp_path / "data.nc")
    assert "\x1b" not in cited(tmp_path / "data.nc")
    note = cited(tmp_path / "data.nc", "--bibtex").splitlines()[-2]
    assert r"a\textbackslash{}x1b[31m\textbackslash{}nb \textbackslash{}\textbackslash{}write18\{rm\} 5 \%\}}" in note


# an editable installation has the checkout, and so the real paper/, on its path; others do not
PROGRAM = """
import os, sys
sys.path[:] = [folder for folder in sys.path if not os.path.isdir(os.path.join(folder, "paper"))]
from thermofem_cli import main
main()
"""
RUNNER = """
def run(output, *, quick, workers, console):
    return {"incomplete": 0, "output": str(output), "quick": quick}
"""


def test_reproduce_of_an_installed_program_finds_the_paper_in_the_working_folder(tmp_path):
    site = tmp_path / "site"
    site.mkdir()
    for package in ("thermofem", "surrogate", "coupled", "thermofem_cli"):
        (site / package).symlink_to(ROOT / package)
    (site / "program.py").write_text(PROGRAM)  # sys.path begins with site
    report = tmp_path / "checkout" / "paper" / "report"
    report.mkdir(parents=True)
    (report / "runner.py").write_text(RUNNER)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [sys.executable, site / "program.py", "reproduce", "--quick", "--json"]
    settings = {"env": environment, "capture_output": True, "text": True, "check": False}
    done = subprocess.run(command, cwd=tmp_path / "checkout", **settings)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["quick"] is True
    done = subprocess.run(command, cwd=tmp_path, **settings)
    assert done.returncode == 2
    assert "reproduce needs a checkout" in done.stderr
