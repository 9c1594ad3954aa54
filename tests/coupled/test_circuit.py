"""Several rings: one ring alone, power balance, transfer matrices, delays, heat between rings, other solvers."""

import copy
import pickle
from dataclasses import replace
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pytest
from paths import ROOT
from rings import RING, SECOND_ORDER, delay_loop
from scipy.integrate import solve_ivp

import coupled
import thermofem as th
from coupled.plot import plot_ports, plot_rings, plot_traces

POWER, FAINT = 6.31e-3, 1e-12  # W; at the second nothing but the linear loss acts
GAMMA = RING.linear_rate


def pair(mutual: float = 250.0) -> th.StateSpace:
    """Two rings that heat each other: second-order heat in each, one slow pole between them, symmetric."""
    rate = np.array([*(1 / np.asarray(SECOND_ORDER.tau)), 1 / 12e-6])
    own = np.array([*np.asarray(SECOND_ORDER.R), 300.0])
    R = np.zeros((3, 2, 2))
    R[:, 0, 0] = R[:, 1, 1] = own
    R[2, 0, 1] = R[2, 1, 0] = mutual
    blocks = [np.linalg.cholesky(m) for m in R]
    B = np.vstack([block.T * np.sqrt(r) for block, r in zip(blocks, rate, strict=True)])
    every = np.repeat(rate, 2)
    return th.StateSpace(np.eye(6), -np.diag(every), B, B.T, inputs=("one", "two"), outputs=("one", "two"))


def parts_of_run(circuit, thermal, inputs, duration, detuning=0.0):
    """Right-hand side of a circuit without delays, in the kernel's units, and its heat."""
    from coupled.circuit.system import system_of

    system = system_of(circuit, thermal, power=inputs, detuning=detuning, duration=duration)
    problem = system.problem(coupled.kernel.tableaus.Method.RODAS5P)

    def f(t, y):
        piece = int(np.clip(np.searchsorted(problem.edges, t, side="right") - 1, 0, problem.edges.size - 2))
        return problem.slopes(y, piece, t)[0]

    return f, system.heat


@pytest.mark.parametrize("detuning", [0.0, -12e9, [0.0, coupled.Sweep([0, 5e-6], [5e9, -5e9])]])
def test_one_ring_on_a_bus_makes_the_steps_of_simulate(detuning):
    wave, times = [4e-3, th.Pulse(power=2e-3, width=1e-6, start=1e-6)], np.linspace(0, 5e-6, 501)
    options = {"detuning": detuning, "duration": 5e-6, "times": times}
    run = coupled.simulate(coupled.bus(RING), SECOND_ORDER, power={"in": wave}, **options)
    alone = coupled.simulate(RING, SECOND_ORDER, power=wave, **options)
    assert run.attrs["steps"] == pytest.approx(alone.attrs["steps"], abs=2)
    for name in ("energy", "carriers", "delta_T", "absorbed"):
        # the same kernel: round-off of the conversions, 1e-16, times what grows over five pulses
        assert run[name].values[0] == pytest.approx(alone[name].values, rel=0, abs=1e-7 * float(alone[name].max()))
    for port, name in (("through", "through"), ("drop 1", "drop")):
        expected = alone[name].values
        assert run.output.sel(port=port).values == pytest.approx(expected, rel=0, abs=1e-7 * POWER)


def test_rings_that_are_optically_and_thermally_separate_are_rings_alone():
    """Two lasers, two rings, the kernel of circuits against that of a ring alone, at a tolerance far below 1e-7."""
    other = replace(RING, frequency=RING.frequency + 5e9)
    circuit = coupled.Circuit(
        {"a": RING, "b": other}, (), [coupled.LaserPort("one", "a.in"), coupled.LaserPort("two", "b.in")]
    )
    times = np.linspace(0, 2e-6, 401)
    run = coupled.simulate(
        circuit, SECOND_ORDER, power={"one": POWER, "two": 4e-3}, duration=2e-6, rtol=1e-10, times=times
    )
    for name, ring, power, detuning in (("a", RING, POWER, 0.0), ("b", other, 4e-3, -5e9)):
        alone = coupled.simulate(
            ring, SECOND_ORDER, power=power, detuning=detuning, duration=2e-6, rtol=1e-11, times=times
        )
        for what in ("energy", "carriers", "delta_T"):
            expected = alone[what].values
            # 1e-10 a step, amplified by a self-pulsing cycle
            assert run[what].sel(ring=name).values == pytest.approx(expected, rel=0, abs=3e-7 * expected.max())


