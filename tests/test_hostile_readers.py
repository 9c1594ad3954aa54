"""Every reader x every hostile generator: a result or one line of InputError, within seconds, and nothing else."""

from __future__ import annotations

import json
import shutil
import time
import warnings

import numpy as np
import pytest
from commands import says_one_line
from fuzz import hostile
from test_every_waveform import WAVES

import coupled
import surrogate
import thermofem as th
from coupled import ring_toml
from coupled.circuit import file as circuit_file
from coupled.maps.journal import Journal
from coupled.maps.pulsing_map import _Cell, _possible
from thermofem.campaign import Campaign
from thermofem.campaign.schema import fields
from thermofem.campaign.store import ResultStore
from thermofem.waveforms import from_json
from thermofem_cli.kinds import kind_of

SECONDS = 20.0  # of one reader over one generator: pint's first use alone takes 2 to 8 on a busy machine


def as_file(read, name):
    """A reader of files as one of text."""

    def reader(text, folder):
        path = folder / name
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        return read(path)

    return reader


READERS = {
    "model": as_file(surrogate.load_model, "model.json"),
    "provenance": as_file(surrogate.load_provenance, "model.json"),
    "geometry": lambda text, folder: th.CrossSection.from_toml_text(text),
    "geometry file": as_file(th.CrossSection.from_toml, "ring.toml"),
    "campaign": lambda text, folder: Campaign(**fields(text, folder)),
    "ring": as_file(coupled.RingResonator.from_toml, "ring.toml"),
    "waveform": lambda text, folder: from_json(text),
    "plan": lambda text, folder: as_file(lambda path: ResultStore(path.parent).read_plan(), "plan.json")(text, folder),
    "journal": as_file(lambda path: Journal(path, {"a": 1}).close(), "map.jsonl"),
    "trace": as_file(lambda path: th.read_trace(path, 1e-3), "table.csv"),
    "kind": as_file(kind_of, "model.json"),
}
GENERATORS = {
    "trees": hostile.trees(),
    "tomls": hostile.tomls(),
    "units": hostile.units(),
    "numbers": hostile.numbers(),
    "cells": ["x" * 200_000 + ",1\n1,2\n", '"' + "x" * 200_000 + '",1\n', "1_0,2\n3,4\n", "١,٢\n٣,٤\n", "1,2\n3\n"],
}


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("reader", READERS)
def test_a_result_or_one_line(reader, generator, tmp_path):
    begin = time.process_time()
    for text in GENERATORS[generator]:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            says_one_line(lambda: READERS[reader](text, tmp_path))  # noqa: B023 - called at once
    assert time.process_time() - begin < SECONDS


@pytest.mark.parametrize("unit", ["m", "s", "W", "K", ""])
def test_no_quantity_hangs(unit):
    for text in hostile.units():
        begin = time.process_time()
        with pytest.raises(th.InputError):
            th.quantity.parse(text, unit)
        assert time.process_time() - begin < SECONDS


NUMBERS = [10**400, 10**5000, -(10**400), float("nan"), float("inf"), "1_0", "١", None, "9" * 400]


@pytest.mark.parametrize("number", NUMBERS, ids=lambda n: str(type(n).__name__))
@pytest.mark.parametrize(
    "take",
    [
        lambda x: th.Pulse(x, 1e-6),
        lambda x: th.Pulse(1e-3, x),
        lambda x: th.Foster(R=[x], tau=[1e-6]),
        lambda x: th.strip_ring(radius=x),
        lambda x: th.quantity.parse(x, ""),
        lambda x: th.checks.finite("x", x),
        lambda x: th.checks.array("x", [x, 1.0]),
        lambda x: th.checks.numbers("x", [[x]]),
    ],
)
def test_no_number_but_a_finite_one(take, number):
    with pytest.raises(th.InputError) as error:
        take(number)
    assert len(str(error.value)) < 1500


def test_names_are_refused_wherever_a_model_is_made_or_loaded(tmp_path):
    good = surrogate.save_model(th.Foster(R=[5e3], tau=[1e-6]), tmp_path / "good.json")
    content = json.loads(good.read_text())
    eye = np.eye(1)
    for name in hostile.names():
        for make in (
            lambda: th.Foster(R=[5e3], tau=[1e-6], inputs=(name,)),  # noqa: B023 - called at once
            lambda: th.StateSpace(eye, -eye, eye, eye, outputs=(name,)),  # noqa: B023
            lambda: surrogate.Cauer([5e3], [2e-10], (name,)),  # noqa: B023
            lambda: surrogate.Network(-eye, eye[0], (name,), th.Foster([1.0], [1.0]), 1.0),  # noqa: B023
            lambda: th.Part(name, "Si", 1e-6, 2e-6, 0.0, 1e-7),  # noqa: B023
            lambda: th.Layer(name, "Si", 1e-6),  # noqa: B023
        ):
            with pytest.raises(th.InputError):
                make()
        path = tmp_path / "bad.json"
        path.write_text(json.dumps({**content, "inputs": [name]}))
        with pytest.raises(th.InputError) as error:
            surrogate.load_model(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": ["core", "core"]}, "one of each|twice"),
        ({"units": {"R": "K/mW", "tau": "us"}}, "R is in 'K/mW'; a model file holds it in K/W"),
        ({"units": 5}, "units must be an object"),
        ({"poles": [{"R": 5e3, "tau": True}]}, "not a number"),
        ({"poles": [{"R": 5e3, "tau": 1e-25}]}, "must lie in 1e-20"),
        ({"poles": [{"R": 5e3, "tau": 1e-320}]}, "numbers of a model lie in"),
    ],
)
def test_a_model_file_that_means_something_else_is_refused(change, words, tmp_path):
    good = surrogate.save_model(th.Foster(R=[5e3], tau=[1e-6]), tmp_path / "good.json")
    good.write_text(json.dumps({**json.loads(good.read_text()), **change}))
    with pytest.raises(th.InputError, match=words):
        surrogate.load_model(good)


