"""Curves that are drawn over a figure are checked and converted as what is below them."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rings import RING, SECOND_ORDER

import coupled
import thermofem as th
from coupled.equilibria.transmission import sweep
from coupled.plot import plot_branch, plot_identification, plot_map, plot_transmission

POWERS, DETUNINGS = np.geomspace(2e-3, 8e-3, 3), np.linspace(-30e9, 40e9, 4)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def stability():
    return coupled.stability_map(RING, SECOND_ORDER, POWERS, DETUNINGS)


@pytest.fixture(scope="module")
def hopf():
    return coupled.hopf_curves(RING, SECOND_ORDER, POWERS, DETUNINGS)


@pytest.fixture(scope="module")
def curve():
    return coupled.transmission(RING, SECOND_ORDER, power=3e-3, detuning=(-100e9, 20e9))


def rescaled(data, **units):
    """A copy with some variables in other units, as their attributes say."""
    data = data.copy(deep=True)
    for name, (factor, unit) in units.items():
        data[name] = (data[name].dims, data[name].values / factor, {"units": unit})
    return data


def test_a_curve_in_other_units_lies_where_it_should(stability, hopf, curve):
    """A Hopf curve in mW stood 30 dB too high, a sweep in GHz at -1e-7 GHz."""
    (line, *_), (same, *_) = (
        plot_map(stability, hopf=one).lines
        for one in (hopf, [rescaled(c, power=(1e-3, "mW"), detuning=(1e9, "GHz")) for c in hopf])
    )
    np.testing.assert_allclose(same.get_xydata(), line.get_xydata(), rtol=1e-12)
    swept = sweep(RING, SECOND_ORDER, power=3e-3, detuning=np.linspace(-100e9, 20e9, 21))
    other = rescaled(swept, detuning=(1e9, "GHz"), drop=(1e-3, "mW"))
    first, second = plot_transmission(curve, sweeps={"SI": swept, "GHz and mW": other}).lines[-2:]
    np.testing.assert_allclose(second.get_xydata(), first.get_xydata(), rtol=1e-12)


def test_a_run_with_a_swept_power_is_a_sweep():
    """`simulate` calls the power input_power."""
    curve = coupled.transmission(RING, SECOND_ORDER, power=(1e-4, 3e-3), detuning=0.0)
    run = coupled.simulate(RING, SECOND_ORDER, power=th.Sampled([0, 1e-6], [1e-4, 3e-3]), duration=1e-6)
    line = plot_transmission(curve, sweeps={"run": run}).lines[-1]
    np.testing.assert_allclose(line.get_xdata(), run["input_power"].values * 1e3)


def test_a_branch_is_drawn_over_its_parameter(curve):
    branch = coupled.continue_cycle(RING, SECOND_ORDER, "detuning", (0.0, 1e9), power=6e-3, points=2)
    ax = plot_branch(branch, fixed=curve)
    assert ax.get_xlabel() == "detuning (GHz)"
    np.testing.assert_allclose(ax.lines[2].get_ydata(), 1e3 * branch["drop_high"].values)  # after the fixed points


def test_curves_of_power_and_detuning_have_no_place_on_other_axes(hopf):
    """They are not drawn as if the axis were the detuning."""
    other = coupled.stability_map(RING, SECOND_ORDER, POWERS, 0.0, vary={"loss_rate": [3e9, 4e9]})
    with pytest.raises(th.InputError, match="hopf and folds are curves of power and detuning"):
        plot_map(other, hopf=hopf)


def test_traces_in_a_unit_of_their_own_keep_it():
    """Volts are no drop power in mW."""
    run = coupled.simulate(RING, SECOND_ORDER, power=6e-3, duration=12e-6)
    trace = run[["drop"]].assign(drop=("time", 2e3 * run["drop"].values, {"units": "V"})).assign_attrs(run.attrs)
    found = coupled.identify(RING, trace, free=["tau_s"], bounds={"tau_s": (1.1e-6, 1.3e-6)}, runs=1)
    assert found.cycles["drop"].attrs["units"] == found.cycles["drop_model"].attrs["units"] == "V"
    (ax,) = plot_identification(found)
    assert ax.get_ylabel() == "drop signal (V)"
    assert ax.lines[0].get_ydata().max() == pytest.approx(float(found.cycles["drop"].max()), abs=0)
