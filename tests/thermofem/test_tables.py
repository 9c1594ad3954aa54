"""Tables of other people: COMSOL probe tables, oscilloscope traces, published measurements; rows made by a formula."""

from __future__ import annotations

import hostile_tables
import numpy as np
import pytest

import surrogate
import thermofem as th
from thermofem.data.column_units import LENGTH, POWER, RATIO, TEMPERATURE, TIME, VOLTAGE, scale_of
from thermofem.data.number_table import number_table
from thermofem.data.quantity import LONGEST_UNIT

TIMES = np.linspace(0, 10e-6, 101)
MODEL = th.Foster(R=[2000.0, 5000.0], tau=[50e-9, 1e-6])
WAVE = th.Pulse(2e-3, 5e-6)
RISE = MODEL.response(WAVE, TIMES)
ROWS = [(f"{k / 5:.1f}", f"{1e3 * k + 1.5:.1f}") for k in range(40)]

COMSOL = """% Model:              ring.mph
% Version:            COMSOL 5.6.0.341
% Date:               Nov 20 2020, 10:11
% Table:              Table 1 - Domain Probe 1
% Time (s)                Temperature (K), Domain Probe 1  Absorbed power (mW), Global Variable Probe 1
"""


def write(path, head, columns, divider=","):
    rows = zip(*columns, strict=True)
    path.write_text(head + "\n".join(divider.join(f"{float(x)!r}" for x in row) for row in rows) + "\n")
    return path


def test_comsol_probe_table_trains_like_our_own(tmp_path):
    path = write(tmp_path / "probe.txt", COMSOL, [TIMES, 293.15 + RISE, 1e3 * WAVE(TIMES)], " " * 8)
    data = th.read_trace(path, "Absorbed power", start=0.0, baseline="20 degC")
    # 293.15 + 15 K is written with all digits of a float: eps * 300 K is left after the subtraction
    np.testing.assert_allclose(data.delta_T, RISE, rtol=0, atol=1e-13 * 300)
    np.testing.assert_allclose(data.power, WAVE(TIMES), rtol=1e-15)
    known = th.read_trace(path, WAVE, temperature="Temperature", start=0.0, baseline=293.15)
    # data of a two-pole network: the fit finds it again, to the fits' own stopping tolerance
    fit = surrogate.fit_second_order(known)
    assert fit.model.thermal_resistance == pytest.approx(7000, rel=1e-4, abs=0)
    assert th.load(th.save(data, tmp_path / "probe.nc")).identical(data)


def test_oscilloscope_trace(tmp_path):
    """Trigger at 2 us on the scope's clock, 10 mV a kelvin: same rise, time from the trigger on."""
    before = np.linspace(-1e-6, -0.1e-6, 10)
    clock = np.append(before, TIMES) + 2e-6
    volts = np.append(np.zeros(10), RISE * 10e-3)
    path = write(tmp_path / "scope.csv", "X [us];CH1 [mV]\n", [clock * 1e6, volts * 1e3], ";")
    for options in ({"sensitivity": "10 mV/K"}, {"units": {"temperature": "0.1 K"}}):
        data = th.read_trace(path, WAVE, start="2 us", baseline=0.0, **options)
        # 1e-6 * eps-sized rounding of microseconds; RISE moves by less than R/tau P = 180 MK/s times that
        np.testing.assert_allclose(data.time, TIMES, rtol=0, atol=1e-20 + 4e-15 * 12e-6)
        np.testing.assert_allclose(data.delta_T, RISE, rtol=1e-12, atol=1e-15)


def scales(text, path):
    """Seconds and kelvin of one unit of the columns of `ROWS`, and how many rows were read."""
    path.write_text(text)
    data = th.read_trace(path, 1e-3, start=0.0, baseline=0.0)
    last = float(ROWS[-1][0]), float(ROWS[-1][1])
    return float(data.time[-1]) / last[0], float(data.delta_T[-1]) / last[1], data.sizes["time"]


@pytest.mark.parametrize("generator", [hostile_tables.headers, hostile_tables.odd_headers])
def test_units_are_taken_or_asked_for(generator, tmp_path):
    """A header that is not `name (unit)` for each column: millikelvin never count as kelvin."""
    read = 0
    for what, text in list(generator(ROWS))[::7]:
        try:
            found = scales(text, tmp_path / "t.csv")
        except th.InputError:
            continue
        assert found == pytest.approx((1e-6, 1e-3, 40), rel=1e-6, abs=0), what
        read += 1
    assert read > 6


