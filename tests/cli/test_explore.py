"""`thermofem explore`: the file it writes, and what it refuses."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem.cli import app


def run(*arguments):
    return CliRunner().invoke(app, ["explore", *map(str, arguments)])


def test_models_side_by_side(tmp_path):
    for name, tau in (("fast", 50e-9), ("slow", 1e-6)):
        surrogate.save_model(th.Foster(R=[7e3], tau=[tau]), tmp_path / f"{name}.json")
    page = tmp_path / "ring.html"
    done = run(tmp_path / "fast.json", tmp_path / "slow.json", "--power", "5 dBm", "-o", page)
    assert done.exit_code == 0, done.output
    text = page.read_text(encoding="utf-8")
    assert '"name":"fast"' in text
    assert '"name":"slow"' in text
    assert '"power":5.0' in text


def test_a_page_is_no_other_kind_of_file(tmp_path):
    surrogate.save_model(th.Foster(R=[7e3], tau=[1e-6]), tmp_path / "model.json")
    done = run(tmp_path / "model.json", "-o", tmp_path / "ring.png")
    assert isinstance(done.exception, th.InputError)
    assert "must end in .html" in str(done.exception)


def test_a_quadratic_model_is_refused_with_a_way_out(tmp_path):
    import numpy as np

    two = np.eye(2)
    model = th.Quadratic(-1e6 * two, np.zeros((2, 2, 2)), np.zeros((2, 2)), 1e9 * np.ones(2), np.ones(2))
    surrogate.save_model(model, tmp_path / "model.json")
    done = run(tmp_path / "model.json", "-o", tmp_path / "ring.html")
    assert isinstance(done.exception, th.InputError)
    assert "surrogate.output_map" in str(done.exception)


@pytest.mark.parametrize("power", ["40 dBm", "-3 W"])
def test_a_power_out_of_range_is_refused(tmp_path, power):
    surrogate.save_model(th.Foster(R=[7e3], tau=[1e-6]), tmp_path / "model.json")
    done = run(tmp_path / "model.json", "--power", power, "-o", tmp_path / "ring.html")
    assert isinstance(done.exception, th.InputError)
    assert not (tmp_path / "ring.html").exists()
