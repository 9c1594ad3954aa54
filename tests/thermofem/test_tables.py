"""Tables of other people: COMSOL probe tables, oscilloscope traces, published measurements."""

from __future__ import annotations

import csv
import logging
from pathlib import Path

import hostile_tables
import numpy as np
import pytest
from commands import says_one_line
from paths import MEASURED

import surrogate
import thermofem as th
from thermofem.data import columns, header_units
from thermofem.data.tables import _edges, _with_jumps
from thermofem.waveforms import from_json

TIMES = np.linspace(0, 10e-6, 101)
MODEL = th.Foster(R=[2000.0, 5000.0], tau=[50e-9, 1e-6])
WAVE = th.Pulse(2e-3, 5e-6)
RISE = MODEL.response(WAVE, TIMES)

COMSOL = """% Model:              ring.mph
% Version:            COMSOL 5.6.0.341
% Date:               Nov 20 2020, 10:11
% Table:              Table 1 - Domain Probe 1
% Time (s)                Temperature (K), Domain Probe 1  Absorbed power (mW), Global Variable Probe 1
"""


def write(path: Path, head: str, columns: list[np.ndarray], divider: str = ",") -> Path:
    rows = zip(*columns, strict=True)
    path.write_text(head + "\n".join(divider.join(f"{float(x)!r}" for x in row) for row in rows) + "\n")
    return path


def test_comsol_probe_table_trains_like_our_own(tmp_path):
    path = write(tmp_path / "probe.txt", COMSOL, [TIMES, 293.15 + RISE, 1e3 * WAVE(TIMES)], " " * 8)
    data = th.read_csv(path, time="Time", temperature="Temperature", power="Absorbed power", ambient="20 degC")
    # 293.15 + 15 K is written with all digits of a float: eps * 300 K is left after the subtraction
    np.testing.assert_allclose(data.delta_T, RISE, rtol=0, atol=1e-13 * 300)
    np.testing.assert_allclose(data.power, WAVE(TIMES), rtol=1e-15)
    assert data.delta_T.attrs["units"] == "K"
    assert data.attrs["source"] == "probe.txt"
    known = th.read_csv(path, time="Time", temperature="Temperature", power=WAVE, ambient=293.15)
    fit = surrogate.fit_second_order(known)
    # data of a two-pole network: the fit finds it again, to the fits' own stopping tolerance
    assert fit.model.thermal_resistance == pytest.approx(7000, rel=1e-4, abs=0)
    again = th.load(th.save(data, tmp_path / "probe.nc"))
    assert again.identical(data)


@pytest.mark.parametrize(
    ("head", "divider"),
    [
        ("Model,DSO1012\nRecord length,101\n\nX,CH1\n(us),(mV)\n", ","),
        ("X,CH1\nmicrosecond,Volt\n", ","),
        ("X [us];CH1 [mV]\n", ";"),
        ("X (us)\tCH1 (mV)\n", "\t"),
    ],
)
def test_oscilloscope_trace(head, divider, tmp_path):
    """Trigger at 2 us on the scope's clock, 10 mV a kelvin: same rise, time from the trigger on."""
    before = np.linspace(-1e-6, -0.1e-6, 10)
    clock = np.append(before, TIMES) + 2e-6
    volts = np.append(np.zeros(10), RISE * 10e-3)
    path = write(tmp_path / "scope.csv", head, [clock * 1e6, volts * 1e3], divider)
    units = {"temperature": "0.1 K"}  # of one millivolt
    data = th.read_csv(path, time="X", temperature="CH1", power=WAVE, units=units, start="2 us")
    # 1e-6 * eps-sized rounding of microseconds; RISE moves by less than R/tau P = 180 MK/s times that
    np.testing.assert_allclose(data.time, TIMES, rtol=0, atol=1e-20 + 4e-15 * 12e-6)
    np.testing.assert_allclose(data.delta_T, RISE, rtol=1e-12)
    assert data.attrs["waveform"] == th.waveforms.to_json(WAVE)


