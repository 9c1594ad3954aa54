"""`fit` on measured tables, `show`, and what every command shares; each run in this process."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from surrogate.plot import plot_fit
from thermofem import read_trace
from thermofem.data.data_doubts import clipping
from thermofem_cli import app

MODEL = th.Foster(R=[2e3, 5e3], tau=[80e-9, 1.2e-6])
WAVE = th.Pulse(1.3e-3, 4e-6)
NOISE = 0.02  # K, of a swing of 8 K


def trace(path, head, *, start, offset, samples=1501, factors=(1e6, 1.0), noise=NOISE, first=0.0):
    t = np.linspace(first, 12e-6, samples)
    rise = np.where(t >= start, MODEL.response(WAVE, np.maximum(t - start, 0)), 0.0)
    y = offset + rise + noise * np.random.default_rng(1).standard_normal(samples)
    rows = "".join(f"{a * factors[0]!r},{b * factors[1]!r}\n" for a, b in zip(t.tolist(), y.tolist(), strict=True))
    path.write_text(head + rows)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("head", "settings"),
    [
        ("Time (us),T (K)\n", {"start": 0.0, "offset": 0.0}),
        ("Time (us),T (degC)\n", {"start": 1.503e-6, "offset": 25.0}),
        ("Model,DSO1012\nTime (us),CH1 (Volt)\n", {"start": 1.0e-6, "offset": 0.5}),
        ("t,dT\n", {"start": 2.37e-6, "offset": -3.0, "factors": (1.0, 1.0)}),
        ("Time (us),CH1 (mV)\n", {"start": 0.0, "offset": 0.1, "factors": (1e6, 1e3), "first": -1e-6}),
    ],
)
def test_offset_and_start_are_found(head, settings, tmp_path):
    path = trace(tmp_path / "scope.csv", head, **settings)
    found = read_trace(path, WAVE)
    # the rows are 8 ns apart, and the front rises R_1 / tau_1 P = .26 K in that time, 13 times the noise
    assert found.attrs["start"] == pytest.approx(settings["start"], abs=8e-9)
    kelvin = 273.15 if "degC" in head else 0.0
    # the mean of at least 90 rows errs by the noise over 9; without rows before, 4 times the noise counts as none
    assert found.attrs["baseline"] == pytest.approx(settings["offset"] + kelvin, abs=4 * NOISE)
    fit = surrogate.fit_foster(found, order=2)
    # 8 ns of the start move tau_1 by at most 8 ns of 80; R_1 with it
    np.testing.assert_allclose(fit.model.tau, MODEL.tau, rtol=0.1)
    assert fit.model.thermal_resistance == pytest.approx(7e3, rel=0.01)
    assert ("warning" in found.attrs["assumed"]) == ("V" in head)


SLOW = {"R_1": 6e3, "R_2": 4e3, "tau_1": 0.8e-6, "tau_2": 5e-6}
FAST = {"R_1": 2e3, "R_2": 5e3, "tau_1": 80e-9, "tau_2": 1.2e-6}


@pytest.mark.parametrize(
    ("truth", "t", "start", "cold", "power", "noise"),
    [
        # a start a third of a row late is a bias of tau_1 of 4.3 standard errors where it counts as known
        (SLOW, np.linspace(-2e-6, 40e-6, 631), 0.5e-6, 300.0, 2e-3, 0.05),
        # one or two rows at rest: as known, the start puts a third of the fits off by 4 standard errors
        (FAST, (np.arange(600) - 0.55) * 20e-9, 0.0, 0.0, 1e-3, 1e-3),
        (FAST, (np.arange(600) - 1.55) * 20e-9, 0.0, 0.0, 1e-3, 1e-3),
    ],
)
def test_standard_errors_cover_a_start_and_a_baseline_that_were_found(truth, t, start, cold, power, noise, tmp_path):
    seen = th.Foster(R=[truth["R_1"], truth["R_2"]], tau=[truth["tau_1"], truth["tau_2"]])
    exact = cold + np.where(t >= start, seen.response(th.Constant(power), np.maximum(t - start, 0)), 0.0)
    pulls, path = [], tmp_path / "scope.csv"
    for number in range(40):
        y = exact + noise * np.random.default_rng(number).standard_normal(t.size)
        rows = zip(t.tolist(), y.tolist(), strict=True)
        path.write_text("t (s),T (K)\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
        fit = surrogate.fit_foster(read_trace(path, th.Constant(power)), order=2)
        pull = [(fit.parameters[name] - truth[name]) / fit.standard_errors[name] for name in truth]
        resistance_error = fit.model.thermal_resistance - truth["R_1"] - truth["R_2"]
        pulls.append([*pull, resistance_error / fit.thermal_resistance_deviation])
        assert cold == 0 or "fitted with the poles" in fit.notes[0]
    # of 40 standard normal numbers the mean is 0 +- .16 and the rms 1 +- .11: four of each
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0, atol=0.64)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(pulls), axis=0)), 1, atol=0.44)


def test_a_start_found_behind_a_slow_rise_is_doubted(tmp_path):
    """A core under its heater: -170, 850, 1020 K/W at .5, 3, 15 us from 1 us on; the front rises some .4 us later."""
    t = np.arange(-10e-6, 60e-6, 40e-9)
    heater = th.Foster(R=[-170.0, 850.0, 1020.0], tau=[0.5e-6, 3e-6, 15e-6])
    noise = 0.01 * np.random.default_rng(7).standard_normal(t.size)
    y = heater.response(th.Constant(5e-3), np.maximum(t - 1e-6, 0)) + noise
    path = tmp_path / "heater.csv"
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t (s),T (K)", comments="")
    doubt = "depart from rest by .* give --heated, --read and --start"
    assert re.search(doubt, read_trace(path, 5e-3).attrs["assumed"])
    assert "depart" not in read_trace(path, 5e-3, start=1e-6).attrs["assumed"]


@pytest.mark.parametrize("seed", range(10))
def test_a_start_found_at_a_front_is_not_doubted(seed, tmp_path):
    """Noise behind a filter of some rows, as of an oscilloscope's bandwidth, before a rise that begins at once."""
    t = np.arange(-4e-6, 8e-6, 10e-9)
    white = np.random.default_rng(seed).standard_normal(t.size + 3)
    noise = 0.03 * np.convolve(white, np.full(4, 0.5), "valid")
    y = MODEL.response(th.Constant(1e-3), np.maximum(t - 0.43e-6, 0)) + noise
    path = tmp_path / "front.csv"
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t (s),T (K)", comments="")
    assert "depart" not in read_trace(path, 1e-3).attrs["assumed"]


