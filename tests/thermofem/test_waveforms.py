"""Waveforms know their edges and their exact means."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

import thermofem as th
from thermofem.algebra.pole_responses import pole_responses
from thermofem.piecewise import bounds
from thermofem.waveforms import from_json, period_times, to_json

SAW = th.Sampled([0, 1e-6, 1e-6, 3e-6], [0, 2e-3, 1e-3, 0], repeat=True)
WAVES = [
    th.Constant(2e-3),
    th.Pulse(2e-3, width=1.5e-6, start=0.4e-6),
    th.SquareWave(2e-3, period=0.7e-6, duty=1 / 3),
    th.Sampled([0, 1e-6, 1e-6, 9e-6], [0, 2e-3, 1e-3, 0]),
    SAW,
]
spans = st.tuples(st.floats(0, 8e-6), st.floats(1e-9, 1e-6)).map(lambda s: (s[0], s[0] + s[1]))


@pytest.mark.parametrize("wave", WAVES, ids=lambda w: type(w).__name__)
@given(span=spans)
def test_mean_is_the_integral_over_the_straight_pieces(wave, span):
    lines = wave.pieces(*span)
    integral = np.sum(np.diff(lines.edges) * (lines.coefficients[:, 0] + lines.ends)) / 2
    # a piece shorter than 1e-12 of t is merged with its neighbour, so allow that share of the peak power
    assert wave.mean(*span) * (span[1] - span[0]) == pytest.approx(integral, rel=1e-9, abs=2e-3 * 1e-11 * span[1])


@pytest.mark.parametrize("wave", WAVES, ids=lambda w: type(w).__name__)
@given(span=spans)
def test_between_breakpoints_the_power_is_straight(wave, span):
    edges = np.concatenate([[span[0]], wave.breakpoints(*span), [span[1]]])
    for start, stop in itertools.pairwise(edges):
        t = start + (stop - start) * np.array([0.1, 0.5, 0.9])
        p = wave(t)
        assert p[1] == pytest.approx((p[0] + p[2]) / 2, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("z", [1e-6, 3e-4, 0.999e-3, 1.001e-3, 0.1, 3.0])
def test_a_pole_follows_a_ramp_at_every_ratio_of_its_times(z):
    """x(u) = slope (e^-z - 1 + z)/rate^2 with z = rate u, in extended precision; a series below z = 1e-3."""
    rate, u = 1e7, z / 1e7
    long = np.longdouble(z)
    exact = float(sum((-1) ** k * long**k / math.factorial(k) for k in range(2, 30)))
    got = pole_responses(np.array([rate]), th.Sampled([0.0, 1e-5], [0.0, 1e-3]), [u])[0, 0]
    # the closed form loses 2e-16/(z/2) above 1e-3
    assert got == pytest.approx(1e-3 / 1e-5 * exact / rate**2, rel=1e-12, abs=0)


def test_continuous_from_the_right_and_limit_from_the_left():
    wave = th.SquareWave(2e-3, period=1e-6, duty=0.25)
    assert wave([0.0, 0.25e-6, 1e-6]).tolist() == [2e-3, 0, 2e-3]
    assert wave.before([0.25e-6, 1e-6]).tolist() == [2e-3, 0]
    pulse = th.Pulse(1e-3, width=1e-6, start=1e-6)
    assert pulse([1e-6, 2e-6]).tolist() == [1e-3, 0]
    assert pulse.before([1e-6, 2e-6]).tolist() == [0, 1e-3]
    # the left limits are values of a line: one rounding of 2 mW
    assert SAW([1e-6, 3e-6]) == pytest.approx([1e-3, 0], rel=0, abs=1e-18)
    assert SAW.before([1e-6, 3e-6]) == pytest.approx([2e-3, 0], rel=0, abs=1e-18)


def test_period_times_hold_both_ends_and_every_edge():
    wave = th.SquareWave(2e-3, period=1e-6, duty=0.3137)
    times = period_times(wave, 101)
    assert times.size == 101
    assert times[0] == 0
    assert times[-1] == 1e-6
    assert wave.duty * wave.period in times
    assert np.all(np.diff(times) > 0)


@pytest.mark.parametrize("wave", WAVES, ids=lambda w: type(w).__name__)
def test_json_round_trip(wave):
    again = from_json(to_json(wave))
    t = np.linspace(0, 8e-6, 321)
    assert np.array_equal(again(t), wave(t))
    assert again.period == wave.period


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: th.SquareWave(2e-3, 1e-6, 1.0), "duty"),
        (lambda: th.SquareWave(2e-3, 1e-12, 0.3).breakpoints(0, 1), r"periods of 1e-12 s = 1e\+12"),
        (lambda: th.SquareWave(2.0e3, 1e-6, 0.3), "power"),
        (lambda: th.Sampled([0, 1e-6], [0, float("nan")]), "power"),
        (lambda: th.Sampled([0, 2e-6, 1e-6], [0, 1, 1]), "times"),
        (lambda: th.Sampled([0, 1e-6], [0, -1e-3]), "power"),
        (lambda: th.Sampled([0, 1e-6], [0, 1e-3])(2e-6), "t = 2e-06 s"),
        (lambda: period_times(th.Constant(1e-3), 11), "period"),
        (lambda: from_json('{"kind": "SquareWav"}'), "kind"),
        (lambda: th.Function(np.sin, breakpoints=[3e-6], period=1e-6), "breakpoints"),
        (lambda: th.Function(lambda t: 1 / 0)(1e-6), "f fails"),
        (lambda: to_json(th.Function(np.sin)), "Function"),
        (lambda: th.Function(lambda t: np.random.default_rng().random(np.shape(t))).pieces(0, 1e-6), "Function"),
    ],
)
def test_bad_input_names_the_argument(make, argument):
    with pytest.raises(th.InputError, match=argument) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("width", [1e-3, 1e-4, 3e-5])
def test_a_narrow_feature_is_found_without_a_breakpoint(width):
    """A Gaussian of standard deviation 3e-5 of the run spans the distance of the probes, 1/8192."""
    rng = np.random.default_rng(5)
    for centre in rng.uniform(0.1, 0.9, 20):
        wave = th.Function(lambda t, centre=centre: 1e-3 * np.exp(-(((t - centre) / width) ** 2) / 2))
        assert wave.mean(0.0, 1.0) == pytest.approx(1e-3 * width * np.sqrt(2 * np.pi), rel=1e-6, abs=0)


@pytest.mark.slow
def test_a_time_scale_finds_what_is_narrower_still():
    def spike(t):
        return 1e-3 * np.exp(-(((t - 0.123456) / 1e-6) ** 2) / 2)

    assert th.Function(spike, time_scale=1e-6).mean(0.0, 1.0) == pytest.approx(
        1e-9 * np.sqrt(2 * np.pi), rel=1e-6, abs=0
    )
    assert th.Function(spike, breakpoints=[0.123456]).mean(0.0, 1.0) > 0


def test_either_side_of_a_breakpoint_whatever_the_function_says_at_it():
    for f in (lambda t: 1e-3 * (t < 1e-6), lambda t: 1e-3 * (t <= 1e-6)):
        wave = th.Function(f, breakpoints=[1e-6])
        assert (float(wave(1e-6)), float(wave.before(1e-6))) == (0.0, 1e-3)
    saw = th.Function(lambda t: 1e9 * t, period=1e-12)
    assert np.allclose(saw([0, 0.5e-12, 1e-12, 7e-12]), [0, 5e-4, 0, 0], atol=1e-12)
    assert np.allclose(saw.before([1e-12, 7e-12]), 1e-3)


def test_a_cubic_fit_is_as_near_as_it_says():
    """1e-8 of the peak at 10 000 times of which the fit knows nothing; a factor of 2 for what lies between probes."""
    wave = th.Function(lambda t: 1e-3 * (1 + np.sin(3e6 * t) * np.exp(-t / 4e-6)))
    t = np.random.default_rng(1).uniform(0, 20e-6, 10_000)
    assert np.abs(wave.pieces(0, 20e-6)(t) - wave(t)).max() < 2e-8 * 2e-3


def test_symbols_are_held_masked_and_noisy():
    wave = th.Symbols([0, 1, 0.5], rate=1e9, power=2e-3, bias=1e-3, mask=(1.0, 0.5), start=1e-9)
    middle = 1e-9 + (np.arange(6) + 0.5) * 0.5e-9
    assert wave(middle) == pytest.approx([1e-3, 1e-3, 3e-3, 2e-3, 2e-3, 1.5e-3], rel=1e-12, abs=0)
    assert wave([0.5e-9, 4.5e-9]).tolist() == [1e-3, 1e-3]  # the bias, before and after
    assert wave.breakpoints(0, 5e-9) == pytest.approx(
        [2e-9, 2.5e-9, 3.5e-9, 4e-9], rel=1e-12, abs=0
    )  # equal neighbours
    assert wave.mean(1e-9, 4e-9) == pytest.approx(wave(middle).mean(), rel=1e-12, abs=0)
    noisy = [th.Symbols(np.ones(20_000), rate=1e9, power=2e-3, bias=2e-3, noise=0.1, seed=s) for s in (1, 1, 2)]
    times = (np.arange(20_000) + 0.5) * 1e-9
    assert np.array_equal(noisy[0](times), noisy[1](times))
    assert not np.array_equal(noisy[0](times), noisy[2](times))
    assert noisy[0](times).std() == pytest.approx(2e-4, rel=0.03, abs=0)  # five sigma of 20 000 draws
    assert wave.samples(2).size == 12
    assert wave.samples()[-1] == wave.stop == pytest.approx(4e-9, rel=1e-6, abs=0)


def test_jumps_that_are_not_named_cost_no_accuracy():
    """Wherever they are: a cubic over the last cell would fall to -25 % of the power."""
    rng, model = np.random.default_rng(5), th.Foster([2000, 5800], [56e-9, 1.2e-6])
    for _ in range(40):
        stop = 10 ** rng.uniform(-6, -3)
        start, width = rng.uniform(0.1, 0.6) * stop, rng.uniform(5e-4, 0.3) * stop
        inside = th.Function(lambda t, a=start, b=start + width: 1e-3 * ((t >= a) & (t < b)))
        times = np.array([start, start + width, start + 1.5 * width, stop])
        want = model.response(th.Pulse(1e-3, width, start=start), times)
        assert model.response(inside, times) == pytest.approx(want, rel=1e-7, abs=1e-9 * want.max())


def test_bounds_of_cubics_that_begin_level():
    """With a slope of exactly zero the second turning point is 0/0."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        a, b, c, d = rng.normal(size=4) * (rng.random(4) < 0.6)
        cubic = th.waveforms.PiecewiseCubic([0.0, 1.5], [[a, b, c, d]])
        dense = np.polyval([d, c, b, a], np.linspace(0, 1.5, 20_001))
        # between 20 000 points: (1.5/2e4)^2/8 of the second derivative
        low, high = bounds(cubic.pieces(0.0, 1.5))
        assert (low, high) == pytest.approx((dense.min(), dense.max()), rel=0, abs=1e-7)
    cold = th.waveforms.PiecewiseCubic([0, 1.5e-6], [[5e-4, 0, -3e9, 2e15]])
    with pytest.raises(th.InputError, match=r"falls to -0\.0005 W"):
        th.Foster([2e3], [1e-6]).response(cold, [1e-6])