def test_a_table_without_header_and_with_decimal_commas(tmp_path):
    path = tmp_path / "bare.csv"
    path.write_text("0;0,0\n1;1,5\n2;2,25\n")
    data = th.read_csv(path, time="1", temperature="2", power=1e-3, units={"time": "ns", "temperature": "K"})
    assert data.delta_T.values.tolist() == [0, 1.5, 2.25]
    assert data.time.values.tolist() == [0, 1e-9, 2e-9]
    assert data.power.values.tolist() == [1e-3] * 3


GOOD = "Time (us),T (K),P (mW)\n0,0,1\n1,1,1\n2,2,1\n"


ROWS = [(f"{k / 5:.1f}", f"{1e3 * k + 1.5:.1f}") for k in range(40)]


def test_units_of_a_header_that_is_divided_in_another_way_count():
    """`np.savetxt` writes a header with commas above rows with spaces; its temperatures in degF were taken for K."""
    for what, text in hostile_tables.headers(ROWS):
        found = says_one_line(lambda text=text: columns.parse(text))
        if "mean" in what:  # no unit is taken, and `calibrate` refuses the name
            assert found is not None
            assert (found.units, header_units.hidden_unit(found.names[1])) == (("us", ""), "mK")
            continue
        assert ("run" in what) if found is None else (found.units == ("us", "mK")), what
        assert found is None or found.values.shape == (40, 2)


def test_units_are_taken_or_the_table_is_refused():
    """Bare units below what instruments write, or with another comment mark, were passed by: mK counted as K."""
    read = set()
    for what, text in hostile_tables.odd_headers(ROWS):
        found = says_one_line(lambda text=text: columns.parse(text))
        assert found is None or found.units[:2] == ("us", "mK"), what
        read |= {what} if found else set()
    assert all(f"'' {head!r} '' above ','" in read for head in ("{0}time,T\n{0}us,mK", "{0}time (us);T (mK)"))


@pytest.mark.parametrize(
    ("head", "end", "units"),
    [
        ("Trigger delay (us),0", "", ("", "")),  # a setting: the times counted as us
        ("Time offset [us],0\nt;T", "", ("", "")),
        ("Time,T\nms,mK", ",", ("ms", "mK")),  # rows with an empty column at their end: the units were dropped
        ("Time_ms,T_mK", ",", ("ms", "mK")),
        ("Index,T\n,mK", "", ("", "mK")),  # a column without unit above a row of units
        ("Time / s,Sensitivity V/K", "", ("s", "")),  # a unit of two, which counted as K
        ("time, type K", "", ("", "")),
    ],
)
def test_settings_are_no_names_and_empty_columns_need_none(head, end, units):
    rows = "\n".join(",".join(row) + end for row in ROWS)
    assert columns.parse(f"{head}\n{rows}\n").units == units


def test_a_separator_that_changes_is_a_damaged_row():
    """The first 100 rows of 201 counted as text before the table: a thermal resistance of 549 instead of 15029."""
    for what, text in hostile_tables.mixed(ROWS):
        found = says_one_line(lambda text=text: columns.parse(text))
        assert found is None or len(found.values) == 40, what  # spaces and tabs are both white space


def test_remarks_with_another_unit_or_separator_change_nothing():
    rows = "\n".join("   ".join(row) for row in ROWS)
    remarks = "% Model: ring, second\n% Ambient (K): 293\n% Power (mW): 2\n% Date: Nov 20 2020, 10:11\n"
    assert columns.parse(f"{remarks}% Time (us)   T (mK)\n{rows}").units == ("us", "mK")
    assert columns.parse(f"{remarks}{rows}").units == ("", "")


def test_degrees_celsius_have_an_offset(tmp_path):
    (tmp_path / "table.csv").write_text("Time (us),T (degC)\n0,20\n1,21.5\n2,22\n")
    for ambient in ("20 degC", "293.15 K"):
        data = th.read_csv(tmp_path / "table.csv", time="Time", temperature="T", power=1e-3, ambient=ambient)
        np.testing.assert_allclose(data.delta_T, [0, 1.5, 2], rtol=0, atol=1e-13 * 300)  # eps * 300 K
    with pytest.raises(th.InputError, match=r"begins at 293.15 K"):
        th.read_csv(tmp_path / "table.csv", time="Time", temperature="T", power=1e-3)


