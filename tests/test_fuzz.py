"""The fuzzing of the readers (`make fuzz`) begins with files that are valid; a short round finds nothing."""

from __future__ import annotations

import importlib.util
import random
import sys
import warnings

import pytest
from paths import ROOT

pytestmark = pytest.mark.slow

SCRIPT = ROOT / "tests" / "fuzz" / "readers.py"


def loaded(name):
    """A script of the folder by its path: another folder of the tests has the name `audit`."""
    spec = importlib.util.spec_from_file_location(name, SCRIPT.with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def readers():
    return loaded("readers")


def test_what_is_edited_is_valid(readers):
    files = readers.seeds()
    assert files.keys() == readers.TARGETS.keys()
    for name, texts in files.items():
        for text in texts:
            readers.TARGETS[name](text)


def test_files_that_end_early_are_documented_errors(readers):
    pick = random.Random(1)
    for name, texts in readers.seeds().items():
        for text in texts:
            for _ in range(15):
                with warnings.catch_warnings():
                    readers.survives(name, text[: pick.randrange(len(text))], {})


@pytest.mark.parametrize("name", ["table", "trace", "mesh", "netcdf"])
def test_damage_of_every_column_and_byte_is_a_documented_error(readers, name):
    texts = list(readers.replaced(name, readers.seeds()[name]))
    random.Random(2).shuffle(texts)
    for text in texts[:400]:
        readers.survives(name, text, {})


@pytest.fixture(scope="module")
def audit():
    sys.path.insert(0, str(SCRIPT.parent))  # where its generators are
    try:
        return loaded("audit")
    finally:
        sys.path.remove(str(SCRIPT.parent))


def test_a_short_audit_finds_nothing(audit):
    """`make audit` goes on with other seeds, and with kills of maps and campaigns."""
    for tried, wrong in (audit.damage(60, seed=5), audit.models(60, seed=5), audit.random_trees(60, seed=5)):
        assert tried >= 60
        assert wrong == 0
    assert audit.full_disks(5, seed=5) == (5, 0)
    assert audit.changed_files(1.0, seed=5)[1] == 0


def test_options_of_commands_with_hostile_values(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    options = loaded("options")
    options.files(tmp_path)
    for _, arguments in zip(range(40), options.jobs(seed=4), strict=False):
        assert not options.failure(arguments, tmp_path), arguments


def test_a_few_calls_with_wrong_things_end_in_documented_errors():
    calls = loaded("calls")
    table = calls.calls()
    assert not calls.missing(table)  # every public name has a call, or a reason to have none
    done, wrong = calls.tried(table, 1500, 60.0, seed=3)
    assert done > 500
    assert not wrong
