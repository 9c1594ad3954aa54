"""Laser noise: its density by Welch's method, the linewidth by the coherence, and what a ring passes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from correctors import NETWORK, RING
from scipy.signal import welch

import coupled
import thermofem as th
from coupled.noise import frequency_noise, intensity_noise, thermorefractive

BANDWIDTH, DURATION = 200e6, 50e-6


def sampled(wave):
    """Samples at 8 times the bandwidth."""
    times = np.arange(int(DURATION * 8 * BANDWIDTH)) / (8 * BANDWIDTH)
    return times, wave(times)


def density(values):
    """One-sided density by Welch's method, within and beyond the bandwidth."""
    f, S = welch(values, 8 * BANDWIDTH, nperseg=1600)
    return S[(f > 5e6) & (f < 0.9 * BANDWIDTH)], S[f > 1.2 * BANDWIDTH]


def test_relative_intensity_noise_has_the_density_asked_for():
    """50 independent segments and 175 lines: the mean is within 3/sqrt(50 175) = 3 %, one line within 4/sqrt(50)."""
    wave = intensity_noise(2e-3, -110, bandwidth=BANDWIDTH, duration=DURATION, seed=3)
    _, P = sampled(wave)
    inside, outside = density(P / 2e-3)
    assert inside.mean() == pytest.approx(1e-11, rel=0.04, abs=0)
    assert inside == pytest.approx(np.full(inside.size, 1e-11), rel=0.7, abs=0)
    assert outside.max() < 1e-3 * 1e-11  # the cubics, and the window's leakage
    assert P.mean() == pytest.approx(2e-3, rel=1e-2)


def test_frequency_noise_has_the_density_of_its_linewidth():
    wave = frequency_noise(1e6, bandwidth=BANDWIDTH, duration=DURATION, seed=4)
    inside, outside = density(sampled(wave)[1])
    assert inside.mean() == pytest.approx(1e6 / np.pi, rel=0.04)
    assert outside.max() < 1e-3 * 1e6 / np.pi


def test_coherence_decays_as_of_a_lorentzian_line():
    """<exp(i phi(t + tau) - i phi(t))> = exp(-pi linewidth tau), tau well above 1/bandwidth."""
    linewidth, products = 2e6, []
    for seed in range(6):
        wave = frequency_noise(linewidth, bandwidth=BANDWIDTH, duration=DURATION, seed=seed)
        _, nu = sampled(wave)
        phase = 2 * np.pi * np.cumsum(nu) / (8 * BANDWIDTH)
        step = int(0.1e-6 * 8 * BANDWIDTH)
        products.append(np.exp(1j * (phase[step:] - phase[:-step])).mean())
    # the correction of a bandwidth B: exp(-pi linewidth tau (1 - 2/(pi^2 B tau))), here 1 %
    wanted = np.exp(-np.pi * linewidth * 0.1e-6 * (1 - 2 / (np.pi**2 * BANDWIDTH * 0.1e-6)))
    assert np.mean(products).real == pytest.approx(wanted, abs=0.02)  # 3000 coherence times: 1/sqrt(3000)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_phase_diffuses_to_the_end_of_a_run(share):
    """<(phi(t) - phi(0))^2> = 2 pi linewidth t; without a constant it returns to its start (0.046 of it at the end).

    600 seeds: a variance is known to sqrt(2/600) = 5.8 %, and the bandwidth takes off 1/(pi^2 B t) of it, below 1 %.
    """
    duration, phases = 1e-6, []
    for seed in range(600):
        wave = frequency_noise(1e6, bandwidth=100e6, duration=duration, seed=seed)
        t = np.linspace(0, share * duration, 801)
        phases.append(2 * np.pi * np.trapezoid(wave(t), t))
    assert np.mean(np.square(phases)) == pytest.approx(2 * np.pi * 1e6 * share * duration, rel=4 * 0.058)


