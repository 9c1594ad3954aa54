"""Transmission curves and slow sweeps against fixed points, folds and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER

import coupled
import thermofem as th
from coupled.equilibria.transmission import sweep

STILL = replace(RING, tpa_coefficient=0.0, fcd=((0.0, 1.0),))  # heat alone


@pytest.mark.parametrize(
    "laser", [{"power": 5e-3, "detuning": (-60e9, 20e9)}, {"power": (1e-4, 1e-2), "detuning": -30e9}]
)
def test_every_point_of_a_curve_is_a_fixed_point(laser):
    curve = coupled.transmission(RING, SECOND_ORDER, **laser)
    assert 400 < curve.sizes["point"] <= 600
    for point in (curve.isel(point=k) for k in range(0, curve.sizes["point"], 40)):
        states = coupled.steady_states(RING, SECOND_ORDER, power=float(point.power), detuning=float(point.detuning))
        nearest = states.isel(branch=int(np.abs(states.energy.values - float(point.energy)).argmin()))
        for name in ("energy", "carriers", "delta_T", "through", "growth_rate"):
            # next to a fold the energy is the root of the distance to it: 1e-16 becomes 1e-8
            assert float(point[name]) == pytest.approx(float(nearest[name]), rel=1e-6, abs=0)
        assert point.regime.item() == nearest.regime.item()
    assert {"stable", "saddle", "unstable focus"} <= set(curve.regime.values)


@pytest.mark.parametrize("width", [1e5, 1e7, 1e9, 60e9])
def test_a_curve_reaches_from_border_to_border_of_any_range(width):
    """Also in ranges between two of 600 points."""
    for nu in (-32e9, -10e9, 3e11):
        ends = (nu, nu + width)
        curve = coupled.transmission(RING, SECOND_ORDER, power=5e-3, detuning=ends)
        assert (curve.detuning.min(), curve.detuning.max()) == ends
        for end in ends:
            states = coupled.steady_states(RING, SECOND_ORDER, power=5e-3, detuning=end)
            # the ends of the pieces, to 2^-48 of a bracket beside the energies of fixed points to round-off
            at = np.unique(curve.energy.values[curve.detuning.values == end])
            assert at == pytest.approx(states.energy.values, rel=1e-9, abs=0)


def test_a_curve_against_power_holds_all_branches_of_a_narrow_range():
    for ends in ((5e-3, 5e-3 * (1 + 1e-9)), (5e-3, 5.00001e-3), (1e-9, 1e-8)):
        curve = coupled.transmission(RING, SECOND_ORDER, power=ends, detuning=-32e9)
        assert (curve.power.min(), curve.power.max()) == ends
        states = coupled.steady_states(RING, SECOND_ORDER, power=ends[0], detuning=-32e9)
        assert np.count_nonzero(curve.power.values == ends[0]) == states.sizes["branch"]


def test_a_sweep_jumps_at_the_folds():
    steps = np.linspace(-120e9, 0, 401)
    folds = [
        float(np.interp(0, [p0 - 6e-3, p1 - 6e-3], [n0, n1]))
        for curve in coupled.fold_curves(STILL, SECOND_ORDER, [4e-3, 8e-3], [-200e9, 0.0])
        for p0, p1, n0, n1 in zip(
            curve.power.values, curve.power.values[1:], curve.detuning.values, curve.detuning.values[1:], strict=False
        )
        if (p0 - 6e-3) * (p1 - 6e-3) < 0
    ]
    assert len(folds) == 2
    found = sweep(STILL, SECOND_ORDER, power=6e-3, detuning=np.concatenate([steps, steps[::-1]]))
    at = np.flatnonzero(found.jumped.values)
    assert at.size == 2
    for k, fold in zip(at, sorted(folds, reverse=True), strict=True):
        before, after = sorted(found.detuning.values[[k - 1, k]])
        assert before - 2e7 < fold < after + 2e7  # the fold is a line between two points of its curve
    up, down = found["drop"].values[:401], found["drop"].values[:400:-1]
    apart = steps[np.abs(up / down - 1) > 1e-9]
    assert apart[0] == pytest.approx(min(folds), abs=0.35e9)
    assert apart[-1] == pytest.approx(max(folds), abs=0.35e9)
    assert set(found.regime.values) == {"stable"}


def test_a_sweep_goes_on_through_a_hopf_point():
    steps = np.linspace(20e9, -140e9, 321)
    found = sweep(RING, SECOND_ORDER, power=6.31e-3, detuning=steps)
    assert (found.regime == "unstable focus").any()
    energy = found.energy.values
    jumps = np.flatnonzero(found.jumped.values)
    assert jumps.size == 1
    smooth = np.delete(np.abs(np.diff(np.log(energy))), jumps[0] - 1)
    assert smooth.max() < 0.3 < abs(np.log(energy[jumps[0]] / energy[jumps[0] - 1]))


HEAT = th.Foster(R=[2000, 5800], tau=[56e-9, 1.2e-6])


@pytest.mark.parametrize(
    ("loss", "bus", "laser"),
    [
        (2.982931076728242e9, 1.2144963771951746e10,
         {"power": 8.409052107938398e-3, "detuning": (18.87317412e9, -32.46744620e9, 3)}),
        (2.5907327e9, 3.7042807e10, {"power": (17.4136711e-3, 3.84791e-3, 3), "detuning": -39.526650e9}),
    ],
)  # fmt: skip
def test_wide_steps_end_where_narrow_ones_do(loss, bus, laser):
    """Steps wider than the bistable range lead to no saddle, which no ring at rest can follow."""
    ring = replace(RING, loss_rate=loss, bus_rate=bus)
    name = next(name for name in laser if isinstance(laser[name], tuple))
    wide = sweep(ring, HEAT, **laser | {name: np.linspace(*laser[name])})
    narrow = sweep(ring, HEAT, **laser | {name: np.linspace(*laser[name][:2], 801)})
    assert "saddle" not in wide.regime
    np.testing.assert_allclose(wide.energy, narrow.energy[::400], rtol=1e-9)  # the same equations, solved to round-off


def test_power_sweeps_too():
    P = np.geomspace(1e-4, 1e-2, 101)
    found = sweep(RING, SECOND_ORDER, power=np.concatenate([P, P[::-1]]), detuning=-30e9)
    up, down = found.power.values[found.jumped.values]
    assert up > 1.5 * down
    folds = coupled.transmission(RING, SECOND_ORDER, power=(1e-4, 1e-2), detuning=-30e9)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(folds.power.values))))
    high, low = folds.power.values[turns + 1]
    # the step after the fold, up; the step below it, down; steps of 4.7 %, and the curve's own 1.5 %
    assert up / high == pytest.approx(1.03, abs=0.04)
    assert down / low == pytest.approx(0.97, abs=0.04)


def test_a_bistability_between_two_steps_is_a_jump():
    """Just below the cusp three points exist in 5 % of the power: the ring jumps there, whatever the steps."""
    folds = max(
        coupled.fold_curves(RING, SECOND_ORDER, np.geomspace(1e-4, 1e-2, 9), [-60e9, 0.0]),
        key=lambda c: c.sizes["point"],
    )
    cusp = int(folds.detuning.values.argmax())
    nu = float(folds.detuning[cusp]) - 1e9
    below, above = float(folds.power[cusp]) * np.array([0.8, 1.25])
    counts = [coupled.steady_states(RING, SECOND_ORDER, power=p, detuning=nu).sizes["branch"] for p in (below, above)]
    between = np.linspace(below, above, 200)
    assert counts == [1, 1]
    assert 3 in {coupled.steady_states(RING, SECOND_ORDER, power=p, detuning=nu).sizes["branch"] for p in between}
    loop = sweep(RING, SECOND_ORDER, power=[below, above, below], detuning=nu)
    assert loop.jumped.values.tolist() == [False, True, True]
