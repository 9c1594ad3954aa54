"""Rings without two-photon absorption, as of silicon nitride: no carriers; heat against Kerr makes them pulse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import coupled
import thermofem as th

# the index falls with temperature, as under a polymer, and rises with light
RING = replace(
    coupled.borghi2021(), bus_rate=5e9, drop_rate=0.0, loss_rate=1e9, tpa_coefficient=0.0, fcd=((0.0, 1.0),),
    thermo_optic=-5e-5, kerr_coefficient=1e-17,
)  # fmt: skip
HEAT = th.Foster(R=[2000.0], tau=[1e-7])
POWER, DETUNING = 1e-3, -477464829.275686


def energies(times):
    """Energy in J by SciPy: light and heat turn the resonance, heat by -(w0/n0) dn/dT dT."""
    from coupled.kernel import units as eq

    rates, _ = eq.internal_rates(RING)
    per_kelvin = 2 * np.pi * RING.frequency / RING.refractive_index * RING.thermo_optic * eq.NS
    pump, turn = eq.internal_pump(RING, POWER), eq.internal_detuning(DETUNING)

    def rhs(_, y):
        a, rise = y[0] + 1j * y[1], y[2]
        U = abs(a) ** 2
        da = (1j * (-per_kelvin * rise - rates.kerr * U - turn) - rates.loss) * a + 1j * pump
        absorbed = 2 * rates.absorbed * U * eq.UW
        return [da.real, da.imag, (HEAT.R[0] * absorbed - rise) / (HEAT.tau[0] / eq.NS)]

    found = solve_ivp(rhs, (0, times[-1] / eq.NS), [0.0, 0.0, 0.0], "LSODA", times / eq.NS, rtol=1e-9, atol=1e-12)
    return (found.y[0] ** 2 + found.y[1] ** 2) * eq.FJ


def test_pulses_of_light_and_heat_alone():
    """The verdict is that of light and heat, in a circuit and elsewhere: no carriers move."""
    times = np.linspace(3e-6, 4e-6, 20001)
    run = coupled.simulate(RING, HEAT, power=POWER, detuning=DETUNING, times=times, duration=4e-6, rtol=1e-8)
    want = energies(times)
    assert run["energy"].values == pytest.approx(want, abs=1e-4 * want.max())  # 0.03 ps on a slope of 5 % in 50 ps
    waits = np.diff(coupled.runs.pulsing.crossings(times, want, (want.min() + want.max()) / 2))
    whole = coupled.simulate(RING, HEAT, power=POWER, detuning=DETUNING, duration=10e-6, rtol=1e-8)
    circuit = coupled.simulate(
        coupled.bus([RING]), HEAT, power={"in": POWER}, detuning=DETUNING, duration=10e-6, rtol=1e-8
    )
    for trace in (whole, circuit.sel(ring="ring 1")):
        found = coupled.pulsing(trace)
        assert str(found.regime) == "self-pulsing"
        assert found.period == pytest.approx(waits[-1], rel=1e-5, abs=0)  # 50 ps between samples, on a cubic
    for cycle in (
        coupled.limit_cycle(RING, HEAT, power=POWER, detuning=DETUNING),
        coupled.limit_cycle(coupled.bus([RING]), HEAT, power={"in": POWER}, detuning=DETUNING, settle=4e-6),
    ):
        assert cycle.attrs["period"] == pytest.approx(waits[-1], rel=1e-5, abs=0)
    at = coupled.pulsing_map(RING, HEAT, [POWER], [DETUNING])
    assert (at["regime"].values.item(), at.attrs["settled"]) == ("self-pulsing", 0)
    assert at["period"].values.item() == pytest.approx(waits[-1], rel=1e-4)  # its rtol is 1e-5


def test_rest_of_light_is_said_of_photons():
    found = coupled.pulsing(coupled.simulate(RING, HEAT, power=1e-5, detuning=-5e9, duration=5e-6))
    assert str(found.regime) == "stable"
    assert "photons" in found.reason
    assert "carriers" not in found.reason


def test_settled_maps_follow_carriers():
    with pytest.raises(th.InputError, match="no two-photon absorption and so no free carriers"):
        coupled.pulsing_map(RING, HEAT, [POWER], [DETUNING], settled=True)


def test_a_branch_of_cycles_without_carriers_holds_single_cycles():
    branch = coupled.continue_cycle(RING, HEAT, "power", (1.2e-3, 0.9e-3), power=POWER, detuning=DETUNING)
    one = coupled.limit_cycle(RING, HEAT, power=1.2e-3, detuning=DETUNING)
    assert branch.attrs["reason"] == "the end of the range"
    assert float(branch["period"][-1]) == pytest.approx(one.attrs["period"], rel=1e-8, abs=0)  # rtol 1e-9 of both


def test_hopf_curves_have_the_lyapunov_coefficient_of_rings_with_few_carriers():
    """Relative to carriers that are 0 it would be nan. Its sign does not depend on what it is relative to."""
    window = [1e-4, 1e-1], [-20e9, 20e9]
    none, few = (coupled.hopf_curves(replace(RING, tpa_coefficient=tpa), HEAT, *window) for tpa in (0.0, 1e-16))
    assert len(none) == len(few) > 0
    for curve, other in zip(none, few, strict=True):
        assert np.isfinite(curve["lyapunov"].values).all()
        near = np.abs(np.log(other.energy.values[:, None] / curve.energy.values)).argmin(axis=0)
        # beside a change of sign the nearest point of the other curve may lie on its other side
        assert np.mean(np.sign(curve.lyapunov.values) == np.sign(other.lyapunov.values[near])) > 0.95


def test_a_circuit_of_such_a_ring_has_its_fixed_points():
    """Carriers have a scale of their own: round-off is not compared with 1e-30."""
    ring = replace(coupled.borghi2021(), tpa_coefficient=0.0)
    alone = coupled.steady_states(ring, HEAT, power=1e-3)
    found = coupled.steady_states(coupled.bus([ring]), HEAT, power={"in": 1e-3})
    assert found["energy"].values.ravel() == pytest.approx(alone["energy"].values, rel=1e-9, abs=0)


def test_a_second_resonance_of_such_a_ring_takes_no_more_steps():
    """Carriers of 1e-30 reject no step."""
    ring = replace(coupled.borghi2021(), tpa_coefficient=0.0)
    probe = coupled.Laser(1e-3, 0.0, resonance=replace(ring, frequency=ring.frequency + 1.5e12))
    run = coupled.simulate(ring, HEAT, power=5e-3, duration=20e-9, lasers=probe)
    assert run.attrs["steps"] + run.attrs["rejected_steps"] < 200


def test_the_rate_decides_whether_there_are_carriers():
    """The rate, not `tpa_coefficient`, also where `with_rates` has set it."""
    ring = coupled.borghi2021()
    same = replace(ring.with_rates(eta_tpa=ring.eta_tpa, g_tpa=ring.g_tpa), tpa_coefficient=0.0)
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    periods = [coupled.limit_cycle(one, model, power=6.31e-3).attrs["period"] for one in (ring, same)]
    assert periods[1] == pytest.approx(periods[0], rel=1e-9, abs=0)
    with pytest.raises(th.InputError, match="comes to rest"):
        coupled.limit_cycle(ring.with_rates(eta_tpa=0.0, g_tpa=0.0), model, power=6.31e-3)
