"""Closed forms of conduction, reciprocity, and random geometries: none of the numbers are of our making.

One-term values at Fo = 0.2 are infinite series summed; see Carslaw and Jaeger, Conduction of Heat in Solids, 2nd ed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem
from grids import facets_where, tensor_mesh
from hypothesis import given, settings, strategies as st
from scipy.special import j1
from sections import on_oxide, random_parts

import thermofem as th
from thermofem.algebra.factor import factorize
from thermofem.fem import HeatProblem
from thermofem.fem.surfaces import Surfaces, surface_terms
from thermofem.fem.weak_forms import discretize
from thermofem.transient import integrate

SERIES = "infinite series (Carslaw and Jaeger)"
FOURIER = 0.2  # k t/(rho c a^2), with all of them 1


def cooling(mesh, where, place, *, convection=False):
    """Temperature at ``place`` at Fo = 0.2 of a body at 1 whose faces ``where`` go to 0, or lose heat with Bi = 1."""
    faces = facets_where(mesh, where)
    none = np.empty(0, dtype=int)
    held, losing = (none, {1.0: faces}) if convection else (faces, {})
    d = th.fem.discretize(mesh, 1.0, 1.0, th.fem.Surfaces(held=held, convection=losing))
    at = np.asarray(d.basis.probes(np.array([[place[0]], [place[1]]])).todense())[:, d.free]
    n = d.free.size
    system = th.StateSpace(d.mass[d.free][:, d.free], -d.stiffness[d.free][:, d.free], np.zeros((n, 1)), at)
    return integrate(system, th.Constant(0.0), [FOURIER], rtol=1e-6, initial=np.ones(n)).outputs[0, 0]


# 24 quadratic elements a radius: (1/24)^3 ~ 7e-5 of the highest mode that is left, itself well below one


def test_infinite_cylinder(validated):
    mesh = tensor_mesh(np.linspace(0, 1, 25), [0, 0.5])
    centre = cooling(mesh, lambda r, z: np.isclose(r, 1), (0, 0.25))
    validated("Heat equation", "axis of a cooling cylinder, Fo = .2", centre, 0.501487, rel=1e-4, source=SERIES)


def test_infinite_cylinder_with_convection(validated):
    mesh = tensor_mesh(np.linspace(0, 1, 25), [0, 0.5])
    centre = cooling(mesh, lambda r, z: np.isclose(r, 1), (0, 0.25), convection=True)
    validated("Heat equation", "the same with convection, Bi = 1", centre, 0.870174, rel=1e-4, source=SERIES)


def test_finite_cylinder_is_the_product_of_cylinder_and_slab(validated):
    """Half height 1 = radius: the centre is 0.501487 x 0.772312."""
    mesh = tensor_mesh(np.linspace(0, 1, 25), np.linspace(0, 1, 25))
    centre = cooling(mesh, lambda r, z: np.isclose(r, 1) | np.isclose(z, 1), (0, 0))
    validated("Heat equation", "centre of a finite cylinder, Fo = .2", centre, 0.387304, rel=1e-4, source=SERIES)


def test_sphere(validated):
    """A half disc in (r, z), with 96 chords for its arc, which take (pi/192)^2/3 = 9e-5 off the mean radius."""
    grid = skfem.MeshTri.init_tensor(np.linspace(0, 1, 25), np.linspace(0, 1, 97))
    rho, angle = grid.p[0], np.pi * grid.p[1]
    points = np.column_stack([rho * np.sin(angle), -rho * np.cos(angle)])
    used, index = np.unique(np.round(points, 12), axis=0, return_inverse=True)
    triangles = index.ravel()[grid.t.T]
    a, b, c = (used[triangles[:, k]] for k in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    triangles[twice < 0] = triangles[twice < 0][:, ::-1]
    triangles = triangles[np.abs(twice) > 1e-12]
    used[np.abs(used[:, 0]) < 1e-10, 0] = 0.0
    mesh = th.mesh.Mesh(used, triangles, np.zeros(len(triangles), dtype=np.int64), ("body",))
    centre = cooling(mesh, lambda r, z: (r > 0) & (np.hypot(r, z) > 0.99), (0, 0.0))
    # the smaller radius raises Fo by 1.8e-4; d ln T/d ln Fo = -pi^2 Fo = -2
    validated("Heat equation", "centre of a sphere, Fo = .2", centre, 0.277078, rel=4.5e-4, source=SERIES)


@pytest.mark.parametrize(("k_r", "k_z"), [(3.0, 3.0), (3.0, 0.5)], ids=["isotropic", "flat"])
def test_manufactured_solution_converges_with_order_three(k_r, k_z):
    """T = (2 + cos(pi r/a)) sin(pi z/H), which does not vanish on the axis; held at both ends, insulated at r = a."""
    a, H = 2.0, 1.0

    def exact(r, z):
        return (2 + np.cos(np.pi * r / a)) * np.sin(np.pi * z / H)

    def source(r, z):
        q = np.pi / a
        radial = -(q**2) * np.cos(q * r) - q * q * np.sinc(q * r / np.pi)
        return -k_r * np.sin(np.pi * z / H) * radial + k_z * (np.pi / H) ** 2 * exact(r, z)

    errors = []
    for n in (4, 8, 16):
        mesh = tensor_mesh(np.linspace(0, a, 2 * n + 1), np.linspace(0, H, n + 1))
        k = np.array([k_r, k_z])[:, None] * np.ones(len(mesh.triangles))
        d = th.fem.discretize(mesh, k, 1.0, th.fem.Surfaces(held=facets_where(mesh, lambda r, z: np.isclose(z % H, 0))))
        fine = skfem.Basis(d.basis.mesh, skfem.ElementTriP2(), intorder=8)
        load = skfem.LinearForm(lambda v, w: 2 * np.pi * w.x[0] * source(*w.x) * v).assemble(fine)
        T = np.zeros(d.mass.shape[0])
        T[d.free] = factorize(d.stiffness[d.free][:, d.free])(load[d.free])
        errors.append(np.abs(T - exact(*d.basis.doflocs)).max())
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 2.8)  # P2: 3
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("k", [(2.0, 2.0), (3.0, 0.5), (0.5, 3.0)], ids=["isotropic", "flat", "upright"])
def test_all_heat_of_a_distant_source_leaves_through_open_sides(k):
    """T = 1/(4 pi sqrt(det k) sqrt(d . k^-1 d)) of 1 W in unbounded material, half of which flows down from z = 0."""
    k_r, k_z = k
    mesh = tensor_mesh(np.linspace(0, 3, 61), np.linspace(-2, 0, 41))
    cut = facets_where(mesh, lambda r, z: np.isclose(r, 3) | np.isclose(z, -2))
    conductivity = np.array([k_r, k_z])[:, None] * np.ones(len(mesh.triangles))
    d = discretize(mesh, conductivity, 1.0, Surfaces(open=cut))
    r, z = d.basis.doflocs
    T = 1 / (4 * np.pi * k_r * np.sqrt(k_z) * np.sqrt(np.maximum(r**2 / k_r + z**2 / k_z, 0.01)))
    outflow = surface_terms(d.basis, conductivity, d.surfaces) @ T
    # P2 on facets of 0.05: (0.05/2)^3, and the next order of T on the way to the far corner
    assert outflow.sum() == pytest.approx(0.5, rel=1e-4)


def test_an_anisotropic_box_reaches_the_matrices():
    strip = th.strip_ring()
    oxide = th.materials.find("SiO2")
    slow = [
        th.assemble(replace(strip, materials=(replace(oxide, **change),))).thermal_resistance()
        for change in (
            {},
            {"conductivity_z": 1.0},
            {"conductivity": 1.0, "conductivity_z": 1.38},
            {"conductivity": 1.0},
        )
    ]
    assert slow[0] < slow[2] < slow[1] < slow[3]  # heat leaves downwards rather than sideways
    assert slow[3] == pytest.approx(10800, rel=2e-3)  # published sensitivity: 10.80 K/mW at 1.0 W/m/K


def layer_resistance(one, other, bottom, height, thickness, k):
    """Mean rise of one ring per watt in another, in a layer held at z = 0 and insulated on top; Hankel transform.

    R = 2 pi/(V1 V2 k) int A1 A2 Z dl,  A = [r J1(l r)/l] from the inner to the outer radius,  Z/l the double integral
    over z and z' in the rings of sinh(l z<) cosh(l (H - z>))/cosh(l H)/l.
    """
    step = 2e-4  # of l in 1/um, against periods of 2 pi/(8 + 5)
    x = np.arange(step / 2, 60, step)
    top, H, h = bottom + height, thickness, height
    squares = lambda a, b: ((np.exp(-x * a) - np.exp(-x * b)) / x) ** 2  # noqa: E731 - of an integral of exp(-l z)
    near = 2 * (h / x - (1 - np.exp(-x * h)) / x**2)
    far = 2 * ((np.exp(-x * (2 * H - h)) - np.exp(-2 * x * H)) / x**2 - np.exp(-2 * x * H) * h / x)
    Z = (near + squares(H - top, H - bottom) - squares(bottom, top) - far) / (2 * (1 + np.exp(-2 * x * H)))
    A1, A2 = ((b * j1(x * b) - a * j1(x * a)) / x for a, b in (one, other))
    V1, V2 = (np.pi * (b**2 - a**2) * height for a, b in (one, other))
    return 2 * np.pi / (V1 * V2) * float(np.sum(A1 * A2 * Z) * step) / k * 1e6  # lengths in um


def test_crosstalk_of_concentric_rings(needs_mesher):
    """Two rings of the layer's own material, 2.5 um apart: exact, each alone and one read while the other is heated."""
    rings = {"inner": (4.75, 5.25), "outer": (7.75, 8.25)}
    place = {"bottom": 0.0, "height": 220e-9, "heated": True}
    parts = [th.Part(name, "SiO2", a * 1e-6, b * 1e-6, **place) for name, (a, b) in rings.items()]
    layers = th.Layer("below", "SiO2", 2e-6, datum=True), th.Layer("above", "SiO2", 2.22e-6)
    heat = th.assemble(th.CrossSection("pair", 60e-6, layers, tuple(parts)), accuracy=1e-3)
    for heated, read in (("inner", "inner"), ("outer", "outer"), ("inner", "outer"), ("outer", "inner")):
        exact = layer_resistance(rings[heated], rings[read], 2.0, 0.22, 4.22, 1.38)
        assert heat.thermal_resistance(heated, read) == pytest.approx(exact, rel=1e-3)
    both = th.solve(heat, th.Constant(1e-3), [1e-6, 20e-6], heated="inner", read=("inner", "outer"))
    assert both.delta_T.sel(probe="outer").values[0] < 0.05 * both.delta_T.sel(probe="outer").values[1]


