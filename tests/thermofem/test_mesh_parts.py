"""Meshes of others: parts that do not quite meet, triangles the other way round."""

from __future__ import annotations

import numpy as np
import pytest

import thermofem as th


def rectangle(bottom, top, columns):
    """Points in um and triangles of a rectangle 2 um wide."""
    r, z = np.linspace(0, 2, columns + 1), np.array([bottom, (bottom + top) / 2, top])
    points = np.array([(a, b) for b in z for a in r])
    low = np.array([j * (columns + 1) + i for j in range(2) for i in range(columns)])
    right, high = low + 1, low + columns + 1
    return points, np.concatenate([np.column_stack([low, right, high]), np.column_stack([right, high + 1, high])])


def halves(path, gap, columns):
    """The file of a rectangle over another one, with a gap in um between them."""
    (low, first), (high, second) = rectangle(0, 0.3, 10), rectangle(0.3 + gap, 0.8, columns)
    region = np.repeat([0, 1], [len(first), len(second)])
    triangles = np.concatenate([first, second + len(low)])
    th.mesh.Mesh(1e-6 * np.concatenate([low, high]), triangles, region, ("low", "high")).save(path)
    return path


@pytest.mark.parametrize("columns", [10, 7])
def test_parts_that_meet_within_round_off_are_refused(columns, tmp_path):
    """One ulp between them, 0.3 and 0.1 + 0.2 um, loaded as two bodies: R_th = 79.6e6 for 26.5e3 K/W."""
    for gap in (0.1 + 0.2 - 0.3, 1e-9, 0.0, -1e-9):
        with pytest.raises(th.InputError, match=r"(not joined|without sharing their points); gmsh's Coherence"):
            th.mesh.load(halves(tmp_path / "m.msh", gap, columns))
    for gap in (1e-5, 1e-3):  # in um: 5e-6 of the mesh is a gap
        assert th.mesh.load(halves(tmp_path / "m.msh", gap, columns)).region_names == ("low", "high")


@pytest.mark.parametrize("angle", [1e-2, 1e-6])
def test_parts_that_meet_in_one_point_at_a_small_angle_are_no_gap(angle, tmp_path):
    points = np.array([[0, 0], [1, angle / 2], [0, 1], [1, -angle / 2], [0, -1]])
    th.mesh.Mesh(1e-6 * points, [[0, 1, 2], [0, 4, 3]], [0, 1], ("high", "low")).save(tmp_path / "m.msh")
    assert len(th.mesh.load(tmp_path / "m.msh").points) == 5


def test_clockwise_triangles_are_turned_round():
    """They were kept, and the volume of the cone was -pi/3."""
    given = np.array([[0, 2, 1]])
    mesh = th.mesh.Mesh([[0, 0], [1, 0], [0, 1]], given, [0], ("a",))
    assert mesh.volumes()["a"] == pytest.approx(np.pi / 3, rel=1e-15)  # a cone of radius and height 1 m
    assert given.tolist() == [[0, 2, 1]]
