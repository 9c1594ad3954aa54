"""The table of the report: every row of the template, whatever numbers are missing."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest
from paths import ROOT

from paper.report import runner
from paper.report.page import PLACE, page
from paper.report.study import STUDIES, Result

TEMPLATE = (ROOT / "paper" / "report" / "report.html").read_text(encoding="utf-8")
ROWS = len(re.findall(r"<tr><td>", TEMPLATE))


def listed(tree):
    """The tree with lists in place of those dictionaries whose keys are 0, 1, ..."""
    if not isinstance(tree, dict):
        return tree
    parts = {key: listed(part) for key, part in tree.items()}
    if all(key.isdigit() for key in parts):
        return [parts.get(str(k)) for k in range(1 + max(map(int, parts)))]
    return parts


def whole_run():
    """Results of all studies with the number 1 wherever the template asks for one."""
    numbers = {name: {} for name in STUDIES}
    for match in PLACE.finditer(TEMPLATE):
        *branches, leaf = " ".join(match[1].split()).split("/")
        part = numbers
        for branch in branches:
            part = part.setdefault(branch, {})
        part[leaf] = 1.0
    assert set(numbers) == set(STUDIES)  # the template names no study that there is not
    return {name: Result(listed(part), files=[f"{name}.json"]) for name, part in numbers.items()}


@pytest.fixture
def results():
    return whole_run()


def test_a_full_run_has_every_row_of_the_template(results):
    text, rows = page(results, {}, "", quick=False)
    assert len(rows) == ROWS > 90
    assert not any(row["missing"] for row in rows)
    assert "–</data>" not in text


def test_a_missing_number_is_a_dash_and_no_missing_row(results):
    """A fit of three traces has no deviations; its row is in the page all the same."""
    results["second_order_fit"].numbers["deviations"]["eta"] = None
    text, rows = page(results, {}, "", quick=False)
    assert len(rows) == ROWS
    (row,) = [row for row in rows if row["missing"]]
    assert row["missing"] == ["second_order_fit/deviations/eta"]
    assert row["ours"].startswith("0.00(0)·10⁻⁴/ns")  # the other numbers are there
    assert "1.000(–) (FEM-coupled)" in row["ours"]
    assert row["agrees"] is None
    assert "no number</td>" in text


def test_a_study_that_failed_leaves_dashes(results):
    lost = results.pop("second_order_fit")
    text, rows = page(results, {}, "", quick=False)
    assert len(rows) == ROWS
    missing = {path for row in rows for path in row["missing"]}
    assert {f"second_order_fit/parameters/{name}" for name in lost.numbers["parameters"]} <= missing
    assert "{second_order_fit" not in text


def test_the_short_version_has_the_rows_of_its_studies(results):
    quick = {name: result for name, result in results.items() if STUDIES[name].quick}
    _, rows = page(quick, {}, "", quick=True)
    assert 0 < len(rows) < ROWS
    assert not any(row["missing"] for row in rows)


def test_the_menu_names_each_section_once(results):
    text, _ = page(results, {"fig1a": b""}, "", quick=False)
    (menu,) = re.findall(r"<nav>(.*?)</nav>", text)
    links = re.findall(r'href="#([^"]+)"', menu)
    assert links.count("data") == 1
    assert len(set(links)) == len(links)


@pytest.mark.parametrize(("incomplete", "code"), [(0, 0), (2, 1)])
def test_a_row_without_a_number_is_exit_code_1(incomplete, code, monkeypatch):
    monkeypatch.setattr(runner, "run", lambda out, **_: {"incomplete": incomplete})
    monkeypatch.setattr(sys, "argv", ["paper", "-o", str(Path("out"))])
    with pytest.raises(SystemExit) as end:
        runpy.run_module("paper", run_name="__main__")
    assert end.value.code == code
