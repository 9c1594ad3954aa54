"""Rings of different heat along one waveguide."""

from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp
from test_circuit import parts_of_run

import coupled
import thermofem as th

DURATION, TIMES = 2e-9, np.linspace(0, 2e-9, 21)


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