def test_short_records_have_the_whole_variance():
    """S bandwidth, also where a record holds one and a half periods."""
    values = [
        frequency_noise(1e6, bandwidth=1e9, duration=1.85e-9, seed=seed)(np.linspace(0, 1.85e-9, 20))
        for seed in range(1000)
    ]
    assert np.mean(np.square(values)) == pytest.approx(1e6 / np.pi * 1e9, rel=4 * np.sqrt(2 / 1000))


def test_a_seed_repeats_a_run():
    def run(seed):
        options = {"bandwidth": 1e9, "duration": 50e-9, "seed": seed}
        return coupled.simulate(
            RING, NETWORK, power=intensity_noise(1e-4, -110, **options),
            detuning=[1e9, frequency_noise(1e6, **options)], duration=50e-9,
        )  # fmt: skip

    first, again, other = run(1), run(1), run(2)
    assert (first["drop"].values == again["drop"].values).all()
    assert first["drop"].values[-1] != other["drop"].values[-1]


def test_a_linear_ring_passes_slow_noise_on():
    """Far below the linewidth of 29 GHz a weakly driven ring drops a fixed share of the power at every time."""
    wave = intensity_noise(1e-9, -95, bandwidth=50e6, duration=0.4e-6, seed=5)
    times = np.linspace(0.1e-6, 0.4e-6, 301)
    drop = coupled.simulate(RING, NETWORK, power=wave, duration=0.4e-6, times=times, rtol=1e-8)["drop"].values
    share = 4 * RING.bus_rate**2 / RING.linear_rate**2
    assert drop == pytest.approx(share * wave(times), rel=2e-3)  # 10 ps of delay at 50 MHz
    assert drop.std() > 0.05 * drop.mean()


def test_intensity_and_frequency_of_one_seed_are_independent():
    """One series for both makes the noise behind a resonance 45 % too small or 30 % too large."""
    options, times = {"bandwidth": 1e9, "duration": 1e-6}, np.linspace(0, 1e-6, 20_001)
    both = (
        intensity_noise(1e-3, -130, **options)(times),
        frequency_noise(1e6, **options)(times),
    )
    # 1000 lines: 3 % is one standard deviation of the correlation of independent series
    assert abs(np.corrcoef(*both)[0, 1]) < 0.13


def test_noise_that_is_negative_between_its_samples_is_refused():
    """One seed of 400 has a spline that falls to -16 uW between samples above zero."""
    refused = 0
    for seed in range(60):
        try:
            wave = intensity_noise(1e-3, -101.3, bandwidth=1e9, duration=2e-7, seed=seed)
        except th.InputError:
            refused += 1
        else:
            assert wave(np.linspace(0, 2e-7, 40_001)).min() > 0
    assert 0 < refused < 60


TEN = th.Foster(  # the reference strip reduced to 1e-3, rounded: poles from below one sample to a quarter of the run
    R=[17, 102, 384, 830, 1040, 1065, 1051, 1116, 1718, 541],
    tau=[0.66e-9, 3.5e-9, 13.3e-9, 46e-9, 143e-9, 397e-9, 1.0e-6, 3.05e-6, 7.2e-6, 9.4e-6],
)


@pytest.mark.parametrize("model", [NETWORK, TEN], ids=["two poles", "ten poles"])
def test_thermorefractive_noise_has_the_density_of_the_heat(model):
    """200 seeds of 9 half-overlapping segments: a line errs by 1/sqrt(1000), a band of n by 1/sqrt(1000 n).

    Folding from beyond 4 bandwidths adds 0.7 % at half the bandwidth, the window's leakage 2 % in the lowest band.
    """
    bandwidth, duration, rate = 50e6, 25e-6, 400e6
    times = np.arange(int(duration * rate)) / rate
    total = 0.0
    for seed in range(200):
        wave = thermorefractive(model, RING, bandwidth=bandwidth, duration=duration, seed=seed)
        f, S = welch(wave(times), rate, nperseg=2000, detrend=False)
        total = total + S / 200
    shift = RING.thermal_shift / (2 * np.pi)
    ratio = total / (shift**2 * th.thermal_noise(model, f, temperature=300.0)["S_T"].values)
    for low, high, system in ((6e5, 2e6, 0.02), (2e6, 6e6, 0.005), (6e6, 12e6, 0.005), (12e6, 25e6, 0.01)):
        band = (f >= low) & (f < high)
        assert ratio[band].mean() == pytest.approx(1, abs=system + 4 / np.sqrt(1000 * band.sum())), low


