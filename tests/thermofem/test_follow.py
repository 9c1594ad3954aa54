"""Members of a campaign on moved meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import thermofem as th
from thermofem.fem import assembly
from thermofem.fem.assembly import Leader, assemble_like
from thermofem.mesh import gmsh_mesher


@pytest.fixture(scope="module")
def leader():
    return Leader(th.strip_ring(), 1e-3)


@pytest.mark.parametrize("changes", [{"radius": 5e-6, "width": 550e-9}, {"radius": 11e-6, "box": 1.2e-6}])
def test_a_member_on_the_moved_mesh_keeps_the_accuracy(leader, changes, needs_mesher):
    geometry, times = th.strip_ring(**changes), np.geomspace(1e-9, 1e-4, 26)
    heat, fine = leader.follow(geometry)[0], th.assemble(geometry, 1e-4)
    assert np.array_equal(heat.mesh.triangles, leader.motion.mesh.triangles)
    assert heat.mesh_error() <= 1e-3
    own, exact = (th.solve(each, th.Constant(1.0), times, rtol=1e-5).delta_T.values for each in (heat, fine))
    assert np.abs(own / exact - 1).max() < 1e-3
    # factors that were taken over from the member before give the same answer as new ones
    alone = th.assemble(geometry, 1e-3).thermal_resistance()
    assert heat.thermal_resistance() == pytest.approx(alone, rel=1e-3)


def test_factors_are_inherited_and_the_one_before_makes_its_own_again(leader):
    first, second = (leader.follow(th.strip_ring(width=w))[0] for w in (460e-9, 470e-9))
    again = first.discretization.factors.solve(0.0, 1.0, first.system.B[:, 0])
    assert first.system.C[0] @ again == pytest.approx(first.thermal_resistance(), rel=1e-9)
    assert second.thermal_resistance() < first.thermal_resistance()


def test_a_member_whose_mesh_cannot_follow_gets_its_own(leader, needs_mesher, monkeypatch):
    assert leader.follow(th.heated_ring()) is None  # other faces
    monkeypatch.setattr(assembly, "FLATTEST", 0.99)
    assert leader.follow(th.strip_ring(radius=5e-6)) is None
    heat = assemble_like(th.strip_ring().to_toml(), th.heated_ring(), 1e-2)
    assert heat.heated == ("core", "heater")


def test_a_strip_takes_the_committed_mesh_where_it_can(monkeypatch, needs_mesher):
    reference = th.assemble(th.strip_ring())
    moved = th.assemble(th.strip_ring(radius=6e-6, width=500e-9, box=1.4e-6))
    assert np.array_equal(moved.mesh.triangles, reference.mesh.triangles)
    assert moved.mesh_error() <= 1e-3
    # thick oxide is too coarse in the stretched mesh: divided; far away triangles turn over: a mesh of its own
    for geometry in (th.strip_ring(cladding=8e-6), th.strip_ring(radius=55e-6, outer_radius=80e-6)):
        heat = th.assemble(geometry)
        assert heat.unknowns != reference.unknowns
        assert heat.mesh_error() <= 1e-3
    monkeypatch.setattr(gmsh_mesher, "make", lambda *arguments: pytest.fail("the mesher was asked"))
    other = replace(th.strip_ring(), layers=(*th.strip_ring().layers[:2], th.Layer("cladding", "air", 2.22e-6)))
    below = th.assemble(other).mesh  # divided; the points before stay
    assert np.array_equal(below.points[: len(reference.mesh.points)], reference.mesh.points)
