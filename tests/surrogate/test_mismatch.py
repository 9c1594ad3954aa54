"""The note of a fit whose drive is not the one that heated; the traces come from poles that no fit is given."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem.data import dataset
from thermofem_cli import app

POLES = th.Foster(R=[800, 1500, 2200, 1800, 1200, 400], tau=[40e-9, 200e-9, 800e-9, 3e-6, 9e-6, 30e-6])
SQUARE, PULSE = th.SquareWave(1e-3, 4e-6, 0.5), th.Pulse(1e-3, 4e-6)
FITS = (surrogate.fit_newton, surrogate.fit_second_order, surrogate.fit_foster, surrogate.fit_spectrum)
SAID = "the drive does not match delta_T"


def trace(heated, stated, noise=0.0, *, together=1, seed=0):
    """A trace heated by one drive that states another; noise [of the swing] of ``together`` neighbouring samples."""
    t = np.linspace(0, 20e-6, 2001)
    rise = POLES.response(heated, t)
    white = np.random.default_rng(seed).standard_normal(t.size + together)
    coloured = np.convolve(white, np.ones(together), "same")[: t.size] / np.sqrt(together)
    return dataset.build(t, rise + noise * np.ptp(rise) * coloured, stated)


def said(fit):
    return sum(note.startswith(SAID) for note in fit.notes)


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize(
    ("heated", "stated"),
    [
        (SQUARE, th.SquareWave(1e-3, 4e-6, 0.4)),
        (SQUARE, th.SquareWave(1e-3, 4.1e-6, 0.5)),
        (PULSE, th.Pulse(1e-3, 5e-6)),
        (PULSE, th.Pulse(1e-3, 3e-6)),
    ],
)
def test_a_wrong_drive_is_noted(fit, heated, stated, noise):
    assert said(fit(trace(heated, stated, noise))) == 1
    assert said(fit(trace(heated, heated, noise))) == 0


@pytest.mark.parametrize("wave", [SQUARE, PULSE])
@pytest.mark.parametrize(("noise", "together"), [(0.05, 1), (0.05, 5), (0.2, 1)])
def test_noise_is_not_a_wrong_drive(wave, noise, together):
    # noise of 5 samples is what a scope of a fifth of the bandwidth shows; its limit is 3 standard deviations
    alarms = sum(said(surrogate.fit_newton(trace(wave, wave, noise, together=together, seed=s))) for s in range(20))
    assert alarms == 0


def test_a_wrong_power_changes_the_resistance_alone():
    fit = surrogate.fit_foster(trace(SQUARE, th.SquareWave(2e-3, 4e-6, 0.5)))
    assert said(fit) == 0
    assert fit.model.thermal_resistance == pytest.approx(POLES.thermal_resistance / 2, rel=0.05)


def test_the_command_says_it(tmp_path):
    data = trace(SQUARE, SQUARE)
    path = tmp_path / "scope.csv"
    np.savetxt(path, np.column_stack([data.time, data.delta_T]), delimiter=",", header="t (s),T (K)", comments="")

    def run(*more):
        command = ["fit", path, "--power", "1 mW", "--square", "4 us", *more, "-o", tmp_path / "m.json"]
        return CliRunner().invoke(app, [str(a) for a in command])

    (line,) = [line for line in run("--duty", "0.4").output.splitlines() if SAID in line]
    assert "check duty, period" in line
    assert SAID in json.loads(run("--duty", "0.4", "--json").stdout)["notes"][0]
    assert SAID not in run("--duty", "0.5").output
