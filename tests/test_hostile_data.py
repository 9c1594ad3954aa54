"""Training data and measured tables that are damaged in one place: a result, or one line that names the place."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import warnings

import h5py
import numpy as np
import pytest
import xarray as xr
from commands import says_one_line
from fuzz import hostile, hostile_tables

import surrogate
import thermofem as th
from thermofem.data import files, netcdf
from thermofem_cli import main
from thermofem_cli.kinds import kind_of

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
STEP = th.Constant(1e-3)
TIMES = np.linspace(0, 4e-6, 60)
DATA = th.dataset.build(TIMES, MODEL.response(STEP, TIMES), STEP)


def test_data_damaged_in_one_place_are_a_result_or_one_line():
    tried = 0
    for what, data in hostile.datasets(DATA):
        tried += 1
        for fit in (surrogate.fit_newton, surrogate.fit_spectrum):
            found = says_one_line(lambda fit=fit, data=data: fit(data))
            assert found is None or 0 < found.model.thermal_resistance < 1e308, what
    assert tried > 80


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("wave", [STEP, th.Pulse(1e-3, 2e-6), th.SquareWave(1e-3, 1e-6, 0.5)])
def test_what_contradicts_its_own_values_is_refused_or_noted(wave, seed, tmp_path):
    """Valid ranges were ignored, a time that begins late gave another model, twice the resistance a slower pole."""
    data = th.dataset.build(TIMES, MODEL.response(wave, TIMES), wave)
    assert not surrogate.fit_spectrum(data).notes
    for what, odd in hostile.contradicting(data, seed):
        found = says_one_line(lambda odd=odd: surrogate.fit_spectrum(odd))
        assert found is None or found.notes, what


def test_a_valid_range_is_that_of_the_stored_numbers(tmp_path):
    """Packed data: the range counts whole numbers as stored, another one counts K, and goes with the unit."""
    odd = DATA.copy(deep=True)
    odd["delta_T"].encoding = {"dtype": "int16", "scale_factor": 1e-3, "_FillValue": -32768}
    highest = float(odd["delta_T"].max())
    for limit, refused in ((np.int16(6000), True), (np.int16(7000), False), (6.0, True), (highest + 0.1, False)):
        odd["delta_T"].attrs["valid_max"] = limit
        odd.to_netcdf(tmp_path / "packed.nc", engine="h5netcdf")
        found = says_one_line(lambda: th.load(tmp_path / "packed.nc"))
        assert (found is None) == refused, limit
    odd = DATA.copy(deep=True)
    odd["time"] = ("time", TIMES * 1e6, {"units": "us", "valid_max": 5.0})
    assert th.dataset.response_of(odd).times[-1] == pytest.approx(TIMES[-1], rel=1e-12)
    odd.to_netcdf(tmp_path / "us.nc", engine="h5netcdf")
    assert "valid_max" not in th.load(tmp_path / "us.nc")["time"].attrs


@pytest.mark.parametrize("other", ["text", "records", "arrays", "one nan", "nan"])
def test_power_that_is_no_number_is_refused_beside_a_waveform(other):
    damaged = DATA.assign(power=("time", hostile.VARIABLE_DAMAGE[other](DATA["power"].values)))
    with pytest.raises(th.InputError, match=r"data\.power"):
        surrogate.fit_newton(damaged)


def test_samples_long_after_the_power_changed_are_refused():
    late = DATA.assign_coords(time=DATA["time"] + 1.0)
    with pytest.raises(th.InputError, match="is a time shifted"):
        surrogate.fit_newton(late)


def test_attributes_that_are_no_text_are_no_citation(tmp_path, monkeypatch, capsys):
    file = tmp_path / "heat.nc"
    for name in ("kind", "geometry", "materials"):
        DATA.assign_attrs({name: np.array([1, 2])}).to_netcdf(file, engine="h5netcdf")
        monkeypatch.setattr(sys, "argv", ["thermofem", "cite", str(file)])
        with pytest.raises(SystemExit, match="2"):
            main()
        assert re.search(rf"^thermofem: error: .*{name}.* is no text$", capsys.readouterr().err, re.M)


def test_a_rise_that_no_row_shows_is_not_extrapolated(tmp_path):
    """Rows from 0 to 8 time constants, said to begin 8 earlier: the baseline would be e^8 times the rise."""
    table = tmp_path / "scope.csv"
    rows = [f"{t * 1e6:.4f},{10 * (1 - np.exp(-t / 0.5e-6)):.5f}" for t in TIMES]
    table.write_text("\n".join(["time (us),dT (K)", *rows]))
    with pytest.raises(th.InputError, match="larger than the rows show; give --baseline"):
        th.read_trace(table, STEP, start=-4e-6)
    assert th.read_trace(table, STEP, start=-4e-6, baseline=0.0).attrs["baseline"] == 0
    assert abs(th.read_trace(table, STEP, start=-10e-9).attrs["baseline"]) < 1


def test_columns_at_the_ends_of_what_floats_hold_are_one_line(tmp_path):
    """Times of 1e-316 s or a unit of 1e308 s overflowed in the search for the start."""
    table = tmp_path / "scope.csv"
    head = "X,CH1,Start,Increment,\nSequence,Volt,-1.0e-06,1.0e-07\n"
    for text in (
        "Time (us),T (K)\n" + "".join(f"{t * 1e6:.5f},{1e6 * t:.5f}\n" for t in TIMES),
        head + "".join(f"{k},{k % 9},\n" for k in range(50)),
    ):
        for other in hostile_tables.scaled_columns(text):
            table.write_text(other)
            with warnings.catch_warnings(action="error"):
                says_one_line(lambda: th.read_trace(table, STEP))


def test_an_interrupt_as_soon_as_a_file_is_there_leaves_none(tmp_path, monkeypatch):
    """Ctrl-C right after the temporary file was made, and while it is written."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        files.write_whole(tmp_path / "out.txt", interrupted)
    monkeypatch.setattr(os, "close", lambda handle, close=os.close: interrupted(close(handle)))
    with pytest.raises(KeyboardInterrupt):
        files.write_whole(tmp_path / "out.txt", lambda path: path.write_text("x"))
    assert not list(tmp_path.iterdir())


