"""Read-outs of heat with one time constant against closed forms, and of any Dataset and model."""

import json
import re

import numpy as np
import pytest
from commands import thermofem

import surrogate
import thermofem as th
from thermofem.data import dataset

TAU, R = 2e-6, 1000.0
ONE = th.Foster(R=[R], tau=[TAU])


@pytest.mark.parametrize(("decibels", "ratio"), [("optical", np.sqrt(3)), ("electrical", 1.0)])
@pytest.mark.parametrize("readout", [th.MZI(bias=0.3), th.RingEdge(bias=1e9, linewidth=2e9, shift=1e9)])
def test_bandwidth_of_one_pole(readout, decibels, ratio):
    """|Z| = R/sqrt(1 + (2 pi f tau)^2): half at 2 pi f tau = sqrt 3, 1/sqrt 2 at 1."""
    assert readout.bandwidth(ONE, decibels=decibels) == pytest.approx(ratio / (2 * np.pi * TAU), rel=1e-8)


@pytest.mark.parametrize("swing", [1e-3, 0.3, 1.5])
def test_edges_at_quadrature(swing):
    """From quadrature the light is (1 - sin phi)/2: sin phi(t) = q sin A on the way up, (1 - q) sin A down."""
    mzi = th.MZI(bias=np.pi / 2, shift=swing / R)
    edges = mzi.edge_times(ONE, th.SquareWave(1.0, 60 * TAU, 0.5))

    def up(q):
        return -TAU * np.log(1 - np.arcsin(q * np.sin(swing)) / swing)

    def down(q):
        return -TAU * np.log(np.arcsin((1 - q) * np.sin(swing)) / swing)

    share = 1 - np.exp(-1)
    exact = up(share), down(share), up(0.9) - up(0.1), down(0.9) - down(0.1)
    found = edges.rise, edges.fall, edges.rise_10_90, edges.fall_10_90
    np.testing.assert_allclose(found, exact, rtol=2e-3)  # 2001 samples of 60 tau: chords of 0.03 tau
    step = mzi.edge_times(ONE, th.Constant(1.0))
    np.testing.assert_allclose([step.rise, step.rise_10_90], [exact[0], exact[2]], rtol=1e-4)
    assert np.isnan(step.fall)


def test_short_square_and_sine():
    """In a square wave of half period h heat goes as (1 - exp(-t/tau))/(1 - exp(-h/tau)); a sine keeps its shape."""
    mzi, h = th.MZI(shift=1e-6 / R), TAU / 2
    edges = mzi.edge_times(ONE, th.SquareWave(1.0, 2 * h, 0.5))
    full = 1 - np.exp(-h / TAU)
    share = 1 - np.exp(-1)
    assert edges.rise == pytest.approx(-TAU * np.log(1 - share * full), rel=1e-4)
    assert edges.fall == pytest.approx(edges.rise, rel=1e-4)
    period = 10 * TAU
    sine = th.Function(lambda t: 0.5 - 0.5 * np.cos(2 * np.pi * t / period), period=period)
    light = mzi(ONE.periodic_response(sine, 2001))
    gain = 1 / np.hypot(1, 2 * np.pi * TAU / period)
    assert np.ptp(light) == pytest.approx(0.5e-6 * gain, rel=1e-4)


def test_light_of_datasets_and_models():
    times = np.linspace(0, 20e-6, 101)
    wave, mzi = th.Pulse(3e-3, 5e-6), th.MZI(bias=0.2, visibility=0.8, shift=0.4)
    data = dataset.build(times, ONE.response(wave, times), wave)
    expected = (1 + 0.8 * np.cos(0.2 + 0.4 * ONE.response(wave, times))) / 2
    np.testing.assert_allclose(mzi(data).optical, expected, rtol=1e-12)
    np.testing.assert_allclose(mzi(ONE.response(wave, times)), expected, rtol=1e-12)
    ring = th.RingEdge(bias=-1e9, linewidth=4e9, shift=1e9, depth=0.9)
    assert float(ring(np.array(1.0))) == pytest.approx(0.1)  # on resonance
    assert float(ring(np.array(3.0))) == pytest.approx(1 - 0.9 / 2)  # half a linewidth away


