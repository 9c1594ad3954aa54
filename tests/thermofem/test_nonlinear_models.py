"""Output map and quadratic system: exact solutions, run-away refused, files."""

import numpy as np
import pytest
from models import quadratic

import surrogate
import thermofem as th

POLE = th.Foster(R=[7800.0], tau=[1e-6])


def test_equal_poles_have_a_step_response_and_an_impedance():
    """A cascade of equal poles has no basis of eigenvectors: their matrix is singular."""
    A = 1e6 * (np.diag([1.0, 1.0], -1) - np.eye(3))
    model = th.Quadratic(A, np.zeros((3, 3, 3)), np.zeros((3, 3)), [1e10, 0.0, 0.0], [0.0, 0.0, 1.0])
    t, f = np.geomspace(1e-7, 1e-2, 20), np.array([0.0, 1e5, 1e6])
    x = 1e6 * t  # Erlang's distribution
    assert model.step_response(t) == pytest.approx(1e4 * (1 - np.exp(-x) * (1 + x + x * x / 2)), rel=1e-8)
    assert model.impedance(f) == pytest.approx(1e4 / (1 + 2j * np.pi * f / 1e6) ** 3, rel=1e-12)


def test_powers_that_are_no_numbers_are_refused():
    """nan and text, in one line."""
    for call in (th.OutputMap(POLE, -4e-4).steady_rise, logistic().steady_state, logistic().steady_rise):
        for power in (np.nan, "1 mW"):
            with pytest.raises(th.InputError, match="power"):
                call(power)


def logistic(k: float = 2e-3) -> th.Quadratic:
    """dx/dt = -l x + h x^2 + l R P: a Riccati equation, solved by tanh."""
    return th.Quadratic([[-1e6]], [[[k * 1e6]]], [[0.0]], [7.8e9], [1.0])


def riccati(k, power, t):
    """Rise from rest: the roots of k x^2 - x + R P are a < b, x = a b (1 - e)/(b - a e), e = exp(-k l (b - a) t)."""
    root = np.sqrt(1 - 4 * k * 7800 * power)
    a, b = (1 - root) / (2 * k), (1 + root) / (2 * k)
    e = np.exp(-k * 1e6 * (b - a) * t)
    return a * b * (1 - e) / (b - a * e)


def test_quadratic_solves_the_riccati_equation():
    t = np.geomspace(1e-9, 2e-5, 50)
    rise = logistic().response(th.Constant(10e-3), t)
    # LSODA at 1e-8 a step accumulates to 1e-6 of the largest rise at most
    assert rise == pytest.approx(riccati(2e-3, 10e-3, t), rel=0, abs=1e-6 * rise.max())
    assert logistic().steady_rise(10e-3) == pytest.approx(riccati(2e-3, 10e-3, 1.0), rel=1e-12)


def test_power_times_state_changes_the_rate():
    """dx/dt = -(l + g P) x + l R P at constant power: one pole of rate l + g P."""
    model = th.Quadratic([[-1e6]], [[[0.0]]], [[-2e7]], [7.8e9], [1.0])
    rate = 1e6 + 2e7 * 10e-3
    t = np.linspace(0, 5e-6, 21)
    exact = 7.8e9 * 10e-3 / rate * -np.expm1(-rate * t)
    assert model.response(th.Constant(10e-3), t) == pytest.approx(exact, rel=0, abs=1e-6 * exact.max())
    wave = th.SquareWave(10e-3, 2e-6, 0.4)
    top = 7.8e9 * 10e-3 / rate * -np.expm1(-rate * 0.8e-6) / -np.expm1(-rate * 0.8e-6 - 1e6 * 1.2e-6)
    end_of_pulse = np.argmin(np.abs(th.waveforms.period_times(wave, 41) - 0.8e-6))
    assert model.periodic_response(wave, 41)[end_of_pulse] == pytest.approx(top, rel=1e-6)