def test_power_is_conserved_at_every_time():
    """Input = output + absorbed + scattered + lost + d(energy)/dt, the last by differences over 0.1 ps."""
    rings = [replace(RING, scattering_rate=2e9), replace(RING, frequency=RING.frequency + 4e9), RING]
    circuit = coupled.scissor(rings, phase=0.7, loss=0.4)
    circuit = replace(circuit, lasers=[replace(circuit.lasers[0], loss=1.0)])  # whose loss was nowhere: 21 %
    middle, step = np.linspace(1e-9, 0.8e-6, 60), 5e-14
    times = np.sort(np.concatenate([middle - step, middle, middle + step]))
    run = coupled.simulate(
        circuit, SECOND_ORDER, power={"in": th.Sampled([0, 1e-6], [2e-3, 9e-3])}, duration=1e-6, rtol=1e-9, times=times
    )
    energy = run.energy.sum("ring").values
    change = (energy[2::3] - energy[0::3]) / (2 * step)
    now = run.isel(time=slice(1, None, 3))
    left = now.output.sum("port") + (now.absorbed + now.scattered).sum("ring") + now.lost
    # differences of the dense output, whose error is 1e-9 of the energies in 1e-13 s, and the energy's third derivative
    assert left.values + change == pytest.approx(now.input.sum("laser").values, rel=2e-5, abs=0)
    assert float(now.lost.min()) > 0


def response(ring: coupled.RingResonator, nu: float) -> np.ndarray:
    """(in, add) -> (through, drop) of a ring at low power."""
    k = np.sqrt(2 * np.array([ring.bus_rate, ring.drop_bus_rate]))
    D = -2 * np.pi * (RING.frequency + nu - ring.frequency)
    return np.eye(2) - np.outer(k, k) / (ring.linear_rate - 1j * D)


def scissor_by_transfer_matrices(rings, nu, phase, loss):
    """Drop and through of a two-bus chain: (in, drop) -> (through, add) of every ring, multiplied."""
    q = 10 ** (-loss / 20) * np.exp(-1j * phase)
    chain = np.eye(2, dtype=complex)
    for k, ring in enumerate(rings):
        (a, b), (c, d) = response(ring, nu)
        chain = np.array([[a - b * c / d, b / d], [-c / d, 1 / d]]) @ chain
        if k < len(rings) - 1:
            chain = np.diag([q, 1 / q]) @ chain  # in of the next; drop of the next = add / q
    drop = -chain[1, 0] / chain[1, 1]  # nothing is added at the end
    return chain[0, 0] + chain[0, 1] * drop, drop


def crow_by_transfer_matrices(rings, nu):
    """(in, through) -> (drop, add) of every ring; the next one's in is i times drop, add i times its through."""
    chain = np.eye(2, dtype=complex)
    for k, ring in enumerate(rings):
        (a, b), (c, d) = response(ring, nu)
        # through = a in + b add, drop = c in + d add
        chain = np.array([[c - d * a / b, d / b], [-a / b, 1 / b]]) @ chain
        if k < len(rings) - 1:
            chain = np.array([[1j, 0], [0, 1 / 1j]]) @ chain
    through = -chain[1, 0] / chain[1, 1]
    return through, chain[0, 0] + chain[0, 1] * through


THREE = [
    RING,
    replace(RING, frequency=RING.frequency + 6e9),
    replace(RING, frequency=RING.frequency - 3e9, bus_rate=30e9),
]


@pytest.mark.parametrize("nu", [-25e9, -6e9, 0.0, 4e9, 17e9])
def test_spectra_are_those_of_transfer_matrices(nu):
    """Detuning by detuning, at a power that heats nothing; the run of 3 ns leaves exp(-100) of the start."""
    for circuit, expected in (
        (coupled.scissor(THREE, phase=0.6, loss=0.3), scissor_by_transfer_matrices(THREE, nu, 0.6, 0.3)),
        (coupled.crow(THREE), crow_by_transfer_matrices(THREE, nu)),
    ):
        powers = np.abs(expected) ** 2
        at = coupled.transmission(circuit, detuning=[nu]).transmission.isel(detuning=0)
        assert at.values == pytest.approx(powers, rel=1e-9, abs=1e-12)
        run = coupled.simulate(
            circuit, SECOND_ORDER, power={"in": FAINT}, detuning=nu, duration=3e-9, rtol=1e-9, times=[3e-9]
        )
        assert run.output.isel(time=0).values / FAINT == pytest.approx(powers, rel=0, abs=1e-6)