def test_a_separator_that_changes_is_a_damaged_row(tmp_path):
    """Rows before the change are no text above the table."""
    for what, text in hostile_tables.mixed(ROWS):
        try:
            assert scales(text, tmp_path / "t.csv")[2] == 40, what  # spaces and tabs are both white space
        except th.InputError:
            continue


def test_names_that_leave_the_scale_open_are_asked_about(tmp_path):
    """Temperatures in mK, or in 1e-3 K, are no K."""
    for name, text in hostile_tables.scaled_names(ROWS):
        (tmp_path / "t.csv").write_text(text)
        with pytest.raises(th.InputError, match="column"):
            pytest.fail(f"{name}: {th.read_trace(tmp_path / 't.csv', 1e-3).attrs['assumed']}")
        data = th.read_trace(tmp_path / "t.csv", 1e-3, units="us,mK", start=0.0, baseline=0.0)
        assert float(data.delta_T[-1]) == pytest.approx(39.0015, rel=1e-12)


# --- the kinds of layout

CLOCK = np.round(-1e-6 + 1e-7 * np.arange(61), 12)
STEP = np.where(CLOCK > 0, 5.0 * (1 - np.exp(-np.clip(CLOCK, 0, None) / 1e-6)), 0.0)  # 5 K/mW, 1 us, 1 mW
SETTINGS = ["Record Length,61", "Sample Interval,1e-07", ",", "Source,CH1", "Model,X1", *[","] * 56]  # beside the rows


