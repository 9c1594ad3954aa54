"""Several lasers on one ring: exact limits, SciPy, energy, and the decay that a probe sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from correctors import NETWORK
from scipy.integrate import solve_ivp

import coupled
import thermofem as th
from coupled.carriers import carrier_decay
from coupled.kernel import integrator

RING = replace(coupled.borghi2021(), kerr_coefficient=4.5e-18)
NEXT = replace(RING, frequency=RING.frequency + 1.5e12, bus_rate=35e9, loss_rate=7e9)
NAMES = ("energy", "carriers", "delta_T", "drop", "through", "absorbed")


def apart(first, second):
    """Largest difference of two runs, relative to the largest value of each trace."""
    return max(float(abs(first[name] - second[name]).max() / abs(first[name]).max()) for name in NAMES)


def test_a_probe_without_power_changes_nothing():
    """1e-7: ten times the tolerance of a step, through one pulse."""
    drive = {"power": 6.31e-3, "duration": 0.8e-6, "rtol": 1e-8}
    alone = coupled.simulate(RING, NETWORK, **drive)
    run = coupled.simulate(RING, NETWORK, lasers=coupled.Laser(0.0, -5e9, NEXT), times=alone["time"].values, **drive)
    assert apart(alone, run) < 2e-7
    assert run["probe_energy"].values.max() == 0


@pytest.mark.parametrize("model", [NETWORK, th.OutputMap(NETWORK, -4e-4)], ids=["network", "output map"])
def test_two_lasers_of_one_frequency_and_phase_are_one(model):
    drive = {"duration": 0.8e-6, "rtol": 1e-8, "detuning": 2e9}
    one = coupled.simulate(RING, model, power=(np.sqrt(5e-3) + np.sqrt(0.1e-3)) ** 2, **drive)
    two = coupled.simulate(
        RING, model, power=5e-3, lasers=coupled.Laser(0.1e-3, 2e9), times=one["time"].values, **drive
    )
    assert apart(one, two) < 2e-7
    opposite = coupled.simulate(RING, model, power=5e-3, lasers=coupled.Laser(5e-3, 2e9, phase=np.pi), **drive)
    assert opposite["energy"].values.max() < 1e-25  # against 1e-14


def right_hand_side(lasers):
    """Two resonances in SI; ``lasers``: (power, detuning, resonance number), phases written out in time."""
    rings = (RING, NEXT)

    def right(t, scaled):
        y = scaled * np.array([1e-7, 1e-7, 1e23, 1, 1, 1e-7, 1e-7])
        a, N, x = (y[0] + 1j * y[1], y[5] + 1j * y[6]), y[2], y[3:5]
        U = [abs(one) ** 2 for one in a]
        da, heat, made = [], 0.0, 0.0
        for k, (ring, field) in enumerate(zip(rings, a, strict=True)):
            both = U[k] + 2 * U[1 - k]
            own = ring.loss_rate + ring.eta_fca * N + ring.eta_tpa * both
            index = ring.thermo_optic * x.sum() + sum(c * N * (N * N + 1e30) ** ((p - 1) / 2) for c, p in ring.fcd)
            reference = next(nu for _, nu, at in lasers if at == k)
            D = -ring.index_rate * index - ring.kerr_shift * both - 2 * np.pi * reference
            comes = sum(np.sqrt(P) * np.exp(2j * np.pi * (nu - reference) * t) for P, nu, at in lasers if at == k)
            da.append((1j * D - own - 2 * ring.bus_rate) * field + 1j * np.sqrt(2 * ring.bus_rate) * comes)
            heat += 2 * own * U[k]
            made += ring.g_tpa * U[k] * both
        c = RING.carriers
        dN = made - N * (1 + c.b * N) / (c.tau0 * (1 + c.a * N))
        dx = (np.asarray(NETWORK.R) * heat - x) / np.asarray(NETWORK.tau)
        flat = [da[0].real, da[0].imag, dN, *dx, da[1].real, da[1].imag]
        return np.array(flat) / np.array([1e-7, 1e-7, 1e23, 1, 1, 1e-7, 1e-7])

    return right


def test_scipy_agrees_on_three_lasers():
    """A pump, a laser 4 GHz beside it and one on the next resonance; SciPy's DOP853 at 1e-10 over 1 ns."""
    lasers = [(4e-3, -1e9, 0), (1e-3, 3e9, 0), (2e-3, -4e9, 1)]
    times = np.linspace(0, 1e-9, 41)
    expected = solve_ivp(
        right_hand_side(lasers), (0, 1e-9), np.zeros(7), "DOP853", times, max_step=2e-12, rtol=1e-10, atol=1e-13
    ).y
    run = coupled.simulate(
        RING, NETWORK, power=4e-3, detuning=-1e9, lasers=[coupled.Laser(1e-3, 3e9), coupled.Laser(2e-3, -4e9, NEXT)],
        duration=1e-9, times=times, rtol=1e-9,
    )  # fmt: skip
    for values, wanted in (
        (run["energy"].values, 1e-14 * (expected[0] ** 2 + expected[1] ** 2)),
        (run["probe_energy"].values[0], 1e-14 * (expected[5] ** 2 + expected[6] ** 2)),
        (run["carriers"].values, 1e23 * expected[2]),
        (run["delta_T"].values, expected[3] + expected[4]),
    ):
        assert values == pytest.approx(wanted, rel=0, abs=1e-6 * wanted.max())