KINDS = [th.Boundary("isothermal"), th.Boundary("insulated"), th.Boundary("convection", 1e5), th.Boundary("open")]
CONTACTS = [(), (th.Interface("part0", 1e-8),)]


@given(random_parts(), st.sampled_from(KINDS[:3]), st.sampled_from(KINDS), st.sampled_from(CONTACTS))
@settings(max_examples=25, deadline=None)
@pytest.mark.slow
def test_any_geometry_is_refused_or_meshed_exactly_and_keeps_its_heat(parts, top, outer, contacts):
    try:
        geometry = on_oxide(*parts, top=top, outer=outer, interfaces=contacts)
        geometry.volumes()
    except th.InputError:  # what contradicts itself, named in test_geometry
        return
    heat: HeatProblem = th.assemble(geometry, accuracy=0.05)
    assert heat.mesh.volumes() == pytest.approx(geometry.volumes(), rel=1e-11, abs=0)  # sums of a thousand triangles
    run = integrate(heat.model(), th.Pulse(1e-3, 1e-7), [1e-7, 1e-6], rtol=1e-2, ledger=heat.audit("part0"))
    assert abs(run.imbalance) < 1e-8  # solves of matrices with a condition of 1e8
    assert 0 < run.outputs[-1, 0] < 1e-3 * heat.thermal_resistance()
