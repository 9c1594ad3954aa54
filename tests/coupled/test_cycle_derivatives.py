"""Derivatives of settled cycles against central differences of converged ones."""

from __future__ import annotations

import numpy as np
import pytest

import coupled
import thermofem as th
from coupled.cycles.derivatives import FINE
from coupled.cycles.guess import from_guess
from coupled.cycles.measures import measure
from coupled.cycles.orbit import problem, settle
from coupled.cycles.parameters import changed, value_of

RING = coupled.borghi2021()
POWER = 10**0.8 * 1e-3
FIVE = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])


@pytest.fixture(scope="module")
def cycle():
    return coupled.limit_cycle(RING, FIVE, power=POWER)


def measured(p, orbit):
    seen = measure(p, orbit)
    return np.array([orbit.T * 1e-9, seen.duty, seen.swing, seen.extinction])


def test_derivatives_are_those_of_converged_cycles(cycle):
    names = ["power", "bus_rate", "loss_rate", "tau_n", "thermo_optic", "fcd2", "R2", "R5", "tau2", "tau4"]
    d = coupled.cycle_derivatives(RING, FIVE, names, power=POWER, cycle=cycle)
    p = problem(RING, FIVE, POWER, 0.0)
    base = settle(p, from_guess(p, cycle).orbit, FINE)
    for name in names:
        value = value_of(p, name)
        h = 1e-4 * value
        ends = [measured(q, settle(q, base, FINE)) for q in (changed(p, name, value + k * h) for k in (1, -1, 2, -2))]
        want = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
        at = d.sel(parameter=name)
        got = np.array([float(at[key]) for key in ("period", "duty", "swing", "extinction")])
        # Fourth order: (2e-4)^4 of the fifth derivative. Meshes differ little over steps of 1e-4, so that their
        # errors of 1e-9 cancel: measured 2e-7, and 1e-8 for the period.
        size = np.array([d.attrs["period"], d.attrs["duty"], d.attrs["swing"], d.attrs["extinction"]]) / value
        np.testing.assert_array_less(np.abs(got - want) / size, [1e-7, 1e-6, 1e-6, 1e-6])


def test_unknown_names_are_refused():
    with pytest.raises(th.InputError, match="R9"):
        coupled.cycle_derivatives(RING, FIVE, ["R9"], power=POWER)