def test_energy_is_conserved_over_all_resonances():
    """In = out + absorbed + change of what is stored; trapezoids between steps of rtol 1e-8 leave 1e-5."""
    lasers = [coupled.Laser(2e-3, -4e9, NEXT), coupled.Laser(1e-3, 2e9)]
    run = coupled.simulate(RING, NETWORK, power=3e-3, lasers=lasers, duration=5e-9, rtol=1e-8)
    t = run["time"].values
    ports = sum(run[f"probe_{name}"].values[0] + run[name].values for name in ("drop", "through"))
    into = run["input_power"].values + run["probe_input_power"].values[0]
    stored = run["energy"].values[-1] + run["probe_energy"].values[0, -1]
    spent = np.trapezoid(ports + run["absorbed"].values, t) + stored
    assert np.trapezoid(into, t) == pytest.approx(spent, rel=1e-5, abs=0)


def test_a_weak_probe_sees_the_carriers_of_a_pump_pulse_decay():
    """Pump and probe, as in Fig. 3 of Borghi et al. (2021): the probe's resonance follows N(t) to lower index.

    After the pulse N decays as the closed form says; the probe's drop power is the Lorentzian at the shift by carriers
    and heat, within the 1e-3 by which it lags.
    """
    ring = coupled.borghi2021()
    after = replace(ring, frequency=ring.frequency + 1.5e12)
    pump, probe = th.Pulse(20e-3, width=1e-9), coupled.Laser(1e-7, 20e9, after)
    times = np.concatenate([[0.0], np.linspace(2e-9, 120e-9, 60)])
    run = coupled.simulate(ring, NETWORK, power=pump, lasers=probe, duration=120e-9, times=times, rtol=1e-9)
    N, t = run["carriers"].values[1:], times[1:]
    assert N[0] > 3e22
    decay = carrier_decay(ring.carriers, N[0], t - t[0])
    assert abs(N / decay["carriers"].values - 1).max() < 1e-4
    index = ring.thermo_optic * run["delta_T"].values[1:] + sum(c * N**p for c, p in ring.fcd)
    D = -after.index_rate * index - 2 * np.pi * 20e9
    gamma = ring.linear_rate + ring.eta_fca * N
    wanted = 4 * ring.bus_rate**2 * 1e-7 / (gamma**2 + D**2)
    assert run["probe_drop"].values[0, 1:] == pytest.approx(wanted, rel=2e-3)
    assert np.ptp(wanted) > 0.2 * wanted.max()  # so that the decay is seen


