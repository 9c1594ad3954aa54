"""Quadratic identification: a known network is found again, what is unsound is refused, extrapolation warns."""

import numpy as np
import pytest
from chain import CHAIN, POWER, TIMES, WAVES, N, dataset, known

import surrogate
import thermofem as th


@pytest.fixture(scope="module")
def data():
    return [dataset(w) for w in WAVES]


@pytest.fixture(scope="module")
def fitted(data):
    return surrogate.fitting.sindy.fit_sindy_quadratic(data, **known())


def test_a_known_network_is_found_again(fitted):
    model = fitted.model
    # test functions of 30 ns against a fastest time constant of 11 ns: measured 1 % on A of the core's equation
    assert model.A[0, :2] == pytest.approx(CHAIN.A[0, :2], rel=0.03)
    assert model.B[0] == pytest.approx(CHAIN.B[0], rel=0.03)
    assert fitted.relative_residual < 2e-3
    fresh = th.Telegraph(POWER, 1e-7, 1e-5, seed=5)
    exact = CHAIN.response(fresh, TIMES[:6000])
    assert np.sqrt(np.mean((model.response(fresh, TIMES[:6000]) - exact) ** 2)) < 3e-3 * np.ptp(exact)
    linear = th.Quadratic(CHAIN.A, 0 * CHAIN.H, 0 * CHAIN.G, CHAIN.B, CHAIN.C).response(fresh, TIMES[:6000])
    assert np.sqrt(np.mean((linear - exact) ** 2)) > 1e-2 * np.ptp(exact)  # the squares are needed


@pytest.mark.slow
def test_the_network_keeps_where_it_comes_from(data):
    for first, geometry in (("a ring", "a ring"), ("another", None)):  # one geometry of all data, or none
        named = [d.assign_attrs(geometry=g) for d, g in zip(data, [first, *["a ring"] * (len(data) - 1)], strict=True)]
        model = surrogate.fitting.sindy.fit_sindy_quadratic(named, **known()).model
        assert model.origin["method"].startswith("SINDy")
        assert model.origin["geometry"] == geometry


def test_both_steady_states_are_exact(fitted):
    assert fitted.model.thermal_resistance == pytest.approx(CHAIN.thermal_resistance, rel=1e-6)
    assert fitted.model.steady_rise(POWER) == pytest.approx(CHAIN.steady_rise(POWER), rel=1e-6)


def test_only_neighbours_are_coupled_and_the_core_alone_is_heated(fitted):
    model = fitted.model
    assert model.A[0, 3] == model.A[3, 0] == 0
    assert np.count_nonzero(model.G) == np.count_nonzero(model.B) == 1
    off = model.H.copy()
    off[:, range(N), range(N)] = 0
    assert not off.any()
    assert model.H[0, 2, 2] == 0
    assert fitted.parameters["H_1_1_1"] == model.H[0, 0, 0]
    assert fitted.equations[3].startswith("dT[far]/dt = +")
    assert "T[core] P" in fitted.equations[0]
    assert " P" not in fitted.equations[1]


def test_it_warns_beyond_its_training(fitted):
    with pytest.warns(th.models.OutsideTrainingWarning, match="its training reached"):
        fitted.model.response(th.Constant(2 * POWER), [1e-5])


def test_noise_is_refused(data):
    draw = np.random.default_rng(1)
    noisy = [d.assign(delta_T=d.delta_T + 10 * draw.standard_normal(d.delta_T.shape)) for d in data]
    with pytest.raises(th.InputError, match="refused"):
        surrogate.fitting.sindy.fit_sindy_quadratic(noisy, **known())


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"static": [1.0]}, "static has shape"),
        ({"steady": [1.0, -1.0, 1.0, 1.0]}, "smallest steady = -1 must be positive"),
        ({"power": 0.0}, "power"),
        ({"window": 1.0}, "window"),
        ({"steady": 2 * CHAIN.steady_state(POWER)}, "refused|settles|no steady"),
    ],
)
def test_what_does_not_fit_the_data_is_named(data, change, reason):
    with pytest.raises(th.InputError, match=reason):
        surrogate.fitting.sindy.fit_sindy_quadratic(data[0], **{**known(), **change})


def test_datasets_must_share_probes_and_times(data):
    with pytest.raises(th.InputError, match="same probes and times"):
        surrogate.fitting.sindy.fit_sindy_quadratic([data[0], data[1].isel(time=slice(0, 4000))], **known())
