"""What seems to rest is judged by the fixed points of the run's own ring, heat and light."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from audit import verdicts

import coupled
import thermofem as th
from coupled.runs.pulsing import rest_of_run, ring_in
from thermofem.data import dataset

RING = coupled.borghi2021()
NETWORK = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
LIGHT = {"power": 5e-3, "detuning": -32e9}  # a stable point, a saddle and an unstable focus


@pytest.fixture(scope="module")
def slow() -> verdicts.Cell:
    """Heat of 4.2 us carries this ring across a Hopf bifurcation after some 10 us."""
    return list(verdicts.random_ring(100059, most=8))[3]


def run_of(cell, model=None, duration=5e-6):
    return coupled.simulate(cell.ring, model or cell.model, power=cell.power, detuning=cell.detuning, duration=duration)


def test_rest_before_slow_heat_starts_pulses_is_a_slow_transient(slow):
    run = run_of(slow)
    found = coupled.pulsing(run)
    assert (found.regime, "no fixed point is stable" in found.reason) == ("slow transient", True)
    later = coupled.pulsing(run_of(slow, duration=found.suggested_duration))
    assert later.regime == "self-pulsing"
    bare = coupled.pulsing(run.drop_attrs())
    assert (bare.regime, "the trace alone" in bare.reason) == ("stable", True)
    cell = coupled.pulsing_map(slow.ring, slow.model, [slow.power], [slow.detuning], duration=5e-6)
    assert cell.regime.item() == "slow transient"
    assert "no fixed point is stable" in cell.reason.item()


def test_an_output_map_and_a_file_tell_the_same(slow, tmp_path):
    """An output map of coefficient 0 is the network itself."""
    dataset.save(run_of(slow), tmp_path / "run.nc")
    runs = [run_of(slow), run_of(slow, th.OutputMap(slow.model, 0.0)), xr.load_dataset(tmp_path / "run.nc")]
    states = coupled.steady_states(slow.ring, slow.model, power=slow.power, detuning=slow.detuning)
    for run in runs:
        rest = rest_of_run(run)
        for name, wanted in (("energy", "energy"), ("delta_T", "delta_T"), ("growth", "growth_rate")):
            # the bisection of two curves that are one to round-off; eigenvalues lose their condition, some 1e3
            assert getattr(rest, name) == pytest.approx(states[wanted].values, rel=1e-8, abs=0)
        assert coupled.pulsing(run).regime == "slow transient"


def test_light_that_ends_where_it_stays_and_heaters_count():
    model = coupled_pair()
    wave = [3e-3, th.Pulse(power=2e-3, width=1e-7, start=1e-7)]
    run = coupled.simulate(
        RING, model, power=wave, detuning=-20e9, duration=8e-6, heaters={"heater": 2e-3}, heated="core", read="core"
    )
    found = rest_of_run(run)
    wanted = coupled.steady_states(
        RING, model, power=3e-3, detuning=-20e9, heaters={"heater": 2e-3}, heated="core", read="core"
    )
    assert found.energy == pytest.approx(wanted.energy.values, rel=1e-9, abs=0)
    assert found.delta_T == pytest.approx(wanted.delta_T.values, rel=1e-9)
    assert found.growth == pytest.approx(wanted.growth_rate.values, rel=1e-6)


def coupled_pair() -> th.StateSpace:
    """Core and heater, each with its own heat capacity, and a conductance between them."""
    E = np.diag([1e-11, 3e-11])  # J/K
    A = -np.array([[3e-4, -1e-4], [-1e-4, 4e-4]])  # W/K
    return th.StateSpace(E, A, np.eye(2), np.eye(2), inputs=("core", "heater"), outputs=("core", "heater"))


def test_a_dark_ring_rests():
    dark = coupled.pulsing(coupled.simulate(RING, NETWORK, power=0.0, duration=1e-6))
    assert (dark.regime, "alone" in dark.reason) == ("stable", False)


@pytest.mark.parametrize(
    "ring", [RING, coupled.vanvaerenbergh2012(), RING.with_rates(eta_fca=1e-13), RING.with_lumped_fcd()]
)
def test_a_ring_comes_back_from_its_attribute(ring):
    run = coupled.simulate(ring, NETWORK, duration=1e-9, **LIGHT)
    assert ring_in(run.attrs["ring_parameters"]) == ring


@pytest.mark.parametrize(
    ("R", "tau", "power", "detuning", "duration"),
    [
        ((7000, 8000), (3e-7, 1e-2), 1e-3, -15e9, 20e-6),  # 0.46 K of 2.89 K
        ((7000, 1500), (3e-7, 1e-4), 1e-3, -15e9, 20e-6),  # a substrate: 0.48 K of 0.61 K
        ((15000,), (1e-3,), 2e-3, -40e9, 20e-6),  # three fixed points, far from the stable ones
    ],
)
def test_carriers_at_rest_far_from_the_fixed_point_are_a_slow_transient(R, tau, power, detuning, duration):
    """Heat of milliseconds does not move the carriers in microseconds, but it moves the ring in the end."""
    run = coupled.simulate(RING, th.Foster(R=R, tau=tau), power=power, detuning=detuning, duration=duration)
    found = coupled.pulsing(run)
    assert found.regime == "slow transient"
    assert "slow heat" in found.reason
    assert found.suggested_duration > 3 * max(tau)  # to 2 % of 1.3 to 6 times
    if max(tau) < 1e-3:
        longer = coupled.simulate(
            RING, th.Foster(R=R, tau=tau), power=power, detuning=detuning, duration=found.suggested_duration
        )
        assert coupled.pulsing(longer).regime == "stable"
        states = coupled.steady_states(RING, th.Foster(R=R, tau=tau), power=power, detuning=detuning)
        assert float(longer.delta_T[-1]) == pytest.approx(float(states.delta_T[0]), rel=0.02)  # SETTLED


def test_pulses_under_heat_that_still_rises_say_so():
    """31 equal cycles of 617 ns in 20 us, of which slow heat makes 1094 ns: the mean rise is half of R_th <P>."""
    slow, quick = th.Foster(R=[7000, 8000], tau=[3e-7, 1.0]), th.Foster(R=[7000, 8000], tau=[3e-7, 1e-6])
    light = {"power": 6.31e-3, "detuning": 0.0, "duration": 20e-6}
    found = coupled.pulsing(coupled.simulate(RING, slow, **light))
    assert found.regime == "self-pulsing"

    # 7000/15000: the fast pole has all of its rise, the slow one none
    assert "the mean rise is 47% of what the absorbed power leads to" in found.reason
    assert "limit_cycle" in found.reason
    assert "mean rise" not in coupled.pulsing(coupled.simulate(RING, quick, **light)).reason
