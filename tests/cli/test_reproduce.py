"""The reproduction: its short version, run twice, and its report held against its files."""

from __future__ import annotations

import html
import json
import re

import pytest
from commands import process
from paths import ROOT

from paper.report.runner import run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    made = run(folder, quick=True, workers=2)
    assert made["kept"] == 0
    rows = json.loads((folder / "data" / "table.json").read_text())
    other = [row["agrees"] for row in rows if row["where"] == "independent code" and row["agrees"] is not None]
    assert len(other) > 5
    assert all(other)
    return folder


def test_a_second_run_takes_what_is_there_and_trusts_nothing_damaged(out):
    (pulse,) = (out / "data" / "results").glob("pulse-*.pulse.nc")
    whole = pulse.read_bytes()
    pulse.write_bytes(whole[: len(whole) // 2])
    made = run(out, quick=True, workers=1)
    assert made["kept"] == made["studies"] - 1
    assert len(pulse.read_bytes()) > len(whole) // 2


def test_every_number_of_the_page_is_that_of_its_file(out):
    text = (out / "report.html").read_text()
    numbers = re.findall(r'<data value="([^"]*)" data-from="([^"]*)#/numbers/([^"]*)"', text)
    assert len(numbers) > 60
    for value, path, pointer in numbers:
        found = json.loads((out / path).read_text())["numbers"]
        for step in html.unescape(pointer).split("/"):
            found = found[int(step)] if isinstance(found, list) else found[step]
        assert repr(found) == html.unescape(value)
    assert not re.search(r"[{]\w+/", text)  # every place was filled
    assert text.count("<img") >= 6
    assert "http" not in re.sub(r'src="data:[^"]*"', "", text)


def test_numbers_are_those_of_independent_codes(out):
    (path,) = (out / "data" / "results").glob("traces-*.json")
    traces = json.loads(path.read_text())["numbers"]
    for name, period in (("Newton, the paper's fit", 762.696), ("second order, the paper's, FEM", 686.002)):
        assert traces[name]["period_s"] == pytest.approx(period * 1e-9, rel=1e-4)  # rtol 1e-6 against 1e-9
    # the FEM itself with nothing fitted; half an ns is the rounding of the other code's number, 1e-3 the mesh's error
    assert traces["reduction"]["period_s"] == pytest.approx(680e-9, abs=1.2e-9)


def test_a_full_run_has_every_row_with_a_number_and_a_reason(tmp_path):
    template = (ROOT / "paper" / "report" / "report.html").read_text()
    made = run(tmp_path / "out", workers=2)
    rows = json.loads((tmp_path / "out" / "data" / "table.json").read_text())
    assert made["rows"] == len(rows) == template.count("<tr><td>")
    assert made["incomplete"] == 0
    assert [row["quantity"] for row in rows if row["agrees"] is False and not row["why"]] == []


def test_an_installation_says_where_the_reproduction_is(tmp_path):
    """Packages copied away from the checkout have no paper/ beside them."""
    for name in ("thermofem", "surrogate", "coupled", "thermofem_cli"):
        (tmp_path / name).symlink_to(ROOT / name)
    done = process("reproduce", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode == 2
    assert "make demo" in done.stderr