def test_periodic_state_of_a_warm_quadratic_is_what_a_train_settles_to():
    model, wave = quadratic(), th.SquareWave(15e-3, 1e-6, 1 / 3)
    periodic = model.periodic_response(wave, 31)
    settled = model.response(wave, 150e-6 + th.waveforms.period_times(wave, 31))  # exp(-150/10) = 3e-7 of the rise
    assert np.ptp(periodic) > 10
    assert periodic == pytest.approx(settled, rel=0, abs=3e-6 * periodic.max())
    linear = th.Foster(R=[1000.0, 4000.0, 3000.0], tau=[5e-8, 5e-7, 1e-5]).periodic_response(wave, 31)
    assert np.abs(linear - periodic).max() > 0.015 * periodic.max()  # that is not the linear answer


def test_a_model_that_runs_away_says_so():
    with pytest.raises(th.InputError, match="runs away"):
        logistic().response(th.Constant(1.0), [1e-5])
    with pytest.raises(th.InputError, match="no steady state"):
        logistic().steady_rise(1.0)


def test_output_map_is_applied_after_the_linear_model():
    model = th.OutputMap(POLE, -4e-4)
    z = POLE.response(th.Pulse(20e-3, 1e-6), [0.5e-6, 1e-6, 3e-6])
    assert model.response(th.Pulse(20e-3, 1e-6), [0.5e-6, 1e-6, 3e-6]) == pytest.approx(z - 4e-4 * z**2, rel=1e-14)
    assert model.steady_rise([0.0, 20e-3]) == pytest.approx([0.0, 156 - 4e-4 * 156**2], rel=1e-14)
    with pytest.raises(th.InputError, match="beyond the top"):
        model.steady_rise(0.2)


def test_models_warn_beyond_their_training():
    for model in (th.OutputMap(POLE, -4e-4, largest_rise=20.0), th.Quadratic(*parts(logistic()), largest_rise=20.0)):
        assert model.response(th.Constant(2e-3), [1e-5]) == pytest.approx([15.6], rel=0.05)
        with pytest.warns(th.models.OutsideTrainingWarning, match="its training reached 20 K"):
            model.response(th.Constant(10e-3), [1e-5])
        with pytest.warns(th.models.OutsideTrainingWarning):
            model.periodic_response(th.SquareWave(10e-3, 1e-5, 0.5), 21)
        assert model.steady_rise([0.0, 2e-3]).max() == pytest.approx(15.6, rel=0.05)
        with pytest.warns(
            th.models.OutsideTrainingWarning, match="its training reached 20 K"
        ):  # steady_rise was silent
            model.steady_rise(10e-3)


def parts(model):
    return model.A, model.H, model.G, model.B, model.C


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"A": [[1.0]]}, "must decay"),
        ({"B": [np.nan]}, "not finite"),
        ({"inputs": ("core", "heater")}, "one of each"),
        ({"largest_rise": -1.0}, "must be positive"),
    ],
)
def test_what_is_no_quadratic_model_is_refused(change, reason):
    fields = dict(zip("AHGBC", parts(logistic()), strict=True))
    with pytest.raises(th.InputError, match=reason):
        th.Quadratic(**{**fields, **change})


def test_a_file_of_a_network_that_the_gate_refuses_is_refused(tmp_path):
    A, b = np.array([[-2e6, 1e6], [1e6, -2e6]]), np.array([1e10, 0.0])
    net = th.models.Network(A, b, ("core", "shell"), th.models.gate(A, b, 2e4 / 3), 12.0)
    path = surrogate.save_model(net, tmp_path / "n.json")
    path.write_text(path.read_text().replace("-2000000.0", "2000000.0"))
    with pytest.raises(th.InputError, match="not stable"):
        surrogate.load_model(path)


def test_the_jacobian_is_the_derivative_of_the_rate():
    model, x, step = quadratic(), np.array([5.0, 40.0, 30.0]), 1e-3
    columns = [(model.rate(x + step * e, 0.01) - model.rate(x - step * e, 0.01)) / (2 * step) for e in np.eye(3)]
    # central differences of a quadratic are exact: round-off 1e-16 rate/step
    assert model.jacobian(x, 0.01) == pytest.approx(np.array(columns).T, rel=1e-9, abs=1e-3)


def test_the_start_alone_is_at_rest():
    """The integrator is not called for it."""
    for times in (0.0, [0.0], [0.0, 0.0]):
        found = quadratic().response(th.Constant(1e-3), times)
        assert found.shape == np.shape(times)
        assert not found.any()
