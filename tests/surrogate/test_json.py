"""Models as JSON files: exact round trip, and every unusable file refused with its reason."""

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st
from models import MODELS

import surrogate
import thermofem as th
from thermofem.models.model_files import KINDS

PAPER = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)


def edited(path, **fields):
    """The file with some fields replaced."""
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, **fields}))
    return path


@pytest.fixture
def saved(tmp_path):
    provenance = {"training": ["square wave"], "power": np.float64(2e-3)}
    return surrogate.save_model(PAPER, tmp_path / "model.json", provenance=provenance)


positive = st.floats(min_value=1e-12, max_value=1e6)


@given(R=st.lists(positive, min_size=1, max_size=12), data=st.data())
def test_any_passive_network_survives_exactly(R, data, tmp_path_factory):
    tau = data.draw(st.lists(positive, min_size=len(R), max_size=len(R)))
    model = th.Foster(R=R, tau=tau, inputs=("heater",), outputs=("heater",))
    back = surrogate.load_model(surrogate.save_model(model, tmp_path_factory.mktemp("m") / "m.json"))
    # repr of a double is read back to the same double: no tolerance
    assert np.array_equal(back.R, model.R)
    assert np.array_equal(back.tau, model.tau)
    assert (back.inputs, back.outputs) == (("heater",), ("heater",))


def test_provenance_travels_with_the_model(saved):
    assert th.models.load_provenance(saved) == {"training": ["square wave"], "power": 2e-3}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_kind_reads_what_it_writes_and_refuses_all_else(kind):
    of_kind = (model for model in (make() for make in MODELS.values()) if type(model) is kind)
    written = next(of_kind).to_json()  # a kind without one stops here: it joins tests/support/models.py
    assert kind.from_json(written).to_json() == written
    for other in (3, None, [], {}, [1], "text", {**written, "units": 3, **dict.fromkeys(written)}):
        with pytest.raises(th.InputError):
            kind.from_json(other)


def test_a_transfer_between_two_parts_may_have_a_negative_R(tmp_path):
    model = th.Foster(R=[-1.0, 3.0], tau=[1e-9, 1e-6], inputs=("heater",), outputs=("core",))
    assert not surrogate.load_model(surrogate.save_model(model, tmp_path / "m.json")).passive


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"schema": 2}, "update thermofem"),
        ({"format": "a recipe"}, "not a thermal model"),
        ({"kind": "Fosster"}, "did you mean 'Foster'"),
        ({"poles": []}, "R has shape"),
        ({"poles": [{"R": 1.0}]}, "no 'tau'"),
        ({"poles": [{"R": 1.0, "tau": -1e-6}], "thermal_resistance": None}, "tau"),
        ({"poles": [{"R": -1.0, "tau": 1e-6}], "thermal_resistance": None}, "not passive"),
        ({"poles": [{"R": 0.0, "tau": 1e-6}], "thermal_resistance": None}, "never warms up"),
        ({"thermal_resistance": 7784.3}, "was a number edited"),
        ({"inputs": "core"}, "list of one name"),
    ],
)
def test_an_unusable_file_is_refused_with_the_reason(saved, fields, reason):
    path = edited(saved, **fields)
    with pytest.raises(th.InputError, match=reason):
        surrogate.load_model(path)


def test_provenance_that_is_no_object_is_refused(saved):
    path = edited(saved, provenance=3)
    with pytest.raises(th.InputError, match="provenance"):
        th.models.load_provenance(path)


@pytest.mark.parametrize(("matrices", "reason"), [({"A": [[1.0]]}, "must decay"), ({"B": [1.0]}, "B has shape")])
def test_unphysical_matrices_are_refused(tmp_path, matrices, reason):
    path = surrogate.save_model(th.StateSpace(np.eye(1), -np.eye(1), np.eye(1), np.eye(1)), tmp_path / "m.json")
    with pytest.raises(th.InputError, match=reason):
        surrogate.load_model(edited(path, **matrices))


@pytest.mark.parametrize("C", [[[-1.0, 0.0]], [[1.0, -0.9]]])
def test_a_state_space_in_which_heat_cools_the_heated_part_is_refused(tmp_path, C):
    """R_th = -1555.6 K/W, and a pole of negative R as in a Foster network."""
    E, A, B = np.diag([1e-11, 1e-10]), np.array([[-1e-3, 5e-4], [5e-4, -7e-4]]), np.array([[1.0], [0.0]])
    path = surrogate.save_model(th.StateSpace(E, A, B, B.T), tmp_path / "m.json")
    with pytest.raises(th.InputError, match="is negative: the network is not passive"):
        surrogate.load_model(edited(path, C=C, provenance={}))
    with pytest.raises(th.InputError, match="is negative: the network is not passive"):
        surrogate.save_model(th.StateSpace(E, A, B, np.array(C)), tmp_path / "saved.json")
    apart = th.StateSpace(E, A, B, np.array(C), inputs=("heater",))  # a transfer may be negative
    assert surrogate.load_model(surrogate.save_model(apart, tmp_path / "saved.json")).inputs == ("heater",)


def test_the_parts_of_a_network_are_those_of_its_file(tmp_path):
    """heater and far are no core and core; a file without them is refused."""
    path = surrogate.save_model(MODELS["SINDy network"](), tmp_path / "m.json")
    content = json.loads(path.read_text())
    for which, name in (("inputs", "heater"), ("outputs", "far")):
        path.write_text(json.dumps({**content, which: [name]}))
        assert getattr(surrogate.load_model(path), which) == (name,)
        path.write_text(json.dumps({key: value for key, value in content.items() if key != which}))
        with pytest.raises(th.InputError, match=f"no '{which}'"):
            surrogate.load_model(path)
