"""Meshes that follow a geometry: the same triangles, with vertices that move along.

Outlines of the faces go exactly where the new geometry has them. All else follows by

    sum over triangles of  size^-SOFT int grad(d) . grad(v) dA = 0    for all v that vanish on the outlines,

with d the displacement along r or z and ``size`` the square root of a triangle's area. Small triangles are stiff, so
the strain goes where the mesh is coarse and the grading towards corners is kept. Along an edge that runs along r or z
the vertices slide: only the other coordinate is given there. On tilted edges both are. New positions are linear in the
positions of the corners of the faces, for each of the two coordinates:

    points(new) = points(old) + W (corners(new) - corners(old))

so that W times the velocity of the corners is the velocity of every vertex.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_matrix

from ..algebra.factor import factorize
from ..arrays import Array, NDArray
from ..checks import InputError
from ..geometry.outline_motion import CornerMotion
from .triangles import Mesh, signed_areas

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.parameter_paths import Change
    from ..geometry.regions import Face

NEAR = 1e-9  # of the largest coordinate: a vertex this near to an edge lies on it
SOFT = 1.0  # the larger, the more of the strain goes to large triangles; the smaller, the further a mesh can move


class Motion:
    """Motion of the vertices of a mesh with the corners of its geometry's faces.

    mesh: of ``geometry``; nodes doubled along contacts move together.
    corners [shape (c, 2), m]: (r, z) of every corner of a face, each once.
    Raises InputError: an edge of the geometry has no vertices in the mesh: they do not belong together.
    """

    def __init__(self, mesh: Mesh, geometry: CrossSection) -> None:
        self.mesh = mesh
        points, self._place = np.unique(mesh.points, axis=0, return_inverse=True)  # each place once
        self._place = self._place.ravel()
        self._once = replace(mesh, points=points, triangles=self._place[mesh.triangles])
        self._faces = geometry.subdivision.faces
        self._rings = _rings(self._faces)
        everywhere = np.concatenate(self._rings)
        self.corners, self._first, self._which = np.unique(everywhere, axis=0, return_index=True, return_inverse=True)
        self._which = self._which.ravel()
        self._held, self._shares, self._ends = self._outline()

    def _edges(self) -> list[tuple[int, int]]:
        """Corners at the ends of every edge of a face, each edge once."""
        edges: set[tuple[int, int]] = set()
        stop = np.cumsum([len(ring) for ring in self._rings])
        for own in np.split(self._which, stop[:-1]):
            edges |= {(int(min(a, b)), int(max(a, b))) for a, b in zip(own, np.roll(own, -1), strict=True)}
        return sorted(edges)

    def _outline(self) -> tuple[NDArray[np.bool_], Array, NDArray[np.intp]]:
        """Whether r and z of each vertex are given by its edge; its share of each corner; the corners of its edge.

        Shapes (vertices, 2), (vertices, c), (vertices, 2); zero where a vertex lies on no edge.
        """
        points, slack = self._once.points, NEAR * float(np.abs(self.corners).max())
        shares = np.zeros((len(points), len(self.corners)))
        held, ends = np.zeros((len(points), 2), dtype=bool), np.zeros((len(points), 2), dtype=np.intp)
        for a, b in self._edges():
            origin, along = self.corners[a], self.corners[b] - self.corners[a]
            length = float(np.hypot(*along))
            offset = points - origin
            place = offset @ along / length**2
            away = np.abs(offset[:, 0] * along[1] - offset[:, 1] * along[0]) / length
            there = (away < slack) & (np.abs(place - 0.5) < 0.5 + slack / length) & ~held.all(axis=1)
            shares[there] = 0.0
            shares[there, a], shares[there, b] = 1 - place[there], place[there]
            ends[there] = a, b
            held[there] |= np.abs(along[::-1]) > slack  # an edge along r gives z, and the other way round
        for c, corner in enumerate(self.corners):
            there = np.abs(points - corner).max(axis=1) < slack
            if not there.any():
                raise InputError("the mesh has no vertex at a corner of this geometry; give the one it was made for")
            shares[there] = np.eye(len(self.corners))[c]
            held[there] = True
        return held, shares, ends

    @cached_property
    def _weights(self) -> Array:
        """W, shape (2, vertices, c): derivative of r and z of each vertex by that of each corner."""
        stiffness = _stiffness(self._once)
        weights = np.zeros((2, *self._shares.shape))
        for axis, held in enumerate(self._held.T):
            free = np.flatnonzero(~held)
            weights[axis, held] = self._shares[held]
            rows = stiffness[free]
            load = -(rows[:, held] @ self._shares[held])
            solve = factorize(rows[:, free])
            weights[axis, free] = np.column_stack([solve(np.ascontiguousarray(column)) for column in load.T])
        return weights

    def corners_of(self, geometry: CrossSection) -> Array:
        """Coordinates in m of the same corners in another geometry, in the order of ``corners``.

        Raises InputError: the other geometry has other faces, or a face with another number of corners.
        """
        faces = geometry.subdivision.faces
        if [face.owner for face in faces] != [face.owner for face in self._faces]:
            raise InputError("the new geometry has other faces than the old one, so its mesh cannot follow")
        rings = _rings(faces)
        if [len(ring) for ring in rings] != [len(ring) for ring in self._rings]:
            raise InputError("a face of the new geometry has another number of corners, so its mesh cannot follow")
        new = np.concatenate([_aligned(ring, old) for ring, old in zip(rings, self._rings, strict=True)])
        corners = new[self._first]
        if not np.array_equal(corners[self._which], new):
            raise InputError("the faces of the new geometry meet in other corners, so its mesh cannot follow")
        return np.asarray(corners)

    def velocity(self, corner_velocity: Array) -> Array:
        """d(points)/dp, shape (vertices, 2), from d(corners)/dp, shape (c, 2)."""
        return self._velocity(corner_velocity)[self._place]

    def _velocity(self, corner_velocity: Array) -> Array:
        return np.stack([self._weights[k] @ corner_velocity[:, k] for k in (0, 1)], axis=1)

    def moved(self, geometry: CrossSection) -> Array:
        """Points (r, z) in m, shape (vertices, 2), of the mesh of another geometry.

        Raises InputError: as `corners_of`; triangles that turn over.
        """
        corners = self.corners_of(geometry)
        points = self._once.points + self._velocity(corners - self.corners)
        both = self._held.all(axis=1)
        points[both] = self._shares[both] @ corners
        for axis in (0, 1):  # the edge may have been tilted: its line at the other coordinate
            on = self._held[:, axis] & ~both
            (a, b), other = self._ends[on].T, 1 - axis
            share = (points[on, other] - corners[a, other]) / (corners[b, other] - corners[a, other])
            points[on, axis] = corners[a, axis] + share * (corners[b, axis] - corners[a, axis])
        if signed_areas(points, self._once.triangles).min() <= 0:
            raise InputError("triangles of the mesh turn over on the way to the new geometry; make a new mesh")
        return np.asarray(points[self._place])


def moved(mesh: Mesh, old: CrossSection, new: CrossSection) -> Array:
    """Points (r, z) in m of a mesh of ``old`` after its geometry has become ``new``, shape (vertices, 2).

    old, new: with the same faces: lengths, positions and angles may differ.
    Raises InputError: the faces differ, or triangles turn over.

    >>> from thermofem.mesh import mesh_for
    >>> points = moved(mesh_for(strip_ring(), 1e-3), strip_ring(), strip_ring(width=500e-9))
    >>> print(f"{points.shape[1]} coordinates")
    2 coordinates
    """
    return Motion(mesh, old).moved(new)


def quality(points: Array, triangles: NDArray[np.int64]) -> Array:
    """4 sqrt(3) area over the sum of the squared edges: 1 for an equilateral triangle, 0 for a degenerate one."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    squares = sum(np.sum(edge**2, axis=1) for edge in (b - a, c - b, a - c))
    return np.asarray(4 * np.sqrt(3) * signed_areas(points, triangles) / squares)