def test_finite_elements_and_their_reduction_read_alike():
    heat = th.assemble(th.straight_guide())
    model = surrogate.reduce(heat.system, tolerance=1e-4).model
    mzi = th.MZI(bias=0.5, shift=0.1)
    # 1e-4 of |H| moves the frequency by up to three times that on a flat response
    assert mzi.bandwidth(heat) == pytest.approx(mzi.bandwidth(model), rel=5e-4)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: th.MZI(bias=0.1, visibility=1.2), "visibility"),
        (lambda: th.RingEdge(bias=0.0, linewidth=-1e9, shift=1e9), "linewidth"),
        (lambda: th.MZI().bandwidth(ONE, decibels="dBm"), "decibels"),
        (lambda: th.MZI().edge_times(ONE, th.Pulse(1e-3, 1e-6)), "wave"),
        (lambda: surrogate.fit_foster(trace(0)[0], 1, readout=th.MZI(shift=0.0)), "shift"),
    ],
)
def test_what_cannot_be(make, name):
    with pytest.raises(th.InputError, match=name):
        make()


def trace(seed, phase=1.4 * np.pi, noise=3e-3):
    """Light behind an interferometer: a pulse of 20 us on one pole, and what made it."""
    draw = np.random.default_rng(seed)
    true = {"R_1": 1e3 * draw.uniform(0.5, 2), "tau_1": 1e-6 * draw.uniform(2, 6)}
    true |= {"visibility": draw.uniform(0.6, 1.0), "bias": draw.uniform(-2.0, 2.0), "half_power": 0.5}
    wave, times = th.Pulse(10e-3, 20e-6), np.linspace(0, 40e-6, 200)
    model = th.Foster(R=[true["R_1"]], tau=[true["tau_1"]])
    shift = phase / (true["R_1"] * 10e-3)
    mzi = th.MZI(bias=true["bias"], visibility=true["visibility"], shift=shift)
    data = mzi(dataset.build(times, model.response(wave, times), wave))
    data["optical"] = data.optical + noise * draw.standard_normal(times.size)
    return data, true, shift


def test_two_traces_of_different_steps_behind_one_interferometer_give_both_poles():
    """A slow record shows the slow pole and a fast one the fast pole; each alone leaves the other one open."""
    true = th.Foster(R=[600.0, 900.0], tau=[0.15e-6, 4e-6])
    mzi = th.MZI(bias=0.7, visibility=0.9, shift=0.3)
    draw = np.random.default_rng(2)
    traces = []
    for width, count in ((20e-6, 81), (1e-6, 400)):  # steps of 0.5 us, longer than the fast pole, and of 5 ns
        wave, times = th.Pulse(10e-3, width), np.linspace(0, 2 * width, count)
        data = mzi(dataset.build(times, true.response(wave, times), wave))
        data["optical"] = data.optical + 1e-3 * draw.standard_normal(count)
        traces.append(data)
    fit = surrogate.fit_foster(traces, 2, readout=th.MZI(shift=0.3))
    for name, value in (("R_1", 600.0), ("R_2", 900.0), ("tau_1", 0.15e-6), ("tau_2", 4e-6)):
        # four standard deviations, and these are small: 1e-3 of noise on 481 samples of a light that turns by 4 rad
        assert abs(fit.parameters[name] - value) < 4 * fit.standard_errors[name]
        assert fit.standard_errors[name] < 0.05 * value


def test_fit_behind_an_interferometer_recovers_twenty_networks():
    """Pulls of 20 synthetic traces, 5 parameters each: their rms is 1 with a spread of 1/sqrt(200) = 7 %."""
    pulls = []
    for seed in range(20):
        data, true, shift = trace(seed)
        fit = surrogate.fit_foster(data, 1, readout=th.MZI(shift=shift))
        pulls.append([(fit.parameters[name] - true[name]) / fit.standard_errors[name] for name in true])
    assert 0.8 < float(np.sqrt(np.mean(np.square(pulls)))) < 1.3
    assert np.abs(pulls).max() < 5


