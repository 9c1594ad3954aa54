"""What several tests share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

ROWS = pytest.StashKey[list]()
VALIDATION = Path(__file__).resolve().parent.parent / "docs" / "validation.json"


def pytest_addoption(parser):
    parser.addoption("--validation", action="store_true", help=f"write the validated numbers into {VALIDATION.name}")


def pytest_configure(config):
    config.stash[ROWS] = []


def pytest_sessionfinish(session, exitstatus):
    if session.config.getoption("--validation") and exitstatus == 0:
        VALIDATION.write_text(
            json.dumps(session.config.stash[ROWS], indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )


@pytest.fixture(scope="session")
def committed():
    """Expected value and tolerance of every row of the validation page."""
    rows = json.loads(VALIDATION.read_text(encoding="utf-8"))
    return {(row["subject"], row["what"]): (row["expected"], row["tolerance"]) for row in rows}


@pytest.fixture
def validated(request, committed):
    """Assert that a number is what something not ours says, and make it a row of docs/validation.md."""

    def check(subject, what, ours, expected, *, rel=0.0, within=0.0, unit="", source):
        ours, expected = float(ours), float(expected)
        error, tolerance = abs(ours / expected - 1), max(rel, within / abs(expected))
        assert error <= tolerance, f"{what}: {ours:.9g} {unit}, expected {expected:.9g} within {tolerance:.1e}"
        row = {"subject": subject, "what": what, "expected": expected, "ours": ours, "unit": unit}
        row |= {"error": float(f"{error:.2g}"), "tolerance": float(f"{tolerance:.2g}"), "source": source}
        request.config.stash[ROWS].append(row)
        if not request.config.getoption("--validation"):
            stale = "docs/validation.json is older than this test: pytest --validation, then python docs/generate.py"
            assert committed.get((subject, what)) == (expected, row["tolerance"]), stale

    return check


@pytest.fixture(scope="session")
def needs_mesher():
    """Skip where gmsh's system libraries are missing: only the committed meshes work there."""
    from thermofem.mesh import gmsh_problem

    problem = gmsh_problem()
    if problem:
        pytest.skip(problem)
