"""Bodies that touch in one point only: no heat flows through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import thermofem as th
from thermofem.fem.assembly import on_mesh
from thermofem.fem.surfaces import split
from thermofem.mesh.mesh_motion import Motion
from thermofem.mesh.triangles import Mesh

SQUARES = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2]], dtype=float)
LOW_LEFT, LOW_RIGHT = [(0, 1, 4), (0, 4, 3)], [(1, 2, 5), (1, 5, 4)]
HIGH_LEFT, HIGH_RIGHT = [(3, 4, 7), (3, 7, 6)], [(4, 5, 8), (4, 8, 7)]
CHECKERS = [("low left", LOW_LEFT), ("high right", HIGH_RIGHT), ("low right", LOW_RIGHT), ("high left", HIGH_LEFT)]


def checkerboard(*squares):
    """Some squares of four around the point (1, 1)."""
    used, triangles = np.unique([t for _, square in squares for t in square], return_inverse=True)
    region = np.repeat(np.arange(len(squares)), 2)
    return Mesh(SQUARES[used], triangles.reshape(-1, 3), region, tuple(name for name, _ in squares))


def test_squares_that_touch_in_a_point_are_parted_there():
    mesh = checkerboard(*CHECKERS[:2])
    found = split(mesh, {})
    assert len(found.points) == len(mesh.points) + 1
    assert np.array_equal(found.points[found.triangles], mesh.points[mesh.triangles])
    assert not set(found.triangles[:2].ravel()) & set(found.triangles[2:].ravel())


@pytest.mark.parametrize("count", [3, 4])
def test_squares_that_share_edges_stay_together(count):
    mesh = checkerboard(*CHECKERS[:count])
    assert split(mesh, {}) is mesh


def test_squares_with_a_boundary_resistance_part_their_neighbours():
    """No edge of the two others is shared, nor do they share one with each other: four groups of triangles."""
    found = split(checkerboard(*CHECKERS), {"low left": 1e-8, "high right": 1e-8})
    assert (np.abs(found.points - 1).max(axis=1) == 0).sum() == 4


def membrane(overlap=0.0, corner=11e-6):
    """A ring between an undercut and a trench, whose corners touch or overlap."""
    strip = th.strip_ring(radius=7.25e-6, width=0.5e-6)
    undercut = th.Part("undercut", "void", 3e-6, corner + overlap, -2e-6, 2e-6)
    return replace(strip, parts=(strip.parts[0], undercut, th.Part("trench", "void", corner, 13e-6, 0.0, 2.22e-6)))


def test_voids_that_touch_in_a_corner_are_as_if_they_overlapped(needs_mesher):
    """By 1 nm, of the micrometres that heat flows there: within some 1e-3. Elements that conduct there give half."""
    touching, overlapping = (th.assemble(membrane(d)) for d in (0.0, 1e-9))
    assert touching.thermal_resistance() == pytest.approx(overlapping.thermal_resistance(), rel=3e-3)
    assert touching.mesh_error() < 1e-3
    coarse = th.assemble(membrane(), 0.05)
    assert coarse.thermal_resistance() == pytest.approx(touching.thermal_resistance(), rel=0.05 + 1e-3)


def test_both_copies_of_a_vertex_move_with_the_corner(needs_mesher):
    heat = th.assemble(membrane(), 1e-2)
    further = membrane(corner=11.2e-6)
    points = Motion(heat.mesh, heat.geometry).moved(further)
    at = np.flatnonzero((heat.mesh.points == (11e-6, 0.0)).all(axis=1))
    assert len(at) == 2
    assert np.array_equal(points[at], [(11.2e-6, 0.0)] * 2)
    there = on_mesh(further, replace(heat.mesh, points=points), 1e-2)
    # twice the accuracy: that of either mesh
    assert there.thermal_resistance() == pytest.approx(th.assemble(further, 1e-2).thermal_resistance(), rel=2e-2)
