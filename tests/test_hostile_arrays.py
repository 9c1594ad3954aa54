"""Damaged tables, and arrays that hold what is no real number: refused in one line, never used in silence."""

from __future__ import annotations

import contextlib
import warnings

import numpy as np
import pytest

import coupled
import thermofem as th
from thermofem.data.columns import parse
from thermofem.data.traces import read_trace

GOOD = "".join(f"{k}e-7,{1e3 * (1 - np.exp(-k / 10)):.6f}\n" for k in range(1, 60))


@pytest.mark.parametrize(
    "row", ["0,OVER", "0x0,0", "0.0,1..2", "OVER,0", "--,OVER", "0,", "OVER,", "0", "0,0,OVER", "OVER,OVER", "0,0 \0"]
)
def test_a_damaged_first_row_does_not_replace_the_header(row, tmp_path):
    """The units of the header were dropped: mK were taken as K."""
    path = tmp_path / "scope.csv"
    path.write_text(f"Time (s),T (mK)\n{row}\n{GOOD}")
    if row == "0,":  # an empty cell is a row, and refused when its column is used
        row = "line 2: 'T (mK)' is empty"
    with pytest.raises(th.InputError, match=r"line [12]"):
        th.read_csv(path, time="Time", temperature="T", power=1.0)
    with pytest.raises(th.InputError, match=r"line [12]"):
        read_trace(path, th.Constant(1.0))


@pytest.mark.parametrize("row", ["0 OVER", "0   OVER", "OVER 0", "1..2 0"])
@pytest.mark.parametrize("head", ["Time (s)  T (mK)", "Time (s) T (mK)", "% Time (s)  T (mK)"])
def test_a_damaged_first_row_between_spaces_is_refused(head, row):
    rows = GOOD.replace(",", " ")
    assert parse(f"{head}\n{rows}").units == ("s", "mK")
    with pytest.raises(th.InputError, match="line 2 = "):
        parse(f"{head}\n{row}\n{rows}")


@pytest.mark.parametrize(
    ("head", "names", "units"),
    [
        ("x-axis,1\nsecond,Volt\n", ("x-axis", "1"), ("second", "Volt")),  # as Keysight writes it
        ("Record length,101\nSample rate,1e6\nX (us),CH1 (mV)\n", ("X (us)", "CH1 (mV)"), ("us", "mV")),
        ("Time (us),T (K)\n# 1, 2 and 3 follow\n\n", ("Time (us)", "T (K)"), ("us", "K")),
        ("", ("1", "2"), ("", "")),
        ("a title of the file\n", ("1", "2"), ("", "")),
    ],
)
def test_headers_of_instruments_are_still_read(head, names, units):
    found = parse(head + GOOD)
    assert (found.names, found.units, len(found.values)) == (names, units, 59)


def test_columns_without_numbers_need_no_name():
    rows = "".join(line + ",\n" for line in GOOD.splitlines())
    assert parse(f"Model,DSO,v1\nTime (us),T (K),\n{rows}").units == ("us", "K")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("Time (µs),T (K)\n".encode("utf-16") + GOOD.encode("utf-16-le"), "UTF-16"),
        (("Time (us),T (K)\n" + GOOD).encode("utf-16-le"), "line 1 holds a NUL character.*UTF-16"),
        (("Time (us),T (K)\n" + GOOD).encode() + b"\0", "line 61 holds a NUL"),
        (("a\nTime (µs),T (K)\n" + GOOD).encode("latin-1"), "line 2 holds the byte 0xb5.*Latin-1"),
    ],
)
def test_tables_in_other_encodings_are_refused_by_name(content, words, tmp_path):
    path = tmp_path / "scope.csv"
    path.write_bytes(content)
    with pytest.raises(th.InputError, match=words):
        th.read_csv(path, time="1", temperature="2", power=1.0)
    with pytest.raises(th.InputError, match=words):
        read_trace(path, th.Constant(1.0))


@pytest.mark.parametrize("head", ["Time (s),T (K)\n", "Time (s),T\n", "Time (s),CH1 (V)\n"])
def test_an_overload_of_the_instrument_is_no_temperature(head, tmp_path):
    path = tmp_path / "scope.csv"
    path.write_text(f"{head}{GOOD}60e-7,9.9E+37\n")
    with pytest.raises(th.InputError, match=r"line 61: .* = 9.9e\+37 is beyond 100000 K"):
        read_trace(path, th.Constant(1.0))
    with pytest.raises(th.InputError, match=r"line 61: .* = 9.9e\+37 is beyond 100000 K"):
        th.read_csv(
            path,
            time="1" if not head else "Time",
            temperature=head.split(",")[1].split()[0],
            power=1.0,
            units={"temperature": "K"},
        )


MODEL = th.Foster(R=[1e3, 2e3], tau=[1e-7, 1e-6])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: th.Sampled([0, 1e-7, 1e-6], np.ma.array([0, 9.0, 0], mask=[0, 1, 0])), "masked"),
        (lambda: th.Foster(R=np.ma.array([1.0, 2.0], mask=[0, 1]), tau=[1e-7, 1e-6]), "masked"),
        (lambda: th.Sampled([0, 1e-6], [1j, 1]), "complex"),
        (lambda: MODEL.step_response([1e-7 + 0j]), "complex"),
        (lambda: th.Sampled([0, 1e-6], [True, False]), "true or false"),
        (lambda: th.Constant(np.ma.masked), "is not a number"),
        (lambda: th.Constant(np.complex128(1j)), "is not a number"),
        (lambda: th.strip_ring().with_({"part.core.radius": np.ma.masked}), "masked is neither"),
        (lambda: MODEL.step_response(range(10**10)), "10000000000 numbers"),
    ],
)
def test_what_is_no_array_of_real_numbers_is_refused(call, words):
    """The mask and the imaginary part were dropped: a masked 9 W heated."""
    with pytest.raises(th.InputError, match=words):
        call()


RING = coupled.borghi2021()
LOOP: list = [1e-3]
LOOP.append(LOOP)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: MODEL.response(lambda t: 1e-3, [1e-7]), r"thermofem\.Function\(f\)"),
        (lambda: coupled.simulate(RING, MODEL, power=LOOP, duration=1e-6), "list in lists"),
        (
            lambda: coupled.simulate(RING, MODEL, power=1e-3, duration=1e-6, times=range(10**12)),
            "times holds 1000000000000 numbers",
        ),
        (
            lambda: coupled.stability_map(RING, MODEL, np.linspace(1e-3, 2e-3, 2000), np.linspace(-1e9, 1e9, 2000)),
            "2000 x 2000 points",
        ),
        (
            lambda: coupled.pulsing_map(RING, MODEL, np.linspace(1e-3, 2e-3, 2000), np.linspace(-1e9, 1e9, 2000)),
            "2000 x 2000 points",
        ),
    ],
)
def test_what_python_would_stumble_over_is_refused_first(call, words):
    with pytest.raises(th.InputError, match=words):
        call()


def test_edges_of_any_power_are_found_without_a_warning(tmp_path):
    """The product of two changes overflowed."""
    path = tmp_path / "scope.csv"
    path.write_text("Time (us),T (K),P (W)\n" + "".join(f"{k},{k % 3},{1e161 * (k == 8)}\n" for k in range(20)))
    with warnings.catch_warnings(), contextlib.suppress(th.InputError):
        warnings.simplefilter("error")
        th.read_csv(path, time="Time", temperature="T", power="P", ambient=0.0, edges="middle")
