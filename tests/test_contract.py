"""Every thermal model keeps the numbered contract of thermofem.models.contract."""

from __future__ import annotations

import numpy as np
import pytest
from models import MODELS
from scipy.sparse import csc_matrix

import surrogate
import thermofem as th
from thermofem.models import NonlinearSystem, foster
from thermofem.waveforms import period_times

# Closed forms agree to round-off; the FEM integrates to its default rtol of 1e-5 of the largest rise.
TOLERANCE = 1e-5


def linear(model) -> bool:
    """Whether the model is linear; the FEM with k(T) has no dynamics to ask."""
    if isinstance(model, NonlinearSystem):
        return False
    return isinstance(model, th.StateSpace) or isinstance(model.dynamics, th.Foster)


@pytest.fixture(params=MODELS, scope="module")
def model(request):
    return MODELS[request.param]()


@pytest.fixture(scope="module")
def slowest(model):
    """Long after every transient: the slowest time constant of the list is about 12 us and exp(-160/12) = 2e-6."""
    return 160e-6


@pytest.fixture(scope="module")
def power(model):
    """W; small where the model is not linear: a rise of 0.8 mK moves k by less than 1e-5 of itself."""
    return 2e-3 if linear(model) else 1e-7


def test_names_one_input_and_one_output(model):
    assert model.inputs == ("core",)
    assert model.outputs == ("core",)


def test_step_response_rises_monotonically_to_the_thermal_resistance(model, slowest):
    times = np.append(np.geomspace(1e-9, 50e-6, 40), slowest)
    step = model.step_response(times)
    assert np.all(np.diff(step) > -TOLERANCE * model.thermal_resistance)  # heat on: never cools (passive)
    assert step[0] > 0
    assert step[-1] == pytest.approx(model.thermal_resistance, rel=2 * TOLERANCE)


def test_impedance_begins_at_the_thermal_resistance_and_falls(model):
    z = model.impedance(np.array([0.0, 1e5, 1e6, 1e7, 1e8]))
    assert z[0] == pytest.approx(model.thermal_resistance, rel=1e-9)  # one linear solve against another
    assert np.all(np.diff(np.abs(z)) < 0)
    assert np.all(z.imag[1:] < 0)  # a passive network lags


def test_response_to_a_constant_is_the_step_response(model, power):
    times = np.geomspace(1e-9, 20e-6, 25)
    response = model.response(th.Constant(power), times)
    assert response == pytest.approx(power * model.step_response(times), rel=0, abs=TOLERANCE * response.max())


def test_pulse_is_the_difference_of_two_steps(model, power):
    times = np.linspace(0, 9e-6, 91)
    pulse = model.response(th.Pulse(power=power, width=3e-6, start=1e-6), times)
    steps = [model.step_response(np.maximum(times - start, 0)) for start in (1e-6, 4e-6)]
    assert pulse == pytest.approx(
        power * (steps[0] - steps[1]), rel=0, abs=2 * TOLERANCE * power * model.thermal_resistance
    )


def test_periodic_state_is_what_a_long_train_settles_to(model, slowest, power):
    wave = th.SquareWave(power=power, period=40e-6, duty=0.3)  # exp(-40/12) of a period is left for the next
    times = period_times(wave, 41)
    cycles = int(slowest / wave.period)
    settled = model.response(wave, cycles * wave.period + times)
    periodic = model.periodic_response(wave, 41)
    assert settled == pytest.approx(periodic, rel=0, abs=3 * TOLERANCE * periodic.max())
    assert periodic[0] == pytest.approx(periodic[-1], rel=0, abs=2 * TOLERANCE * periodic.max())


def test_periodic_state_has_the_fourier_component_of_the_impedance(model, power):
    """Mean = R_th x mean power, and the first harmonic of the rise = Z(1/T) x that of the power."""
    wave = th.SquareWave(power=power, period=1e-6, duty=0.3)
    n = 4001
    rise = model.periodic_response(wave, n)[:-1]
    harmonic = np.exp(-2j * np.pi * np.arange(n - 1) / (n - 1))
    # trapezoids over a continuous rise with kinks: error (pi/n)^2 of the swing, far below 1e-4
    assert rise.mean() == pytest.approx(model.thermal_resistance * 0.3 * power, rel=1e-4)
    power = power * (1 - np.exp(-2j * np.pi * 0.3)) / (2j * np.pi)
    assert abs(np.mean(rise * harmonic) / (model.impedance(1e6) * power) - 1) < 1e-4


def test_a_20_ns_pulse_at_50_us_is_not_missed(model, power):
    pulse = th.Pulse(power=power, width=20e-9, start=50e-6)
    late = model.response(pulse, [49e-6, 50.02e-6, 60e-6])
    assert late[0] == 0
    assert late[1] == pytest.approx(power * model.step_response(20e-9), rel=5e-5)