def test_a_run_goes_on_with_its_lasers():
    drive = {"power": 3e-3, "lasers": coupled.Laser(1e-3, -5e9, NEXT), "rtol": 1e-9}
    whole = coupled.simulate(RING, NETWORK, duration=20e-9, **drive)
    first = coupled.simulate(RING, NETWORK, duration=8e-9, **drive)
    second = coupled.simulate(RING, NETWORK, duration=12e-9, initial=first, **drive)
    for name in ("final_state", "final_fields"):
        assert second.attrs[name] == pytest.approx(whole.attrs[name], rel=1e-6, abs=0)


def test_light_goes_on_at_its_own_resonance():
    """Lasers in another order keep each its light; damaged light is refused."""
    lasers = [
        coupled.Laser(1e-3, 0.0, NEXT),
        coupled.Laser(0.2e-3, 0.0, replace(NEXT, frequency=NEXT.frequency + 1e12)),
    ]
    first = coupled.simulate(RING, NETWORK, power=1e-3, duration=1e-9, lasers=lasers)
    options = {"power": 1e-3, "duration": 1e-12, "initial": first}
    one, other = (coupled.simulate(RING, NETWORK, lasers=given, **options) for given in (lasers, lasers[::-1]))
    began = one["probe_energy"].values[:, 0]
    np.testing.assert_array_equal(other["probe_energy"].values[::-1, 0], began)
    assert began == pytest.approx(first["probe_energy"].values[:, -1], rel=1e-9, abs=0)
    for bad in ("x", [1.0, 2.0, 3.0], [float("nan")] * 4):
        damaged = first.assign_attrs(final_fields=bad)
        with pytest.raises(th.InputError, match="initial"):
            coupled.simulate(RING, NETWORK, lasers=lasers, **(options | {"initial": damaged}))


def test_an_event_of_the_first_field_under_two_lasers():
    """The crossing is where the energy, known at other times within the tolerance of a step, is the level."""
    drive = {"power": 3e-3, "lasers": coupled.Laser(2e-3, -4e9, NEXT), "duration": 1e-9, "rtol": 1e-9}
    whole = coupled.simulate(RING, NETWORK, **drive)
    level = 0.5 * float(whole["energy"].max())
    run = coupled.simulate(RING, NETWORK, event=coupled.Event("energy", level), **drive)
    at = np.interp(level, whole["energy"].values[:50], whole["time"].values[:50])  # rising
    assert run.attrs["crossings"][0] == pytest.approx(at, rel=1e-4)
    assert float(run["energy"][-1]) == pytest.approx(level, rel=1e-7, abs=0)


def test_a_beat_of_too_many_steps_is_refused_before_the_run():
    """A step lasts a tenth of a beat at most: 10 x 1 GHz x 2.1 ms are 2.1e7 steps, of 2e7 that are possible."""
    reached = []
    run = {"power": 1e-3, "duration": 2.1e-3, "times": [0.0, 1e-3], "progress": reached.append}
    with pytest.raises(th.InputError, match=r"takes 2\.1e\+07 steps at least, as none is longer than 0\.1 ns"):
        coupled.simulate(RING, NETWORK, lasers=[coupled.Laser(1e-3, 1e9)], **run)
    assert not reached


def test_a_beat_that_does_not_fit_into_the_memory_is_refused_before_the_run(monkeypatch):
    """10 x 1 GHz x 1 us are 10,000 rows; there is room for 8192 where 50,000 numbers are allowed: 5 or 6 a row."""
    monkeypatch.setattr(integrator, "MOST_NUMBERS", 50_000)
    reached = []
    run = {"power": 1e-3, "duration": 1e-6, "progress": reached.append}
    beat = [coupled.Laser(1e-3, 1e9)]
    with pytest.raises(th.InputError, match=r"takes 1e\+04 steps at least.*do not fit into the memory; give times"):
        coupled.simulate(RING, NETWORK, lasers=beat, **run)
    assert not reached
    assert coupled.simulate(RING, NETWORK, lasers=beat, times=[0.0, 1e-6], **run).sizes["time"] == 2
    stopping = coupled.Event("energy", 1e-16)
    assert coupled.simulate(RING, NETWORK, lasers=beat, event=stopping, **run).attrs["crossings"].size == 1
