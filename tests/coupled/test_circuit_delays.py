"""Fronts of light, of lasers and from delays, against closed forms."""

import numpy as np
import pytest
from rings import RING, SECOND_ORDER

import coupled
import thermofem as th
from coupled import Circuit, Detector, LaserPort, Splitter, Waveguide

P, FAINT = 1e-3, 1e-12  # W; at the second nothing but the linear loss acts
RTOL = [1e-6, 1e-9]


@pytest.mark.parametrize("rtol", RTOL)
@pytest.mark.parametrize("delay", [1.722793110816546e-10, 2e-10, 1e-10])
def test_every_round_in_a_loop_of_one_splitter_is_a_step(delay, rtol):
    """Light is constant between fronts, and so is `output`, at any rtol."""
    cross, loop = 0.4, Waveguide("s.out 2", "s.in 2", loss=3.0, phase=1.0, delay=delay)
    circuit = Circuit({"idle": RING}, [loop], [LaserPort("in", "s.in 1")], (), [Splitter("s", cross)])
    near = np.arange(1, 12)[:, None] + [-0.01, -1e-3, 1e-3, 3e-3, 0.1]
    times = np.unique(np.concatenate([near.ravel(), np.linspace(0.0013, 11.9, 301)])) * delay
    drive = {"power": {"in": P}, "duration": 12 * delay, "rtol": rtol}
    run = coupled.simulate(circuit, SECOND_ORDER, times=times, **drive)
    inside = [0j]
    for _ in range(12):
        inside.append(loop.transmission * (1j * np.sqrt(cross * P) + np.sqrt(1 - cross) * inside[-1]))
    seen = np.abs(np.sqrt((1 - cross) * P) + 1j * np.sqrt(cross) * np.array(inside)) ** 2
    # no ring takes part: round-off
    assert run.output.sel(port="s.out 1").values == pytest.approx(
        seen[(times / delay).astype(int)], rel=0, abs=1e-13 * P
    )
    every = coupled.simulate(circuit, SECOND_ORDER, average=True, **drive)
    late = every.isel(time=slice(1, None))
    means = seen[((late.time - np.diff(every.time) / 2) / delay).values.astype(int)]
    # the energies since the start, divided by the shortest step
    assert late.mean_output.sel(port="s.out 1").values == pytest.approx(means, rel=0, abs=1e-9 * P)


def interferometer(delay: float, bandwidth: float) -> Circuit:
    """A ring in one arm, a delay in the other."""
    arms = [
        Waveguide("s1.out 1", "ring 1.in"),
        Waveguide("ring 1.through", "s2.in 1"),
        Waveguide("s1.out 2", "s2.in 2", delay=delay, phase=0.4),
    ]
    detector, splitters = Detector("out", "s2.out 1", bandwidth=bandwidth), [Splitter("s1", 0.5), Splitter("s2", 0.5)]
    return Circuit({"ring 1": RING}, arms, [LaserPort("in", "s1.in 1")], [detector], splitters)