def test_response_keeps_the_shape_of_the_times(model):
    assert model.step_response(1e-6).shape == ()
    assert model.impedance([1e6, 2e6]).shape == (2,)


def test_times_may_have_any_order_and_shape(model, power):
    """Every kind takes them."""
    times = np.array([[3e-6, 1e-7, 0.0], [1e-6, 3e-6, 2e-5]])
    order = np.argsort(times, axis=None)
    for ask in (model.step_response, lambda t: model.response(th.Pulse(power, 1e-6, 5e-7), t)):
        # other times, other steps where a model is stepped
        np.testing.assert_allclose(ask(times).ravel()[order], ask(times.ravel()[order]), rtol=1e-12)
    assert model.step_response([-1e-6, 1e-6]).tolist() == [0.0, model.step_response([0.0, 1e-6])[1]]
    assert model.step_response([]).size == 0
    for times, words in (([-1e-9, 1e-6], "times"), ([], "non-empty")):
        with pytest.raises(th.InputError, match=words):
            model.response(th.Constant(power), times)


@pytest.mark.parametrize("ask", ["step_response", "impedance"])
def test_what_is_not_finite_is_refused(model, ask):
    with pytest.raises(th.InputError, match="not finite"):
        getattr(model, ask)([1e-6, np.nan])


SKEW = np.array([[2.0, 0.5], [0.0, 1.0]])
NO_HEAT_FLOW = {
    "A is not symmetric": {"A": -SKEW},
    "E is not symmetric": {"E": SKEW},
    "E is not positive definite|E.*positive": {"E": np.diag([1.0, -1.0])},
    "-A is not positive definite|decay|positive|a mode grows": {"A": np.diag([-2.0, 1.0])},
    "singular|decay|positive": {"A": np.array([[-1.0, 1.0], [1.0, -1.0]])},
    r"E.* = nan is not finite": {"E": np.array([[1.0, np.nan], [np.nan, 1.0]])},
    "B = inf": {"B": np.array([[np.inf], [-np.inf]])},
}
USES = {
    "poles": foster,
    "gain": lambda system: system.thermal_resistance,
    "periodic": lambda system: system.periodic_response(th.SquareWave(1e-3, 1e-6, 0.3), 5),
    "reduction": surrogate.reduce,
    "truncation": lambda system: surrogate.balanced_truncation(system, 1),
}


@pytest.mark.parametrize("reason", NO_HEAT_FLOW)
@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("stored", [np.asarray, csc_matrix], ids=["dense", "sparse"])
def test_matrices_that_are_not_those_of_heat_flow_are_refused(reason, use, stored):
    """5333 K/W for 4444 from one triangle of a skew matrix, and -4000 K/W that grew without end."""
    parts = {"E": np.eye(2), "A": -np.eye(2), "B": np.ones((2, 1)), "C": np.ones((1, 2)), **NO_HEAT_FLOW[reason]}
    with pytest.raises(th.InputError, match=reason):
        USES[use](th.StateSpace(**{name: stored(matrix) if name in "EA" else matrix for name, matrix in parts.items()}))


def test_a_stiff_system_in_mixed_coordinates_is_still_one_of_heat_flow():
    """Twelve decades of time constants: the check of definiteness allows for round-off."""
    tau, mix = np.geomspace(1e-12, 1.0, 6), np.random.default_rng(1).normal(size=(6, 6))
    system = th.StateSpace(mix.T @ np.diag(tau) @ mix, -mix.T @ mix, mix.T @ np.ones((6, 1)), np.ones((1, 6)) @ mix)
    assert system.thermal_resistance == pytest.approx(6.0, rel=1e-9)
    assert system.step_response(100.0) == pytest.approx(6.0, rel=1e-5)


def test_what_is_kept_shares_no_memory_with_what_was_given():
    """No waveform or model keeps the array itself, and changes with it."""
    two, eye = np.array([1.0, 2.0]), np.eye(2)
    for kind, *given in (
        (th.Sampled, two, two),
        (th.waveforms.PiecewiseCubic, two, np.ones((1, 4))),
        (th.models.cauer.Cauer, two, two),
        (th.StateSpace, eye, -eye, two[:, None], two[None]),
        (th.Quadratic, -eye, np.zeros((2, 2, 2)), np.zeros((2, 2)), two, two),
    ):
        kept = [value for value in vars(kind(*given)).values() if isinstance(value, np.ndarray)]
        assert kept
        assert not any(np.shares_memory(a, b) for a in kept for b in given)
