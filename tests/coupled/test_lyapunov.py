"""First Lyapunov coefficient: a closed form for planar systems, and what integration finds on both sides."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from rings import RING, SECOND_ORDER

import coupled
import surrogate
import thermofem as th
from coupled.equilibria.steady_states import first_lyapunov

FEM_TRAINED = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
POWERS, DETUNINGS = 1e-3 * 10 ** (np.linspace(3, 10, 12) / 10), np.linspace(-30e9, 30e9, 13)


@pytest.mark.parametrize("seed", range(8))
def test_closed_form_of_a_planar_system(seed):
    """x' = -w y + f, y' = w x + g with all quadratic and cubic terms: Guckenheimer and Holmes (1983), Eq. 3.4.11."""
    rng = np.random.default_rng(seed)
    w = rng.uniform(0.5, 3)
    second, third = rng.normal(size=(2, 3)), rng.normal(size=(2, 4))  # f and g: x^2, xy, y^2 and x^3, x^2 y, x y^2, y^3
    (fxx, fxy, fyy), (gxx, gxy, gyy) = second * [2, 1, 2]
    fxxx, fxyy, gxxy, gyyy = 6 * third[0, 0], 2 * third[0, 2], 2 * third[1, 1], 6 * third[1, 3]
    want = (fxxx + fxyy + gxxy + gyyy) / 16 + (
        fxy * (fxx + fyy) - gxy * (gxx + gyy) - fxx * gxx + fyy * gyy
    ) / (16 * w)  # fmt: skip
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # with a third state that decays, and turned in space

    def jacobian(z):
        x, y, _ = turn.T @ z
        J = np.zeros((3, 3))
        J[:2, 0] = second @ [2 * x, y, 0] + third @ [3 * x * x, 2 * x * y, y * y, 0] + [0, w]
        J[:2, 1] = second @ [0, x, 2 * y] + third @ [0, x * x, 2 * x * y, 3 * y * y] + [-w, 0]
        J[2, 2] = -1.7
        return turn @ J @ turn.T

    found, values = first_lyapunov(jacobian, np.zeros(3), np.ones(3), 1.02 * w, 0)
    # r is the amplitude of the first state, |row 0 of the turn in the plane| times that in the plane
    plane = np.hypot(turn[0, 0], turn[0, 1])
    # the circle of the plane is seen as an ellipse only if the third state took part: it does not
    assert found * plane**2 == pytest.approx(want, rel=1e-6, abs=1e-8)  # differences: 1e-10 over the step
    assert sorted(values.imag)[2] == pytest.approx(w, rel=1e-9)


def swing_of(model, power, detuning, ring=RING, initial=None):
    run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=80e-6, rtol=1e-8, initial=initial)
    late = run["carriers"].values[run["time"].values > 70e-6]
    return float(np.ptp(late) / (late.max() + late.min())), run


def test_a_supercritical_pulse_grows_like_the_root():
    """r = sqrt(-growth/g) on the side that grows, nothing on the other: from the eigenvalue and g alone."""
    curve = xr.concat(coupled.hopf_curves(RING, SECOND_ORDER, POWERS, DETUNINGS), "point")
    soft = np.flatnonzero((curve.lyapunov.values < 0) & curve.leading.values)
    point = curve.isel(point=int(soft[np.argmin(np.abs(curve.detuning.values[soft] + 10e9))]))
    sides = {+1: [], -1: []}
    for step in (0.1e9, -0.1e9, 0.2e9, -0.2e9, 0.4e9, -0.4e9):
        laser = {"power": float(point.power), "detuning": float(point.detuning) + step}
        states = coupled.steady_states(RING, SECOND_ORDER, **laser)
        branch = states.isel(branch=int(np.abs(states.energy.values - float(point.energy)).argmin()))
        growth, (amplitude, _) = float(branch.growth_rate), swing_of(SECOND_ORDER, *laser.values())
        sides[np.sign(growth)].append((growth, amplitude))
    assert [len(side) for side in sides.values()] == [3, 3]
    for growth, amplitude in sides[+1]:
        want = np.sqrt(-growth / float(point.lyapunov))
        assert 0.03 < want < 0.1
        # the next term of the amplitude equation and the overtones are of relative order r^2; 7 e-folds or more
        assert amplitude == pytest.approx(want, rel=6 * want**2 + np.exp(-2 * 70e-6 * growth) / want)
    (slow, small), (fast, large) = sides[+1][0], sides[+1][-1]
    assert large / small == pytest.approx(np.sqrt(fast / slow), rel=0.03)  # the root, whatever g
    for growth, amplitude in sides[-1]:
        assert amplitude < 2 * np.exp(70e-6 * growth)  # a cold start rings down


def test_a_subcritical_point_has_a_pulse_beside_it():
    ring, newton = RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    curves = coupled.hopf_curves(ring, newton, POWERS, DETUNINGS)
    hard = [c.isel(point=k) for c in curves for k in np.flatnonzero((c.lyapunov.values > 0) & c.leading.values)]
    assert hard
    point = min(hard, key=lambda p: abs(float(p.power) - 5e-3) + abs(float(p.detuning)) * 1e-12)
    sides = [float(point.detuning) + step * 0.2e9 for step in (-1, 1)]
    stable = [
        nu for nu in sides
        if int(coupled.stability_map(ring, newton, [float(point.power)], [nu]).stable_points[0, 0])
    ]  # fmt: skip
    (rest,), (pulses,) = stable, [nu for nu in sides if nu not in stable]
    amplitude, run = swing_of(newton, float(point.power), pulses, ring)
    assert amplitude > 0.3  # at once large
    assert (
        swing_of(newton, float(point.power), rest, ring, initial=run)[0] > 0.3
    )  # and goes on where rest is stable too


def test_which_thermal_models_begin_to_pulse_softly():
    """As docs/stability.md says, on every leading point of the plane of the paper's maps."""
    cases = {
        "newton": (RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)),
        "experiment": (RING, SECOND_ORDER),
        "FEM": (RING, surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-4).model),
        "FEM-trained": (RING, FEM_TRAINED),
    }
    hard = {}
    for name, (ring, model) in cases.items():
        curves = coupled.hopf_curves(ring, model, POWERS, DETUNINGS)
        g, nu, leading = (np.concatenate([c[v].values for c in curves]) for v in ("lyapunov", "detuning", "leading"))
        hard[name] = nu[(g > 0) & leading], nu[(g < 0) & leading]
    assert hard["newton"][1].size == hard["experiment"][0].size == hard["FEM"][0].size == 0
    assert hard["FEM-trained"][0].min() > 22e9
    assert hard["FEM-trained"][1].size


def test_the_narrow_hysteresis_of_the_fem_trained_set():
    """A large pulse and rest beside each other just outside its subcritical border, one pulse or rest farther off."""
    curves = coupled.hopf_curves(RING, FEM_TRAINED, POWERS, DETUNINGS)
    points = [c.isel(point=k) for c in curves for k in np.flatnonzero((c.lyapunov.values > 0) & c.leading.values)]
    point = min(points, key=lambda p: abs(float(p.detuning) - 28e9))
    power, border = float(point.power), float(point.detuning)
    _, pulses = swing_of(FEM_TRAINED, power, border - 3e9)
    after, _ = swing_of(FEM_TRAINED, power, border + 0.01e9, initial=pulses)
    assert after > 0.3
    (rest,) = coupled.steady_states(RING, FEM_TRAINED, power=power, detuning=border + 0.01e9).regime.values
    assert rest == "stable"
    far, _ = swing_of(FEM_TRAINED, power, border + 0.4e9, initial=pulses)
    assert far < 0.01
