"""thermofem noise and linearize, as a user types them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from commands import thermofem

import coupled
import surrogate
import thermofem as th


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The ten-pole reduction of the reference strip, and a chip of which no silicon guides."""
    folder = tmp_path_factory.mktemp("noise")
    surrogate.save_model(surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3), folder / "fem.json")
    return folder


def answers(folder, *arguments):
    """The numbers of a command."""
    done = thermofem(*arguments, "--json", "-q", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_linearize_prints_plots_and_writes_what_python_has(folder):
    light = ("--power", "1 mW", "--detuning=-5 GHz")
    done = thermofem("linearize", "fem.json", *light, "--figure", "bode.png", "--csv", "bode.csv", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "stable; leading eigenvalue -9.497e+04 1/s" in done.stdout
    assert "15.02 K/mW" in done.stdout
    assert "delta_T: 88.3 mK per GHz at rest, -3 dB at 23.7 kHz" in done.stdout
    assert (folder / "bode.png").stat().st_size > 1e4
    linear = coupled.linearize(
        coupled.borghi2021(), surrogate.load_model(folder / "fem.json"), power=1e-3, detuning=-5e9
    )
    numbers = answers(folder, "linearize", "fem.json", *light)
    for name in ("A", "B", "C", "D"):
        assert np.array(numbers[name]) == pytest.approx(getattr(linear, name), rel=1e-12, abs=0)
    assert numbers["inputs"] == list(linear.inputs)
    table = np.loadtxt(folder / "bode.csv", delimiter=",", skiprows=1)
    response = linear.response(table[:, 0])["response"].sel(input="detuning", output="drop").values
    assert table[:, 1] == pytest.approx(np.abs(response), rel=1e-6, abs=0)
    # the bandwidth is where the response is 3 dB down; interpolation between 401 points errs by 1e-4
    bandwidth = numbers["responses"]["delta_T"]["bandwidth"]
    ratio = linear.response([0.0, bandwidth])["response"].sel(input="detuning", output="delta_T").values
    assert abs(ratio[1] / ratio[0]) == pytest.approx(np.sqrt(0.5), rel=2e-4, abs=0)


def test_linearize_names_bad_input(folder):
    for arguments, said in (
        (("--input", "lamp"), "--input"),
        (("--power", "0 mW"), "--power"),
        (("--branch", "4"), "branch"),
    ):
        done = thermofem("linearize", "fem.json", *arguments, cwd=folder)
        assert done.returncode == 2
        assert said in done.stderr


def test_noise_prints_plots_and_writes_what_python_has(folder):
    options = ("--wavelength", "1555 nm", "--temperature", "300 K")
    done = thermofem("noise", *options, "--figure", "noise.png", "--csv", "s.csv", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "rms temperature 412 uK, rms frequency 3.73 MHz" in done.stdout
    assert "certified" in done.stdout
    assert (folder / "noise.png").stat().st_size > 1e4
    f, S = np.loadtxt(folder / "s.csv", delimiter=",", skiprows=1).T
    heat = th.assemble(th.strip_ring())
    lit = heat.with_light(th.light(heat, wavelength=1.555e-6).mode())
    data = th.thermal_noise(lit, f, temperature=300.0)
    assert pytest.approx(data["S_nu"].values, rel=1e-4, abs=0) == S  # each certified to 1e-4, on other frequencies
    # the area by Simpson's rule on many points, up to where the density meets 8 ln 2 f/pi^2
    fine = np.geomspace(1.0, 1e8, 4001)
    density = th.thermal_noise(lit, fine, temperature=300.0)["S_nu"].values
    slow = density > 8 * np.log(2) / np.pi**2 * fine
    width = np.sqrt(8 * np.log(2) * np.trapezoid(density[slow], fine[slow]))
    assert answers(folder, "noise", *options)["linewidth"] == pytest.approx(width, rel=0.03, abs=0)  # steps of 8 % in f


def test_noise_names_bad_input(folder):
    for arguments, said in (
        (("--temperature", "-3 K"), "temperature"),
        (("--frequency", "1 kHz"), "--frequency"),
        (("--mode", "TE9"), "TE9"),
    ):
        done = thermofem("noise", *arguments, cwd=folder)
        assert done.returncode == 2
        assert said in done.stderr
