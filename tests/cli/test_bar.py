"""The bar over simulated time: what it says, and that what takes long shows it."""

from __future__ import annotations

from importlib import import_module

import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem_cli import app
from thermofem_cli.bar import Bar

SAID: list[tuple[float, str]] = []  # share done, and the words beside the bar


@pytest.fixture(autouse=True)
def terminal(monkeypatch):
    """Standard error as a terminal: elsewhere there is no bar."""
    monkeypatch.setattr("thermofem_cli.bar.watched", lambda: True)


class Listened(Bar):
    def __call__(self, time):
        super().__call__(time)
        (task,) = self.progress.tasks
        SAID.append((task.completed / task.total, task.fields["at"]))


@pytest.mark.parametrize(
    ("module", "arguments", "last"),
    [
        ("solve", ["solve", "warm.toml", "--square", "1 us", "--duration", "1 us", "--accuracy", "1e-2"], "1 of 1 us"),
        ("solve", ["solve", "warm.toml", "--square", "1 us", "--periodic", "--accuracy", "1e-2"], "of 7 or so"),
        ("models", ["simulate", "model.json", "--duration", "2 ms"], "2 of 2 ms"),
        ("cosimulate", ["cosimulate", "--duration", "2 us"], "2 of 2 us"),
    ],
)
@pytest.mark.slow
def test_what_takes_long_says_how_far_it_is(module, arguments, last, tmp_path, monkeypatch):
    (tmp_path / "warm.toml").write_text(th.strip_ring().to_toml().replace('"Si"', '"Si(T)"'))  # stepped: k(T)
    surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), tmp_path / "model.json")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module(f"thermofem_cli.{module}"), "Bar", Listened)
    SAID.clear()
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    shares = [share for share, _ in SAID]
    assert len(shares) > 2
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1, abs=0.2)  # a periodic state takes 6 to 8 passes
    assert last in SAID[-1][1]
    assert "solving" not in done.output  # the bar is gone when the run is done


def test_the_words_beside_the_bar():
    bar = Bar("solving", 1e-6, periodic=True, first="compiles")
    (task,) = bar.progress.tasks
    assert (task.fields["at"], task.total) == ("compiles", None)  # alive, no telling how far
    for time, said in ((0.4e-6, "pass 1 of 7 or so"), (1e-6, "pass 1 of 7 or so"), (2.5e-6, "pass 3 of 7 or so")):
        bar(time)
        assert task.fields["at"] == said
    bar = Bar("solving", 1e-6)
    bar(0.25e-6)
    assert bar.progress.tasks[0].fields["at"] == "0.25 of 1 us"
    assert bar.progress.tasks[0].percentage == 25
