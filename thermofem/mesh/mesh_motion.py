"""Meshes that follow a geometry: the same triangles, with vertices that move along.

Outlines of the faces go exactly where the new geometry has them. All else follows by

    sum over triangles of  size^-SOFT int grad(d) . grad(v) dA = 0    for all v that vanish on the outlines,

with d the displacement along r or z and ``size`` the square root of a triangle's area. Small triangles are stiff, so
the strain goes where the mesh is coarse and the grading towards corners is kept. Along an edge that runs along r or z
the vertices slide: only the other coordinate is given there. On tilted edges both are. New positions are linear in the
positions of the corners of the faces, for each of the two coordinates:

    points(new) = points(old) + W (corners(new) - corners(old))

so that W times the velocity of the corners is the velocity of every vertex.

Every edge between two faces is drawn by one or several outlines. Its velocity along the normal is that of the outline
that draws it after a small motion in either direction; the velocity of a corner follows from the edges that meet there.
An edge between two faces of the same material and role carries no heat flow of its own: it follows where it can.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from ..algebra.factor import factorize
from ..arrays import Array, Indices, Mask, NDArray, scattered
from ..checks import InputError
from ..geometry.regions import CUT_GRID, closed, distance, nearest, outlines
from ..materials.material_library import VOID
from .triangles import Mesh, sides, signed_areas

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.parameter_paths import Change
    from ..geometry.regions import Face

AGREE = 1e-6  # of the largest velocity: two velocities of one edge that differ by less are the same
SOFT = 1.0  # the larger, the more of the strain goes to large triangles; the smaller, the further a mesh can move

Key = tuple[str, str] | None  # material and role of an owner; None for what is not meshed


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
        self._cut = geometry.subdivision
        self.corners = self._cut.corners
        self._held, self._shares, self._ends = self._outline()

    def _outline(self) -> tuple[Mask, Array, Indices]:
        """For every vertex: which of r and z its edge prescribes, weights of the corners, and the corners of its edge.

        Shapes (vertices, 2), (vertices, c) and (vertices, 2); zero where a vertex lies on no edge.
        """
        points = self._once.points
        count = len(self.corners)
        edges = self.corners[self._cut.ends]
        away, edge, share = nearest(points, edges)
        # a vertex this near to an edge lies on it
        slack = 1e-9 * float(np.abs(self.corners).max())
        on = away < slack
        ends = self._cut.ends[edge]
        weights = np.column_stack([1 - share, share]) * on[:, None]
        shares = (weights[..., None] * np.eye(count)[ends]).sum(axis=1)
        along = edges[edge, 1] - edges[edge, 0]
        held = (np.abs(along[:, ::-1]) > slack) & on[:, None]  # an edge along r gives z, and the other way round
        at_corner = np.abs(points[:, None] - self.corners).max(axis=2) < slack
        if not at_corner.any(axis=0).all():
            raise InputError("the mesh has no vertex at a corner of this geometry; give the one it was made for")
        is_corner = at_corner.any(axis=1)
        shares[is_corner] = at_corner[is_corner]
        held[is_corner] = True
        return held, shares, ends

    @cached_property
    def _weights(self) -> Array:
        """W, shape (2, vertices, c): derivative of r and of z of each vertex with respect to that of each corner."""
        stiffness = _stiffness(self._once)
        weights = np.zeros((2, *self._shares.shape))
        for axis, held in enumerate(self._held.T):
            free = np.flatnonzero(~held)
            weights[axis, held] = self._shares[held]
            rows = stiffness[free]
            load = -(rows[:, held] @ self._shares[held])
            solve = factorize(rows[:, free])
            columns = [solve(np.ascontiguousarray(column)) for column in load.T]
            weights[axis, free] = np.column_stack(columns)
        return weights

    def corners_of(self, geometry: CrossSection) -> Array:
        """Coordinates in m of the same corners in another geometry, in the order of ``corners``.

        Raises InputError: the other geometry has other faces, or a face with another number of corners.
        """
        new = _rings(geometry.subdivision.faces)
        before = _rings(self._cut.faces)
        if [(owner, len(ring)) for owner, ring in new] != [(owner, len(ring)) for owner, ring in before]:
            raise InputError("the new geometry has other faces than the old one, so its mesh cannot follow")
        pairs = set()
        for (_, ring), (_, old) in zip(new, before, strict=True):
            for corner, place in zip(old.tolist(), _aligned(ring, old).tolist(), strict=True):
                pairs.add((tuple(corner), tuple(place)))
        moved = dict(pairs)
        if len(moved) < len(pairs):
            raise InputError("the faces of the new geometry meet in other corners, so its mesh cannot follow")
        return np.array([moved[tuple(corner)] for corner in self.corners.tolist()])

    def velocity(self, corner_velocity: Array) -> Array:
        """Velocity d(points)/dp of the vertices, shape (vertices, 2), from d(corners)/dp, shape (c, 2)."""
        return self._velocity(corner_velocity)[self._place]

    def _velocity(self, corner_velocity: Array) -> Array:
        return np.stack([self._weights[k] @ corner_velocity[:, k] for k in (0, 1)], axis=1)

    def moved(self, geometry: CrossSection) -> Array:
        """Vertices (r, z) in m, shape (vertices, 2), of the same mesh moved to another geometry.

        geometry: with the same faces as the one that the mesh was made for.
        Raises InputError: its faces are others (`corners_of`), or a triangle would turn over.
        """
        corners = self.corners_of(geometry)
        points = self._once.points + self._velocity(corners - self.corners)
        both = self._held.all(axis=1)
        points[both] = self._shares[both] @ corners
        for axis in (0, 1):  # the edge may have been tilted: its line at the other coordinate
            on = self._held[:, axis] & ~both
            first, last = corners[self._ends[on].T]
            along = last - first
            other = 1 - axis
            share = (points[on, other] - first[:, other]) / along[:, other]
            points[on, axis] = first[:, axis] + share * along[:, axis]
        if signed_areas(points, self._once.triangles).min() <= 0:
            raise InputError("triangles of the mesh turn over on the way to the new geometry; make a new mesh")
        return points[self._place]


def quality(points: Array, triangles: NDArray[np.int64]) -> Array:
    """4 sqrt(3) area over the sum of the squared edges: 1 for an equilateral triangle, 0 for a degenerate one."""
    squares = (sides(points[triangles]) ** 2).sum(axis=(1, 2))
    return 4 * np.sqrt(3) * signed_areas(points, triangles) / squares


def _rings(faces: tuple[Face, ...]) -> list[tuple[str, Array]]:
    """Outlines of faces, each with the owner of its face."""
    return [(face.owner, ring) for face in faces for ring in face.rings]


def _aligned(ring: Array, old: Array) -> Array:
    """Corners of a closed polygon, renumbered cyclically so that their distances from those of ``old`` are least."""
    shape = ring - ring.mean(axis=0)
    before = old - old.mean(axis=0)
    shape = shape / np.ptp(shape, axis=0)
    before = before / np.ptp(before, axis=0)
    costs = []
    for k in range(len(ring)):
        distance_squares = (np.roll(shape, -k, axis=0) - before) ** 2
        costs.append(float(distance_squares.sum()))
    return np.roll(ring, -int(np.argmin(costs)), axis=0)


def _stiffness(mesh: Mesh) -> Any:
    """Stiffness matrix of linear elements for div(size^-`SOFT` grad d) = 0, sparse, shape (vertices, vertices)."""
    corners = mesh.points[mesh.triangles]
    edges = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)  # opposite to each corner
    area = signed_areas(mesh.points, mesh.triangles)
    softness = 4 * area ** (1 + SOFT / 2)
    local = np.einsum("eix,ejx->eij", edges, edges) / softness[:, None, None]
    return scattered(local, mesh.triangles, mesh.triangles, len(mesh.points))


@dataclass(frozen=True)
class Line:
    """One outline that draws an edge: its velocity along the edge's normal at both ends, and the side it encloses.

    side: 1 where the inside of the outline lies to the left of the edge, else -1.
    """

    name: str
    start: float
    stop: float
    side: int

    @property
    def middle(self) -> float:
        """Velocity in the middle of the edge."""
        return (self.start + self.stop) / 2

    def apart(self, other: Line) -> float:
        """Difference of the velocities of two lines, at both ends."""
        return abs(self.start - other.start) + abs(self.stop - other.stop)


class CornerMotion:
    """Velocities of the corners of a geometry's faces when a parameter changes.

    roles: layers and parts that are heated or read by name: their outlines matter, whatever the material beside them.
    """

    def __init__(self, geometry: CrossSection, roles: Collection[str]) -> None:
        self.geometry = geometry
        self.roles = {*roles, *(interface.part for interface in geometry.interfaces)}
        self.roles |= {probe.part for probe in geometry.probes}
        self.edges = geometry.subdivision
        self.outlines = outlines(geometry)
        self.polygons = {name: shapely.Polygon(outline / CUT_GRID) for name, outline in self.outlines.items()}
        self.slack = max(100 * CUT_GRID, 1e-9 * float(np.abs(self.edges.corners).max()))

    def key(self, owner: str | None) -> Key:
        """Material of a layer or part, and its name if it has a role (heated, interface, probe); None for a void."""
        material = None if owner is None else self.geometry.material_of(owner).name
        return None if material in (None, VOID) else (material, owner if owner in self.roles else "")

    def corner_velocities(self, change: Change) -> Array:
        """Velocity of every corner of a face, in m per unit of the parameter; shape (corners, 2).

        Raises InputError: a face would appear or vanish, so that the derivative is not the same on both sides.
        """
        count = len(self.edges.corners)
        hard: list[list[tuple[Array, float]]] = [[] for _ in range(count)]
        soft: list[list[tuple[Array, float]]] = [[] for _ in range(count)]
        for k, (a, b) in enumerate(self.edges.ends):
            along = self.edges.corners[b] - self.edges.corners[a]
            normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)  # to the left
            line = self._line(k, normal, change)
            left, right = map(self.key, self.edges.owners[k])
            wanted = soft if left == right else hard
            wanted[a].append((normal, line.start))
            wanted[b].append((normal, line.stop))
        return np.array([self._corner(k, hard[k], soft[k], change) for k in range(count)])

    def _corner(
        self, k: int, hard: list[tuple[Array, float]], soft: list[tuple[Array, float]], change: Change
    ) -> Array:
        """Velocity of corner ``k`` from the wanted normal components of its edges, (normal, speed).

        All ``hard`` ones must hold; ``soft`` ones, of edges within one material, as far as possible.
        """
        velocity = np.zeros(2)
        free = np.eye(2)
        scale = max((abs(speed) for _, speed in hard + soft), default=0.0)
        for rows, must in ((hard, True), (soft, False)):
            if not rows or not (free.size or must):
                continue
            normals = np.array([normal for normal, _ in rows])
            wanted = np.array([speed for _, speed in rows])
            inside = normals @ free
            u, s, vt = np.linalg.svd(inside)
            # 1e-6: with smaller singular values, of unit normals, edges count as parallel
            rank = int((s > 1e-6).sum())
            missing = wanted - normals @ velocity
            along = (u[:, :rank].T @ missing) / s[:rank]
            step = vt[:rank].T @ along
            velocity = velocity + free @ step
            if must and np.abs(normals @ velocity - wanted).max() > AGREE * scale:
                r, z = self.edges.corners[k]
                raise InputError(
                    f"{change.name}: a face would appear or vanish at r = {r:g} m, z = {z:g} m, because another "
                    "outline that meets there does not move along; give the paths of both as one parameter"
                )
            free = free @ vt[rank:].T
        return velocity

    def _line(self, k: int, normal: Array, change: Change) -> Line:
        """Outline that draws edge ``k`` after a small change of the parameter in either direction."""
        a, b = self.edges.corners[self.edges.ends[k]]
        lines = []
        for name, side in self._drawing[k]:
            outline = self.outlines[name]
            velocity = change.corners(name)
            after = (side + 1) % 4
            start = outline[side]
            inward = outline[after] - start
            turn = velocity[after] - velocity[side]
            ends = []
            for point in (a, b):
                share = float((point - start) @ inward / (inward @ inward))
                ends.append(float((velocity[side] + share * turn) @ normal))
            encloses = 1 if inward @ (b - a) > 0 else -1  # outlines run counterclockwise: inside lies to the left
            lines.append(Line(name, ends[0], ends[1], encloses))
        first = lines[0]
        scale = max(max(abs(line.start), abs(line.stop)) for line in lines)
        if all(line.apart(first) <= AGREE * scale for line in lines):
            return first
        for line in lines:
            if all(self._stays(k, line, lines, direction) for direction in (1, -1)):
                return line
        r, z = (a + b) / 2
        names = " and ".join(repr(line.name) for line in lines)
        raise InputError(
            f"{change.name}: the outlines of {names} lie on each other at r = {r:g} m, z = {z:g} m, and do not move "
            "together: a face would appear on one side, so the derivative is not defined; give the paths of both as "
            "one parameter, or move them apart"
        )

    @cached_property
    def _drawing(self) -> list[list[tuple[str, int]]]:
        """For every edge the outlines that draw it, each with the index of its side (0 to 3)."""
        drawn = []
        for ends in self.edges.corners[self.edges.ends]:
            on_edge = []
            for name, outline in self.outlines.items():
                along = [k for k, side in enumerate(closed(outline)) if distance(ends, side[None]).max() < self.slack]
                on_edge += [(name, k) for k in along[:1]]
            drawn.append(on_edge)
        return drawn

    def _stays(self, k: int, chosen: Line, lines: list[Line], direction: int) -> bool:
        """Whether both sides of edge ``k`` keep material and role when it moves with the outline ``chosen``."""
        moved = {line.name: (line.side, direction * line.middle) for line in lines}
        ends = sorted({0.0, *(offset for _, offset in moved.values())})
        middle = shapely.Point(self.edges.corners[self.edges.ends[k]].mean(axis=0) / CUT_GRID)

        def covers(name: str, y: float) -> bool:
            if name not in moved:
                return bool(self.polygons[name].contains(middle))
            side, offset = moved[name]
            return side * (y - offset) > 0

        left, right = self.edges.owners[k]
        middles = [sum(pair) / 2 for pair in pairwise(ends)]
        for y in (ends[0] - 1, *middles, ends[-1] + 1):
            owner = next((name for name in reversed(self.outlines) if covers(name, y)), None)
            before = left if y > direction * chosen.middle else right
            if self.key(owner) != self.key(before):
                return False
        return True


def vertex_velocities(
    geometry: CrossSection, mesh: Mesh, changes: Sequence[Change], *, roles: Collection[str]
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
    outlines = CornerMotion(geometry, roles)
    motion = Motion(mesh, geometry)
    for k in moving:
        total[k] = motion.velocity(outlines.corner_velocities(changes[k]))
    return total
