"""How many poles a record shows, whether its misfit is noise, and what lies outside a fit's reach; synthetic truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import surrogate
import thermofem as th

TIMES = np.geomspace(1e-8, 2e-4, 400)
STEP = th.Constant(1e-3)
POLES = ([1e3, 2e3, 4e3], [5e-8, 1e-6, 2e-5])


def record(order, noise, seed=0):
    y = th.Foster(R=POLES[0][:order], tau=POLES[1][:order]).response(STEP, TIMES)
    return th.dataset.build(TIMES, y + noise * np.random.default_rng(seed).standard_normal(y.size), STEP)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("noise", [0.0, 0.01])  # K, of a swing of 1 to 7 K
def test_the_smallest_order_that_leaves_noise_is_that_of_the_truth(order, noise):
    fit = surrogate.fit_foster(record(order, noise), order="auto")
    assert fit.model.order == order
    assert fit.misfit_is_noise
    if noise:
        for k in range(order):
            error = fit.parameters[f"tau_{k + 1}"] - POLES[1][k]
            assert abs(error) < 4 * fit.standard_errors[f"tau_{k + 1}"]  # one of 16000 standard normal numbers


def test_one_pole_too_few_leaves_more_than_noise():
    assert not surrogate.fit_foster(record(3, 0.01), order=2).misfit_is_noise


def test_rows_at_rest_tell_what_noise_is(tmp_path):
    """Noise that is correlated from row to row is noise where the rows before the edge show the same."""
    t = (np.arange(1200) - 400) * 2e-8
    white = np.random.default_rng(2).standard_normal(t.size + 1)
    slow = 0.02 * np.convolve(white, np.ones(2) / np.sqrt(2), "valid")
    y = np.where(t > 0, th.Foster(R=[5e3], tau=[1e-6]).response(STEP, np.clip(t, 0, None)), 0.0) + slow
    np.savetxt(tmp_path / "t.csv", np.column_stack([t, y]), delimiter=",", header="t (s),T (K)", comments="")
    assert surrogate.fit_newton(th.read_trace(tmp_path / "t.csv", 1e-3)).misfit_is_noise


@pytest.mark.parametrize("stays", [0.5, 0.9])
@pytest.mark.parametrize("order", [1, 2])
def test_noise_behind_a_filter_is_noise_without_rows_at_rest(order, stays):
    """Noise e_k = stays e_(k-1) + white, and the true poles; one pole too few is more than noise."""
    t = np.arange(1, 10_001) * 1e-8
    heat = th.Foster(R=[3e3, 2e3][:order], tau=[1e-5, 1e-6][:order])
    noise = lfilter([np.sqrt(1 - stays**2)], [1, -stays], np.random.default_rng(4).standard_normal(t.size + 500))[500:]
    data = th.dataset.build(t, heat.response(STEP, t) + 0.05 * noise, STEP)
    fit = surrogate.fit_foster(data, order="auto")
    assert fit.model.order == order
    assert fit.misfit_is_noise
    if order == 2:
        assert not surrogate.fit_foster(data, order=1).misfit_is_noise


def test_results_of_a_fit_of_a_slow_device_are_taken():
    t = np.linspace(0, 240, 200)
    data = th.dataset.build(t, 2 * -np.expm1(-t / 40), th.Constant(1.0))
    found = surrogate.fit_newton(data).parameters
    model = surrogate.newton(tau_th=found["tau_th"], heat_capacity=found["heat_capacity"])
    assert model.thermal_resistance == pytest.approx(2.0, rel=1e-6)  # exact rows
