"""Circuits of separate parts, rings of different heat along one waveguide, and what a step must not hide."""

from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp
from test_circuit import parts_of_run

import coupled
import thermofem as th
from coupled.circuit import separate, simulate

DURATION, TIMES = 2e-9, np.linspace(0, 2e-9, 21)


def three(**options) -> coupled.Circuit:
    """Rings a and c on one bus, b between them in the list but alone, d dark."""
    rings = {"a": RING, "b": replace(RING, frequency=RING.frequency + 3e9), "c": RING, "d": RING}
    ways = [coupled.Waveguide("a.through", "c.in", loss=0.4, phase=0.7)]
    lasers = [coupled.LaserPort("two", "b.in"), coupled.LaserPort("one", "a.in")]
    return coupled.Circuit(rings, ways, lasers, **options)


def run(circuit, **options):
    wave = th.SquareWave(power=2e-3, period=0.5e-9, duty=0.5)
    given = {"inputs": {"one": wave, "two": 3e-3}, "duration": DURATION, "rtol": 1e-9, "times": TIMES}
    return coupled.simulate(circuit, SECOND_ORDER, **(given | options))


def test_separate_parts_run_alone_and_come_back_in_their_places(monkeypatch):
    detectors = [coupled.Detector("slow", "c.drop", bandwidth=5e9)]
    circuit, heard = three(detectors=detectors), []
    apart = run(circuit, average=True, progress=heard.append)
    monkeypatch.setattr(simulate, "parts_of", lambda circuit: [circuit])
    together = run(circuit, average=True)
    assert apart.attrs["rejected_steps"] + apart.attrs["steps"] > together.attrs["steps"]  # of both parts
    for name in together.data_vars:
        # rtol = 1e-9 in a step, some hundred of which add up
        size = np.pi if name == "phase" else float(np.abs(together[name]).max())
        dark = np.zeros(together[name].shape, dtype=bool)
        if name == "phase":
            dark = together.output.values < 1e-12
        difference = np.where(dark, 0, np.angle(np.exp(1j * (apart[name] - together[name]))) if name == "phase" else
                              apart[name] - together[name])  # fmt: skip
        assert apart[name].dims == together[name].dims
        assert np.abs(difference).max() <= 1e-6 * size, name
    for dim in ("ring", "port", "laser"):
        assert list(apart[dim].values) == list(together[dim].values)
    final, expected = apart.attrs["final_state"], together.attrs["final_state"]
    assert np.abs(final - expected).max() <= 1e-6 * np.abs(expected).max()
    assert set(apart.attrs) == set(together.attrs)
    assert heard == sorted(heard)
    assert heard[-1] == DURATION


def test_parts_are_what_light_separates():
    assert [part.names for part in separate.parts_of(three())] == [
        ("b", "d"),
        ("a", "c"),
    ]  # the dark one with the first
    joined = replace(three(), waveguides=[*three().waveguides, coupled.Waveguide("c.through", "b.add")])
    assert len(separate.parts_of(joined)) == 1
    beating = [coupled.LaserPort("one", "a.in"), coupled.LaserPort("two", "b.in", offset=1e9)]
    assert len(separate.parts_of(replace(three(), lasers=beating))) == 1  # phases turn against the first laser


def test_rings_of_different_heat_along_one_bus_against_lsoda():
    """Every ring has poles of its own, and the light of all before it arrives by one waveguide with loss and phase."""
    rings = [replace(RING, frequency=RING.frequency + df) for df in (0.0, 4e9, -3e9, 1e9)]
    ways = [
        coupled.Waveguide(f"ring {k}.through", f"ring {k + 1}.in", loss=0.2 * k, phase=0.5 + k) for k in range(1, 4)
    ]
    circuit = coupled.Circuit(rings, ways, [coupled.LaserPort("in", "ring 1.in")])
    rate = np.concatenate([(1 + 0.3 * k) / np.asarray(SECOND_ORDER.tau) for k in range(4)])
    B = np.kron(np.eye(4), np.sqrt(np.asarray(SECOND_ORDER.R))[:, None]) * np.sqrt(rate)[:, None]
    B[0, 1] = B[2, 0] = 0.2 * B[0, 0]
    names = ("one", "two", "three", "four")
    model = th.StateSpace(np.eye(8), -np.diag(rate), B, B.T, inputs=names, outputs=names)
    inputs, times = {"in": 4e-3}, np.linspace(0, 40e-9, 41)
    found = coupled.simulate(circuit, model, power=inputs, duration=40e-9, rtol=1e-9, times=times)
    f, heat = parts_of_run(circuit, model, inputs, 40e-9)
    start = np.zeros(4 * (3 + heat.gain.shape[1]))
    exact = solve_ivp(f, (0, 40), start, method="LSODA", rtol=1e-11, atol=1e-13, t_eval=times[1:] * 1e9)
    energy = (exact.y[0:12:3] ** 2 + exact.y[1:12:3] ** 2) * 1e-15
    assert found.energy.values[:, 1:] == pytest.approx(energy, rel=0, abs=1e-6 * energy.max())
    x = exact.y[12:].reshape(4, -1, len(times) - 1)
    rise = np.einsum("ijk,jkt->it", heat.read, x)
    assert found.delta_T.values[:, 1:] == pytest.approx(rise, rel=0, abs=1e-6 * rise.max())


def test_a_step_that_ends_in_no_number_in_any_ring_is_refused():
    """The error of a step is that of the worst ring; a NaN in the second one passed for none."""
    from coupled.circuit.kernel import step_error, workspace
    from coupled.circuit.system import system_of

    parts = system_of(three(), SECOND_ORDER, power={"one": 1e-3}, duration=1e-9)
    w = workspace(parts.rings, parts.states, False, 6, 6)
    for values in (w.start, w.after, w.weight):
        values[:] = 1.0
    y, k, zero = np.ones(20), np.zeros((6, 16)), np.zeros(4)
    error = lambda: step_error(y, y, k, parts.rings, 1e-6, zero, zero, w)  # noqa: E731
    assert np.isfinite(error())
    k[-1, 1] = np.nan
    assert np.isnan(error())
