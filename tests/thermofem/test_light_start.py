"""The start of light behind an interferometer, of a trace of another part than the heated one, and of a late fall."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem_cli import app

SHIFT = 0.1  # rad/K


def write(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.9g")
    return path


def device(seed):
    """R (K/W), tau (s), power (W), bias (rad) and visibility of an interferometer."""
    draw = np.random.default_rng(seed)
    R = draw.uniform(300, 900)
    tau = draw.uniform(3e-6, 12e-6)
    power = 10 ** draw.uniform(-2, -1)
    return R, tau, power, draw.uniform(-3, 3), draw.uniform(0.6, 1.0)


@pytest.mark.parametrize("seed", [4, 7, 10, 13])
def test_light_that_falls_before_it_rises_has_its_start_in_the_bars(seed, tmp_path):
    """Searched as a temperature, the start of these is up to 20 us late and R wrong by 298 %, 21 deviations."""
    R, tau, power, bias, V = device(seed)
    t = np.linspace(-9e-6, 60e-6, 800)
    rise = R * power * (1 - np.exp(-np.maximum(t, 0) / tau))
    noise = 0.01 * np.random.default_rng(seed + 100).standard_normal(800)
    light = (1 + V * np.cos(bias + SHIFT * rise)) / 2 + noise
    path = write(tmp_path / "mzi.csv", "time (us),signal (V)", (t + 9e-6) * 1e6, light)
    data = th.read_trace(path, power, light=True)
    fit = surrogate.fit_foster(data, order=1, readout=th.MZI(shift=SHIFT))
    start = data.attrs["start"] + fit.parameters["late_1"]
    # 4 standard deviations of a normal number: one in 16000
    assert abs(start - 9e-6) < 4 * fit.standard_errors["late_1"]
    assert abs(fit.parameters["R_1"] - R) < 4 * fit.standard_errors["R_1"]
    assert abs(fit.parameters["tau_1"] - tau) < 4 * fit.standard_errors["tau_1"]
    searched = th.read_trace(path, power, baseline="0 K", sensitivity="1 V/K")
    with pytest.raises(th.InputError, match=r"as if the light were a temperature.*light=True"):
        surrogate.fit_foster(searched, order=1, readout=th.MZI(shift=SHIFT))


def test_light_without_rows_at_rest_asks_for_its_start(tmp_path):
    t = np.linspace(0, 60e-6, 800)
    light = (1 + 0.9 * np.cos(0.4 + 3 * (1 - np.exp(-t / 6e-6)))) / 2
    path = write(tmp_path / "mzi.csv", "time (us),signal (V)", t * 1e6, light)
    with pytest.raises(th.InputError, match=r"too few rows.*--start"):
        th.read_trace(path, 0.06, light=True)
    dark = write(tmp_path / "dark.csv", "time (us),signal (V)", t * 1e6, np.random.default_rng(0).standard_normal(800))
    with pytest.raises(th.InputError, match="does not depart"):
        th.read_trace(dark, 0.06, light=True)


def test_a_fall_of_light_is_a_drive_and_its_order_is_found(tmp_path):
    """800 K/W and 6 us, bias .4: the light is not negated."""
    t = np.linspace(-10e-6, 60e-6, 500)
    fall = 48.0 * np.exp(-np.maximum(t, 0) / 6e-6)
    light = (1 + 0.9 * np.cos(0.4 + SHIFT * fall)) / 2
    path = write(tmp_path / "mzi.csv", "time (us),signal (mV)", t * 1e6, 1e3 * light)
    data = th.read_trace(path, 0.06, light=True, fall=True, start=0.0)
    fit = surrogate.fit_foster(data, order="auto", readout=th.MZI(shift=SHIFT))
    assert pytest.approx([800.0], rel=1e-6) == fit.model.R  # no noise: nine digits are written
    assert fit.model.tau == pytest.approx([6e-6], rel=1e-6)
    assert fit.parameters["bias"] == pytest.approx(0.4, abs=1e-6)
    assert fit.parameters["half_power"] == pytest.approx(0.5, rel=1e-6)


R = np.array([-170.0, 850.0, 1020.0])
TAU = np.array([0.5e-6, 3e-6, 15e-6])


@pytest.fixture
def delayed(tmp_path):
    """Rise of a core under its heater, and the voltage of its driver: the start is t = 0 of the file."""
    t = np.arange(-100, 1001) * 5e-8
    rise = (5e-3 * R * -np.expm1(-np.maximum(t, 0)[:, None] / TAU)).sum(axis=1)
    noise = 0.005 * np.random.default_rng(1).standard_normal(t.size)
    gate = np.where(t > 0, 3.3, 0.0) + 0.02 * np.random.default_rng(2).standard_normal(t.size)
    return write(tmp_path / "core.csv", "time (us),T (K),gate (V)", t * 1e6, rise + noise, gate)


def test_the_start_of_another_part_is_not_searched(delayed):
    """The delay of diffusion is no late start: it would be 370 +- 13 ns, 28 deviations."""
    with pytest.raises(th.InputError, match=r"""by diffusion.*--start "0 s" or --start 'gate \(V\)'$"""):
        th.read_trace(delayed, 5e-3, heated="heater", read="core")
    found = th.read_trace(delayed, 5e-3)
    assert "'gate (V)' has two levels, as a drive has: --start 'gate (V)'" in found.attrs["assumed"]
    assert "two levels" not in th.read_trace(delayed, 5e-3, start="0 s").attrs["assumed"]
    with pytest.raises(th.InputError, match="as if the heated part were read"):
        surrogate.fit_foster(found, order=3, transfer=True)
    with pytest.raises(th.InputError, match="two levels"):
        th.read_trace(delayed, 5e-3, start="T (K)")


@pytest.mark.parametrize("start", ["0 s", "gate"])
def test_a_delay_of_diffusion_is_in_the_bars(start, delayed):
    data = th.read_trace(delayed, 5e-3, heated="heater", read="core", start=start)
    assert abs(data.attrs["start"]) < 26e-9  # half of a row
    fit = surrogate.fit_foster(data, order=3)
    truth = dict(zip(("R_1", "R_2", "R_3", "tau_1", "tau_2", "tau_3"), (*R, *TAU), strict=True))
    pulls = [(fit.parameters[name] - value) / fit.standard_errors[name] for name, value in truth.items()]
    assert np.abs(pulls).max() < 4  # of six normal numbers
    assert fit.model.inputs == ("heater",)
    assert fit.model.outputs == ("core",)


@pytest.mark.parametrize("start", [None, 0.0])
def test_a_late_fall_ends_its_heating_at_zero(start, tmp_path):
    """Even rows from 2 us on; 2954 for 3200 K/W if the fall began at its first row."""
    t = 2e-6 + np.arange(600) * 1e-7
    gains = np.array([1200.0, 2000.0])
    y = 300 + (1e-3 * gains * np.exp(-t[:, None] / np.array([3e-6, 20e-6]))).sum(axis=1)
    path = write(tmp_path / "fall.csv", "Time (s),T (K)", t, y)
    data = th.read_trace(path, 1e-3, fall=True, start=start)
    assert "poles faster than that do not show, and R_th lacks them" in data.attrs["assumed"]
    fit = surrogate.fit_foster(data, order=2)
    # nine digits of 300 K are written: 1e-7 of a swing of 2.6 K, ten times more in a fit of two poles
    np.testing.assert_allclose(fit.model.R, gains, rtol=1e-3)


@pytest.mark.parametrize(("ending", "program"), [("npz", "NumPy"), ("npy", "NumPy"), ("mat", "MATLAB"), ("h5", "HDF5")])
def test_a_file_of_arrays_is_named(ending, program, tmp_path):
    path = tmp_path / f"trace.{ending}"
    path.write_bytes(np.arange(18.0).tobytes())
    with pytest.raises(th.InputError, match=f"holds arrays of {program}, no table of text; write two of them"):
        th.read_trace(path, 1e-3)
    done = CliRunner().invoke(app, ["fit", str(path), "--power", "1 mW"])
    assert f"holds arrays of {program}" in str(done.exception)
