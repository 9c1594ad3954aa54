"""Matrices against scikit-fem's quadrature, shared factorizations against direct ones, enrichment against cubics."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

import thermofem as th
from thermofem.algebra import factor
from thermofem.algebra.factor import Pencil, factorize
from thermofem.fem.error_estimate import PEAK, SATURATION
from thermofem.fem.weak_forms import capacity, conduction, mean, properties

ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def strip():
    return th.assemble(th.strip_ring(), 1e-3)


@pytest.mark.parametrize("element", [skfem.ElementTriP2, skfem.ElementTriP3])
def test_matrices_are_those_of_the_weak_form(strip, element):
    k, c = properties(strip.geometry, strip.mesh)
    k = k * np.array([[1.0], [1.7]])
    basis = skfem.Basis(strip.discretization.basis.mesh, element(), intorder=7)  # exact to degree 3 + 3 + 1

    @skfem.BilinearForm
    def flow(u, v, w):
        return 2 * np.pi * w.x[0] * (w["k_r"] * u.grad[0] * v.grad[0] + w["k_z"] * u.grad[1] * v.grad[1])

    @skfem.BilinearForm
    def content(u, v, w):
        return 2 * np.pi * w.x[0] * w["c"] * u * v

    def spread(values):
        return np.broadcast_to(values[:, None], basis.dx.shape)

    K, M = flow.assemble(basis, k_r=spread(k[0]), k_z=spread(k[1])), content.assemble(basis, c=spread(c))
    assert abs(conduction(basis, k) - K).max() < ROUND_OFF * abs(K).max()
    assert abs(capacity(basis, c) - M).max() < ROUND_OFF * abs(M).max()


@pytest.mark.parametrize("small", [True, False])
def test_a_pencil_solves_every_combination_however_often_it_comes_back(strip, small, monkeypatch):
    E, K = strip.discretization.E, strip.discretization.K
    if not small:
        monkeypatch.setattr(factor, "QDLDL_LIMIT", 0)
    pencil, rhs = Pencil(E, K), np.random.default_rng(1).normal(size=E.shape[0])
    for _ in range(factor.PATIENCE + 2):  # the shared place, and places of their own
        for a, b in ((1.0, 1e-9), (1.0, 0.0), (0.0, 1.0), (1.0, 1e-6)):
            found = pencil.solve(a, b, rhs)
            left = (a * E + b * K) @ found - rhs
            # backward stable: the residual is round-off of the largest term
            scale = abs(a * E + b * K).max() * np.abs(found).max()
            assert np.abs(left).max() < ROUND_OFF * scale


@pytest.mark.parametrize("s", [0.0, 1e7])
def test_the_enrichment_adds_nearly_what_cubic_elements_add(strip, s):
    """Cubic functions with the quadratic part kept, against a direct solve with scikit-fem's own cubics."""
    d = strip.discretization
    k, c = properties(strip.geometry, strip.mesh)
    basis = skfem.Basis(d.basis.mesh, skfem.ElementTriP3(), intorder=7)
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(d.surfaces.held).all())
    core = mean(basis, strip.mesh.region == strip.mesh.region_names.index("core"))[free]
    cubic = core @ factorize((conduction(basis, k) + s * capacity(basis, c))[free][:, free])(core)
    quadratic = d.means["core"][d.free] @ d.factors.solve(s, 1.0, d.means["core"][d.free])
    estimate = strip.estimate(("core", "core"))
    error = estimate.errors["core", "core"][list(estimate.shifts).index(s)] / SATURATION / (PEAK if s else 1)
    # alone they add less; 0.82 to 0.98 of it on random cross-sections (thermofem.fem.error_estimate)
    assert 0.8 < error / (cubic / quadratic - 1) < 1
    assert estimate.shares["core", "core"].sum(axis=1) == pytest.approx(estimate.errors["core", "core"], rel=1e-9)


def test_a_solve_does_not_depend_on_the_solves_before_it(strip):
    """Steps that differ by round-off share a factorization; it is the same one, whichever of them came first."""
    E, K = strip.discretization.E, strip.discretization.K
    rhs, b = np.random.default_rng(1).normal(size=E.shape[0]), 1e-9
    fresh, used = Pencil(E, K), Pencil(E, K)
    used.solve(1.0, b * (1 + 1e-10), rhs)
    np.testing.assert_array_equal(used.solve(1.0, b, rhs), fresh.solve(1.0, b, rhs))
