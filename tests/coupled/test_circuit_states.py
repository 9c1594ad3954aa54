"""Fixed points and limit cycles of circuits: against a ring alone, by differences, and against long runs."""

from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from test_circuit import pair

import coupled
import thermofem as th

TWO = coupled.Circuit([RING, RING], (), [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")])


@pytest.mark.parametrize(("power", "detuning"), [(5e-3, -32e9), (6.31e-3, 0.0), (1e-3, -20e9)])
def test_one_ring_has_the_fixed_points_of_steady_states(power, detuning):
    """Two methods: Newton from many starts, and a curve cut at its turning points that misses none."""
    ours = coupled.steady_states(coupled.bus(RING), SECOND_ORDER, power={"in": power}, detuning=detuning)
    alone = coupled.steady_states(RING, SECOND_ORDER, power=power, detuning=detuning)
    assert ours.sizes["state"] == alone.sizes["branch"]
    for name in ("energy", "carriers", "delta_T"):
        # the last Newton correction is below 1e-11, and the other method is good to 1e-10
        assert ours[name].values[:, 0] == pytest.approx(alone[name].values, rel=1e-8, abs=0)
    assert ours.growth_rate.values == pytest.approx(alone.growth_rate.values, rel=1e-6, abs=1e-3)
    assert ours.output.sel(port="drop 1").values == pytest.approx(alone["drop"].values, rel=1e-8, abs=0)


def test_a_detector_with_a_bandwidth_does_not_change_fixed_points():
    """A fixed point has constant light, which every detector shows whole."""
    slow = replace(coupled.bus(RING), detectors=[coupled.Detector("through", "ring 1.through", bandwidth=1e9)])
    fast = replace(slow, detectors=[coupled.Detector("through", "ring 1.through")])
    light = {"power": {"in": 5e-3}, "detuning": -32e9}
    ours, wanted = (coupled.steady_states(one, SECOND_ORDER, **light) for one in (slow, fast))
    assert ours.sizes["state"] == 3
    assert np.array_equal(ours.output, wanted.output)


@pytest.mark.slow
def test_two_separate_bistable_rings_have_all_pairs_of_states():
    alone = coupled.steady_states(RING, SECOND_ORDER, power=5e-3, detuning=-32e9)
    inputs = {"one": 5e-3, "two": 5e-3}
    found = coupled.steady_states(TWO, SECOND_ORDER, power=inputs, detuning=-32e9, starts=200)
    pairs = sorted((a, b) for a in alone.energy.values for b in alone.energy.values)
    assert found.sizes["state"] == len(pairs) == 9
    ours = sorted(map(tuple, found.energy.values), key=lambda pair: [float(f"{energy:.9g}") for energy in pair])
    assert np.array(ours) == pytest.approx(np.array(pairs), rel=1e-7, abs=0)
    stable = int(np.sum(alone.growth_rate.values < 0))
    assert int(np.sum(found.growing.values == 0)) == stable**2


def test_a_run_settles_on_the_stable_fixed_point_of_two_rings_that_heat_each_other():
    inputs = {"one": 0.4e-3, "two": 0.8e-3}
    found = coupled.steady_states(TWO, pair(), power=inputs, detuning=-3e9)
    run = coupled.simulate(TWO, pair(), power=inputs, detuning=-3e9, duration=200e-6, times=[200e-6])
    settled = run.isel(time=0)
    stable = found.isel(state=found.growing.values == 0)
    # rtol = 1e-6 a step, and 16 time constants of the slowest heat: 1e-7
    assert min(abs(e / settled.energy - 1).max() for e in stable.energy) < 1e-4


def test_one_ring_has_the_cycle_of_limit_cycle():
    """Shooting with differences against collocation."""
    ours = coupled.limit_cycle(coupled.bus(RING), SECOND_ORDER, power={"in": 6.31e-3})
    alone = coupled.limit_cycle(RING, SECOND_ORDER, power=6.31e-3)
    assert ours.attrs["period"] == pytest.approx(alone.attrs["period"], rel=1e-6, abs=0)
    size = np.sort(np.abs(alone.multipliers.values))[::-1]
    # differences of 3e-5 of flows good to 1e-10 a step
    assert np.abs(ours.multipliers.values)[:3] == pytest.approx(size[:3], rel=0, abs=1e-4)
    assert ours.delta_T.values[0, 0] == pytest.approx(ours.delta_T.values[0, -1], rel=1e-6, abs=0)


@pytest.mark.parametrize(("power", "detuning"), [(0.002938037697727, 21.66839546736296e9), (3e-3, 22e9)])
def test_a_circuit_that_comes_to_rest_slowly_has_no_cycle(power, detuning):
    """At a fixed point every period closes: a "cycle" of 1.04 us with a swing of 5e-10 K."""
    two, five = ([1998.1, 5786.2], [55.8e-9, 1.2e-6]), ([600, 1500, 2000, 2200, 1500], [2e-8, 1e-7, 4e-7, 2e-6, 1.2e-5])
    model = th.Foster(*(two if power < 3e-3 else five))
    circuit, inputs = coupled.bus(RING), {"in": power}
    with pytest.raises(th.InputError, match="unless the pulses die away"):
        coupled.limit_cycle(circuit, model, power=inputs, detuning=detuning)
    at_rest = coupled.steady_states(circuit, model, power=inputs, detuning=detuning)
    assert at_rest.growing.values.tolist() == [0]


@pytest.mark.slow
def test_a_faint_ring_beside_a_pulsing_one_follows_it():
    """The cycle of both is that of the ring that pulses, and the other one is heated by it."""
    cycle = coupled.limit_cycle(TWO, pair(), power={"one": 6.31e-3, "two": 1e-9}, settle=100e-6)
    assert abs(cycle.multipliers.values[0]) == pytest.approx(1, rel=0, abs=1e-4)  # the trivial one; all else decays
    mean = cycle.absorbed.isel(ring=0).integrate("time") / cycle.attrs["period"]
    # the neighbour's mean rise is 250 K/W of the mean power, whatever its ripple
    rise = cycle.delta_T.isel(ring=1).integrate("time") / cycle.attrs["period"]
    assert float(rise) == pytest.approx(250.0 * float(mean), rel=1e-4, abs=0)


def test_a_dark_laser_of_another_frequency_changes_no_cycle():
    """States turned with the dark laser, and Newton's method never closed them."""
    lit = coupled.LaserPort("in", "ring 1.in", offset=3e9)
    alone, dark = (
        coupled.Circuit([RING], lasers=lasers) for lasers in ([lit], [coupled.LaserPort("a", "ring 1.add"), lit])
    )
    periods = [
        coupled.limit_cycle(circuit, SECOND_ORDER, power={"in": 6.31e-3}).attrs["period"] for circuit in (alone, dark)
    ]
    assert periods[0] == periods[1]


@pytest.mark.parametrize("average", [True, False])
def test_the_start_alone_is_one_row(average):
    """One row, not one for each accepted step."""
    circuit = coupled.bus([RING, RING])
    run = coupled.simulate(circuit, SECOND_ORDER, power={"in": 1e-3}, duration=1e-9, times=[0.0], average=average)
    assert run.sizes["time"] == 1
    assert not run.energy.values.any()
