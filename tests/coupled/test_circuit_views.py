"""What one sees of a run of several rings: panels, one ring's pulses, and what functions for one ring say of all."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

import coupled
import surrogate
import thermofem as th
from coupled.plot import plot_ports, plot_rings, plot_traces

mpl.use("Agg")


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    """Two rings on a bus; the first one takes the light, and the second one what it leaves."""
    ring, model = coupled.borghi2021(), surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
    return coupled.simulate(coupled.bus([ring, ring]), model, power={"in": 6.31e-3}, duration=8e-6)


def test_a_ring_of_a_circuit_pulses_as_it_does_alone(run):
    found = coupled.pulsing(run.sel(ring="ring 1"))
    model = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
    alone = coupled.pulsing(coupled.simulate(coupled.borghi2021(), model, power=6.31e-3, duration=8e-6))
    assert found.regime == alone.regime == "self-pulsing"
    # no heat and no light comes back to the first ring; both runs have rtol 1e-6
    np.testing.assert_allclose([found.period, found.duty], [alone.period, alone.duty], rtol=1e-4)
    with pytest.raises(th.InputError, match=r"holds 2 rings; pick one of them, run.sel\(ring='ring 1'\)"):
        coupled.pulsing(run)


def test_rings_under_a_swept_laser_are_driven(run):
    ring, model = coupled.borghi2021(), surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
    sweep = coupled.Sweep([0, 1e-6], [5e9, -5e9])
    times = np.linspace(0, 1e-6, 401)
    apart = coupled.Circuit([ring, ring], lasers=[coupled.LaserPort(f"l{i}", f"ring {i}.in") for i in (1, 2)])
    for circuit, inputs in (
        (coupled.bus([ring, ring]), {"in": 1e-3}),
        (apart, {"l1": 1e-3, "l2": th.Pulse(1e-3, 7e-7)}),
    ):
        swept = coupled.simulate(circuit, model, power=inputs, detuning=sweep, duration=1e-6, times=times)
        np.testing.assert_allclose(swept.detuning, sweep(times), atol=1e-3)  # Hz, round-off of 5e9
        assert "detuning" not in swept.attrs
        for name in ("ring 1", "ring 2"):
            found = coupled.pulsing(swept.sel(ring=name))
            assert found.regime == "driven"
            assert found.reason.startswith("light or heaters vary up to 1 us")
    assert run.attrs["detuning"] == 0
    assert "detuning" not in run


@pytest.mark.parametrize(("plot", "count"), [(plot_rings, 2), (plot_ports, 3)])
def test_every_line_has_its_panel(run, plot, count):
    first = plot(run)
    assert [len(panel.lines) for panel in first.figure.axes] == [1] * count
    assert len(plot(run, ax=first.figure.axes[-1]).lines) == count + 1


def test_traces_of_one_ring_refuse_a_circuit(run):
    with pytest.raises(th.InputError, match=r"run has no 'drop'.*plot_rings and plot_ports draw"):
        plot_traces(run)
