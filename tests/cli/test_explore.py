"""`thermofem explore`: the file it writes, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem_cli import app


def run(*arguments):
    return CliRunner().invoke(app, ["explore", *map(str, arguments)])


def test_models_side_by_side(tmp_path):
    for name, tau in (("fast", 1e-6), ("slow", 1e-4)):  # at 1 K/mW without folds of cycles, which take seconds
        surrogate.save_model(th.Foster(R=[1e3], tau=[tau]), tmp_path / f"{name}.json")
    page = tmp_path / "ring.html"
    done = run(tmp_path / "fast.json", tmp_path / "slow.json", "--power", "5 dBm", "-o", page)
    assert done.exit_code == 0, done.output
    text = page.read_text(encoding="utf-8")
    assert '"name":"fast"' in text
    assert '"name":"slow"' in text
    assert '"power":5.0' in text


@pytest.fixture
def heated(tmp_path):
    """A model with two inputs; 1 mW in the heater warms the ring by 1 K."""
    B = np.array([[1998.1, 100.0], [5786.2, 900.0]])
    parts = {"inputs": ("core", "heater"), "outputs": ("core",)}
    # heat so slow that there are no folds of cycles, which a page takes seconds for
    model = th.StateSpace(np.diag([1e-7, 1e-4]), -np.eye(2), B, np.ones((1, 2)), **parts)
    surrogate.save_model(model, tmp_path / "heated.json")
    return tmp_path / "heated.json"


def data_of(page):
    """What the page holds."""
    text = page.read_text(encoding="utf-8")
    return json.loads(text.split('id="data">')[1].split("</script>")[0])


@pytest.mark.parametrize(
    ("lit", "other", "own", "beside"), [("core", "heater", 7784.3, 1000), ("heater", "core", 1000, 7784.3)]
)
def test_heaters_get_sliders_and_their_powers(heated, tmp_path, lit, other, own, beside):
    """The light heats the part that is named, and the other one is a heater."""
    page = tmp_path / "ring.html"
    done = run(heated, "--heater", f"{other}=2.5 mW", "--heated", lit, "--read", "core", "-o", page)
    assert done.exit_code == 0, done.output
    data = data_of(page)
    assert data["start"]["h0"] == 2.5
    assert [slider["name"] for slider in data["heaters"]] == [other]
    assert sum(data["models"][0]["heaters"][other]) == pytest.approx(beside)
    assert sum(data["models"][0]["R"]) == pytest.approx(own)
