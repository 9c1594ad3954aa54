"""What k(T) and c_p(T) do to a few fields: against the laws themselves, LSODA, and a field without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from models import coarse_warm_fem
from scipy.integrate import odeint
from scipy.interpolate import CubicHermiteSpline

import thermofem as th
from thermofem.algebra.krylov import krylov
from thermofem.transient.deflation import FieldIntegrator
from thermofem.transient.fast_part import FastPart
from thermofem.transient.nonlinear import Curvature, curvature
from thermofem.waveforms import PiecewiseCubic

TIMES = np.linspace(0, 0.2e-6, 41)


def parabolic():
    """The coarse FEM with every law a straight line, whose integrals are parabolas."""
    system = coarse_warm_fem()
    T0 = system.flow.ambient

    def straight(lift, slope):
        return replace(lift, laws=tuple((th.materials.Polynomial((slope,), T0), at) for _, at in lift.laws))

    return replace(system, flow=straight(system.flow, -3e-3), content=straight(system.content, 2e-3))


def test_the_forms_are_the_projected_laws():
    system = parabolic()
    basis = krylov(system.linear, 1)
    V, forms = basis.vectors, curvature(system, basis)
    z = np.random.default_rng(1).normal(size=(5, V.shape[1])) * 1e-4
    flow, content = forms(z)
    for one, f, e in zip(z, flow, content, strict=True):
        x = V @ one
        exact = V.T @ (system.flow(x) + system.linear.A @ x), V.T @ (system.content(x) - system.linear.E @ x)
        # what cancels leaves round-off
        assert f == pytest.approx(exact[0], rel=1e-9, abs=1e-13 * np.abs(V.T @ system.flow(x)).max())
        assert e == pytest.approx(exact[1], rel=1e-9, abs=1e-13 * np.abs(V.T @ system.content(x)).max())


@pytest.mark.slow
def test_the_amplitudes_follow_their_equation():
    """d(z + e(z))/dt = -rate z - f(z) + heating P, by LSODA in z + e(z)."""
    system = coarse_warm_fem()
    basis = krylov(system.linear, 2)
    forms, reach = curvature(system, basis), np.abs(system.linear.C[0] @ basis.vectors)
    power, slope = 0.02 * np.sin(np.pi * TIMES / TIMES[-1]) ** 2, 0.02 * np.pi / TIMES[-1] * np.sin(1e7 * np.pi * TIMES)
    spline = CubicHermiteSpline(TIMES, power, slope)
    wave = PiecewiseCubic.of_spline(spline)
    start = np.zeros(basis.rate.size)
    fast = FastPart(basis, 0.0, start, [wave], TIMES, forms, 1e-7 / reach)

    def amplitudes(w):
        z = w
        for _ in range(8):
            z = w - forms(z[None])[1][0]
        return z

    def right(w, t):
        z = amplitudes(w)
        return -basis.rate * z - forms(z[None])[0][0] + basis.heating[:, 0] * float(wave(t))

    scale = np.abs(fast.values).max(axis=0)
    track = odeint(right, start, TIMES, rtol=1e-9, atol=1e-9 * scale, mxstep=5000, tcrit=TIMES[-1:])
    exact = np.array([amplitudes(w) for w in track]) @ (system.linear.C[0] @ basis.vectors)
    found, linear = (
        one.z(TIMES) @ (system.linear.C[0] @ basis.vectors)
        for one in (fast, FastPart(basis, 0.0, start, [wave], TIMES))
    )
    # g is one cubic on each of 40 intervals of 5 ns
    assert found == pytest.approx(exact, rel=0, abs=1e-5 * exact.max())
    assert np.abs(linear - exact).max() > 1e-3 * exact.max()  # so that it is seen


def test_any_forms_give_the_same_field_and_the_right_ones_take_fewer_steps():
    system, wave = coarse_warm_fem(), th.SquareWave(20e-3, 0.1e-6, 1 / 3)
    basis, found, steps = krylov(system.linear), [], []
    for share in (0.0, 0.5, 1.0):
        field = FieldIntegrator(system, basis, tolerance=5e-3)
        forms = field.equations.curved
        field.equations.curved = Curvature(share * forms.flow, share * forms.content, share * forms.inverse)
        found.append(field.advance(field.start(), [wave], TIMES)[0][:, 0])
        steps.append(field.stepper.steps)
    assert np.abs(found[0] - found[2]).max() < 5e-3
    assert np.abs(found[1] - found[2]).max() < 5e-3
    assert steps[2] < 0.7 * steps[0]
