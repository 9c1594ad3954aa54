"""A file that `save` wrote and somebody changed says so when it is read; one that is whole says nothing."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import h5py
import numpy as np
import pytest
from campaigns import STEP, make
from commands import thermofem

import surrogate
import thermofem as th
from thermofem.campaign import Drive
from thermofem_cli.show_command import show

TIMES = np.linspace(0, 10e-6, 50)
WORDS = "changed after thermofem wrote it"


@pytest.fixture
def data():
    model = th.Foster(R=[5e3], tau=[3e-6])
    made = th.dataset.build(TIMES, model.response(th.Constant(1e-3), TIMES), th.Constant(1e-3))
    return made.assign_attrs(start_within=0.0, rest_rows=200.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda file: file["time"].attrs.update(units="ns"),
        lambda file: file["delta_T"].write_direct(1.001 * file["delta_T"][()]),
        lambda file: file.attrs.update(waveform=th.waveforms.to_json(th.Constant(2e-3))),
        lambda file: file.attrs.update(start_within=1e-7),  # standard errors of a measured trace follow from it
        lambda file: file.attrs.pop("rest_rows"),
    ],
)
def test_a_change_behind_its_back_is_said(data, change, tmp_path, caplog):
    """Times in ns instead of s, of a step that has not settled, contradict nothing else in the file."""
    th.save(data, tmp_path / "a.nc")
    with h5py.File(tmp_path / "a.nc", "a") as file:
        change(file)
    th.load(tmp_path / "a.nc")
    assert WORDS in caplog.text


def test_what_is_whole_says_nothing(data, tmp_path, caplog):
    """Words, whole numbers, Booleans, several probes, attributes of every type; once more after `load`."""
    odd = data.assign(word=("time", np.array(["a", "é"] * 25)), flag=("time", TIMES > 0), count=("time", np.arange(50)))
    odd = odd.assign_coords(probe="core", many=("time", TIMES.astype("f4"))).assign_attrs(heated="core", read="core")
    with caplog.at_level(logging.WARNING):
        for one in (data, odd):
            th.save(one, tmp_path / "a.nc")
            again = th.load(tmp_path / "a.nc")
            th.save(again.isel(time=slice(0, 20)), tmp_path / "b.nc")
            th.load(tmp_path / "b.nc")
    assert WORDS not in caplog.text


def test_a_trace_that_is_given_twice_is_refused(data):
    """Twice the samples made the standard errors smaller by a factor of 1.4."""
    for fit in (surrogate.fit_newton, lambda two: surrogate.fit_foster(two, order=1)):
        with pytest.raises(th.InputError, match=r"data\[1\] is the same trace as data\[0\]"):
            fit([data, data.copy()])


@pytest.fixture
def reduced(tmp_path):
    """A model file with a certificate."""
    provenance = {"method": "reduction", "error_bound": 1e-4, "residual_K": 0.1, "geometry": "", "content_hash": "old"}
    provenance |= {"assumed": ["a voltage: 1 V counts as 1 K"], "source": "scope.csv"}
    return surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), tmp_path / "m.json", provenance=provenance)


@pytest.mark.parametrize(
    "change",
    [
        lambda tree: tree["poles"][0].update(tau=4e-8),
        lambda tree: tree["provenance"].update(error_bound=1e-9),
        lambda tree: tree["provenance"].update(geometry="another"),
        lambda tree: tree["provenance"].update(content_hash=[1]),
        lambda tree: tree["provenance"].update(content_hash={"hash": "x", "entries": 3}),
        lambda tree: tree["provenance"]["content_hash"]["entries"].remove("geometry"),
        lambda tree: tree["provenance"].pop("assumed"),
        lambda tree: tree["provenance"].update(source="another"),
        lambda tree: tree.update(outputs=["shell"]),
    ],
)
def test_a_changed_model_keeps_no_certificate(change, reduced, caplog):
    """`show` called a bound proven for time constants that somebody had written in."""
    tree = json.loads(reduced.read_text())
    change(tree)
    reduced.write_text(json.dumps(tree))
    model = surrogate.load_model(reduced)
    assert caplog.text.count(WORDS) == 1
    assert "error_bound" not in model.origin
    card = show(reduced)
    assert card["error_bound"] is card["residual"] is None
    assert "proven" not in card["trusted"]
    surrogate.save_model(model, reduced)  # nor once it is written again
    assert "error_bound" not in th.models.load_provenance(reduced)


def test_a_model_as_it_was_written_keeps_its_certificate(reduced, caplog):
    """Also with notes of its user, in another layout, with 5000.0 as 5000, and written again."""
    tree = json.loads(reduced.read_text())
    tree["provenance"]["mine"] = "chip 7"
    reduced.write_text(json.dumps(tree, sort_keys=True).replace("000.0", "000"))
    surrogate.save_model(surrogate.load_model(reduced), reduced)
    found = th.models.load_provenance(reduced)
    assert (found["error_bound"], found["mine"], "content_hash" in found) == (1e-4, "chip 7", False)
    assert "proven" in show(reduced)["trusted"]
    del tree["provenance"]["content_hash"]  # of an earlier version, or of another program
    reduced.write_text(json.dumps(tree))
    assert surrogate.load_model(reduced).origin["error_bound"] == 1e-4
    assert WORDS not in caplog.text


def test_a_command_says_once_what_was_changed(reduced, tmp_path):
    tree = json.loads(reduced.read_text())
    tree["poles"][0].update(tau=4e-8)
    reduced.write_text(json.dumps(tree))
    refused = thermofem("simulate", str(reduced), "--power", "-2 mW", "--duration", "1 us", "-o", "a.nc", cwd=tmp_path)
    assert refused.returncode == 2
    done = thermofem("simulate", str(reduced), "--power", "1 mW", "--duration", "1 us", "-o", "a.nc", cwd=tmp_path)
    assert (done.returncode, done.stderr.count(WORDS)) == (0, 1)


def test_a_campaign_whose_files_were_changed_says_so(tmp_path, threads, caplog):
    """A result that somebody had scaled trained a model 1.5 times too hot; the index was not looked at either."""
    square = Drive("square", th.SquareWave(2e-3, 1e-6, 1 / 3), samples=31)
    campaign = replace(make(2, read=("core", "box")), drives=(STEP, square))
    campaign.run(tmp_path, threads)
    results = sorted((tmp_path / "results").glob("*.nc"))
    paths = [*results, tmp_path / "training.nc", tmp_path / "index.nc"]
    for path in paths:
        th.load(path)
    with th.campaign.open_campaign(tmp_path) as index:
        right = index["thermal_resistance"].values
    assert WORDS not in caplog.text
    for path, name in zip(paths, ["delta_T", "delta_T", "features", "thermal_resistance"], strict=True):
        with h5py.File(path, "a") as file:
            file[name][...] *= 1.5
        caplog.clear()
        th.load(path)
        assert WORDS in caplog.text, path
    caplog.clear()
    with th.campaign.open_campaign(tmp_path) as index:
        assert np.isnan(index["thermal_resistance"]).all()  # its results are changed, too
    assert WORDS in caplog.text
    campaign.run(tmp_path, threads)
    with h5py.File(tmp_path / "index.nc", "a") as file:
        file["thermal_resistance"][...] *= 2
    with th.campaign.open_campaign(tmp_path) as index:
        np.testing.assert_array_equal(index["thermal_resistance"], right)


def test_a_changed_plan_is_refused(tmp_path):
    """Without the index the swapped values of two geometries became the features of the training data."""
    make(2).run(tmp_path, workers=1)
    plan = json.loads((tmp_path / "plan.json").read_text())
    first, second = plan["cases"]
    plan["cases"] = [[first[0], *second[1:]], [second[0], *first[1:]]]
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    (tmp_path / "index.nc").unlink()
    with pytest.raises(th.InputError, match=f"{WORDS}; run the campaign again"):
        th.campaign.open_campaign(tmp_path)
    make(2).run(tmp_path, workers=1)
    assert th.campaign.open_campaign(tmp_path)["oxide"].values.tolist() == [1.0, 1.4]