def test_a_misfit_of_light_is_no_kelvin_in_the_file():
    """The field residual_K of the provenance is in kelvin; a misfit in W or V does not stand there."""
    data, _, shift = trace(0)
    fit = surrogate.fit_foster(data, 1, readout=th.MZI(shift=shift))
    assert fit.residual > 0
    assert fit.model.origin["residual_K"] is None


def test_fine_steps_of_one_trace_count_beside_coarse_ones_of_another():
    """50 ns from steps of 6 ns and 100 us from steps of 50 us: searches begin above the smallest step of all traces."""
    wave = th.Pulse(10e-3, 400e-6)
    model = th.Foster(R=[400.0, 900.0], tau=[50e-9, 100e-6])
    mzi = th.MZI(bias=0.6, visibility=0.9, shift=0.3)
    traces = []
    for times in (np.linspace(0, 0.5e-6, 81), np.linspace(0, 1e-3, 21)):
        traces.append(mzi(dataset.build(times, model.response(wave, times), wave)))
    fit = surrogate.fit_foster(traces, 2, readout=mzi)
    # 1e-6: without noise the misfit is that of round-off
    np.testing.assert_allclose([fit.model.tau, fit.model.R], [model.tau, model.R], rtol=1e-6)


def test_small_signals_do_not_tell_visibility_from_resistance():
    """A swing of 0.03 rad is linear: V and R enter as one product, which the notes say."""
    data, _, shift = trace(3, phase=0.03, noise=1e-5)
    fit = surrogate.fit_foster(data, 1, readout=th.MZI(shift=shift))
    assert any("R_1" in note and "bias" in note for note in fit.notes), fit.notes


def test_one_command_fits_a_trace_behind_an_interferometer(tmp_path):
    """Trace of a photodiode in V: network, bias and visibility come back within five standard errors."""
    wave, model = th.Pulse(10e-3, 20e-6), th.Foster(R=[1000.0], tau=[4e-6])
    times = np.linspace(-5e-6, 45e-6, 300)
    rise = np.where(times < 0, 0.0, model.response(wave, np.maximum(times, 0.0)))
    noise = 2e-3 * np.random.default_rng(0).standard_normal(times.size)
    light = 1.7 * th.MZI(bias=0.7, visibility=0.9, shift=0.4)(rise) + noise
    table = np.column_stack([times * 1e6, light])
    np.savetxt(tmp_path / "trace.csv", table, delimiter=",", header="time (us),light (V)", comments="")
    words = ["--readout", "mzi", "--order", "1", "--power", "10 mW", "--pulse", "20 us", "--start", "0 us"]
    phase = ["--phase", "0.4 rad/K"]
    done = thermofem("fit", "trace.csv", *words, *phase, "--json", "-o", "m.json", cwd=tmp_path)
    found = json.loads(done.stdout)
    size, unit = re.search(r"misfit = (\S+) (\S+) rms, ", done.stderr).groups()
    assert unit == "V"  # of the photodiode; its noise is 2 mV, known to 1/sqrt(600)
    assert float(size) == pytest.approx(2e-3, rel=0.15, abs=0)
    assert re.search(r"half_power = \S+ ± \S+ m?V$", done.stderr, re.MULTILINE)
    for name, true in (("R_1", 1000.0), ("tau_1", 4e-6), ("visibility", 0.9), ("bias", 0.7), ("half_power", 0.85)):
        assert abs(found["parameters"][name] - true) < 5 * found["standard_errors"][name], name
    bare = thermofem("fit", "trace.csv", *words, "-o", "bare.json", cwd=tmp_path)
    assert "1 rad counts as 1 K, so R and R_th are in rad/W" in bare.stderr
    (R,) = re.findall(r"R_1 = (\S+) ± \S+ rad/W$", bare.stdout, re.MULTILINE)
    assert float(R) == pytest.approx(0.4 * found["parameters"]["R_1"], rel=1e-2)
