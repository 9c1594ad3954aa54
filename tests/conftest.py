"""What several tests share."""

from __future__ import annotations

import json
import logging
from concurrent.futures import ThreadPoolExecutor

import hypothesis
import pytest
from paths import ROOT
from validation_rows import merged

ROWS = pytest.StashKey[list]()
VALIDATION = ROOT / "docs" / "validation.json"

hypothesis.settings.register_profile("thermofem", deadline=None)  # a busy machine is no failure
hypothesis.settings.load_profile("thermofem")


def pytest_addoption(parser):
    parser.addoption("--validation", action="store_true", help=f"write the validated numbers into {VALIDATION.name}")


def pytest_configure(config):
    config.stash[ROWS] = []


def pytest_sessionfinish(session, exitstatus):
    if hasattr(session.config, "workeroutput"):  # one of xdist's processes: the one that started it writes
        session.config.workeroutput["rows"] = session.config.stash[ROWS]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error):
    node.config.stash[ROWS] += getattr(node, "workeroutput", {}).get("rows", [])


def pytest_terminal_summary(terminalreporter, exitstatus, config):
    if not config.getoption("--validation") or hasattr(config, "workeroutput"):
        return
    if exitstatus != 0:
        terminalreporter.write_line(f"{VALIDATION.name} is left as it was: not every test passed")
        return
    whole = config.args_source is not config.ArgsSource.ARGS and not config.option.keyword
    rows, left = merged(
        json.loads(VALIDATION.read_text(encoding="utf-8")),
        config.stash[ROWS],
        drop=whole and not terminalreporter.stats.get("skipped"),
    )
    VALIDATION.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    terminalreporter.write_line(f"{VALIDATION.name}: {len(rows)} rows; next: python docs/generate.py")
    for row in left:
        fate = "kept" if row in rows else "dropped"
        terminalreporter.write_line(f"  {fate}, no test measured it: {row['subject']}: {row['what']}")


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
        row["test"] = f"{request.path.relative_to(ROOT).as_posix()}::{request.node.originalname}"
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


@pytest.fixture(scope="module")
def threads():
    """An executor for campaigns that need no process of their own."""
    with ThreadPoolExecutor(2) as executor:
        yield executor


@pytest.fixture(autouse=True)
def level_of_the_log():
    """The level of the log is that of a new process: a command sets it for the rest of its process."""
    logging.getLogger("thermofem").setLevel(logging.NOTSET)
