"""The paper's lumped models trained on our FEM."""

from __future__ import annotations

import numpy as np
import pytest

import surrogate
import thermofem as th

# Trained on the periodic state, 2 mW and 33 %, of the same ring with a far larger domain (R_th 7.886 K/mW) by an
# independent code; parameters move by under 1 % with the domain and the mesh, 2 % is the stated margin.
NEWTON = {
    1.0e-6: (445e-9, 7.64),
    0.8e-6: (409e-9, 6.95),
}  # tau_th, c_p over silicon's; the paper's own fit: 417 ns, 6.9


@pytest.fixture(scope="module", params=NEWTON, ids=["1 us", "0.8 us"])
def square(request):
    heat = th.assemble(th.strip_ring())
    return request.param, th.solve_periodic(heat, th.SquareWave(2e-3, request.param, 0.33))


def test_newton_needs_a_specific_heat_seven_times_too_large(square, validated):
    period, data = square
    fit = surrogate.fit_newton(data)
    tau, ratio = NEWTON[period]
    source = "prototype" + ("; the paper's fit to its experiment: 417 ns, 6.9" if period == 0.8e-6 else "")
    for what, name, value, scale, unit in (
        ("time constant", "tau_th", tau, 1e9, "ns"),
        ("specific heat over silicon's", "heat_capacity_ratio", ratio, 1, ""),
    ):
        what = f"{what} of Newton's law trained on a square of {period * 1e6:g} us"
        ours = fit.parameters[name] * scale
        validated("Compact models", what, ours, value * scale, rel=0.02, unit=unit, source=source)
    assert fit.residual > 8 * surrogate.fit_second_order(data).residual


TRUE = {"kappa": 8.87e5, "tau_f": 55.8e-9, "tau_s": 1200e-9, "eta": 0.31}  # the paper's FEM-trained set


@pytest.mark.parametrize("periodic", [False, True])
def test_training_recovers_the_model_that_made_the_data(periodic):
    model, wave = surrogate.second_order(**TRUE), th.SquareWave(2e-3, 1e-6, 1 / 3)
    if periodic:
        times = th.waveforms.period_times(wave, 301)
        rise = model.periodic_response(wave, 301)
    else:
        times = np.linspace(0, 6e-6, 1201)
        rise = model.response(wave, times)
    fit = surrogate.fit_second_order(th.dataset.build(times, rise, wave, periodic=periodic))
    for name, value in TRUE.items():
        assert fit.parameters[name] == pytest.approx(
            value, rel=1e-6, abs=0
        )  # exact data: as far as least squares converges
    assert fit.residual < 1e-8


def test_several_datasets_are_weighted_by_their_swing():
    """A small drive counts as much as a large one: scaling one dataset's power and rise changes nothing."""
    heat = th.assemble(th.strip_ring())
    short, long = (th.solve_periodic(heat, th.SquareWave(2e-3, T, 0.33), 101) for T in (0.5e-6, 2e-6))
    weak = th.solve_periodic(heat, th.SquareWave(2e-5, 2e-6, 0.33), 101)
    one, two = surrogate.fit_second_order([short, long]), surrogate.fit_second_order([short, weak])
    for name, value in one.parameters.items():
        assert two.parameters[name] == pytest.approx(value, rel=1e-3, abs=0)  # rtol of the two solves
    assert len(one.training) == 2


def test_mapping_of_the_second_order_equation():
    """Eq. 3 itself: its transfer function (kappa + eta s)/(m c_p)/((s + 1/tau_f)(s + 1/tau_s)) at any frequency."""
    model, capacity = surrogate.second_order(**TRUE), th.models.BORGHI2021_HEAT_CAPACITY
    f = np.array([0, 1e4, 1e6, 3e7])
    s = 2j * np.pi * f
    equation = (TRUE["kappa"] + TRUE["eta"] * s) / capacity / ((s + 1 / TRUE["tau_f"]) * (s + 1 / TRUE["tau_s"]))
    assert np.allclose(model.impedance(f), equation, rtol=1e-12)
    assert model.thermal_resistance == pytest.approx(
        TRUE["kappa"] * TRUE["tau_f"] * TRUE["tau_s"] / capacity, rel=1e-12
    )
    shares = model.gain * capacity
    assert shares == pytest.approx([0.273210, 0.0367904], rel=1e-5)  # c_f, c_s of that set


