"""Derivatives of settled cycles against central differences of converged ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import FIVE, RING

import coupled
import thermofem as th
from coupled.cycles.cycle_problem import CycleProblem, changed, value_of
from coupled.cycles.derivatives import cycle_derivatives
from coupled.cycles.orbit_measures import measure
from coupled.cycles.return_map import close
from coupled.kernel.units import units
from coupled.thermal import compact

POWER = 10**0.8 * 1e-3


@pytest.fixture(scope="module")
def cycle():
    return coupled.limit_cycle(RING, FIVE, power=POWER)


def measured(p, cycle):
    """Measures of the cycle near another one, closed on its own."""
    begin = coupled.State.end_of(cycle).as_array() / units(p.flow.rough.order)
    orbit = close(p.flow, begin, cycle.attrs["pulses"], 30e9 * cycle.attrs["period"])
    seen = measure(orbit.trace.rows)
    return np.array([orbit.T * 1e-9, seen.duty, seen.swing, seen.extinction])


def check(ring, model, cycle, names, h, within):
    """Fourth-order differences with steps of h, from the measures of cycles."""
    power, detuning = cycle.attrs["input_power"], cycle.attrs["detuning"]
    d = cycle_derivatives(ring, model, names, power=power, detuning=detuning, cycle=cycle)
    p = CycleProblem(ring, compact(model), power, detuning)
    for name in names:
        value = value_of(p, name)
        step = h * value
        ends = [measured(changed(p, name, value + k * step), cycle) for k in (1, -1, 2, -2)]
        want = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * step)
        at = d.sel(parameter=name)
        got = np.array([float(at[key]) for key in ("period", "duty", "swing", "extinction")])
        size = np.array([d.attrs["period"], d.attrs["duty"], d.attrs["swing"], d.attrs["extinction"]]) / value
        np.testing.assert_array_less(np.abs(got - want) / size, within)


def test_derivatives_are_those_of_converged_cycles(cycle):
    names = ["power", "bus_rate", "loss_rate", "tau_n", "thermo_optic", "fcd2", "R2", "R5", "tau2", "tau4"]
    # (2e-3)^4 of the fifth derivative, and 1e-10 of the traces over h: measured 3e-7, 5e-9 for the period
    check(RING, FIVE, cycle, names, 1e-3, [1e-7, 1e-6, 1e-6, 1e-6])


def test_derivatives_of_pulses_much_shorter_than_the_period():
    """A pulse of 1e-3 of the period: steps of 1e-5 of it miss the duty cycle's by 57 % to 137 %."""
    model = th.Foster(R=[680.0, 4162.0, 5864.0, 1323.0], tau=[32e-9, 39.9e-9, 231e-9, 241e-9])
    rates = {"bus_rate": 2.083e10, "loss_rate": 9.015e8, "drop_rate": 0.0}
    carriers = coupled.ConstantLifetime(32.1e-9)
    ring = replace(RING, **rates, fca_cross_section=8.225e-22, carriers=carriers)
    cycle = coupled.limit_cycle(ring, model, power=4.858e-3, detuning=-5.575e9)
    assert cycle.attrs["duty"] < 1e-3
    # 1e-9 of the period, which the difference of two moments over the duty cycle and a relative step of 1e-5 make 1e-5
    check(ring, model, cycle, ["power", "fcd2", "R2", "bus_rate"], 1e-5, [1e-7, 5e-5, 1e-6, 5e-6])


def test_equal_time_constants_keep_their_order():
    """Both states are one but for R, so the derivatives by tau go with R; steps that swapped the poles erred by 6 %."""
    model = th.Foster(R=[1998.1, 3000.0, 2786.2], tau=[55.8e-9, 1.2e-6, 1.2e-6])
    d = cycle_derivatives(RING, model, ["tau2", "tau3", "R2", "R3"], power=POWER)
    for name in ("period", "duty", "swing", "extinction"):
        by_tau, by_R = d[name].values[:2], d[name].values[2:]
        # both states differ by the last step of Newton's method, 3e-10, which the duty cycle magnifies a hundredfold;
        # the lowest light follows what traces at 1e-10 leave, to 1e-6
        within = 1e-6 if name == "extinction" else 3e-8
        assert by_tau[0] / by_tau[1] == pytest.approx(3000.0 / 2786.2, rel=within)
        assert by_R[0] / by_R[1] == pytest.approx(1, rel=within)
