"""Fixed points and stability of the paper's ring, and beyond it: Kerr shift, scattering, one bus, an output map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import BENT, LUMPED, NETWORKS, NEWTON, RING, SECOND_ORDER
from scipy import constants
from support import ring_ode

import coupled
import thermofem as th
from coupled.equilibria.transmission import power_for_drop

MAPPED = th.OutputMap(th.Foster(R=[2e3, 3e3, 3e3], tau=[5e-8, 4e-7, 1.5e-6]), -4e-3)  # ten times silicon in oxide
KERR = replace(RING, kerr_coefficient=2e-16)  # about fifty times silicon's
CASES = {
    "paper": (RING, SECOND_ORDER),
    "newton": (LUMPED, NEWTON),
    "sixteen poles": (RING, NETWORKS[16]),
    "kerr": (KERR, SECOND_ORDER),
    "scattering": (replace(RING, loss_rate=2e9, scattering_rate=8e9), SECOND_ORDER),
    "output map": (RING, MAPPED),
    "all of it": (replace(KERR, scattering_rate=5e9, drop_rate=20e9), MAPPED),
    "quadratic": (replace(KERR, scattering_rate=5e9), BENT),
}
LASERS = [(2e-3, -20e9), (6.3e-3, 0.0), (5e-3, -32e9), (10e-3, 15e9)]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("power", "detuning"), LASERS)
def test_fixed_points_rest_and_their_eigenvalues_are_those_of_the_differentiated_right_hand_side(case, power, detuning):
    ring, model = CASES[case]
    found = coupled.steady_states(ring, model, power=power, detuning=detuning)
    for branch in (found.isel(branch=k) for k in range(found.sizes["branch"])):
        y = ring_ode.state_at(branch, ring, model, power, detuning)
        assert y[0] ** 2 + y[1] ** 2 == pytest.approx(float(branch.energy), rel=1e-11, abs=0)
        f, J = (g(y, ring, model, power, detuning) for g in (ring_ode.right_hand_side, ring_ode.jacobian))
        assert np.abs(f[:2]).max() < 1e-11 * np.sqrt(2 * ring.bus_rate * power)
        assert np.all(np.abs(f[3:]) <= 1e-11 * np.abs(np.diag(J))[3:] * np.abs(y[3:]).sum())
        growth, frequency, growing = ring_ode.leading(J)
        # Differences: truncation (h^4/30) f^(5) ~ 1e-12, round-off 1e-16 x 300/(1e-3) = 3e-11 per ns; an eigenvalue of
        # 5e-3 per ns that is a small difference of rates of 100 per ns magnifies them by their ratio, 2e4: 1e-6.
        assert float(branch.growth_rate) == pytest.approx(growth, rel=1e-6)
        assert float(branch.frequency) == pytest.approx(frequency, rel=2e-6, abs=0)
        assert (growing == 0) == (branch.regime.item() == "stable")
        assert (growing % 2 == 1) == (branch.regime.item() == "saddle")
        energy = branch["drop"] + branch.through + branch.absorbed + 2 * ring.scattering_rate * branch.energy
        assert float(energy) == pytest.approx(power, rel=1e-10, abs=0)


@pytest.mark.parametrize("case", CASES)
def test_curves(case):
    ring, model = CASES[case]
    powers, detunings = np.geomspace(1e-3, 2e-2, 8), np.linspace(-60e9, 40e9, 9)
    curves = coupled.hopf_curves(ring, model, powers, detunings)
    points = [c.isel(point=k) for c in curves for k in range(1, c.sizes["point"], 11)]
    assert points
    for point in points:
        states = coupled.steady_states(ring, model, power=float(point.power), detuning=float(point.detuning))
        branch = states.isel(branch=int(np.abs(states.energy.values - float(point.energy)).argmin()))
        assert float(branch.energy) == pytest.approx(float(point.energy), rel=1e-8, abs=0)
        # Newton's method ends at round-off of a sum of terms of 1e4 per ns^2, 1e-12, over a slope of 1e2 per ns.
        if bool(point.leading):
            assert abs(float(branch.growth_rate)) < 1e-8 * 2 * np.pi * float(point.frequency)
            assert float(branch.frequency) == pytest.approx(float(point.frequency), rel=1e-7)
    curves = coupled.fold_curves(ring, model, powers, detunings)
    assert curves
    for curve in curves:
        for k in range(1, curve.sizes["point"], 40):
            P, nu = float(curve.power[k]), float(curve.detuning[k])
            drop = 2 * ring.drop_bus_rate * float(curve.energy[k])
            assert power_for_drop(ring, model, drop=drop, detuning=nu) == pytest.approx(P, rel=1e-11, abs=0)
            sides = [power_for_drop(ring, model, drop=drop * (1 + j * 1e-3), detuning=nu) for j in (-2, -1, 1, 2)]
            slope = (sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / 12e-3
            assert abs(float(slope)) < 1e-7 * P  # dP/dU = 0; truncation of the differences is 1e-12


def test_kerr_alone_is_a_cubic():
    """No heat, no carriers: U (gamma^2 + (kerr U + delta)^2) = 2 gamma_e P, folds as for heat with c = kerr."""
    ring = replace(KERR, kerr_coefficient=5e-16, tpa_coefficient=0.0, fcd=((0.0, 1.0),), thermo_optic=0.0)
    found = coupled.steady_states(ring, SECOND_ORDER, power=10e-3, detuning=-40e9)
    delta, kerr = -2 * np.pi * 40e9, ring.kerr_shift * 1e-15  # of energies in fJ
    drive = 2 * ring.bus_rate * 10e-3 * 1e15
    roots = np.roots([kerr**2, 2 * kerr * delta, ring.linear_rate**2 + delta**2, -drive])
    want = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    assert want.size == 3
    assert found.energy.values / 1e-15 == pytest.approx(want, rel=1e-10, abs=0)


def test_a_quadratic_model_without_steady_states_is_named():
    """x' = -x + x^2 + P in units of 1e7/s and 1 K: at rest up to P = 1/4, and with a square root's end just there."""
    model = th.Quadratic(A=[[-1e7]], H=[[[1e7]]], G=[[0.0]], B=[1e10], C=[1.0])  # 1 mW heats by 1 K
    share = 43e9 / (2 * 43e9)  # of the power, what the ring can absorb at most
    coupled.steady_states(RING, model, power=0.22e-3 / share)
    with pytest.raises(th.InputError, match="near the end of its steady states"):
        coupled.steady_states(RING, model, power=0.249999e-3 / share)
    with pytest.raises(th.InputError, match="has no steady state there"):
        coupled.stability_map(RING, model, [0.1e-3, 0.6e-3], [-1e9, 0.0])
    found = coupled.pulsing_map(RING, model, [0.1e-3, 0.6e-3], [-1e9, 0.0], duration=1e-6)
    assert (found.regime == "stable").all()  # as little is absorbed as leaves it at rest


def without_heat(lifetime):
    """A ring whose whole set of parameters is published, with Kerr shift and any carrier lifetime, but without heat."""
    return replace(
        coupled.vanvaerenbergh2012(),
        thermo_optic=0.0,
        kerr_coefficient=4.5e-18,
        carriers=coupled.ConstantLifetime(lifetime),
    )


@pytest.mark.parametrize("lifetime", [0.3e-12, 1e-12, 10e-12, 30e-12, 100e-12, 1e-9, 5.3e-9, 100e-9])
def test_carriers_alone_pulse_at_published_lifetimes_and_frequencies(lifetime):
    """Carrier lifetimes of several to several hundred ps, several to beyond 10 GHz, above 1e6 W/cm^2, and no others.

    Abstract of "Bistability and self-pulsation phenomena in silicon microring resonators based on nonlinear optical
    effects", Opt. Express 20, 7454 (2012). Its rings are others, so orders of magnitude are compared: "several" is
    taken as 2 to 10 where the end is a limit.
    """
    ring, heat = without_heat(lifetime), th.Foster(R=[1.0], tau=[1e-9])
    widths = np.linspace(-60, 60, 121) * ring.linear_rate / np.pi
    found = coupled.stability_map(ring, heat, np.geomspace(1e-5, 0.9, 20), widths)
    pulsing = found.where(found.regime == "self-pulsing")
    if not 2e-12 <= lifetime < 1e-9:
        assert not (found.regime == "self-pulsing").any()
        return
    assert 2e9 < float(pulsing.frequency.min()) < 30e9
    assert float(pulsing.frequency.max()) > 10e9
    onset = pulsing.frequency.dropna("power", how="all").isel(power=0).dropna("detuning")
    laser = {"power": float(onset.power), "detuning": float(onset.detuning[0])}
    state = coupled.steady_states(ring, heat, **laser).isel(branch=-1)
    intensity = float(state.energy) * constants.c / (ring.group_index * ring.tpa_volume)  # W/m^2
    assert intensity > 1e10
    run = coupled.simulate(ring, heat, **laser, duration=400 / float(onset[0]))  # and the trace itself pulses
    cycle = coupled.pulsing(run)
    assert cycle.regime == "self-pulsing"
    assert 2e9 < 1 / cycle.period < 50e9


STEEP = th.OutputMap(th.Foster(R=[2e3, 3e3, 3e3], tau=[5e-8, 4e-7, 1.5e-6]), -0.05)  # at 10 K of z more heat cools


def test_a_stability_map_beyond_the_top_of_an_output_map_says_so():
    with pytest.warns(th.models.OutsideTrainingWarning, match="ends at 5 K.*may absorb"):
        coupled.stability_map(RING, STEEP, [1e-3, 20e-3], [-20e9, 0.0])
    coupled.stability_map(RING, STEEP, [1e-4, 1e-3], [-20e9, 0.0])  # warnings are errors in the tests