def test_netcdf_that_points_elsewhere_or_declares_too_much(tmp_path):
    for words, path in hostile.netcdf(tmp_path):
        with pytest.raises(th.InputError) as error:
            th.load(path)
        assert str(error.value).startswith(str(path))
        assert words in str(error.value) or words == "declares 1e12 values", str(error.value)


def test_units_of_netcdf_are_converted(tmp_path):
    """The same data in us, mW and mK train the same model."""
    model, t = th.Foster(R=[5e3], tau=[1e-6]), np.linspace(0, 8e-6, 200)
    rise = model.response(th.Constant(2e-3), t)
    data = th.dataset.build(t, rise, th.Constant(2e-3)).drop_attrs()
    scaled = data.assign_coords(time=("time", t * 1e6, {"units": "us"}))
    scaled["power"] = ("time", data["power"].values * 1e3, {"units": "mW"})
    scaled["delta_T"] = ("time", rise * 1e3, {"units": "mK"})
    for found in (scaled, th.load(th.save(scaled, tmp_path / "us.nc"))):
        fit = surrogate.fit_newton(found)
        # the fit of exact data ends at its own stopping tolerance
        assert fit.model.tau[0] == pytest.approx(1e-6, rel=1e-6)
        assert fit.model.thermal_resistance == pytest.approx(5e3, rel=1e-6)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0, 0], [1, 0], [np.nan, 1]], "not finite"),
        ([[0, 0], [1, 0], [np.inf, 1]], "not finite"),
        ([[0, 0], [1, 0], [-0.5, 1]], "beyond the axis"),
        ([[0, 0], [1, 0], [2, 0]], "has no area"),
        ([[1, 1], [1, 1], [1, 1]], "has no area"),
    ],
)
def test_meshes_that_are_none(points, words):
    with pytest.raises(th.InputError, match=words):
        th.Mesh(1e-6 * np.array(points, dtype=float), np.array([[0, 1, 2]]), np.zeros(1, dtype=int), ("core",))


def campaign_text(vary: str, drive: str = "") -> str:
    geometry = th.strip_ring().to_toml().replace("[[", "[[geometry.").replace("\n[boundary]", "\n[geometry.boundary]")
    head = "".join(f"geometry.{line}\n" for line in geometry.split("\n\n")[0].splitlines())
    tables = "\n\n".join(geometry.split("\n\n")[1:])
    plan = f'[[vary]]\npath = "part.core.width"\nname = "{vary}"\nvalues = ["450 nm"]\n'
    return f'{head}{plan}[[drive]]\npower = "1 mW"\n{drive}{tables}'


@pytest.mark.parametrize("name", ["feature_unit", "time_step", "power_step", "delta_T_step", "case", "features"])
def test_a_varied_quantity_may_not_have_a_name_of_the_index(name, tmp_path):
    with pytest.raises(th.InputError, match="is taken by"):
        Campaign(**fields(campaign_text(name), tmp_path))
    Campaign(**fields(campaign_text("width"), tmp_path))


def test_a_damaged_result_is_not_taken_over(tmp_path):
    """Whatever bytes of a result change, it is not believed; undamaged it is."""
    store = ResultStore(tmp_path)
    with store.opened():
        content = th.save(th.dataset.build([0, 1e-6], [0, 1.0], th.Constant(1e-3)), tmp_path / "x.nc").read_bytes()
        key = "0123456789abcdef"
        store.write_result(key, content)
        assert store.finished(key, store.hashes())
        for wrong in hostile.damaged(content, seed=1, count=50):
            store.result(key).write_bytes(wrong)
            assert store.finished(key, store.hashes()) == (wrong == content)
        shutil.copy(tmp_path / "x.nc", store.result(key))
        assert store.finished(key, store.hashes())
        store.ledger.write_text("nonsense\n")
        assert not store.finished(key, store.hashes())