def test_decay_recovers_two_exponentials():
    t = np.linspace(0, 20e-6, 400)
    found = surrogate.fit_decay(t, 9 * np.exp(-t / 0.3e-6) + 6 * np.exp(-t / 5e-6))
    assert found.tau == pytest.approx([0.3e-6, 5e-6], rel=1e-6, abs=0)
    assert found.amplitude == pytest.approx([9, 6], rel=1e-6, abs=0)


@pytest.mark.parametrize("tau", [(3e-8, 1e-6), (1e-8, 3e-6), (1e-8, 1e-7, 1e-6), (1.46e-8, 4.25e-8, 2.15e-6, 8.92e-6)])
def test_decay_of_samples_spread_over_decades(tau):
    """One start from the length of the record ends at 20 ps and 298 ns, or in an error of LAPACK."""
    t = np.append(0, np.geomspace(1e-9, 1e-4, 200))
    found = surrogate.fit_decay(t, np.exp(-t[:, None] / np.array(tau)).sum(axis=1), order=len(tau))
    assert found.tau == pytest.approx(tau, rel=1e-5, abs=0)


def test_a_decay_says_what_its_samples_leave_open():
    """One pole fitted with two, of which one is anything from 1.25 ns to 1 us, and pure noise."""
    t, noise = np.linspace(0, 5e-6, 500), np.random.default_rng(1).standard_normal(500)
    one = 8 * np.exp(-t / 1e-6) + 0.02 * noise
    assert surrogate.fit_decay(t, one, order=1).notes == ()
    assert surrogate.fit_decay(t, one + 5 * np.exp(-t / 1e-7)).notes == ()
    assert "the data do not determine tau" in " ".join(surrogate.fit_decay(t, one).notes)
    assert "is an extrapolation" in " ".join(surrogate.fit_decay(t, 8 * np.exp(-t / 4e-5), order=1).notes)
    with pytest.raises(th.InputError, match="it is noise"):
        surrogate.fit_decay(t, noise)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda d: surrogate.fit_newton(d.drop_vars("delta_T")), "no 'delta_T'"),
        (lambda d: surrogate.second_order(kappa=8.87e5, tau_f=1e-6, tau_s=1e-7, eta=0.31), "are they swapped"),
        (lambda d: surrogate.second_order(kappa=8.87e-4, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31), "8.87e5 1/s"),
        (lambda d: surrogate.newton(tau_th=-1e-9), "tau_th = -1e-09 must be positive"),
        (lambda d: surrogate.fit_decay(1 + 1e-6 * np.arange(9), np.exp(-np.arange(9))), r"times\[0\] = 1 must lie"),
        (lambda d: surrogate.fit_decay(1e-6 * np.arange(9), np.ones(9)), "a cooling curve falls"),
    ],
)
def test_bad_input(call, words):
    model, wave = surrogate.newton(tau_th=275e-9), th.Constant(1e-3)
    times = np.linspace(0, 1e-6, 11)
    with pytest.raises(th.InputError, match=words):
        call(th.dataset.build(times, model.response(wave, times), wave))


def test_a_thermal_resistance_other_than_that_of_the_data_is_told():
    """Newton's law trained on a pulse of 1 us has half of it; a Foster network has it, as it is imposed."""
    data = th.solve(th.assemble(th.strip_ring()), th.Pulse(2e-3, 1e-6), np.linspace(1e-8, 3e-6, 300))
    newton, foster = surrogate.fit_newton(data), surrogate.fit_foster(data)
    assert newton.model.thermal_resistance < 0.9 * data.attrs["thermal_resistance"]
    (note,) = [note for note in newton.notes if "R_th" in note]
    assert "where the data state 7.86 K/mW" in note
    assert not [note for note in foster.notes if "R_th" in note]


def test_more_than_one_period_of_a_periodic_state_is_refused():
    """The closed forms hold for one period: beyond it a linear answer has an output map of 0.015 /K."""
    wave, model = th.SquareWave(1e-3, 1e-6, 0.5), th.Foster([2e3, 5e3], [5e-8, 1e-6])
    one, rise = th.waveforms.period_times(wave, 101), model.periodic_response(wave, 101)
    twice, rises = np.append(one[:-1], 1e-6 + one), np.append(rise[:-1], rise)
    with pytest.raises(th.InputError, match="times runs to 2e-06 s; a periodic state is one period of 1e-06 s"):
        th.dataset.build(twice, rises, wave, periodic=True)
    data = th.dataset.build(twice, rises, wave).assign_attrs(kind="periodic")
    with pytest.raises(th.InputError, match=r"data\.time runs to 2e-06 s"):
        surrogate.fit_foster(data, 2)