def test_a_given_start_and_baseline_are_taken_as_known(tmp_path):
    path = trace(tmp_path / "scope.csv", "t (s),T (K)\n", start=2e-6, offset=3.0, factors=(1.0, 1.0))
    known = read_trace(path, WAVE, start=2e-6, baseline=3.0)
    assert not {"start_within", "rest_rows"} & set(known.attrs)
    found = read_trace(path, WAVE)
    assert found.attrs["rest_rows"] == pytest.approx(249, abs=3)  # 2 us of rows 8 ns apart
    exact, fitted = (surrogate.fit_foster(data, order=2) for data in (known, found))
    assert fitted.standard_errors["tau_1"] > exact.standard_errors["tau_1"]


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.02])
@pytest.mark.parametrize("bits", [0, 8, 12])
def test_a_clipped_trace_is_named_and_a_settled_one_is_not(noise, bits):
    """An instrument that ends at 60 % of the rise would give half the thermal resistance."""
    t = np.linspace(-2e-6, 40e-6, 1501)
    rise = np.where(t >= 0, 1 - 0.6 * np.exp(-t / 0.8e-6) - 0.4 * np.exp(-t / 5e-6), 0.0)
    y = rise + noise * np.random.default_rng(3).standard_normal(t.size)
    for values, clipped in ((y, False), (-y, False), (np.minimum(y, 0.6), True), (np.maximum(-y, -0.6), True)):
        step = 1.3 / 2**bits
        assert bool(clipping(np.round(values / step) * step if bits else values)) == clipped


def test_a_settled_square_wave_is_named_and_fitted_from_an_earlier_start(tmp_path):
    wave = th.SquareWave(1.3e-3, 2e-6, 0.5)
    t = np.arange(39e-6, 43e-6, 1e-8)
    y = 296.1 + MODEL.response(wave, t)
    path = tmp_path / "settled.csv"
    np.savetxt(path, np.column_stack([(t - 39e-6) * 1e6, y]), delimiter=",", header="t (us),T (K)", comments="")
    assert "depart from rest" in read_trace(path, wave).attrs["assumed"]
    found = read_trace(path, wave, start=-19e-6, baseline=296.1)  # 10 periods: exp(-20 / 1.2) of the rise is missing
    assert "warning" not in found.attrs["assumed"]
    fit = surrogate.fit_foster(found, order=2)
    np.testing.assert_allclose(fit.model.tau, MODEL.tau, rtol=1e-4)


def test_a_model_of_volts_says_so_wherever_it_is_used(tmp_path):
    path = trace(tmp_path / "scope.csv", "Time (us),CH1 (mV)\n", start=1e-6, offset=0.0, factors=(1e6, 1e3))
    rows = path.read_text().replace(",", ";").replace(".", ",") + ";;\n\n"  # as a spreadsheet in German writes it
    path.write_text(rows)
    model = tmp_path / "m.json"
    said = run("fit", path, "--pulse", "4 us", "--power", "1.3 mW", "-o", model)
    assert said.exit_code == 0, said.output
    card = run("show", model).output
    assert "V/mW" in card
    assert "K/mW" not in card
    used = run("simulate", model, "--duration", "1 us", "-o", tmp_path / "t.nc")
    assert "trained on data in which 1 V counts as 1 K" in used.output
    comma = run("fit", path, "--pulse", "4 us", "--power", "1,3 mW")
    assert "has a comma in its number; decimals follow a point" in str(comma.exception)


