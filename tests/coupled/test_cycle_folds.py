"""Curves of folds of cycles against branches in one parameter and against settled maps."""

from __future__ import annotations

import numpy as np
import pytest

import coupled
import surrogate
from coupled.cycles.cycle_folds import cycle_fold_curves
from coupled.explore.contents import curves_of
from coupled.plot import plot_map

RING, NEWTON = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
POWERS, DETUNINGS = np.geomspace(4.5e-3, 5.5e-3, 3), np.linspace(-5e9, 10e9, 16)


@pytest.fixture(scope="module")
def curve():
    (one,) = cycle_fold_curves(RING, NEWTON, [2e-3, 10e-3], [-20e9, 20e9])
    return one


def border(curve, power):
    """Detuning of the curve at a power."""
    order = np.argsort(curve["power"].values)
    return np.interp(power, curve["power"].values[order], curve["detuning"].values[order])


def test_the_curve_holds_the_folds_of_branches_in_one_parameter(curve):
    for power in (4.6e-3, 5.4e-3):
        at = curve.isel(point=int(np.argmin(np.abs(curve["power"].values - power))))
        nu, cycle = float(at["detuning"]), None
        for start in (-1e9, nu - 2e9, nu - 1e9):  # towards the fold, each from the one before
            cycle = coupled.limit_cycle(RING, NEWTON, power=float(at["power"]), detuning=start, guess=cycle)
        branch = coupled.continue_cycle(RING, NEWTON, "detuning", (nu + 5e9, nu - 1.5e9), guess=cycle)
        (fold,) = branch["detuning"].values[branch["special"].values == "fold"]
        # both are located to 1e-6 of the length along the branch, whose square moves the detuning; meshes err by 1e-7
        assert nu == pytest.approx(fold, abs=15e9 * 1e-6)
        here = branch["period"].values[branch["special"].values == "fold"]
        assert float(at["period"]) == pytest.approx(float(here[0]), rel=1e-4)  # the root of the error above


def test_the_curve_crosses_a_wide_window_from_every_start_and_the_page_shows_it(curve):
    """It ends at the borders, 2 and 10 mW, not where a slope is round-off."""
    assert curve["power"].values.min() < 2e-3
    assert curve["power"].values.max() > 10e-3
    assert curve.attrs["reason"] == "the end of the range; the end of the range"
    window = {"power": 10 * np.log10([2.0, 9.9]), "detuning": [-20.0, 20.0]}  # dBm and GHz
    (shown,) = curves_of(RING, NEWTON, window)
    power, detuning = np.array(shown).T
    assert power.min() < 2e-3
    assert power.max() > 9.9e-3
    inside = (power > 2e-3) & (power < 10e-3)
    assert inside.sum() > 20
    # straight lines between the points of the curve
    np.testing.assert_allclose(detuning[inside], border(curve, power[inside]), rtol=0, atol=1e-3 * 40e9)


def test_the_curve_bounds_stable_pulses(curve):
    between = (POWERS[0] < curve["power"].values) & (curve["power"].values < POWERS[-1])
    assert between.sum() > 5
    assert curve["leading"].values[between].all()


def test_settled_maps_pulse_on_one_side_only(curve):
    cold = coupled.pulsing_map(RING, NEWTON, POWERS, DETUNINGS)
    beyond = DETUNINGS[None, :] > border(curve, POWERS)[:, None]
    assert set(cold["regime"].values[beyond]) == {"stable"}
    no_rest = coupled.stability_map(RING, NEWTON, POWERS, DETUNINGS)["stable_points"].values == 0
    assert set(cold["regime"].values[no_rest]) == {"self-pulsing"}
    beside = ~beyond & ~no_rest
    assert beside.sum() > 5
    for i, j in [*zip(*np.nonzero(beside), strict=True)][1::5]:  # a cycle beside a stable point
        before = coupled.limit_cycle(RING, NEWTON, power=POWERS[i], detuning=-2e9)
        run = coupled.continue_cycle(RING, NEWTON, "detuning", (DETUNINGS[j], -3e9), guess=before)
        assert run["stability"].values[-1] == "stable"
        assert run.attrs["reason"] == "the end of the range"


def test_a_ring_without_hysteresis_has_none():
    model = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29, heat_capacity=7.63e-12)
    assert cycle_fold_curves(coupled.borghi2021(), model, [4e-3, 6e-3], [-10e9, 10e9]) == []


def test_curves_are_drawn(curve):
    ax = plot_map(coupled.stability_map(RING, NEWTON, POWERS, DETUNINGS), folds=[curve])
    drawn = [line.get_xdata() for line in ax.get_lines()]
    assert any(np.allclose(x, curve["detuning"].values * 1e-9) for x in drawn)