def test_a_current_folder_that_was_deleted_is_named(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    surrogate.save_model(th.Foster(R=[1e3], tau=[1e-6]), tmp_path / "model.json")
    words = ["export", str(tmp_path / "model.json"), "--to", "csv", "-o", "x.csv"]
    code = f"import os, sys; os.rmdir({str(gone)!r}); sys.argv[1:] = {words!r}; "
    run = subprocess.run(
        [sys.executable, "-c", f"import thermofem_cli; {code}thermofem_cli.main()"],
        cwd=gone, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 2
    assert run.stderr.startswith("thermofem: error: ")
    assert run.stderr.count("\n") == 1
    assert "current folder was deleted" in run.stderr


def test_a_group_that_holds_itself_under_many_names_is_refused_at_once(tmp_path, monkeypatch):
    """Each of 200 names leads to all of them again; the first check came after 40 000 looks."""
    path, looks, plain = tmp_path / "loop.nc", [], h5py.Group.__getitem__
    with h5py.File(path, "w") as file:
        for k in range(200):
            file[f"g{k}"] = file["/"]
    monkeypatch.setattr(h5py.Group, "__getitem__", lambda group, name: looks.append(name) or plain(group, name))
    with pytest.raises(th.InputError, match="groups deep"):
        th.load(path)
    assert len(looks) <= netcdf.MOST_OBJECTS + 1


def test_damaged_groups_of_a_file_are_one_line(tmp_path):
    """`kind_of` let the KeyError of HDF5 through, and most commands ask it first."""
    path = th.save(DATA, tmp_path / "heat.nc")
    for content in hostile.flipped(path.read_bytes(), 1200):
        path.write_bytes(content)
        assert kind_of(path) in ("data", "result", None)
        says_one_line(lambda: th.load(path))
        says_one_line(lambda: th.dataset.load(path))


@pytest.mark.parametrize(
    ("attribute", "right", "wrong"),
    [("start_within", (0.0, 1e-7, 4e-6), (1.0, -1e-9)), ("rest_rows", (0.0, 1.0, 200), (1e-6, 0.5, -1))],
)
def test_a_start_or_rest_that_no_trace_has_is_refused(attribute, right, wrong):
    """Standard errors follow from them."""
    for value in right:
        assert getattr(th.dataset.response_of(DATA.assign_attrs({attribute: value})), attribute) <= value
    for value in wrong:
        with pytest.raises(th.InputError, match=attribute):
            th.dataset.response_of(DATA.assign_attrs({attribute: value}))


def test_a_dimension_that_is_no_probe_is_named():
    """The file of two cases was said to have several probes, also where one was picked."""
    both = xr.concat([DATA, DATA], dim="case")
    with pytest.raises(th.InputError, match=r"a dimension 'case' beside time; pick one with data\.isel\(case=0\)"):
        th.dataset.response_of(both)
    assert th.dataset.response_of(both.isel(case=0)).times.size == TIMES.size