LAYOUTS = {
    "settings above": ("Averages,1\nCoupling,DC\nTrigger,A\nTime (s),T (K)\n", "{t},{y}\n", {}),
    "line of units": ("x-axis,1\nmicrosecond,mV\n", "{us},{y}\n", {"sensitivity": "1 mV/K"}),
    "names above units": (
        "Time,Channel A,Channel B\n(us),(mV),(V)\n\n",
        "{us},{y},0\n",
        {"time": "Time", "temperature": "Channel A", "sensitivity": "1 mV/K"},
    ),
    "marker line": ("Mode,Detail,\nWaveform Data,\n", "{t},{y},\n", {"units": "s,K"}),
    "units in settings": ("Horizontal Units,us\nVertical Units,K\nTIME,CH1\n", "{us},{y}\n", {}),
    "same name": ("Time (s),U (V),U (V)\n", "{t},9,{mv}\n", {"columns": "1,3", "sensitivity": "1 mV/K"}),
    "by number": ("a,b,c\n", "7,{us},{mv}\n", {"columns": (2, 3), "units": "us,V", "sensitivity": "1 mV/K"}),
    "degrees": ("Time(S),T (deg C)\n", "{t},{c}\n", {}),
    "impedance": ("Time [s],Zth [K/W]\n", "{t},{zth}\n", {}),
    "trailer": ("Index TIME T(K)\n", "{k} {t:.9e} {y:.9e}\n", {}),
    "unit given": ("Time (s),Shift\n", "{t},{pm}\n", {"units": "s,pm", "sensitivity": "0.075 nm/K"}),
    "frequency": ("t / us;f in GHz\n", "{us};{ghz}\n", {"units": "us,GHz", "sensitivity": "-10 GHz/K"}),
    "phase": ("Time (us)\tphase (rad)\n", "{us}\t{y}\n", {"sensitivity": "1000 mrad/K"}),
    "repeated": ("Time (s),T (K)\n", "{t},{y}\n{again}", {}),
    "Latin-1": ("Time (µs),T (°C)\n", "{us},{c}\n", {}),
    "settings beside": ("", "{set},,{t:.12f},{y:.9f},\n", {"units": "s,K"}),
    "one sign": ("Time (µs);T (℃)\n", "{us};{c}\n", {}),
    "unit in words": ("Time (microseconds),T (Kelvin)\n", "{us},{y}\n", {}),
    "counted samples": (
        "X,CH1,Start,Increment\nSequence,Volt,-1e-06,1e-07\n",
        "{k},{mv},\n",
        {"columns": "1,2", "units": "100 ns,V", "sensitivity": "1 mV/K"},
    ),
    "fortran": ("# t(s) T(K)\n", "{fortran}\n", {}),
    "unit behind the name": (
        "TIME,CH1,CH2\n",
        "{t},{mv},7\n",
        {"time": "TIME (s)", "temperature": "CH1 (V)", "sensitivity": "1 mV/K"},
    ),
    "words": ("time (us),at 1550 nm mean of 5 ms (K)\n", "{us},{y}\n", {}),
    "bare names": ("t,T\n", "{t},{y}\n", {}),
    "clock above": ("12:30:45 run 7\n", "{t},{y}\n", {"units": "s,K"}),
    "numbered names": ("0:time (s),1:T (K)\n", "{t},{y}\n", {}),
    "a name like a FORTRAN number": ("t1D2 (s),T2D1 (K)\n", "{t},{y}\n", {"time": "t1D2", "temperature": "T2D1"}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_instruments_and_simulators(layout, tmp_path):
    head, row, options = LAYOUTS[layout]
    text = head + "".join(
        row.format(
            k=k, t=float(t), y=float(y), us=float(t) * 1e6, ms=float(t) * 1e3, mv=float(y) * 1e-3, c=20 + float(y),
            zth=float(y) / 1e-3, pm=75 * float(y), ghz=-10 * float(y), again=f"{t},{y}\n" if k == 30 else "",
            set=SETTINGS[k], fortran=f"{t:.9E} {y:.9E}".replace("E", "D"),
        )
        for k, (t, y) in enumerate(zip(CLOCK, STEP, strict=True))
    )  # fmt: skip
    path = tmp_path / "table"
    encoding = "utf-8" if layout == "one sign" else "latin-1"
    path.write_bytes((text + ("End of Simulation\n" if layout == "trailer" else "")).encode(encoding))
    fit = surrogate.fit_newton(th.read_trace(path, 1e-3, **options))
    # 17 digits are written, and the start is a row: to the stopping tolerance of the fit
    assert fit.model.thermal_resistance == pytest.approx(5e3, rel=1e-5)
    assert fit.model.tau[0] == pytest.approx(1e-6, rel=1e-5)


@pytest.mark.parametrize(
    ("head", "row", "options", "words"),
    [
        ("Time (s),U (V),U (V)\n", "{t},{y},{y}\n", {"temperature": "U (V)"}, "names the columns 2,3.*--columns"),
        ("time,V(core)\n", "{t},{y}\n", {}, "V.core.*--units"),
        ("x-axis,1\nmA,mV\n", "{t},{y}\n", {}, "column 'mA' states no unit.*--units"),
        ("Time (s),T (K)\n", "{t},{y}\n", {"start": "gate"}, "--start = 'gate'.*header of a drive.*1 'Time"),
        ("Time,T (K)\n", "{k},{y}\n", {}, "span of column.*60.*--units"),
        ("Record of 10 us\nTime,T (K)\n", "{t},{y}\n", {}, "Record of 10 us.*--units"),
        ("Time (s),Shift (pm)\n", "{t},{y}\n", {}, 'sensitivity, such as "75 pm/K"'),
        ("Time (s),T (K)\n", "{t:.0e},{y}\n", {}, "rounded"),
        ("a,b,c\n", "{t},{y},1\n", {}, "3 columns of numbers.*--columns"),
        ("Time (s),T (K)\n", "{k},{k}" + 400 * "0" + "\n", {}, "beyond 1e308"),
        ("Time (s),T (K)\n", "{t},{y}\n", {"sensitivity": "1 mV/K"}, "sensitivity"),
        ("Time (s),U (V)\n", "{t},{fall}\n", {}, "--fall.*--sensitivity"),
        ("Time (ns);T (mK);note\n", "1,{k:03d};2,{k:03d};at 3, on\n", {}, "may divide thousands"),
        ("", "{t},{y}\n", {}, "column 1 states no unit.*--units"),
        ("T in unit K at a heater\ntime,T\n", "{t},{y}\n", {}, "column 'time' states no unit.*--units"),
        ("unit K as measured\ntime,T\n", "{t},{y}\n", {}, "column 'time' states no unit.*--units"),
        ("Time (s),T (K),gate\n", "{t},{y},1e{k}00\n", {"start": "gate"}, "'gate' has not two levels"),
        ("Time (s),T (K)\n", "{t},{y}\n{again}", {}, "more than once"),
        ("Time unit: us\nTime unit: ms\nTime,T\n", "{t},{y}\n", {}, "Time unit: us.*--units"),
    ],
)
def test_what_a_file_does_not_say_is_asked_for_in_one_line(head, row, options, words, tmp_path):
    rows = []
    for k, (t, y) in enumerate(zip(CLOCK, STEP, strict=True)):
        again = 2 * f"{t},{y}\n" if k == 30 else ""  # three rows at one time
        rows.append(row.format(k=k, t=t, y=y, fall=-y, again=again))
    (tmp_path / "t.csv").write_text(head + "".join(rows))
    with pytest.raises(th.InputError, match=words) as error:
        th.read_trace(tmp_path / "t.csv", 1e-3, **options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["wavelength", "lambda_nm"])
@pytest.mark.parametrize("unit", ["", " (nm)", " (GHz)", " (mA)", " (dBm)", " (dB)", " (mW)", " [%]"])
def test_what_is_no_time_and_no_temperature_is_asked_about(name, unit, tmp_path):
    """A sweep of light is no trace of a temperature."""
    rows = "".join(f"{t},{y}\n" for t, y in zip(CLOCK, STEP, strict=True))
    asked = 0
    for head in (f"{name}{unit},T (K)\n", f"Time (s),{name}{unit}\n", f"{name}{unit},{name}{unit}\n"):
        (tmp_path / "t.csv").write_text(head + rows)
        for options in ({}, {"columns": "1,2"}):
            with pytest.raises(th.InputError, match=r"column.*--(units|columns)"):
                th.read_trace(tmp_path / "t.csv", 1e-3, **options)
            asked += 1
    assert asked == 6
    named = {"time": name, "temperature": "T"}
    (tmp_path / "t.csv").write_text(f"{name}{unit},T (K)\n{rows}")
    with pytest.raises(th.InputError, match=r"column.*--units"):
        th.read_trace(tmp_path / "t.csv", 1e-3, **named)


@pytest.mark.parametrize("behind", [" and more", "V"])
def test_a_text_that_only_begins_with_a_unit_is_none(behind):
    unit = "1 mV".rjust(LONGEST_UNIT, "0")
    assert scale_of(unit) is not None
    assert scale_of(unit + behind) is None


@pytest.mark.parametrize(
    ("unit", "dimensions", "in_si"),
    [
        ("dBm", POWER, 1e-3 * 10**0.25),
        ("dB", RATIO, 10**0.25),
        ("nm", LENGTH, 2.5e-9),
        ("GHz", "1 / second", 2.5e9),
        ("°C", TEMPERATURE, 275.65),
        ("deg C", TEMPERATURE, 275.65),
        ("mA", "ampere", 2.5e-3),
        ("Volt", VOLTAGE, 2.5),
        ("Msec", TIME, 2.5e6),
        ("msec", TIME, 2.5e-3),
        ("Mvolt", VOLTAGE, 2.5e6),
    ],
)
def test_units_of_headers_become_si(unit, dimensions, in_si):
    """A capital letter is a prefix (M is 1e6, m is 1e-3) before it is a style."""
    table = number_table(f"x [{unit}];y\n2.5;1\n2.5;2\n2.5;3\n".encode())
    column = table.columns[0]
    assert column.name == "x"
    assert column.scale.dimensions == dimensions
    np.testing.assert_allclose(column.scale.in_si(column.values), in_si, rtol=1e-14)  # two roundings
    assert table.columns[1].scale is None


# --- where the power sets in

SLOW = th.Foster(R=[0.1, 0.3, 0.6], tau=[1e-4, 1e-2, 1.0])
LATE = np.logspace(-4, 1, 60)


@pytest.mark.parametrize("first", [[], [0.0]])
def test_a_record_without_rows_before_the_heating_begins_at_zero(first, tmp_path):
    """As in every table of a thermal impedance: the rise until the first row, 7 % here, is no baseline."""
    t = np.append(first, LATE)
    path = write(tmp_path / "zth.csv", "Time (s),T (K)\n", [t, SLOW.response(th.Constant(1.0), t)])
    fit = surrogate.fit_foster(th.read_trace(path, 1.0), order=3)
    np.testing.assert_allclose(fit.model.R, SLOW.R, rtol=1e-6)  # exact rows: the fit's stopping tolerance


@pytest.mark.parametrize("offset", [0.0, 25.0])
def test_standard_errors_cover_a_late_first_row(offset, tmp_path):
    """20 records of an oscilloscope, with and without an offset."""
    t, pulls = np.arange(1, 401) * 20e-9, []
    for seed in range(20):
        y = offset + MODEL.response(th.Constant(1e-3), t) + 0.02 * np.random.default_rng(seed).standard_normal(t.size)
        path = write(tmp_path / "t.csv", "t (s),T (degC)\n" if offset else "t (s),T (K)\n", [t, y])
        options = {"start": 0.0} if offset else {}
        fit = surrogate.fit_foster(th.read_trace(path, 1e-3, **options), order=2)
        error = np.hypot(fit.standard_errors["R_1"], fit.standard_errors["R_2"])
        pulls.append((fit.model.thermal_resistance - 7e3) / error)
        if offset:
            assert any("offset" in note for note in fit.notes)
    assert np.abs(pulls).max() < 4  # of 20 standard normal numbers, one in 800 such tests
    assert abs(np.mean(pulls)) < 4 / np.sqrt(20)


def test_noisy_log_spaced_rows_with_an_offset_are_right_or_ask_for_the_baseline(tmp_path):
    """Their clock counts from the edge, not from the first row, before which the first pole has done half its rise."""
    t = np.geomspace(50e-9, 10e-6, 60)
    pulls = []
    for seed in range(12):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(t.size)
        path = write(tmp_path / "t.csv", "t (s),T (K)\n", [t, 300 + MODEL.response(th.Constant(1e-3), t) + noise])
        try:
            fit = surrogate.fit_foster(th.read_trace(path, 1e-3), order=2)
        except th.InputError:  # which says to give --baseline
            continue
        pulls.append((fit.model.thermal_resistance - 7e3) / fit.thermal_resistance_deviation)
    assert len(pulls) > 5
    assert np.abs(pulls).max() < 4  # of 12 standard normal numbers, one in 1300 such tests


@pytest.mark.parametrize(("cold", "unit"), [(0.0, "K"), (300.0, "K"), (25.0, "degC")])
@pytest.mark.parametrize("before", [0, 100])
def test_a_fall_after_a_long_heating_is_the_rise_upside_down(cold, unit, before, tmp_path):
    t = (np.arange(600) - before) * 20e-9
    y = cold + 7.0 - np.where(t > 0, MODEL.response(th.Constant(1e-3), np.clip(t, 0, None)), 0.0)
    path = write(tmp_path / "fall.csv", f"Time (s),T ({unit})\n", [t, y])
    fit = surrogate.fit_foster(th.read_trace(path, 1e-3, fall=True), order=2)
    np.testing.assert_allclose(fit.model.R, MODEL.R, rtol=1e-4)
    with pytest.raises(th.InputError, match=r"the rows fall.*--fall"):
        th.read_trace(path, 1e-3)


def test_a_fall_after_a_heating_of_any_length(tmp_path):
    """T = sum R P (1 - exp(-L/tau)) exp(-t/tau) above an unknown ambient, 2 us after the power was on for 0.7 us."""
    t, length = np.arange(400) * 20e-9, 0.7e-6
    y = 300 + (
        np.array(MODEL.R) * 1e-3 * -np.expm1(-length / np.array(MODEL.tau)) * np.exp(-t[:, None] / MODEL.tau)
    ).sum(1)
    path = write(tmp_path / "fall.csv", "Time (s),T (K)\n", [t, y])
    fit = surrogate.fit_foster(th.read_trace(path, th.Pulse(1e-3, length), fall=True, start=0.0), order=2)
    np.testing.assert_allclose(fit.model.R, MODEL.R, rtol=1e-4)


def test_a_log_spaced_fall_as_of_a_transient_tester(tmp_path):
    """Rows from 100 us on, hot level not recorded; the voltage of a diode, -2 mV/K."""
    y = 1.7 - 2e-3 * (1.0 - SLOW.response(th.Constant(1.0), LATE))
    path = write(tmp_path / "t3ster.txt", "time [s]\tU [V]\n", [LATE, y], "\t")
    data = th.read_trace(path, 1.0, fall=True, sensitivity="-2 mV/K")
    fit = surrogate.fit_foster(data, order=3)
    np.testing.assert_allclose(fit.model.R, SLOW.R, rtol=1e-3)


def test_an_edge_is_a_ramp_unless_two_rows_stand_at_its_time(tmp_path, caplog):
    """Second-order response to 2 mW, sampled every 40 ns."""
    model = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
    t = np.sort(np.append(np.arange(200) * 40e-9, 1.2e-6))
    rise = 2e-3 * model.step_response(np.maximum(t - 1.2e-6, 0))
    power = np.where(np.arange(201) > 30, 2e-3, 0.0)
    data = th.read_trace(write(tmp_path / "twice.csv", "t (s),P (W),T (K)\n", [t, power, rise]), "P")
    assert surrogate.fit_second_order(data).parameters["kappa"] == pytest.approx(8.87e5, rel=1e-4)
    assert not caplog.text
    once = [np.delete(column, 30) for column in (t, power, rise)]
    th.read_trace(write(tmp_path / "once.csv", "t (s),P (W),T (K)\n", once), "P")
    assert "the power changes by more than half its range between rows, 1 times" in caplog.text


def german(text):
    return text.translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize("divider", [";", "\t", ","])
@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize(
    ("time", "rise"),
    [
        (lambda x: f"{x:,.0f}", lambda x: f"{x:.4f}"),
        (lambda x: f"{x:,.0f}", lambda x: f"{x:.0f}"),
        (lambda x: f"{x:,.2f}", lambda x: f"{x:.2f}"),
        (lambda x: german(f"{x:,.0f}"), lambda x: german(f"{x:.4f}")),
        (lambda x: german(f"{x:.3f}"), lambda x: german(f"{x:.2f}")),
        (lambda x: f"{x:.0f}", lambda x: f"{x:.0f}"),
    ],
)
def test_thousands_are_never_read_as_decimals(divider, quote, time, rise, tmp_path):
    """1,234 ns in a table with semicolons is not 1.234 ns."""
    times, rises = np.arange(1000.0, 9000.0, 20.0), np.arange(1000.0, 7800.0, 17.0)
    rows = [divider.join(f"{quote}{x}{quote}" for x in (time(t), rise(r))) for t, r in zip(times, rises, strict=True)]
    (tmp_path / "t.csv").write_text(divider.join(["Time (ns)", "T (mK)"]) + "\n" + "\n".join(rows) + "\n")
    try:
        data = th.read_trace(tmp_path / "t.csv", 1e-3, start=0.0, baseline=0.0)
    except th.InputError:
        assert not time(1000.0) == rise(1000.0) == "1000"
        return
    np.testing.assert_allclose(data.time, 1e-9 * times, rtol=1e-12)
    np.testing.assert_allclose(data.delta_T, 1e-3 * rises, rtol=1e-12)


def test_a_clipped_trace_is_named_on_every_way_into_a_fit(tmp_path):
    """A trace that ends at 60 % of its rise."""
    t = np.linspace(0, 20e-6, 2001)
    path = write(tmp_path / "scope.csv", "t (s),T (K)\n", [t, np.minimum(MODEL.response(th.Constant(2e-3), t), 8.0)])
    data = th.read_trace(path, 2e-3, start=0.0, baseline=0.0)
    for fit in (surrogate.fit_foster(data, order=2), surrogate.fit_spectrum(data)):
        assert any("rows hold the largest value, 8 K: the trace looks clipped" in line for line in fit.notes)


@pytest.mark.parametrize("wave", [th.Constant(2e-3), WAVE, th.SquareWave(2e-3, 10e-6, 0.5)])
@pytest.mark.parametrize("decays", [MODEL, th.Foster(R=[2000.0], tau=[1e-9])])
def test_what_settles_is_not_called_clipped(wave, decays):
    """A solution without noise holds its last value for many rows; round-off and edges of the power are no noise."""
    for t in (np.linspace(0, 40e-6, 1601), np.geomspace(1e-9, 40e-6, 400)):
        y = decays.response(wave, t)
        for step in (1e-12, np.ptp(y) / 4096):
            data = th.dataset.build(t, np.round(y / step) * step, wave)
            assert not any("clipped" in doubt for doubt in th.dataset.response_of(data).doubts)
