"""Fits of a transfer channel, from a heater to a core: the rise begins late, so some residues are negative."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import surrogate
import thermofem as th


@cache
def step(*, known=True):
    """The core's rise after a step in the heater, with or without the names of the parts."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    times = np.geomspace(1e-9, 60e-6, 200)
    data = th.solve(heat, th.Constant(1e-3), times=times, heated="heater", read="core")
    return data if known else th.dataset.build(times, data["delta_T"].values, th.Constant(1e-3))


def test_residues_of_either_sign_fit_a_heater():
    """With R_i >= 0 the best fit is one late pole and errs by 2.8 % of the swing; four of either sign by .02 %."""
    fit, positive = surrogate.fit_foster(step(), order=4), surrogate.fit_foster(step(), order=4, transfer=False)
    assert fit.relative_residual < 1e-3
    assert positive.relative_residual > 2e-2
    assert len(positive.notes) == 3  # three poles too many
    assert not fit.notes
    assert (fit.model.inputs, fit.model.outputs) == (("heater",), ("core",))
    assert np.min(fit.model.R) < 0
    # against the FEM itself under a drive that was not trained on
    heat, wave = th.assemble(th.heated_ring(), accuracy=1e-2), th.SquareWave(5e-3, 4e-6, 0.4)
    wanted = heat.channels("heater", "core").periodic_response(wave, 101)
    assert fit.model.periodic_response(wave, 101) == pytest.approx(wanted, rel=0, abs=0.02 * np.ptp(wanted))


def test_the_sign_of_residues_that_are_known_is_found():
    """Data of a network with a negative residue: its own numbers come back, round-off amplified by 1e4."""
    known = th.Foster(R=[-900.0, 1500.0, 3400.0], tau=[0.3e-6, 2e-6, 15e-6])
    times = np.geomspace(1e-8, 60e-6, 150)
    data = th.dataset.build(times, 1e-3 * known.step_response(times), th.Constant(1e-3))
    fit = surrogate.fit_foster(data, order=3, transfer=True)
    assert np.asarray(fit.model.R) == pytest.approx(np.asarray(known.R), rel=1e-5)
    assert np.asarray(fit.model.tau) == pytest.approx(np.asarray(known.tau), rel=1e-5, abs=0)


def test_the_second_order_of_a_transfer_channel():
    fit = surrogate.fit_second_order(step())
    assert fit.relative_residual < 1e-2
    assert fit.parameters["eta"] < 0  # the rise begins late
    assert fit.model.thermal_resistance == pytest.approx(step().attrs["thermal_resistance"], rel=2e-2)
    with pytest.raises(th.InputError, match="transfer=True"):
        surrogate.fit_second_order(step(known=False))
    assert surrogate.fit_second_order(step(known=False), transfer=True).parameters == pytest.approx(
        fit.parameters, rel=1e-6, abs=0
    )


def test_poles_that_cancel_are_named():
    assert any("nearly one" in note for note in surrogate.fit_foster(step(), order=6).notes)


def test_one_of_several_probes_keeps_its_own_channel():
    """``sel`` of xarray leaves the attributes of the whole, the core's resistance among them."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    times = np.append(0.0, np.geomspace(1e-9, 1e-4, 150))
    both = th.solve(heat, th.Constant(1e-3), times=times, heated="core", read=("core", "heater"))
    own, other = (surrogate.fit_foster(both.sel(probe=name), order=4).model for name in ("core", "heater"))
    assert own.thermal_resistance == pytest.approx(heat.thermal_resistance("core"), rel=1e-9)  # imposed
    assert other.thermal_resistance == pytest.approx(heat.thermal_resistance("core", "heater"), rel=5e-3)  # the misfit
    assert (other.inputs, other.outputs) == (("core",), ("heater",))
    assert th.dataset.at_probe(both, "heater").attrs["read"] == "heater"
    with pytest.raises(th.InputError, match="read = 'near' is unknown"):
        th.dataset.at_probe(both, "near")
    with pytest.raises(th.InputError, match="thermal_resistances"):
        surrogate.fit_newton(both.assign_attrs(thermal_resistances=["a", "b"]).sel(probe="heater"))