def test_a_map_is_locked_and_its_rows_are_checked(tmp_path):
    path = tmp_path / "map.jsonl"
    with Journal(path, {"a": 1}) as journal:
        journal.add(0, [["stable", float("nan"), 0.5, 1.0, ""]])
        with pytest.raises(th.InputError, match="in use by another run"):
            Journal(path, {"a": 1})
    content = path.read_bytes()
    with Journal(path, {"a": 1}) as again:
        assert again.rows[0][0][2] == 0.5
    for wrong in hostile.damaged(content, seed=2, count=60):
        path.write_bytes(wrong)
        found = says_one_line(lambda: Journal(path, {"a": 1}))
        if found is not None:
            # what is taken over is what was written; a line without its end is a row not yet done
            assert found.rows == {} or found.rows[0][0][2:] == [0.5, 1.0, ""]
            found.close()


def test_a_map_refuses_values_that_no_run_has():
    assert _possible(_Cell("self-pulsing", 1e-6, 0.5, 1.0, ""))
    nan = float("nan")
    for period, duty, swing in (
        (-1.0, 0.5, 1.0),
        (1e-6, 5.0, 1.0),
        (1e-6, 0.5, -1.0),
        (nan, 0.5, 1.0),
        (0.0, 0.5, 1.0),
    ):
        assert not _possible(_Cell("self-pulsing", period, duty, swing, ""))


def described(module):
    """The file that the docstring of its reader shows."""
    return (module.__doc__ or "").split("```toml\n")[1].split("```")[0]


PLAN = """geometry = "strip.toml"
name = "x"
samples = 5
[[vary]]
path = "part.core.radius"
from = "3 um"
to = "15 um"
spacing = "log"
[[drive]]
power = "1 mW"
square = "1 us"
duty = 0.3
periodic = true
[[drive]]
power = "1 mW"
duration = "40 us"
first = "1 ns"
[probes]
heated = "core"
read = ["core"]
"""
TOML_FILES = {
    "campaign": (PLAN, lambda text, folder: Campaign(**fields(text, folder))),
    "ring": (
        described(ring_toml).replace('drop_rate = "40e9 1/s"', ""),
        lambda text, folder: coupled.RingResonator.from_text(text),
    ),
    "circuit": (described(circuit_file), lambda text, folder: coupled.Circuit(**circuit_file.fields(text, folder))),
    "geometry": (th.heated_ring().to_toml(), lambda text, folder: th.CrossSection.from_toml_text(text)),
}


@pytest.mark.parametrize("kind", TOML_FILES)
@pytest.mark.slow
def test_every_line_of_a_file_replaced(kind, tmp_path):
    """Each value by values of every other type and size, each line left out and there twice."""
    text, read = TOML_FILES[kind]
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    (tmp_path / "ring.toml").write_text('base = "borghi2021"\n')
    read(text, tmp_path)
    for other in hostile.replaced_lines(text):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            says_one_line(lambda: read(other, tmp_path))  # noqa: B023 - called at once


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('periodic = "no"', "must be true or false"),
        ("periodic = 0", "must be true or false"),
        ('pulse = ""', "is not a quantity|does not begin with a number|exclude each other"),
        ('duration = "1 us"', "not of a periodic state"),
        ("name = true", "must be text"),
    ],
)
def test_a_drive_of_the_wrong_type_is_refused(line, words, tmp_path):
    """`periodic = "no"` was true, and an empty pulse a step."""
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    old = next(known for known in PLAN.splitlines() if known.startswith(("power", line.split(" = ")[0])))
    text = PLAN.replace("periodic = true\n", "", 1) if line.startswith("periodic") else PLAN
    with pytest.raises(th.InputError, match=words):
        Campaign(**fields(text.replace('power = "1 mW"\n', f'power = "1 mW"\n{line}\n', 1), tmp_path))
    assert old


@pytest.mark.parametrize(
    "model",
    [
        th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]),
        th.OutputMap(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), -4e-4, 20.0),
        th.StateSpace(1e-10 * np.eye(2), -1e-4 * np.array([[2.0, -1], [-1, 2]]), np.eye(2)[:, :1], np.eye(2)[:1]),
        th.Quadratic(-1e6 * np.eye(2), np.zeros((2, 2, 2)), np.zeros((2, 2)), np.ones(2), np.ones(2)),
        surrogate.cauer(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])),
    ],
    ids=lambda model: type(model).__name__,
)
@pytest.mark.slow
def test_every_field_of_a_model_replaced(model, tmp_path):
    path = surrogate.save_model(model, tmp_path / "m.json", provenance={"a": 1})
    tree = json.loads(path.read_text())
    for other in hostile.replaced_leaves(tree):
        path.write_text(json.dumps(other))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            loaded = says_one_line(lambda: surrogate.load_model(path))
            if loaded is not None and not isinstance(loaded, th.StateSpace):
                says_one_line(lambda: loaded.step_response([0.0, 1e-9, 1e-6]))  # noqa: B023


@pytest.mark.parametrize("kind", th.waveforms.KINDS)
def test_every_field_of_a_waveform_replaced(kind):
    wave = next(wave for wave in WAVES.values() if type(wave).__name__ == kind)
    for other in hostile.replaced_leaves(json.loads(th.waveforms.to_json(wave))):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            says_one_line(lambda: from_json(json.dumps(other))(np.linspace(0, 2e-6, 9)))  # noqa: B023
