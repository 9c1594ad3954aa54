"""k(T) and c_p(T): closed forms, manufactured solutions, limits, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem
from grids import facets_where, tensor_mesh
from models import coarse_warm_fem, warm_fem

import thermofem as th
from thermofem.materials import PowerLaw
from thermofem.models import NonlinearSystem
from thermofem.transient import integrate, integrate_periodic
from thermofem.transient.nonlinear import nodal_operator

T0 = 300.0


def nonlinear(d, k, c, k_law, c_law, *, heated="body"):
    """One material with laws of temperature on a discretization of constants k, c at T0."""
    linear = d.state_space((heated,), (heated,))
    flow = nodal_operator([(d.stiffness, k_law)], 0 * d.stiffness, d.free, T0)
    content = nodal_operator([(d.mass, c_law)] if c_law else [], d.mass * (0 if c_law else 1), d.free, T0)
    return NonlinearSystem(
        linear, replace(flow, matrix=flow.matrix[d.free]), replace(content, matrix=content.matrix[d.free])
    )


def rod(n, k=2.0, c=3.0):
    """A column 0 < z < 1 held at both ends, nothing varies along r."""
    mesh = tensor_mesh(np.linspace(0, 1, max(n // 2, 1) + 1), np.linspace(0, 1, n + 1))
    return th.fem.discretize(mesh, k, c, th.fem.Surfaces(held=facets_where(mesh, lambda r, z: np.isclose(z % 1, 0))))


@pytest.mark.parametrize("law", [PowerLaw(-1.3), PowerLaw(0.8), th.materials.Polynomial((2e-3, 1e-5))], ids=str)
def test_kirchhoff_slab_in_closed_form(law):
    """Heated evenly, q = P/pi: g(T) = q z (1 - z)/(2 k), so that the mean of g is q/(12 k), at the nodes exactly."""
    d = rod(8)
    system = nonlinear(d, 2.0, 3.0, law, None)
    power = 2.0 * np.pi * 8 * 60  # g in the middle is 60 K
    x = np.zeros(d.mass.shape[0])
    x[d.free] = system.steady_state(power)
    z = d.basis.doflocs[1]
    g = power / np.pi * z * (1 - z) / (2 * 2.0)
    # the parabola is in the space of the elements: exact to the tolerance of Newton's method
    assert law.integral(T0, x) / law.factor(T0) == pytest.approx(g, rel=1e-9, abs=1e-9 * 60)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_a_first_power_that_heats_by_less_than_round_off(rtol):
    """1e-8 W in the first 10 ps heat by 1e-8 K: the steps shrank without end."""
    heat = warm_fem()
    times = np.append(0, np.geomspace(1e-11, 1e-6, 20))
    rises = [
        th.solve(heat, th.Sampled(t, 1e3 * np.asarray(t)), [1e-7, 1e-6], rtol=rtol).delta_T.values
        for t in (times, [0, 1e-6])
    ]  # one ramp, with and without knots
    assert rises[0] == pytest.approx(rises[1], rel=2 * rtol)


def test_static_strip_follows_kirchhoff_where_one_law_rules_all():
    """With k ~ 1/T in everything the Kirchhoff variable g solves the linear problem: T = T0 exp(g/T0)."""
    strip = th.strip_ring()
    law = PowerLaw(-1.0, strip.ambient)
    materials = tuple(replace(th.materials.find(name), conductivity_law=law) for name in ("Si", "SiO2"))
    warm, cold = th.assemble(replace(strip, materials=materials)), th.assemble(strip)
    power = 10e-3
    g = power * cold.discretization.factors.solve(0.0, 1.0, cold.system.B[:, 0])
    exact = cold.system.C[0] @ (strip.ambient * np.expm1(g / strip.ambient))
    assert warm.steady_rise(power) == pytest.approx(exact, rel=1e-10)
    assert warm.steady_rise(power) > 1.1 * power * cold.thermal_resistance()


def manufactured_error(n, rtol, a=2e-3, b=3e-3):
    """k = k0 (1 + b T), c = c0 (1 + a T) with the rise T = A s(t) sin(pi z), s = 1 - cos w t; one input per time shape.

    c0 (1 + a T) T_t - k0 ((1 + b T) T_z)_z = c0 A s' (sin + a A s sin^2)
                                              + k0 pi^2 (A s sin - b A^2 s^2 (cos^2 - sin^2))
    """
    A, k0, c0, w = 100.0, 0.2, 1.0, 3.0
    d = rod(n, k0, c0)
    base = nonlinear(d, k0, c0, th.materials.Polynomial((b,), T0), th.materials.Polynomial((a,), T0))
    basis = skfem.Basis(d.basis.mesh, skfem.ElementTriP2(), intorder=8)

    def load(shape):
        form = skfem.LinearForm(lambda v, x: 2 * np.pi * x.x[0] * shape(np.pi * x.x[1]) * v)
        return form.assemble(basis)[d.free]

    columns = [
        load(lambda x: c0 * A * np.sin(x)),
        load(lambda x: c0 * a * A**2 * np.sin(x) ** 2),
        load(lambda x: k0 * np.pi**2 * A * np.sin(x)),
        load(lambda x: -k0 * np.pi**2 * b * A**2 * np.cos(2 * x)),
    ]

    def s(t):
        return 1 - np.cos(w * t)

    shapes = (lambda t: w * np.sin(w * t), lambda t: w * np.sin(w * t) * s(t), s, lambda t: s(t) ** 2)
    linear = replace(base.linear, B=np.column_stack(columns), inputs=("a", "b", "c", "d"))
    end = 2.0
    run = integrate(replace(base, linear=linear), [th.Function(f) for f in shapes], [end], rtol=rtol)
    exact = A * s(end) * np.sin(np.pi * d.basis.doflocs[1][d.free])
    return np.abs(run.final - exact).max() / exact.max()


def test_manufactured_transient_converges_with_order_three_in_space():
    errors = np.array([manufactured_error(n, 1e-5) for n in (4, 8, 16)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 2.8)  # P2 at its nodes: 3
    assert errors[-1] < 2e-4


def test_manufactured_transient_follows_the_tolerance_in_time():
    mesh_error = manufactured_error(8, 1e-6)
    for rtol in (1e-3, 1e-4):
        assert manufactured_error(8, rtol) == pytest.approx(mesh_error, abs=rtol)


def test_factors_follow_the_state_for_few_factorizations():
    """At 100 K the oxide's k moves by 10 %, silicon's by 30 %; each of some dozen step lengths has its factors made."""
    data = th.solve(warm_fem(), th.Pulse(15e-3, 5e-6), times=[5e-6, 20e-6], rtol=1e-3)
    assert data.attrs["factorizations"] <= 18  # 15; 21 if the state were followed for its own sake
    assert data.attrs["solves"] < 10 * data.attrs["steps"]  # 8.6; at least 5 stages each


def test_energy_closes_at_100_kelvin():
    data = th.solve(warm_fem(), th.Pulse(15e-3, 5e-6), times=[5e-6, 20e-6], rtol=1e-3)
    assert data.delta_T.values[0] > 80
    assert 0 < data.attrs["heat_out"] < data.attrs["heat_in"]
    # enthalpy balances as exactly as the stages are solved: 0.1 x 0.01 x rtol each
    assert abs(data.attrs["heat_imbalance"]) < 1e-4
    assert data.attrs["heat_imbalance"] != 0


def test_data_of_k_of_t_say_so_and_may_leave_the_thermal_resistance_of_small_powers():
    times = np.linspace(0, 20e-6, 9)
    data = th.solve(warm_fem(), th.Constant(15e-3), times, rtol=1e-3)
    assert data.attrs["temperature_dependent"] == 1
    halved = data.assign_attrs(thermal_resistance=data.attrs["thermal_resistance"] / 2)
    assert th.dataset.response_of(halved).rise.size == times.size
    with pytest.raises(th.InputError, match="K/W allows"):
        th.dataset.response_of(halved.assign_attrs(temperature_dependent=0))
    still = th.solve(th.assemble(th.strip_ring()), th.Constant(15e-3), times)
    assert still.attrs["temperature_dependent"] == 0


def test_long_runs_end_in_the_steady_state():
    heat = warm_fem()
    data = th.solve(heat, th.Constant(10e-3), [300e-6], rtol=1e-4)
    assert data.delta_T.item() == pytest.approx(heat.steady_rise(10e-3), rel=1e-4)
    assert heat.steady_rise(10e-3) != pytest.approx(10e-3 * heat.thermal_resistance(), rel=5e-3)


@pytest.mark.slow
def test_the_periodic_state_is_what_a_train_settles_to():
    model, wave = coarse_warm_fem(), th.SquareWave(20e-3, 10e-6, 0.3)
    periodic = integrate_periodic(model, wave, 21, rtol=1e-3)
    settled = integrate(model, wave, 100e-6 + np.linspace(0, 10e-6, 21), rtol=1e-3)
    # both to rtol; exp(-100/12) = 2e-4 of the slowest mode is below it
    assert np.abs(periodic.outputs - settled.outputs).max() < 2e-3 * periodic.outputs.max()
    assert periodic.outputs.max() > 50


def test_ambient_temperature_is_respected():
    geometry = warm_fem().geometry
    hot = th.assemble(replace(geometry, ambient=400.0))
    # 98.9 and 1.51 W/m/K of the table at 400 K, 148 and 1.38 at 300 K
    exact = replace(
        th.strip_ring(), materials=(th.Material("Si", 98.9, 2330, 790), th.Material("SiO2", 1.51, 2220, 905))
    )
    assert hot.thermal_resistance() == pytest.approx(th.assemble(exact).thermal_resistance(), rel=1e-12)


def test_where_no_steady_state_exists_it_says_so():
    strip = th.strip_ring()
    runaway = tuple(replace(th.materials.find(n), conductivity_law=PowerLaw(-3.0)) for n in ("Si", "SiO2"))
    heat = th.assemble(replace(strip, materials=runaway))
    # g is bounded by T0/2 = 147 K: 40 mW would need 315 K of it
    with pytest.raises(th.InputError, match=r"power = 0.04 W: no steady state"):
        heat.steady_rise(40e-3)
