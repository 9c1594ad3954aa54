"""fit, reduce, validate and simulate, each fed with the file the one before wrote."""

from __future__ import annotations

import json

import pytest
from test_cli import thermofem

import thermofem as th


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Training data, a trained model and a reduction of the reference strip."""
    folder = tmp_path_factory.mktemp("models")
    heat = th.assemble(th.strip_ring())
    th.save(th.solve_periodic(heat, th.SquareWave(2e-3, 1e-6, 0.33)), folder / "square.nc")
    for arguments in (["fit", "square.nc", "-o", "second.json"], ["reduce", "-o", "fem.json"]):
        done = thermofem(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


def test_fit_and_reduce_write_models(folder):
    second, fem = (json.loads((folder / f"{name}.json").read_text()) for name in ("second", "fem"))
    assert len(second["poles"]) == 2
    assert sum(pole["R"] for pole in second["poles"]) == pytest.approx(
        7890, rel=0.02
    )  # table of the trained parameters
    assert sum(pole["R"] for pole in fem["poles"]) == pytest.approx(7867.156, rel=1e-3)  # converged reference, accuracy
    assert fem["provenance"]["error_bound"] <= 1e-4


def test_validate_states_the_range(folder):
    done = thermofem("validate", "second.json", "--reference", "fem.json", "--figure", "curve.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "within 10 %" in done.stdout
    curve = th.load(folder / "period_error.nc").sel(model="second").interp(period=1e-6)
    assert curve.relative_error.item() == pytest.approx(0.04, abs=0.015)  # +4 % at 1 us by an independent code
    assert (folder / "curve.png").read_bytes().startswith(b"\x89PNG")


def test_simulate_pulses_with_the_period_of_the_fem(folder):
    done = thermofem("simulate", "fem.json", "--power", "8 dBm", "--figure", "traces.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    period = float(done.stdout.split("period ")[1].split(" ns")[0])
    assert period == pytest.approx(680, rel=0.01)  # the same optics on an independent code's heat
    assert th.load(folder / "traces.nc")["drop"].max() > 3e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fit", "missing.nc"], "missing.nc does not exist"),
        (["fit", "square.nc", "--kind", "secondorder"], "did you mean 'second-order'"),
        (["reduce", "--tolerance", "-1"], "tolerance"),
        (["validate", "second.json", "--reference", "square.nc"], "square.nc"),
        (["validate", "second.json", "--reference", "fem.json", "--shortest", "20 us"], "must be below --longest"),
        (["simulate", "fem.json", "--detuning", "-10"], "--detuning"),
        (["simulate", "fem.json", "--power", "8 dB"], "--power"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, folder):
    before = sorted(folder.iterdir())
    done = thermofem(*arguments, cwd=folder)
    assert done.returncode == 2, done.stdout + done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(folder.iterdir()) == before
