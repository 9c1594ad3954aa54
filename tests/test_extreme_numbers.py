"""Numbers near the end of what a float holds: refused in one line, without a warning and without a wait."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from scipy import stats

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Variation

pytestmark = pytest.mark.filterwarnings("error")

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
ONE = np.ones((1, 1))


def single(E=1e-9, A=-1e-4, B=1.0):
    return th.StateSpace(E * ONE, A * ONE, B * ONE, ONE)


@pytest.fixture(scope="module")
def family():
    box = Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6)
    return surrogate.train_family(th.Campaign(th.strip_ring().to_toml(), (box,), samples=1), 5e-2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: th.PiecewiseCubic([-1e308, 1e308], [[1, 0, 0, 0]]), "edges holds a number beyond 1e.12"),
        (lambda: th.PiecewiseCubic([0, 1e-6], [[1e200] * 4]), "coefficients holds a number beyond 1e.100"),
        (
            lambda: MODEL.response(th.PiecewiseCubic([0, 1e-300], [[1e-3, 0, 0, 0]], repeat=True), [0, 1e-6]),
            "periods of 1e-300 s are asked for at once",
        ),
        (
            lambda: MODEL.response(th.Sampled([0, 1e-300], [1e-3, 1e-3], repeat=True), [0, 1e-6]),
            "periods of 1e-300 s are asked for at once",
        ),
        (lambda: surrogate.reduce(single(E=1e200)), "E holds a number beyond 1e.50"),
        (lambda: surrogate.reduce(single(E=1e-200)), "E/-A is 1e-196 to 1e-196 s"),
        (lambda: surrogate.reduce(single(A=-1e-200)), "-A has 1e-200 to 1e-200 W/K"),
        (lambda: surrogate.reduce(single(B=1e-200)), "is zero everywhere"),
        (lambda: coupled.Method((), names=()), "method takes one value; known: rodas4, rodas5p"),
    ],
)
def test_models_and_waveforms(call, words):
    with pytest.raises(th.InputError, match=words):
        call()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f, d: surrogate.design(f, target={"thermal_resistance": 1e-300}), "1e-300 is below 1e-50"),
        (lambda f, d: surrogate.calibrate(f, d, noise=1e300), "noise = 1e.300 is beyond 1e.100"),
        (lambda f, d: surrogate.calibrate(f, d, noise=1e-100), "noise = 1e-100 must lie between"),
        (lambda f, d: surrogate.uncertainty(f, {"box": stats.gamma}, samples=2), "box: ppf of .* with its numbers"),
    ],
)
def test_studies(call, words, family):
    t = np.linspace(0, 1e-5, 60)
    data = th.dataset.build(t, MODEL.response(th.Constant(1e-3), t), th.Constant(1e-3))
    with pytest.raises(th.InputError, match=words):
        call(family, data)


def test_a_system_without_a_static_state_has_no_impedance_there():
    """SciPy's RuntimeError: Factor is exactly singular."""
    loose = th.StateSpace(np.eye(2), [[-1.0, 1], [1, -1]] * np.ones(1), np.array([[1.0], [0]]), np.array([[1.0, 0]]))
    with pytest.raises(th.InputError, match="singular; is a boundary held"):
        loose.impedance([0.0])
    # s = 2 pi i f, of two capacities over one resistance: (1 + s)/(s (2 + s))
    s = 2j * np.pi * 0.1
    assert loose.impedance([0.1])[0] == pytest.approx((1 + s) / (s * (2 + s)), rel=1e-12)


def test_derivatives_of_a_step_long_ago():
    heat = th.assemble(th.strip_ring(outer_radius=30e-6, substrate=10e-6), 0.05)
    with pytest.raises(th.InputError, match="times holds a number beyond"):
        th.derivatives(heat, ["material.SiO2.conductivity"], times=[1e300])


@pytest.mark.parametrize("kind", ["conductivity_law", "specific_heat_law"])
def test_a_law_that_turns_negative_is_named_with_its_temperature(kind):
    def heat_of(law):
        silicon = th.Material("Si", 130.0, 2330.0, 700.0, **{kind: law})
        strip = th.strip_ring(outer_radius=30e-6, substrate=10e-6)
        return th.assemble(dataclasses.replace(strip, materials=(silicon,)), 0.05)

    named = r"the law Polynomial\(coefficients=\(1.0, -1.0\), reference=.* at 29[0-9.]* K; no material property"
    with pytest.raises(th.InputError, match=named):
        heat_of(th.Polynomial((1, -1)))  # at the ambient temperature already
    with pytest.raises(th.InputError, match=named):
        th.solve(heat_of(th.Polynomial((1, -1), 293.0)), th.Constant(1e-3), [1e-8, 1e-6])
    with pytest.raises(th.InputError, match="polynomial: largest coefficient = 100000 must lie between 0 and 10"):
        th.Polynomial((1e5,))


@pytest.mark.parametrize("sparse", [False, True])
def test_the_arrays_of_a_state_space_are_read_only(sparse):
    from scipy.sparse import csc_matrix

    kind = csc_matrix if sparse else np.array
    given = kind([[1e-9]])
    model = th.StateSpace(given, kind([[-1e-4]]), ONE, ONE)
    for kept in (model.E, model.A, model.B, model.C):
        with pytest.raises(ValueError, match="read-only"):
            kept[0, 0] = 1.0
    given[0, 0] = 2.0  # the caller's own array
    assert model.E[0, 0] == 1e-9


def test_a_thousand_splitters_take_no_time():
    splitters = [coupled.Splitter(f"s{k}") for k in range(1000)]
    laser = coupled.LaserPort("in", "ring 1.in")
    circuit = coupled.Circuit([coupled.borghi2021()], lasers=[laser], splitters=splitters)
    begin = time.perf_counter()
    found = coupled.transmission(circuit, detuning=[0.0, 1e9])
    assert time.perf_counter() - begin < 5
    assert found.transmission.sum("port").max() <= 1


LONG = np.broadcast_to(np.float64(1e-4), 50_000_000)  # one number in memory


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (
            lambda: coupled.power_for_drop(coupled.borghi2021(), MODEL, drop=LONG, detuning=0.0),
            "hold 50000000 values; 1 to 20,000,000",
        ),
        (
            lambda: coupled.sweep(coupled.borghi2021(), MODEL, power=1e-3, detuning=LONG),
            "detuning holds 50000000 numbers; at most 1,0",
        ),
        (
            lambda: coupled.transmission(coupled.bus([coupled.borghi2021()] * 2), detuning=LONG),
            "detunings holds 50000000 numbers; at most 1,000,000",
        ),
        (
            lambda: coupled.carrier_decay(coupled.borghi2021().carriers, 1e23, LONG),
            "times holds 50000000 numbers; at most 20,000,000",
        ),
        (lambda: MODEL.impedance(LONG), "frequency holds 50000000 numbers; at most 20,000,000"),
        (
            lambda: surrogate.period_error(MODEL, MODEL, np.geomspace(1e-7, 1e-5, 200_000)),
            "periods holds 200000 values",
        ),
    ],
)
def test_arrays_that_would_take_hours_or_the_memory_are_refused(function, words):
    with pytest.raises(th.InputError, match=words):
        function()


def test_a_long_impedance_is_worked_out_in_pieces():
    f = np.geomspace(1, 1e9, 6_000_000)
    one = MODEL.impedance(f)
    assert one.shape == f.shape
    np.testing.assert_array_equal(one[::100_000], MODEL.impedance(f[::100_000]))