@pytest.mark.parametrize(
    ("text", "change", "words"),
    [
        (GOOD, {"temperature": "Temp"}, "temperature: column = 'Temp' is unknown"),
        (GOOD, {"time": "Tme"}, "did you mean 'Time'"),
        (GOOD, {"power": "Power"}, "power: column = 'Power' is unknown"),
        (GOOD.replace("(us)", ""), {}, "column 'Time' states no unit"),
        (GOOD.replace("(K)", "(V)"), {}, "wrong dimension; a temperature is needed"),
        (GOOD, {"units": {"time": "parsec"}}, "wrong dimension; a time is needed"),
        (GOOD, {"units": {"temperature": "parsnip"}}, "'parsnip' is unknown"),
        (GOOD, {"units": {"T": "K"}}, "units: key = 'T' is unknown"),
        (GOOD.replace("(mW)", "(dBm)"), {}, "no straight scale"),
        (GOOD.replace("1,1,1", "1,nan,1"), {}, "line 3: 'T' is empty or not finite"),
        (GOOD.replace("1,1,1", "1,,1"), {}, "line 3"),
        (GOOD.replace("2,2,1", "0.5,2,1"), {}, "line 4: time 5e-07 s is before 1e-06 s of line 3"),
        (GOOD.replace("1,1,1", "1,1"), {}, "line 3 = '1,1' is no row of 3 numbers"),
        (GOOD + "broken off", {}, "line 5 = 'broken off'"),
        (GOOD.replace("0,0,1", "0,293.15,1"), {}, "a temperature and no rise"),
        (GOOD.replace("0,0,1", "0,293.15,1"), {"ambient": 20}, "begins at 273.15 K above ambient = 20"),
        (GOOD, {"ambient": "293.15 K"}, "begins at -293.15 K above ambient"),
        (GOOD, {"units": {"time": "."}}, "'.' is not a unit"),
        (GOOD, {"units": {"time": "1e999 s"}}, "factor of the unit '1e999 s' = inf is not finite"),
        (GOOD, {"units": {"time": "0 s"}}, "factor of the unit '0 s' = 0 must be positive"),
        (GOOD, {"units": {"time": "1.2.3 s"}}, "time: unit of 'Time"),
        (GOOD, {"start": "5 us"}, "leaves 0 rows"),
        (GOOD, {"start": "5"}, "start = '5' has no unit"),
        (GOOD.replace("1,1,1", "1,1,-1"), {}, "negative"),
        ("a,b\nc,d\n", {}, "no line of at least two numbers"),
        ("T (K),Time (us),T (K) 2\n1,2,3\n2,3,4", {"power": 1.0}, "names 2 columns"),
    ],
)
def test_what_cannot_be_read_says_why(text, change, words, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(text)
    arguments = {"time": "Time", "temperature": "T", "power": "P", **change}
    with pytest.raises(th.InputError) as error:
        th.read_csv(path, **arguments)
    assert words in str(error.value)
    assert str(error.value).startswith(f"{path}: ") or words.startswith("units")
    assert "\n" not in str(error.value)


def test_missing_file(tmp_path):
    with pytest.raises(th.InputError, match="does not exist"):
        th.read_csv(tmp_path / "none.csv", time="t", temperature="T", power=1e-3)


@pytest.mark.parametrize("name", ["led_t3ster", "led_t3ster_2", "mosfet_dry", "mosfet_tim"])
def test_published_measurements(name):
    """Cooling curves of packaged devices, averaged in 20 bins a decade, already turned into rises from 0."""
    path = MEASURED / "thermal_steps" / f"{name}.csv"
    if not path.is_file():
        pytest.skip(f"the measured traces are not here: {path}")
    rise = "zth_K_per_W" if name.startswith("led") else "temperature_drop_K"
    data = th.read_csv(path, time="time_s", temperature=rise, power=1.0, units={"time": "s", "temperature": "K"})
    with path.open() as opened:
        rows = list(csv.DictReader(opened))
    assert data.delta_T.values.tolist() == [float(row[rise]) for row in rows]
    assert data.time.values.tolist() == [float(row["time_s"]) for row in rows]
    # the best second-order network of each trace misses 2.46 to 2.73 % rms of the last value (another code's fits),
    # so its R_th cannot be further off than a few of these
    fit = surrogate.fit_second_order(data)
    assert fit.model.thermal_resistance == pytest.approx(data.delta_T.values[-1], rel=0.1, abs=0)


# --- edges of a sampled power -----------------------------------------------------------------------------------------


def scope(path, on, off):
    """Second-order response to 2 mW from ``on`` to ``off``, sampled every 40 ns from 0 on."""
    model = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
    t = np.arange(200) * 40e-9
    rise = 2e-3 * (model.step_response(np.maximum(t - on, 0)) - model.step_response(np.maximum(t - off, 0)))
    power = np.where((t > on - 1e-12) & (t < off - 1e-12), 2e-3, 0.0)
    return write(path, "t (s),P (W),T (K)\n", [t, power, rise])


@pytest.mark.parametrize(("edges", "phase"), [("row", 0.0), ("middle", 20e-9)])
def test_an_edge_between_two_rows_is_a_jump_where_asked(edges, phase, tmp_path, caplog):
    on, off = 0.52e-6 - phase, 3.04e-6 - phase
    path = scope(tmp_path / "scope.csv", on, off)
    with caplog.at_level(logging.WARNING, "thermofem"):
        ramps = th.read_csv(path, time="t", power="P", temperature="T")
    assert "scope.csv: the power changes by more than half its range between rows, 2 times" in caplog.text
    caplog.clear()
    jumps = th.read_csv(path, time="t", power="P", temperature="T", edges=edges)
    assert not caplog.records
    wave = from_json(jumps.attrs["waveform"])
    times = np.asarray(wave.times)
    assert times[:-1][np.diff(times) == 0] == pytest.approx([on, off], rel=1e-9, abs=0)
    np.testing.assert_array_equal(jumps.delta_T, ramps.delta_T)
    # with the true edges the fit has the true model; with ramps of 40 ns it has not
    found = [surrogate.fit_second_order(data).parameters["kappa"] for data in (ramps, jumps)]
    assert found[1] == pytest.approx(8.87e5, rel=1e-4)
    assert abs(found[0] / 8.87e5 - 1) > 0.01


def test_an_edge_over_three_rows_keeps_its_energy_and_noise_is_no_edge():
    t = np.arange(10.0)
    power = np.array([0, 0.02, 0, 0.3, 1, 0.99, 1, 0.01, 0, 0])
    at, found = _with_jumps(t, power, _edges(t, power), "middle")
    assert np.flatnonzero(np.diff(at) == 0).size == 2
    assert np.trapezoid(found, at) == pytest.approx(np.trapezoid(power, t), rel=1e-12)
    assert not _edges(t, np.linspace(0, 1, 10))  # a slow ramp is none


def test_another_word_for_edges_is_refused(tmp_path):
    path = scope(tmp_path / "scope.csv", 0.5e-6, 3e-6)
    with pytest.raises(th.InputError, match=r"edges = 'rows'.*did you mean 'row'"):
        th.read_csv(path, time="t", power="P", temperature="T", edges="rows")


def german(text: str) -> str:
    return text.translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize("divider", [";", "\t", ","])
@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize(
    ("time", "rise"),
    [
        (lambda x: f"{x:,.0f}", lambda x: f"{x:.4f}"),
        (lambda x: f"{x:,.0f}", lambda x: f"{x:.0f}"),
        (lambda x: f"{x:,.0f}", lambda x: f"{x:,.0f}"),
        (lambda x: f"{x:,.2f}", lambda x: f"{x:.2f}"),
        (lambda x: german(f"{x:,.0f}"), lambda x: german(f"{x:.4f}")),
        (lambda x: german(f"{x:,.2f}"), lambda x: german(f"{x:,.2f}")),
        (lambda x: german(f"{x:.3f}"), lambda x: german(f"{x:.2f}")),
        (lambda x: f"{x:.0f}", lambda x: f"{x:.0f}"),
    ],
)
def test_thousands_are_never_read_as_decimals(divider, quote, time, rise, tmp_path):
    """1,234 ns was read as 1.234 ns in a table with semicolons: time constants 1000 times too short, without a word."""
    times, rises = np.arange(1000.0, 9000.0, 20.0), np.arange(1000.0, 7800.0, 17.0)
    rows = [divider.join(f"{quote}{x}{quote}" for x in (time(t), rise(r))) for t, r in zip(times, rises, strict=True)]
    path = tmp_path / "table.csv"
    path.write_text(divider.join(["Time (ns)", "T (mK)"]) + "\n" + "\n".join(rows) + "\n")
    try:
        data = th.read_csv(path, time="Time", temperature="T", power=1e-3)
    except th.InputError:
        readable = time(1000.0) == rise(1000.0) == "1000"
        assert not readable
        return
    np.testing.assert_allclose(data.time, 1e-9 * times, rtol=1e-12)
    np.testing.assert_allclose(data.delta_T, 1e-3 * rises, rtol=1e-12)


@pytest.mark.parametrize(
    "header",
    [
        "Time (us),T (K)\nns,mK",
        "Time (us),T (K)\n(ms),(K)",
        "Time (ms),T (mK)\nTime (us),T (K)",
        "Time (us) [ns],T (K)",
    ],
)
def test_two_units_for_one_column_are_refused(header, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n0,0\n1,1\n2,1.5\n")
    with pytest.raises(th.InputError, match=r"line \d gives 'Time' in .s, the header in us"):
        th.read_csv(path, time="Time", temperature="T", power=1e-3)


@pytest.mark.parametrize("header", ["Time (us),T (K)\nus,K", "Time (us),T (K)\nmicrosecond,K", "Time,T\n(us),K"])
def test_one_unit_said_twice_is_read(header, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n0,0\n1,1\n2,1.5\n")
    assert th.read_csv(path, time="Time", temperature="T", power=1e-3).time.values.tolist() == [0, 1e-6, 2e-6]


@pytest.mark.parametrize("text", ["NAN NAN\n", "nan,nan\nnan,nan\n", "--,--\n"])
def test_a_table_of_no_numbers_is_refused(text):
    """`nan` is a number to Python: a table of nothing else had no last column."""
    with pytest.raises(th.InputError, match="no line of at least two numbers"):
        columns.parse(text)


def test_a_clipped_trace_is_named_on_every_way_into_a_fit(tmp_path, caplog):
    """Only `thermofem fit` said so: `th.read_csv` and a fit gave 4.0 for 7 K/mW without a word."""
    t = np.linspace(0, 20e-6, 2001)
    rise = MODEL.response(th.Constant(2e-3), t)
    path = write(tmp_path / "scope.csv", "t (s),T (K)\n", [t, np.minimum(rise, 8.0)])
    data = th.read_csv(path, time="t", power=2e-3, temperature="T")
    for fit in (surrogate.fit_foster(data, order=2), surrogate.fit_spectrum(data)):
        assert any("rows hold the largest value, 8 K: the trace looks clipped" in line for line in fit.notes)
    geometry = th.strip_ring()
    surrogate.calibrate(geometry, data, {"layer.box.thickness": (1e-6, 3e-6)}, tolerance=0.02)
    assert "the trace looks clipped" in caplog.text


@pytest.mark.parametrize(
    "wave",
    [
        th.Constant(2e-3),
        th.Pulse(2e-3, 5e-6),
        th.SquareWave(2e-3, 10e-6, 0.5),
        th.SquareWave(2e-3, 0.5e-6, 0.5),
        th.Sampled([0.0, 20e-6, 40e-6], [0.0, 2e-3, 2e-3]),  # a plateau that the power makes
    ],
)
@pytest.mark.parametrize("decays", [MODEL, th.Foster(R=[2000.0], tau=[1e-9])])
def test_what_settles_is_not_called_clipped(wave, decays):
    """A solution without noise holds its last value for many rows; round-off and edges of the power are no noise."""
    from thermofem.data.dataset import response_of

    for t in (np.linspace(0, 40e-6, 1601), np.geomspace(1e-9, 40e-6, 400)):
        y = decays.response(wave, t)
        for step in (1e-12, np.ptp(y) / 4096):
            data = th.dataset.build(t, np.round(y / step) * step, wave)
            assert not any("clipped" in doubt for doubt in response_of(data).doubts)
