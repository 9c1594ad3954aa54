"""Matrices of facets against scikit-fem's own boundary forms."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

import thermofem as th
from thermofem.fem.surfaces import Surfaces, contacts, split, surface_terms
from thermofem.mesh import mesh_for

ELEMENTS = {2: skfem.ElementTriP2(), 3: skfem.ElementTriP3()}
ROUND_OFF = 1e-12  # both integrate polynomials exactly; relative to the largest entry


def close(ours, theirs, tolerance=ROUND_OFF):
    return abs(ours - theirs).max() < tolerance * abs(theirs).max()


@pytest.fixture(scope="module")
def grid():
    return mesh_for(th.strip_ring(), 1e-3).skfem


@pytest.mark.parametrize("degree", ELEMENTS)
def test_exchange_is_the_boundary_form_of_scikit_fem(grid, degree):
    """On all sides at once: h 2 pi r u v ds; of degree 2 or 3 in u and v and 1 in r, so 7 is exact."""
    basis = skfem.Basis(grid, ELEMENTS[degree])
    facets, h = grid.boundary_facets(), 3e4
    ours = surface_terms(basis, 1.0, Surfaces(convection={h: facets}))
    side = skfem.FacetBasis(grid, ELEMENTS[degree], facets=facets, intorder=7)
    theirs = skfem.BilinearForm(lambda u, v, w: 2 * np.pi * w.x[0] * h * u * v).assemble(side)
    assert close(ours, theirs)


@pytest.mark.parametrize("degree", ELEMENTS)
def test_an_open_side_is_the_boundary_form_of_scikit_fem(grid, degree):
    """2 pi r (n . d)/(d . k^-1 d) u v ds with scikit-fem's normal, anisotropic, from a source off the origin.

    Round-off with the same Gauss points. These integrate u v times a line exactly; the curvature of the weight over a
    facet of length L at a distance d is left, (L/d)^2/8 of it or less: 2e-3 for 4 um at 30 um.
    """
    basis = skfem.Basis(grid, ELEMENTS[degree])
    facets = grid.facets_satisfying(lambda x: (x[1] < -31.9e-6) | (x[0] > 59.9e-6), boundaries_only=True)
    k, source = np.array([2.0, 5.0]), 0.11e-6
    conductivity = np.outer(k, np.ones(grid.t.shape[1]))
    ours = surface_terms(basis, conductivity, Surfaces(open=facets, source=(0.0, source)))

    def form(u, v, w):
        r, z = w.x[0], w.x[1] - source
        return 2 * np.pi * r * (w.n[0] * r + w.n[1] * z) / (r**2 / k[0] + z**2 / k[1]) * u * v

    for order, tolerance in ((2 * degree + 1, ROUND_OFF), (16, 2e-3)):
        side = skfem.FacetBasis(grid, ELEMENTS[degree], facets=facets, intorder=order)
        theirs = skfem.BilinearForm(form).assemble(side)
        assert theirs.sum() > 0
        assert close(ours, theirs, tolerance)


@pytest.mark.parametrize("degree", ELEMENTS)
def test_a_contact_is_the_jump_integrated_by_scikit_fem(degree):
    """u^T K u = int 2 pi r (f - g)^2/R ds, with quadratic f in the core and g around it; f = g costs nothing."""
    resistance = {"core": 3e-8}
    mesh = split(mesh_for(th.strip_ring(), 1e-3), resistance)
    grid = mesh.skfem
    basis = skfem.Basis(grid, ELEMENTS[degree])
    pairs = contacts(mesh, resistance)
    K = surface_terms(basis, 1.0, Surfaces(contacts=pairs))
    ((R, (first, second)),) = pairs.items()
    assert R == 3e-8
    inside = mesh.region_names.index("core")

    def f(x):
        return 1.0 + x[0] / 8e-6 - 0.7 * (x[1] / 2e-7) ** 2

    def g(x):
        return 0.2 - x[0] / 9e-6 + 0.3 * x[1] / 2e-7

    def values(one, other):
        """Nodal values: ``one`` in the core, ``other`` outside; nodes of a contact are there on both sides."""
        u = other(basis.doflocs)
        core = np.unique(basis.element_dofs[:, mesh.region == inside])
        u[core] = one(basis.doflocs)[core]
        return u

    side = skfem.FacetBasis(grid, ELEMENTS[degree], facets=first, intorder=8)
    jump = skfem.Functional(lambda w: 2 * np.pi * w.x[0] * (f(w.x) - g(w.x)) ** 2 / R).assemble(side)
    u = values(f, g)
    assert u @ K @ u == pytest.approx(jump, rel=1e-10)
    same = values(f, f)
    assert abs(same @ K @ same) < 1e-10 * jump
    assert len(first) == len(second)