def bus_of_four():
    """Every ring has poles of its own, and the light of all before it comes by one waveguide with loss and phase."""
    rings = [replace(RING, frequency=RING.frequency + df) for df in (0.0, 4e9, -3e9, 1e9)]
    ways = [
        coupled.Waveguide(f"ring {k}.through", f"ring {k + 1}.in", loss=0.2 * k, phase=0.5 + k) for k in range(1, 4)
    ]
    rate = np.concatenate([(1 + 0.3 * k) / np.asarray(SECOND_ORDER.tau) for k in range(4)])
    B = np.kron(np.eye(4), np.sqrt(np.asarray(SECOND_ORDER.R))[:, None]) * np.sqrt(rate)[:, None]
    B[0, 1] = B[2, 0] = 0.2 * B[0, 0]
    names = ("one", "two", "three", "four")
    model = th.StateSpace(np.eye(8), -np.diag(rate), B, B.T, inputs=names, outputs=names)
    return coupled.Circuit(rings, ways, [coupled.LaserPort("in", "ring 1.in")]), model, {"in": 4e-3}, 40e-9


def two_that_pulse():
    """Ring 1 pulses once; crosstalk by extrapolation against crosstalk in the Jacobian."""
    lasers = [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")]
    return coupled.Circuit([RING, RING], (), lasers), pair(), {"one": POWER, "two": 3e-3}, 0.6e-6


@pytest.mark.parametrize("case", [two_that_pulse, bus_of_four])
def test_rings_that_heat_each_other_against_lsoda(case):
    circuit, model, inputs, duration = case()
    times, n = np.linspace(0, duration, 61), len(circuit.rings)
    run = coupled.simulate(circuit, model, power=inputs, duration=duration, rtol=1e-9, times=times)
    f, heat = parts_of_run(circuit, model, inputs, duration)
    start = np.zeros(3 * n + heat.gain.size)
    exact = solve_ivp(f, (0, duration * 1e9), start, "LSODA", rtol=1e-10, atol=1e-12, t_eval=times[1:] * 1e9)
    rise = np.einsum("ijk,jkt->it", heat.read, exact.y[3 * n :].reshape(n, -1, len(times) - 1))
    assert run.delta_T.values[:, 1:] == pytest.approx(rise, rel=0, abs=2e-6 * rise.max())
    energy = (exact.y[0 : 3 * n : 3] ** 2 + exact.y[1 : 3 * n : 3] ** 2) * 1e-15
    # 1e-9 a step, magnified where ring 1 pulses
    within = 2e-5 if case is two_that_pulse else 1e-6
    assert run.energy.values[:, 1:] == pytest.approx(energy, rel=0, abs=within * energy.max())


def test_two_lasers_of_different_frequency_beat_as_lsoda_says():
    circuit = coupled.Circuit(
        [RING, replace(RING, frequency=RING.frequency + 40e9)],
        [coupled.Waveguide("ring 1.through", "ring 2.in", phase=0.3)],
        [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 1.add", offset=40e9)],
    )
    inputs, times = {"one": 2e-3, "two": 1e-3}, np.linspace(0, 2e-9, 101)
    run = coupled.simulate(circuit, SECOND_ORDER, power=inputs, duration=2e-9, rtol=1e-9, times=times)
    f, heat = parts_of_run(circuit, SECOND_ORDER, inputs, 2e-9)
    exact = solve_ivp(
        f, (0, 2), np.zeros(6 + heat.gain.size), method="DOP853", rtol=1e-9, atol=1e-11, t_eval=times[1:] * 1e9
    )
    energy = (exact.y[[0, 3]] ** 2 + exact.y[[1, 4]] ** 2) * 1e-15
    assert run.energy.values[:, 1:] == pytest.approx(energy, rel=0, abs=1e-6 * energy.max())


def test_a_linear_delay_loop_has_its_closed_form():
    """Until the light has gone round twice: exponentials, and one of them times t."""
    delay, loss, phase = 0.3e-9, 2.0, 0.9
    times = np.linspace(0, 2 * delay, 81)
    run = coupled.simulate(
        delay_loop(RING, delay, loss=loss, phase=phase), SECOND_ORDER,
        power={"in": FAINT}, detuning=3e9,
        duration=2 * delay, rtol=1e-9, times=times,
    )  # fmt: skip
    ke, kd, s = np.sqrt(2 * RING.bus_rate), np.sqrt(2 * RING.drop_bus_rate), np.sqrt(FAINT)
    eta = 10 ** (-loss / 20) * np.exp(-1j * phase - 2j * np.pi * 3e9 * delay)
    rate = -1j * 2 * np.pi * 3e9 - GAMMA
    A = -1j * ke * s / rate  # where a goes without feedback
    first = A * (1 - np.exp(rate * times))
    u = times - delay
    force = 1j * ke * s + 1j * kd * eta * (s + 1j * ke * A)
    grown = np.exp(rate * u)
    second = A * (1 - np.exp(rate * delay)) * grown + force * (grown - 1) / rate + kd * ke * eta * A * u * grown
    expected = np.where(times < delay, np.abs(first) ** 2, np.abs(second) ** 2)
    assert run.energy.values[0] == pytest.approx(expected, rel=0, abs=1e-7 * expected.max())
    add = np.where(times < delay, 0, eta * (s + 1j * ke * A * (1 - np.exp(rate * u))))
    out = np.abs(add + 1j * kd * np.where(times < delay, first, second)) ** 2
    later = np.abs(u) > 1e-14  # the power jumps there
    assert run.output.values[0][later] == pytest.approx(out[later], rel=0, abs=1e-6 * FAINT)


def test_a_nonlinear_delay_loop_against_the_method_of_steps():
    """Each pass over the delay as an ordinary equation, by SciPy's DOP853 with its dense output for the past."""
    delay, duration = 1e-9, 6e-9
    times = np.linspace(0, duration, 121)
    circuit = delay_loop(RING, delay, loss=1.0, phase=0.4)
    run = coupled.simulate(circuit, SECOND_ORDER, power={"in": 3e-3}, duration=duration, rtol=1e-9, times=times)
    f, heat = parts_of_run(coupled.bus(RING), SECOND_ORDER, {"in": 3e-3}, duration)
    ke, kd, s = np.sqrt(2 * RING.bus_rate * 1e-9), np.sqrt(2 * RING.drop_bus_rate * 1e-9), np.sqrt(3e3)
    eta, past, y = 10 ** (-1 / 20) * np.exp(-0.4j), None, np.zeros(3 + heat.gain.size)
    for lap in range(6):

        def g(t, y, past=past):
            out = f(t, y)
            if past is not None:
                b = past.sol(t - 1.0)
                push = 1j * kd * eta * (s + 1j * ke * (b[0] + 1j * b[1]))
                out[0] += push.real
                out[1] += push.imag
            return out

        past = solve_ivp(g, (lap, lap + 1.0), y, method="DOP853", rtol=1e-9, atol=1e-11, dense_output=True)
        y = past.y[:, -1]
        here = (times * 1e9 > lap) & (times * 1e9 <= lap + 1)
        a = past.sol(times[here] * 1e9)
        expected = (a[0] ** 2 + a[1] ** 2) * 1e-15
        assert run.energy.values[0][here] == pytest.approx(expected, rel=0, abs=1e-6 * 2e-14)


def test_a_detector_with_a_bandwidth_is_a_low_pass():
    """Against the exact recurrence of a low pass on finely sampled powers, straight between the samples."""
    base = coupled.scissor([RING, RING])
    slow = [replace(detector, bandwidth=2e9 if detector.name == "drop" else 0.0) for detector in base.detectors]
    circuit, x = replace(base, detectors=slow), 2 * np.pi * 2e9 * 0.5e-12
    times = np.linspace(0, 2e-9, 4001)
    arguments = {"power": {"in": th.SquareWave(power=2e-3, period=0.5e-9, duty=0.5)}, "duration": 2e-9, "rtol": 1e-8}
    run = coupled.simulate(circuit, SECOND_ORDER, **arguments, times=times)
    power, shown = run.output.sel(port="drop").values, [0.0]
    for before, after in pairwise(power):
        rise = (after - before) / x
        shown.append((shown[-1] - before + rise) * np.exp(-x) + after - rise)
    # straight lines of 0.5 ps miss a field that changes over 5 ps by (0.1)^2/12 where it bends, less on average
    assert run.detected.sel(port="drop").values == pytest.approx(np.array(shown), rel=0, abs=1e-4 * power.max())
    assert np.array_equal(run.detected.sel(port="through"), run.output.sel(port="through"))
    few = times[::400]
    means = coupled.simulate(circuit, SECOND_ORDER, **arguments, times=few, average=True)
    sums = np.add.reduceat((np.array(shown)[1:] + np.array(shown)[:-1]) / 2, np.arange(0, 4000, 400)) / 400
    assert means.mean_output.sel(port="drop").values[1:] == pytest.approx(sums, rel=0, abs=1e-4 * power.max())


@pytest.mark.parametrize("later", [{"heater": 1e-3}, {"heater": th.Constant(1e-3)}, {"heater": 0.0}, None])
def test_a_run_goes_on_with_the_heat_of_its_heaters(later):
    """The heat that a heater has left is there when the second run begins: 5.06 K."""
    both = pair()
    B = np.column_stack([both.B, 0.3 * both.B[:, 0]])
    model = th.StateSpace(both.E, both.A, B, both.C, inputs=("one", "two", "heater"), outputs=("one", "two"))
    circuit, times = coupled.bus([RING, RING]), np.linspace(0, 2e-6, 21)
    on = later is not None and later["heater"] != 0.0
    wave = th.Constant(1e-3) if on else th.Pulse(1e-3, 1e-6)
    run = {"power": {"in": FAINT}, "rtol": 1e-8}
    whole = coupled.simulate(circuit, model, heaters={"heater": wave}, duration=2e-6, times=times, **run)
    half = coupled.simulate(circuit, model, heaters={"heater": th.Constant(1e-3)}, duration=1e-6, **run)
    rest = coupled.simulate(circuit, model, heaters=later, duration=1e-6, times=times[10:] - 1e-6, initial=half, **run)
    # cubics between samples miss an exponential by 1e-6 of it
    np.testing.assert_allclose(rest.delta_T, whole.delta_T[:, 10:], rtol=0, atol=1e-5 * float(whole.delta_T.max()))


def test_a_run_of_another_model_is_not_gone_on_from():
    inputs, other = {"in": POWER}, th.Foster(R=[2e3, 5e3], tau=[1e-7, 1e-5])
    run = coupled.simulate(coupled.bus([RING]), SECOND_ORDER, power=inputs, duration=1e-8)
    with pytest.raises(th.InputError, match="initial was made with other time constants"):
        coupled.simulate(coupled.bus([RING]), other, power=inputs, duration=1e-8, initial=run)
    run = coupled.simulate(RING, SECOND_ORDER, power=POWER, duration=1e-8)
    with pytest.raises(th.InputError, match="initial was made with other time constants"):
        coupled.simulate(RING, other, power=POWER, duration=1e-8, initial=run)
    with pytest.raises(th.InputError, match="or another output map"):  # it jumped, by 0.2 K of 9.9 K
        coupled.simulate(RING, th.OutputMap(SECOND_ORDER, 2e-3), power=POWER, duration=1e-8, initial=run)


def test_scatter_is_normal_and_reproducible():
    circuit = coupled.bus([RING] * 400)
    scattered = circuit.scattered(3e9, seed=4)
    shift = np.array([ring.frequency for ring in scattered.resonators]) - RING.frequency
    assert np.std(shift) == pytest.approx(3e9, rel=0.15, abs=0)  # 4 sigma of 400 draws
    assert scattered.scattered(0.0).names == circuit.names
    assert [r.frequency for r in circuit.scattered(3e9, seed=4).resonators] == [
        r.frequency for r in scattered.resonators
    ]
    assert scattered.frequency == RING.frequency


def test_rings_of_a_chain_are_shifted_and_the_first_is_the_reference():
    """Detunings count from the first ring, 2 GHz above RING: light passes it and leaves by the other's drop port."""
    bus = coupled.bus([RING, RING], shift=[2e9, 5e9])
    assert bus.frequency == bus.resonators[0].frequency == pytest.approx(RING.frequency + 2e9, rel=1e-12)
    detuning = np.array([-1e9, 0.5e9, 3e9])
    found = coupled.transmission(bus, detuning=detuning).transmission.sel(port="drop 2").values
    passed = [response(bus.resonators[0], 2e9 + df)[0, 0] for df in detuning]
    dropped = [response(bus.resonators[1], 2e9 + df)[1, 0] for df in detuning]
    assert found == pytest.approx(np.abs(np.multiply(passed, dropped)) ** 2, rel=1e-9)
    run = coupled.simulate(bus, SECOND_ORDER, power={"in": 1e-6}, duration=1e-10)
    assert run.attrs["frequency"] == bus.frequency
    assert coupled.crow([RING] * 2, shift=-1e9).resonators[1].frequency == RING.frequency - 1e9
    with pytest.raises(th.InputError, match="shift has shape"):
        coupled.bus([RING, RING], shift=[1e9])


def test_a_circuit_file_is_the_circuit_that_it_documents(tmp_path):
    text = (
        (ROOT / "docs/circuits.md").read_text(encoding="utf-8").split('```toml title="bus.toml"\n')[1].split("```")[0]
    )
    (tmp_path / "circuit.toml").write_text(text)
    circuit = coupled.Circuit.from_toml(tmp_path / "circuit.toml")
    assert circuit.names == ("a", "b")
    assert circuit.resonators[0].frequency == pytest.approx(RING.frequency + 5e9, rel=1e-12, abs=0)
    assert circuit.waveguides == (coupled.Waveguide("a.through", "b.in", loss=0.3, phase=0.5, delay=10e-12),)
    assert circuit.ports == ("out", "a.drop", "b.drop", "s.out 1", "s.out 2")
    (tmp_path / "wrong.toml").write_text(text.replace("delay", "dealy"))
    with pytest.raises(th.InputError, match="waveguide number 1: key = 'dealy' is unknown; did you mean 'delay'"):
        coupled.Circuit.from_toml(tmp_path / "wrong.toml")


def test_heat_goes_to_the_rings_that_the_model_names(caplog):
    """The first of the model heated the first of the circuit, whatever their names: 8.80 K where 5.94 K is right."""
    ring = coupled.borghi2021()
    E, A = np.diag([1e-9, 2e-9]), -np.diag([1.3e-4, 2e-4])
    model = th.StateSpace(E, A, np.eye(2), np.eye(2), ("ring 1", "ring 2"), ("ring 1", "ring 2"))
    rises = {}
    for names in (("ring 1", "ring 2"), ("ring 2", "ring 1"), ("a", "b")):
        ports = [coupled.LaserPort(name, f"{name}.in") for name in names]
        both = coupled.Circuit(dict.fromkeys(names, ring), lasers=ports)
        run = coupled.simulate(both, model, power=dict.fromkeys(names, 5e-3), duration=1e-7)
        rises[names] = run.delta_T.isel(time=-1).to_series()
    right, turned, other = rises.values()
    assert right["ring 1"] == pytest.approx(turned["ring 1"], rel=1e-9)
    assert right["ring 2"] == pytest.approx(turned["ring 2"], rel=1e-9)
    assert right["ring 1"] > 1.5 * right["ring 2"]
    assert other["a"] == pytest.approx(right["ring 1"], rel=1e-9)
    assert not caplog.messages
    parts = replace(model, inputs=("core", "heater"), outputs=("core", "heater"))
    coupled.simulate(both, parts, power={"a": 5e-3}, duration=1e-8)
    assert "thermal is of core, heater: they stand for the rings a, b, in this order" in caplog.text


def test_a_circuit_can_be_copied_and_sent_to_a_worker():
    circuit = coupled.bus([RING])
    again = pickle.loads(pickle.dumps(circuit))
    assert again == circuit == copy.deepcopy(circuit)
    assert list(again.rings) == ["ring 1"]


RATE = np.array([1 / 60e-9, 1 / 1.2e-6, 1 / 8e-6])
OWN, OTHER = np.array([[0.8, 0.6, 0.4], [0.02, 0.3, 0.5]]) * np.sqrt(5000 * RATE)


def heated(rate=RATE, own=OWN, other=OTHER) -> th.StateSpace:
    """One ring and one heater."""
    B = np.column_stack([own, other])
    return th.StateSpace(
        np.eye(rate.size), -np.diag(rate), B, own[None], inputs=("ring 1", "heater"), outputs=("ring 1",)
    )


def test_a_heater_takes_what_the_heater_of_a_ring_takes():
    """Lists, which add; powers that no heater has are refused."""
    circuit, run = coupled.bus(RING), {"power": {}, "duration": 2e-6, "times": np.linspace(0, 2e-6, 9), "rtol": 1e-8}
    bias, pulse = th.Constant(1e-3), th.Pulse(2e-3, width=0.3e-6, start=0.5e-6)
    each = [coupled.simulate(circuit, heated(), heaters={"heater": w}, **run) for w in (bias, pulse)]
    both = coupled.simulate(circuit, heated(), heaters={"heater": [1e-3, pulse]}, **run)
    expected = sum(one.delta_T.values for one in each)
    np.testing.assert_allclose(both.delta_T, expected, rtol=0, atol=3e-10 * expected.max())  # 0.01 rtol of three runs
    assert np.array_equal(both.heater_power, sum(one.heater_power.values for one in each))
    for wave in (th.Function(lambda t: 1e-3 * np.sin(1e7 * t)), th.Function(lambda t: 20.0 + 0 * t), 20.0, -1e-3):
        with pytest.raises(th.InputError, match=r"heaters\['heater'\] = .* must lie between 0 and 10"):
            coupled.simulate(circuit, heated(), heaters={"heater": wave}, **run)


def test_a_run_goes_on_under_a_function():
    """A sine in two halves, the second from the heat of the first, against a whole one."""
    circuit, run = coupled.bus(RING), {"power": {"in": 1e-3}, "detuning": -20e9, "rtol": 1e-9}
    period, times = 1e-6, np.linspace(0, 2e-6, 21)
    wave = th.Function(lambda t: 2e-3 * (1 + np.sin(2 * np.pi * t / period)))
    whole = coupled.simulate(circuit, heated(), heaters={"heater": wave}, duration=2e-6, times=times, **run)
    half = coupled.simulate(circuit, heated(), heaters={"heater": wave}, duration=1e-6, **run)
    rest = coupled.simulate(
        circuit, heated(), heaters={"heater": wave}, duration=1e-6, times=times[10:] - 1e-6, initial=half, **run
    )
    # 1e-9 a step of some hundred steps
    np.testing.assert_allclose(rest.delta_T, whole.delta_T[:, 10:], rtol=0, atol=3e-7 * float(whole.delta_T.max()))


def test_the_cycle_beside_a_heater_is_that_of_limit_cycle():
    """A circuit whose model has a heater begins with no states of it."""
    rate = np.append(1 / np.asarray(SECOND_ORDER.tau), 1 / 5e-6)
    own, other = np.sqrt(np.append(SECOND_ORDER.R, 100.0) * rate), np.array([0.2, 0.3, 0.5]) * np.sqrt(1000 * rate)
    model = heated(rate, own, other)
    for heaters in ({"heater": 1e-3}, None):
        cycle = coupled.limit_cycle(coupled.bus(RING), model, power={"in": 6.31e-3}, heaters=heaters)
        one = coupled.limit_cycle(RING, model, power=6.31e-3, heaters=heaters, heated="ring 1", read="ring 1")
        assert cycle.attrs["period"] == pytest.approx(one.attrs["period"], rel=1e-5, abs=0)  # limit_cycle's own error


@pytest.fixture(scope="module")
def on_a_bus():
    """Two rings on a bus; the first one takes the light, and the second one what it leaves."""
    return coupled.simulate(coupled.bus([RING, RING]), SECOND_ORDER, power={"in": POWER}, duration=8e-6)


def test_a_ring_of_a_circuit_pulses_as_it_does_alone(on_a_bus):
    found = coupled.pulsing(on_a_bus.sel(ring="ring 1"))
    alone = coupled.pulsing(coupled.simulate(RING, SECOND_ORDER, power=POWER, duration=8e-6))
    assert found.regime == alone.regime == "self-pulsing"
    # no heat and no light comes back to the first ring; both runs have rtol 1e-6
    np.testing.assert_allclose([found.period, found.duty], [alone.period, alone.duty], rtol=1e-4)
    with pytest.raises(th.InputError, match=r"holds 2 rings; pick one of them, run.sel\(ring='ring 1'\)"):
        coupled.pulsing(on_a_bus)


@pytest.mark.parametrize(("plot", "count"), [(plot_rings, 2), (plot_ports, 3)])
def test_every_line_has_its_panel(on_a_bus, plot, count):
    first = plot(on_a_bus)
    assert [len(panel.lines) for panel in first.figure.axes] == [1] * count
    assert len(plot(on_a_bus, ax=first.figure.axes[-1]).lines) == count + 1
    plt.close("all")
    with pytest.raises(th.InputError, match=r"run has no 'drop'.*plot_rings and plot_ports draw"):
        plot_traces(on_a_bus)
