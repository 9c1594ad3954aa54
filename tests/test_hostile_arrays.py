"""Damaged tables, and arrays that hold what is no real number: refused in one line, never used in silence."""

from __future__ import annotations

import contextlib
import warnings

import numpy as np
import pytest

import coupled
import thermofem as th

GOOD = "".join(f"{k}e-7,{1e3 * (1 - np.exp(-k / 10)):.6f}\n" for k in range(1, 60))


@pytest.mark.parametrize(
    "row", ["0,OVER", "0x0,0", "0.0,1..2", "OVER,0", "--,OVER", "0,", "OVER,", "0", "0,0,OVER", "0,0 \0"]
)
def test_a_damaged_first_row_is_refused(row, tmp_path):
    """It counted as text above the table, and the heating began a row late."""
    path = tmp_path / "scope.csv"
    path.write_text(f"Time (s),T (mK)\n{row}\n{GOOD}")
    with pytest.raises(th.InputError, match=r"line 2|empty|above"):
        th.read_trace(path, 1.0)


@pytest.mark.parametrize("row", ["0 OVER", "0   OVER", "OVER 0", "1..2 0"])
@pytest.mark.parametrize("head", ["Time (s)  T (mK)", "Time (s) T (mK)", "% Time (s)  T (mK)"])
def test_a_damaged_first_row_between_spaces_is_refused(head, row, tmp_path):
    path, rows = tmp_path / "scope.dat", GOOD.replace(",", " ")
    path.write_text(f"{head}\n{rows}")
    assert float(th.read_trace(path, 1.0).delta_T.max()) < 2
    path.write_text(f"{head}\n{row}\n{rows}")
    with pytest.raises(th.InputError, match="line 2"):
        th.read_trace(path, 1.0)


@pytest.mark.parametrize("code", ["9.9E+37", "inf", ""])
def test_an_overload_of_the_instrument_is_no_temperature(code, tmp_path):
    (tmp_path / "scope.csv").write_text(f"Time (s),CH1 (V)\n{GOOD}60e-7,{code}\n")
    with pytest.raises(th.InputError, match="CH1"):
        th.read_trace(tmp_path / "scope.csv", 1.0)


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
        th.read_trace(path, "P", time="Time", temperature="T", baseline=0.0, edges="middle")