def _rings(faces: tuple[Face, ...]) -> list[Array]:
    return [ring for face in faces for ring in face.rings]


def _aligned(ring: Array, old: Array) -> Array:
    """The corners of a closed polygon, renumbered cyclically so that they move least from those of ``old``."""
    shape, before = ring - ring.mean(axis=0), old - old.mean(axis=0)
    shape, before = shape / np.ptp(shape, axis=0), before / np.ptp(before, axis=0)
    costs = [float(np.sum((np.roll(shape, -k, axis=0) - before) ** 2)) for k in range(len(ring))]
    return np.roll(ring, -int(np.argmin(costs)), axis=0)


def _stiffness(mesh: Mesh) -> Any:
    """Linear elements for div((1/size) grad d) = 0, sparse, shape (vertices, vertices)."""
    corners = mesh.points[mesh.triangles]
    edges = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)  # opposite to each corner
    area = signed_areas(mesh.points, mesh.triangles)
    local = np.einsum("eix,ejx->eij", edges, edges) / (4 * area ** (1 + SOFT / 2))[:, None, None]
    rows, columns = (np.broadcast_to(t, local.shape) for t in (mesh.triangles[:, :, None], mesh.triangles[:, None, :]))
    return csr_matrix((local.ravel(), (rows.ravel(), columns.ravel())), shape=(len(mesh.points),) * 2)


def vertex_velocities(
    geometry: CrossSection, mesh: Mesh, changes: Sequence[Change], *, roles: Collection[str] = ()
) -> Array:
    """Velocity of every vertex for every parameter, in m per unit; shape (parameters, vertices, 2).

    mesh: of this geometry, cut open along interfaces or not.
    roles: regions that are heated or read.
    Raises InputError: a face would appear or vanish.
    """
    total = np.zeros((len(changes), *mesh.points.shape))
    moving = [k for k, change in enumerate(changes) if change.moves]
    if not moving:
        return total
    outlines, motion = CornerMotion(geometry, roles), Motion(mesh, geometry)
    number = {(r, z): k for k, (r, z) in enumerate(outlines.edges.corners.tolist())}
    order = [number[r, z] for r, z in motion.corners.tolist()]
    for k in moving:
        total[k] = motion.velocity(outlines.corner_velocities(changes[k])[order])
    return total
