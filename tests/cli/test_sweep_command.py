"""`thermofem sweep` on tables of nm and dBm, and traces of `identify` in decibels: synthetic truths."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem
from scipy.constants import c

import coupled
import thermofem as th
from coupled.equilibria.transmission import sweep
from coupled.ring_toml import write_text
from thermofem.data.column_units import Column
from thermofem_cli.inputs.light_tables import drop_table

ONE = replace(coupled.borghi2021(), drop_rate=0.0, name="on one bus")
TRUE = {"bus_rate": 3e9, "loss_rate": 6e9, "frequency": c / 1550.3e-9, "thermal_resistance": 9e3}


def tables(folder, noise=0.05):
    """A weak and a strong sweep of the true ring in nm and dBm, behind a fibre of 7.3 dB and a tilted grating."""
    rng = np.random.default_rng(1)
    rates = {name: value for name, value in TRUE.items() if name != "thermal_resistance"}
    ring = replace(ONE, **rates)
    heat = th.Foster(R=[TRUE["thermal_resistance"]], tau=[1e-6])
    wavelength = np.linspace(1550.2e-9, 1550.5e-9, 121)
    for dbm in (-10, 0):
        watts = 1e-3 * 10 ** (dbm / 10)
        run = sweep(ring, heat, power=watts, detuning=c / wavelength - ring.frequency)
        level = 10 * np.log10(run["through"].values / 1e-3) - 7.3
        level = level + 0.8 * np.linspace(-0.5, 0.5, 121) + noise * rng.standard_normal(121)
        rows = np.column_stack([wavelength * 1e9, level])
        header = "Wavelength (nm),through (dBm)"
        np.savetxt(folder / f"{dbm}.csv", rows, delimiter=",", header=header, comments="", fmt="%.6f")
    (folder / "ring.toml").write_text(write_text(ONE, {}))


@pytest.mark.slow
def test_sweeps_in_nm_and_dbm_give_losses_and_resistance(tmp_path):
    tables(tmp_path)
    arguments = ["--power", "-10 dBm", "--power", "0 dBm", "--ring", "ring.toml", "--figure", "f.png", "--json"]
    done = thermofem("sweep", "./-10.csv", "0.csv", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for name, value in TRUE.items():
        assert abs(found["parameters"][name] - value) < 5 * found["standard_deviations"][name], name
    assert found["standard_deviations"]["thermal_resistance"] < 0.05 * 9e3
    assert found["misfit"] < 1.5
    assert "search starts at 1550.3" in done.stderr
    ring = coupled.RingResonator.from_toml(tmp_path / "swept.toml")
    assert ring.bus_rate == pytest.approx(found["parameters"]["bus_rate"])
    assert (tmp_path / "f.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("header", "arguments", "said"),
    [
        ("wavelength,through (dBm)", [], "states no unit; give --units"),
        ("wavelength (nm),power (dBm)", [], "neither drop nor through; give --port"),
        ("wavelength (nm),through (dBm)", ["--units", "nm"], "--units = 'nm' must be two units"),
        (
            "wavelength (nm),through (dBm)",
            ["--columns", "1,9"],
            "--columns = '1,9' must be two of the columns of numbers: 1 'w",
        ),
        ("wavelength (nm),through (dBm)", ["--held", "tau_x=5 %"], "--held = 'tau_x' is unknown"),
        ("wavelength (nm),through", [], "states no unit and is negative on average"),
    ],
)
def test_what_a_table_leaves_open_is_asked_for(tmp_path, header, arguments, said):
    rows = np.column_stack([np.linspace(1550, 1551, 9), np.linspace(-20, -21, 9)])
    np.savetxt(tmp_path / "t.csv", rows, delimiter=",", header=header, comments="")
    done = thermofem("sweep", "t.csv", "--power", "0 dBm", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("header", "units"), [("t (us),drop [DBM]", None), ("t (us),drop_dBm", None), ("t,drop", "us,dbm")]
)
def test_a_trace_in_dbm_is_in_watts(tmp_path, header, units):
    """0 dBm is 1 mW and -10 dBm .1 mW."""
    rows = np.column_stack([np.arange(5), [0, -10, 0, -10, 0]])
    np.savetxt(tmp_path / "t.csv", rows, delimiter=",", header=header, comments="")
    trace = drop_table(tmp_path / "t.csv", "1,2", units)
    assert trace["drop"].attrs["units"] == "W"
    np.testing.assert_allclose(trace["drop"].values, [1e-3, 1e-4, 1e-3, 1e-4, 1e-3], rtol=1e-12)
    np.testing.assert_allclose(trace["time"].values, 1e-6 * np.arange(5), rtol=1e-12)


def test_decibels_without_a_unit_are_asked_for(tmp_path):
    rows = np.column_stack([np.arange(5), [-3, -10, -3, -10, -3]])
    np.savetxt(tmp_path / "t.csv", rows, delimiter=",", header="t (us),drop", comments="")
    done = thermofem("identify", "t.csv", "--power", "0 dBm", "--detuning", "0 GHz", cwd=tmp_path)
    assert done.returncode == 2
    assert "is negative on average" in done.stderr
    assert 'give --units "us,dBm"' in done.stderr


@pytest.mark.parametrize(
    ("unit", "watts", "si"),
    [
        ("dB", [0.1, 1.0], "fraction"),
        ("mW", [-0.01, 0.0], "W"),
        ("mV", [-0.01, 0.0], "V"),
        ("counts", [-10, 0], "counts"),
    ],
)
def test_units_of_light(unit, watts, si):
    """10 dB are a factor of 10; mW are W, mV are V; an arbitrary unit stays."""
    light, in_unit = Column(1, "y", unit, np.array([-10.0, 0.0])).light_in_si()
    np.testing.assert_allclose(light, watts, rtol=1e-12)
    assert in_unit == si