def test_fit_a_table_and_show_its_model(tmp_path):
    path = trace(tmp_path / "data.csv", "Time (us),T (K)\n", start=1e-6, offset=0.5)
    model = tmp_path / "m.json"
    drive = ["--pulse", "4 us", "--power", "1.3 mW"]
    done = run("fit", path, *drive, "--kind", "foster", "--order", "2", "-o", model, "--json")
    assert done.exit_code == 0, done.output
    numbers = json.loads(done.stdout)
    assert numbers["thermal_resistance"] == pytest.approx(7e3, rel=0.01)
    assert abs(numbers["thermal_resistance"] - 7e3) < 4 * numbers["thermal_resistance_deviation"] < 100
    assert "baseline" in done.stderr
    card = json.loads(run("show", model, "--json").stdout)
    assert [pole["tau"] for pole in card["poles"]] == surrogate.load_model(model).tau.tolist()
    assert card["training"] == ["pulse 1.3 mW, 4 us, from rest"]
    assert any("baseline" in line for line in card["assumed"])
    named = ["--time", "Time (us)", "--temperature", "T", "--figure", tmp_path / "fit.png"]
    assert run("fit", path, *drive, *named, "--kind", "spectrum", "-o", model).exit_code == 0
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")
    assert surrogate.load_model(model).passive


@pytest.mark.parametrize(
    ("heated", "read", "proven"),
    [(["core"], ["core"], True), (["core", "heater"], ["core"], False), (["heater"], ["core"], False)],
)
def test_a_bound_is_called_proven_for_one_port_alone(heated, read, proven, tmp_path):
    """Between its samples the bound of several ports has a margin without a proof (docs/models.md)."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    rom = surrogate.reduce(heat.channels(heated, read), 1e-2)
    one = rom.model if len(heated) == 1 else rom.model.channel("core", "core")  # of several ports
    for model, provenance in ((rom, None), (one, rom.provenance)):
        surrogate.save_model(model, tmp_path / "m.json", provenance=provenance)
        said = json.loads(run("show", tmp_path / "m.json", "--json").stdout)["trusted"]
        assert ("(proven; against its FEM)" in said) == proven
        assert ("sampled frequencies" in said) != proven


def test_a_record_that_begins_after_the_heating(tmp_path):
    t = np.geomspace(50e-9, 50e-6, 80)  # an instrument that leaves out the switching
    rows = "".join(f"{a},{b}\n" for a, b in zip(t, MODEL.response(th.Constant(1e-3), t), strict=True))
    (tmp_path / "late.csv").write_text("time (s),rise (K)\n" + rows)
    arguments = ["fit", tmp_path / "late.csv", "--power", "1 mW", "--kind", "foster", "--order", "2"]
    done = run(*arguments, "--start", "0 s", "--baseline", "0 K", "-o", tmp_path / "m.json")
    assert done.exit_code == 0, done.output
    assert "50 ns before the first row" in done.output
    np.testing.assert_allclose(surrogate.load_model(tmp_path / "m.json").R, MODEL.R, rtol=1e-6)  # no noise


def test_a_figure_of_volts_has_volts_on_its_axes(tmp_path):
    path = trace(tmp_path / "scope.csv", "Time (us),CH1 (V)\n", start=1e-6, offset=0.5)
    for sensitivity, label in ((None, "rise of the voltage (V)"), (1.0, "temperature rise (K)")):
        data = read_trace(path, WAVE, sensitivity=sensitivity)
        upper, lower = plot_fit(surrogate.fit_newton(data), data)
        assert upper.get_ylabel() == label
        assert lower.get_ylabel() == f"residual {label[-3:]}"
        assert f"{label[-2]} rms" in upper.get_title(loc="left")
        assert "4 µs" in upper.get_title(loc="left")


@pytest.mark.parametrize("name", ["out[red]1.json", "[bold]x.json", "a[/b].json"])
def test_a_path_is_no_markup(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a[").mkdir()
    surrogate.save_model(MODEL, tmp_path / "m.json")
    target = tmp_path / name.replace(".json", ".cir")
    target.parent.mkdir(exist_ok=True)
    done = run("export", "m.json", "--to", "spice", "-o", target)
    assert done.exit_code == 0, done.output
    assert target.exists()
    assert str(target) in done.output
    quiet = run("export", "m.json", "--to", "spice", "-o", target, "-q")
    assert quiet.output == ""