@pytest.mark.parametrize("rtol", RTOL)
@pytest.mark.parametrize("delay", [1.0e-9, 1.2345678e-10])
def test_detectors_behind_an_interferometer_with_a_ring_at_low_power(delay, rtol):
    """Means and detected light are exact at every front that comes back, at any rtol.

    The laser is switched on at t = 0, off at 4 delays and so on; the field of the ring is an exponential between.
    """
    bandwidth, detuning, halves, cells = 2e9, -5e9, 32, 400
    circuit, k = interferometer(delay, bandwidth), 2 * np.pi * bandwidth
    times = np.arange(1, halves + 1) * delay / 2
    run = coupled.simulate(
        circuit, SECOND_ORDER, power={"in": th.SquareWave(FAINT, period=8 * delay, duty=0.5)}, detuning=detuning,
        duration=halves * delay / 2, times=times, rtol=rtol, average=True,
    )  # fmt: skip
    cell = delay / 2 / cells
    u, weight = (np.polynomial.legendre.leggauss(6)[0] + 1) / 2 * cell, np.polynomial.legendre.leggauss(6)[1] / 2
    rate, drive = RING.linear_rate + 2j * np.pi * detuning, 1j * np.sqrt(2 * RING.bus_rate)
    turn = np.exp(-0.4j - 2j * np.pi * detuning * delay)
    a, z, expected = 0j, 0.0, []
    for half in range(halves):
        lit, late = (np.sqrt(FAINT / 2) * float(n >= 0 and n // 8 % 2 == 0) for n in (half, half - 2))
        end = drive * lit / rate
        start = cell * np.arange(cells)[:, None]
        field = end + (a - end) * np.exp(-rate * (start + u))
        power = np.abs(lit + drive * field + 1j * 1j * turn * late) ** 2 / 2
        for gained in power @ (weight * np.exp(-k * (cell - u))) * k * cell:
            z = z * np.exp(-k * cell) + gained
        a = end + (a - end) * np.exp(-rate * delay / 2)
        expected.append((z, power))
    port = run.sel(port="out")
    within = {1e-6: 1e-5, 1e-9: 3e-8}[rtol] * FAINT  # ten times rtol, and 1e-8 of the detuning by the light's heat
    assert port.detected.values == pytest.approx([z for z, _ in expected], rel=0, abs=within)
    # what the detector shows, averaged: by its equation, mean z = mean P - (change of z)/(k length)
    change = np.diff([0.0, *(z for z, _ in expected)])
    means = [float((power @ weight).mean()) for _, power in expected] - change / (k * delay / 2)
    assert port.mean_output.values == pytest.approx(means, rel=0, abs=within)


def test_a_front_at_a_dark_ring_takes_the_sharpest_rtol():
    """A step ends at the front, also at rtol = 1e-12, where times of echoes differ by round-off."""
    delay = 4.5773677521120785e-11
    ways = [
        Waveguide("s.out 2", "ring 1.in", loss=1.6, phase=3.1, delay=2 * delay),
        Waveguide("ring 1.drop", "s.in 2", loss=1.0, phase=-1.0, delay=delay),
        Waveguide("ring 1.through", "ring 1.add", loss=2.0, phase=0.8, delay=3 * delay),
    ]
    circuit = Circuit({"ring 1": RING}, ways, [LaserPort("in", "s.in 1")], (), [Splitter("s", 0.5)])
    drive = {"power": {"in": P}, "duration": 50 * delay, "times": np.linspace(2.1, 49.9, 20) * delay}
    sharp = coupled.simulate(circuit, SECOND_ORDER, rtol=1e-13, **drive).energy.values
    for rtol in (1e-12, 1e-9):
        run = coupled.simulate(circuit, SECOND_ORDER, rtol=rtol, **drive)
        within = run.attrs["steps"] * rtol * sharp.max()  # rtol in each step
        assert run.energy.values == pytest.approx(sharp, rel=0, abs=within)


@pytest.mark.parametrize("times", [None, np.arange(9) * 0.5e-9])
def test_light_at_a_jump_is_that_after_it(times):
    """As `input` and `simulate` have it; the power balance holds at that time."""
    wave, drive = th.SquareWave(P, 2e-9, 0.5), {"duration": 4.5e-9, "times": times, "rtol": 1e-9}
    run = coupled.simulate(coupled.bus(RING), SECOND_ORDER, power={"in": [P, wave]}, average=True, **drive)
    one = coupled.simulate(RING, SECOND_ORDER, power=[P, wave], **{**drive, "times": run.time.values})
    assert run.output.sel(port="through").values == pytest.approx(one.through.values, rel=0, abs=1e-6 * P)


def test_light_at_a_front_is_that_after_it():
    """Light that passes a delay alone, at the times of its jumps, and one round-off beside them."""
    delay, period = 1.234567e-10, 4.1e-10
    ways = [Waveguide("s1.out 1", "s2.in 1", delay=delay), Waveguide("s2.out 2", "s3.in 2", delay=delay / 3)]
    splitters = [Splitter(name, 0.5) for name in ("s1", "s2", "s3")]
    circuit = Circuit({"idle": RING}, ways, [LaserPort("in", "s1.in 1")], (), splitters)
    jumps = np.sort(np.concatenate([delay * 4 / 3 + np.arange(4) * period / 2, delay + np.arange(4) * period / 2]))
    times = np.unique(np.concatenate([jumps, np.nextafter(jumps, 0), np.nextafter(jumps, 1)]))
    run = coupled.simulate(
        circuit, SECOND_ORDER, power={"in": th.SquareWave(P, period, 0.5)}, duration=1e-9, times=times
    )
    for port, late, share in (("s2.out 1", delay, 4), ("s3.out 1", delay * 4 / 3, 8)):
        phase = (times - late) / period + 1e-9
        lit = (phase >= 0) & (phase % 1 < 0.5)
        assert run.output.sel(port=port).values == pytest.approx(P / share * lit, rel=0, abs=1e-12 * P)


@pytest.mark.parametrize("rtol", RTOL)
def test_a_detector_is_dark_until_light_comes(rtol):
    """The light of a ring arrives as a kink, on which a step ends."""
    delay = 2.07e-10
    ways, detector = [Waveguide("ring 1.drop", "s.in 1", delay=delay)], [Detector("out", "s.out 1", bandwidth=10e9)]
    circuit = Circuit({"ring 1": RING}, ways, [LaserPort("in", "ring 1.in")], detector, [Splitter("s", 0.5)])
    run = coupled.simulate(
        circuit,
        SECOND_ORDER,
        power={"in": FAINT},
        duration=3.1 * delay,
        times=delay * np.linspace(0.8, 3, 23),
        rtol=rtol,
    )
    # the field rises like 1 - exp(-rate u); it was resolved by the long steps of the ring at rest, 0.9 % off at 1e-6
    u, k = np.maximum(run.time.values - delay, 0), 2 * np.pi * 10e9
    rates = RING.linear_rate * np.arange(3)
    answers = k / (k - rates) * (np.exp(-np.outer(u, rates)) - np.exp(-k * u)[:, None]) @ [1, -2, 1]
    want = 2 * RING.bus_rate * RING.drop_bus_rate / RING.linear_rate**2 * FAINT * answers
    assert run.detected.values[0] == pytest.approx(want, rel=0, abs={1e-6: 5e-5, 1e-9: 5e-7}[rtol] * want.max())
    before = run.time.values < delay
    assert not run.detected.values[:, before][0].any()
    assert run.detected.values[0, run.time.values > 1.01 * delay].all()


def test_two_lasers_beat_at_a_detector_behind_no_ring():
    """Steps of an idle ring are long against the beat; its mean is exact."""
    beat, times = 20e9, np.linspace(0, 1e-9, 9)[1:]
    lasers = [LaserPort("a", "s.in 1"), LaserPort("b", "s.in 2", offset=beat)]
    circuit = Circuit({"idle": RING}, (), lasers, (), [Splitter("s", 0.5)])
    run = coupled.simulate(
        circuit, SECOND_ORDER, power={"a": P, "b": P}, duration=1e-9, times=times, average=True, rtol=1e-6
    )
    # |1 + i exp(i w t)|^2 / 2 = 1 - sin(w t)
    turned = np.cos(2 * np.pi * beat * np.append(0.0, times)) / (2 * np.pi * beat)
    means = P * (1 + np.diff(turned) / np.diff(np.append(0.0, times)))
    assert run.mean_output.sel(port="s.out 1").values == pytest.approx(means, rel=0, abs=1e-5 * P)  # ten times rtol


@pytest.mark.parametrize("cross", [0.0, 1e-16, 1e-12])
def test_a_resonance_of_a_loop_without_loss_has_no_spectrum(cross):
    """Its matrix is singular, or nearly so where 1e-16 of the power enters the loop."""
    loop = Waveguide("s.out 1", "s.in 1", delay=1e-11)
    circuit = Circuit({"idle": RING}, [loop], [LaserPort("in", "s.in 2")], (), [Splitter("s", cross)])
    with pytest.raises(th.InputError, match=r"detuning = 0 Hz: the waveguides form a loop without loss"):
        coupled.transmission(circuit, detuning=[-1e9, 0.0])
    assert np.isfinite(coupled.transmission(circuit, detuning=[-1e9, 1e9]).transmission).all()
