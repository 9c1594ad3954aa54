"""``thermofem cosimulate``: geometry in, traces and fields out."""

from __future__ import annotations

import pytest
from commands import thermofem

import thermofem as th


def test_traces_fields_and_figure(tmp_path):
    done = thermofem(
        "cosimulate", "--duration", "2 us", "--field-times", "0.5 us, 1 us", "--paraview", "heat.xdmf",
        "--figure", "traces.png", "-o", "run.nc", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "self-pulsing" in done.stdout or "slow transient" in done.stdout
    assert "the ring 'Borghi 2021'; --ring RING.toml" in done.stderr
    run = th.load(tmp_path / "run.nc")
    assert run.field.sizes["field_time"] == 2
    assert run.attrs["largest_discrepancy"] < 1e-3
    assert abs(run.attrs["heat_imbalance"]) < 1e-6
    assert (tmp_path / "heat.xdmf").exists()
    assert (tmp_path / "traces.png").read_bytes().startswith(b"\x89PNG")


def test_a_heater_a_ring_file_and_no_predictor(tmp_path):
    (tmp_path / "ring.toml").write_text(th.heated_ring().to_toml())
    (tmp_path / "optics.toml").write_text('base = "borghi2021"\nname = "on one bus"\nbuses = 1\n')
    done = thermofem(
        "cosimulate", "ring.toml", "--heater", "heater=5 mW", "--power", "1 uW", "--duration", "0.2 us",
        "--predictor", "none", "--ring", "optics.toml", "-o", "run.nc", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = th.load(tmp_path / "run.nc")
    assert run.attrs["ring"] == "on one bus"
    assert run.attrs["predictor"] == "none"
    assert run.attrs["heat_in"] == pytest.approx(5e-3 * 0.2e-6, rel=1e-3, abs=0)  # 1 uW of light adds 1e-4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--heater", "heatr=5 mW"], "'heatr' is unknown"),
        (["--heater", "5 mW"], "NAME=VALUE"),
        (["--paraview", "a.xdmf"], "--field-times"),
        (["--max-discrepancy", "1 mW"], "--max-discrepancy"),
        (["--predictor", "missing.json"], "missing.json"),
        (["--figure", "a.txt"], "a.txt"),
    ],
    ids=str,
)
def test_bad_input_is_one_line(tmp_path, arguments, message):
    done = thermofem("cosimulate", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())