def test_thermorefractive_noise_has_the_variance_and_the_memory_of_its_pole():
    """<x(0) x(t)> = (shift/2 pi)^2 k_B T^2 (R/tau) exp(-t/tau): 400 seeds of one pole that outlasts the run."""
    model = th.Foster(R=[5000.0], tau=[20e-6])
    times = np.array([1e-6, 9e-6])
    settings = {"bandwidth": 1e6, "duration": 10e-6, "temperature": 350.0}
    x = np.array([thermorefractive(model, RING, seed=seed, **settings)(times) for seed in range(400)])
    variance = (RING.thermal_shift / (2 * np.pi)) ** 2 * 1.380649e-23 * 350.0**2 * 5000.0 / 20e-6
    assert np.mean(x**2, axis=0) == pytest.approx([variance, variance], rel=4 * np.sqrt(2 / 400))
    assert np.mean(x[:, 0] * x[:, 1]) == pytest.approx(variance * np.exp(-0.4), rel=4 * np.sqrt(2 / 400) * np.exp(0.4))


def test_thermorefractive_noise_repeats_and_refuses_what_is_no_port():
    settings = {"bandwidth": 50e6, "duration": 5e-6}
    first, again, other = (thermorefractive(NETWORK, RING, seed=s, **settings)(2e-6) for s in (1, 1, 2))
    assert first == again != other
    system = th.StateSpace(np.eye(1), [[-1e6]], [[1e4]], [[1e4], [2e4]], ("core",), ("core", "light"))
    lit = replace(RING, read="light")
    light, core = (thermorefractive(system, ring, seed=1, **settings)(2e-6) for ring in (lit, RING))
    assert light == pytest.approx(2 * core, rel=1e-12, abs=0)
    transfer = th.Foster(R=[100.0], tau=[1e-6], inputs=("heater",), outputs=("core",))
    with pytest.raises(th.InputError, match="from 'heater' to 'core'"):
        thermorefractive(transfer, RING, **settings)
    for change in ({"temperature": -3.0}, {"bandwidth": 0.0}, {"duration": -1.0}, {"seed": 0.5}):
        with pytest.raises(th.InputError, match=next(iter(change))):
            thermorefractive(NETWORK, RING, **settings | change)


def test_a_simulated_ring_jitters_as_its_linear_answer_says():
    """The rise under thermorefractive noise, by the linear ring: sum_k |H_k|^2 against |drop/detuning|^2 S_nu.

    12 seeds of 7 segments: a band of 30 lines errs by 1/sqrt(12 4 30) = 2.6 %.
    """
    power, detuning, bandwidth, rate = 1e-3, -5e9, 20e6, 160e6
    linear = coupled.linearize(RING, NETWORK, power=power, detuning=detuning)
    rest = coupled.simulate(RING, NETWORK, power=power, detuning=detuning, duration=200e-6)
    times = np.arange(int(50e-6 * rate)) / rate
    total = 0.0
    for seed in range(12):
        wave = thermorefractive(NETWORK, RING, bandwidth=bandwidth, duration=50e-6, seed=seed)
        run = coupled.simulate(
            RING, NETWORK, power=power, detuning=[detuning, wave], duration=50e-6, times=times, initial=rest, rtol=1e-7
        )
        f, S = welch(run["drop"].values - float(linear.state["drop"]), rate, nperseg=2000, detrend=False)
        total = total + S / 12
    response = linear.response(f)["response"].sel(input="detuning", output="drop").values
    shift = RING.thermal_shift / (2 * np.pi)
    expected = np.abs(response) ** 2 * shift**2 * th.thermal_noise(NETWORK, f, temperature=300.0)["S_T"].values
    band = (f > 1e6) & (f < 4e6)
    assert (total / expected)[band].mean() == pytest.approx(1, abs=4 * 0.026)
