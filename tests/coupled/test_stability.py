"""Stability maps and the Hopf and fold curves: against eigenvalues of single points and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import LUMPED, NEWTON, RING, SECOND_ORDER

import coupled
import thermofem as th

TWO = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
SIXTEEN = th.Foster(R=np.linspace(100, 800, 16), tau=np.geomspace(2e-9, 9e-6, 16))
CASES = {"second order": (RING, SECOND_ORDER), "newton": (LUMPED, NEWTON), "sixteen poles": (RING, SIXTEEN)}
POWERS = 1e-3 * 10 ** (np.linspace(3, 10, 12) / 10)
DETUNINGS = np.linspace(-30e9, 30e9, 13)
WIDE = 1e-3 * 10 ** (np.array([-5, 15]) / 10), np.array([-120e9, 60e9])


@pytest.mark.parametrize("case", CASES)
def test_every_point_of_a_map_is_what_its_fixed_points_say(case):
    ring, model = CASES[case]
    found = coupled.stability_map(ring, model, POWERS, DETUNINGS)
    for cell in (found.isel(power=i, detuning=j) for i in range(POWERS.size) for j in range(DETUNINGS.size)):
        states = coupled.steady_states(ring, model, power=float(cell.power), detuning=float(cell.detuning))
        stable = int(np.sum(states.regime == "stable"))
        assert int(cell.fixed_points) == states.sizes["branch"]
        assert int(cell.stable_points) == stable
        assert str(cell.regime.values) == ("self-pulsing", "stable", "bistable")[min(stable, 2)]
        least = states.isel(branch=int(states.growth_rate.values.argmin()))
        # Eigenvalues below 1e-2 per ns next to 100 per ns: LAPACK's 1e-15 of the norm is 1e-11 of them; where two
        # nearly coincide their difference is known to the root of that.
        assert float(cell.growth_rate) == pytest.approx(float(least.growth_rate), rel=1e-6, abs=1e-6 * 1e6)
        assert float(cell.frequency) == pytest.approx(float(least.frequency), rel=1e-5, abs=1e3)


def test_the_known_points():
    found = coupled.stability_map(RING, SECOND_ORDER, 1e-3 * 10 ** (np.array([5.5, 7, 8]) / 10), [-28e9, 0.0])
    assert [str(v) for v in found.regime.values[:, 0]] == ["bistable", "stable", "self-pulsing"]
    assert found.fixed_points.values.tolist() == [[3, 1], [3, 1], [1, 1]]
    assert str(found.regime.values[2, 1]) == "self-pulsing"
    assert float(found.growth_rate[2, 1]) == pytest.approx(0.01518554e9, rel=4e-7)  # half a unit of the last digit
    assert float(found.frequency[2, 1]) == pytest.approx(0.006693e9 / (2 * np.pi), rel=8e-5)


@pytest.mark.parametrize("case", CASES)
def test_hopf_curves_part_stable_from_pulsing(case):
    """Crossing a leading Hopf curve changes the number of stable fixed points by one."""
    ring, model = CASES[case]
    for curve in coupled.hopf_curves(ring, model, POWERS, DETUNINGS):
        for k in range(1, curve.sizes["point"], 10):
            point = curve.isel(point=k)
            assert bool(point.leading)
            sides = [float(point.detuning) - 1e6, float(point.detuning) + 1e6]
            found = coupled.stability_map(ring, model, [float(point.power)], sides)
            assert abs(int(found.stable_points[0, 0]) - int(found.stable_points[0, 1])) == 1


@pytest.mark.parametrize("case", CASES)
def test_hopf_curves_are_smooth_and_end_only_at_the_border_or_at_a_fold(case):
    ring, model = CASES[case]
    (low, high), (left, right) = WIDE
    for curve in coupled.hopf_curves(ring, model, *WIDE):
        x = np.log(curve.power.values / low) / np.log(high / low)
        y = (curve.detuning.values - left) / (right - left)
        assert np.hypot(np.diff(x), np.diff(y)).max() < 0.011  # what the curves promise, and round-off of the ends
        closed = np.hypot(x[0] - x[-1], y[0] - y[-1]) < 0.011
        for end in (0, -1):
            border = not (0.01 < x[end] < 0.99 and 0.01 < y[end] < 0.99)
            slow = float(curve.frequency[end]) < 1e3  # w -> 0: the oscillation ends on a fold (Bogdanov and Takens)
            assert border or slow or closed


def test_folds_of_heat_alone_are_those_of_the_cubic():
    """U (gamma^2 + (c U + delta)^2) = 2 gamma_e P turns where 3 x^2 + 4 delta x + delta^2 + gamma^2 = 0, x = c U."""
    ring, model = replace(RING, tpa_coefficient=0.0, fcd=((0.0, 1.0),)), SECOND_ORDER
    c, gamma = ring.thermal_shift * model.thermal_resistance * 2 * ring.loss_rate, ring.linear_rate
    (curve,) = coupled.fold_curves(ring, model, *WIDE)
    x, delta = curve.energy.values * c, 2 * np.pi * curve.detuning.values
    terms = 3 * x**2, 4 * delta * x, delta**2, gamma**2
    # A sum that vanishes, to round-off of delta = shift - D, terms up to 1e3 rad/ns: a few 1e-15 of the largest term.
    assert np.abs(sum(terms)).max() < 1e-13 * max(np.abs(t).max() for t in terms)
    # The cusp: detuning -sqrt(3) gamma. It lies between two of 300 points, quadratically flat in between: (pi/300)^2.
    assert delta.max() == pytest.approx(-np.sqrt(3) * gamma, rel=2e-3)


@pytest.mark.parametrize("share", [1e-1, 1e-2, 1e-3])
def test_folds_are_found_in_windows_of_any_size(share):
    """Also in windows between two of 300 points."""
    curve = coupled.transmission(RING, TWO, power=15e-3, detuning=(-150e9, 50e9))
    nu = curve.detuning.values
    turns = np.flatnonzero(np.diff(np.sign(np.diff(nu)))) + 1
    for k in turns[nu[turns] > -149e9]:  # the curve leaves the range once more
        left, right = nu[k] - 20e9 * share, nu[k] + 20e9 * share
        (fold,) = coupled.fold_curves(RING, TWO, [15e-3 * (1 - share), 15e-3 * (1 + share)], [left, right])
        at = float(np.interp(15e-3, *np.sort([fold.power.values, fold.detuning.values], axis=1)))
        sides = (left + at) / 2, (right + at) / 2
        counts = [coupled.steady_states(RING, TWO, power=15e-3, detuning=s).sizes["branch"] for s in sides]
        assert abs(counts[0] - counts[1]) == 2


@pytest.mark.parametrize("scale", [0.685, 0.6875])
def test_a_thin_closed_hopf_curve_is_found_in_every_window(scale):
    """Between two sheets, whole, also in windows wider than itself: 419 points pulse."""
    ring = replace(RING, fcd=tuple((scale * c, p) for c, p in RING.fcd))
    heat = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    seen = []
    for powers, detunings in (([1e-3, 0.1], [-3e11, 5e10]), ([1e-3, 20e-3], [-100e9, 30e9])):
        (curve,) = coupled.hopf_curves(ring, heat, powers, detunings)
        assert curve.power.values[0] == curve.power.values[-1]  # closed
        ends = [f(curve[name].values) for name in ("power", "detuning") for f in (np.min, np.max)]
        seen.append([*np.array(ends) / [1e-3, 1e-3, 1e9, 1e9]])
    # points lie a hundredth of a window apart: the ends of the smaller one to a thousandth
    np.testing.assert_allclose(seen[0], seen[1], rtol=3e-3)
    if scale == 0.685:  # dense eigenvalues on a grid of 0.05 mW and 0.1 GHz
        np.testing.assert_allclose(seen[1], [8.764, 11.583, -69.36, -46.04], rtol=3e-3)
        for nu, inwards in zip(_crossings(curve, 10e-3), (1, -1), strict=True):
            hot = [coupled.steady_states(ring, heat, power=10e-3, detuning=nu + d * inwards) for d in (-2e8, 2e8)]
            growth = [float(states.growth_rate[-1]) for states in hot]  # of the brightest fixed point
            assert growth[0] < 0 < growth[1]


def _crossings(curve, power):
    """Detunings at which a curve passes a power, in order."""
    away = curve.power.values - power
    at = np.flatnonzero(away[:-1] * away[1:] < 0)
    share = away[at] / (away[at] - away[at + 1])
    return np.sort(curve.detuning.values[at] + share * np.diff(curve.detuning.values)[at])


def test_heat_that_lowers_another_part_counts():
    """A map has poles of negative resistance, as of a part that the light does not heat."""
    model = th.Foster(R=[3000.0, -800.0, 2000.0], tau=[1e-6, 2e-7, 5e-8], inputs=("a",), outputs=("b",))
    found = coupled.stability_map(RING, model, [5e-3], [-32e9])
    rest = coupled.steady_states(RING, model, power=5e-3, detuning=-32e9)
    # equal Jacobians; eigenvalues to round-off times their condition
    assert float(found["growth_rate"][0, 0]) == pytest.approx(float(rest["growth_rate"].min()), rel=1e-9)
