"""Motion of the corners of the subdivision when outlines move.

Every edge between two faces is drawn by one or several outlines. Its velocity along the normal is that of the outline
that draws it after a small motion in either direction; the velocity of a corner follows from the edges that meet there.
An edge between two faces of the same material and role carries no heat flow of its own: it follows where it can.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from ..arrays import Array, NDArray
from ..checks import InputError
from ..materials.material_library import VOID
from .regions import GRID, distance, outlines

if TYPE_CHECKING:
    from .cross_section import CrossSection
    from .parameter_paths import Change

Point = tuple[float, float]
Key = tuple[str, str] | None  # material and role of an owner; None for what is not meshed

AGREE = 1e-6  # of the largest velocity: two velocities of one edge that differ by less are the same


@dataclass(frozen=True, eq=False)
class Edges:
    """All edges of a subdivision, each once.

    corners [shape (c, 2), m]
    ends [shape (e, 2)]: corners of each edge.
    left: name of the owner on the left of each edge, None where nothing is meshed; and ``right``.
    """

    corners: Array
    ends: NDArray[np.intp]
    left: list[str | None]
    right: list[str | None]

    @classmethod
    def of(cls, geometry: CrossSection) -> Edges:
        """The corners and edges of all faces of a geometry, each once, with the face on either side."""
        number: dict[Point, int] = {}
        sides: dict[tuple[int, int], list[str | None]] = {}
        for face in geometry.subdivision.faces:
            for edge in face.edges().tolist():
                a, b = (number.setdefault((r, z), len(number)) for r, z in edge)
                key, side = ((a, b), 0) if a < b else ((b, a), 1)
                sides.setdefault(key, [None, None])[side] = face.owner
        return cls(
            corners=np.array(list(number)),
            ends=np.array(list(sides), dtype=np.intp),
            left=[pair[0] for pair in sides.values()],
            right=[pair[1] for pair in sides.values()],
        )


@dataclass(frozen=True)
class Line:
    """One outline that draws an edge: velocity along the edge's normal at both ends, and the side it encloses."""

    name: str
    start: float
    stop: float
    side: int

    @property
    def middle(self) -> float:
        """Velocity in the middle."""
        return (self.start + self.stop) / 2


class CornerMotion:
    """The motion of a geometry's corners.

    roles: layers and parts that are heated or read by name: their outlines matter, whatever the material beside them.
    """

    def __init__(self, geometry: CrossSection, roles: Collection[str]) -> None:
        self.geometry, self.roles = geometry, set(roles)
        self.roles |= {interface.part for interface in geometry.interfaces} | {p.part for p in geometry.probes}
        self.edges = Edges.of(geometry)
        self.outlines = outlines(geometry)
        self.slack = max(100 * GRID, 1e-9 * float(np.abs(self.edges.corners).max()))
        self._drawn: list[list[tuple[str, int]]] | None = None

    def key(self, owner: str | None) -> Key:
        """Material of an owner, and its name if it has a role (heated, interface, probe); None for a void."""
        if owner is None:
            return None
        material = next((p.material for p in self.geometry.parts if p.name == owner), "")
        if material == VOID:
            return None
        return self.geometry.material_of(owner).name, owner if owner in self.roles else ""

    def corner_velocities(self, change: Change) -> Array:
        """Velocity of every corner of `Edges`, in m per unit of the parameter; shape (corners, 2).

        Raises InputError: a face would appear or vanish, so that the derivative is not the same on both sides.
        """
        count = len(self.edges.corners)
        hard: list[list[tuple[Array, float]]] = [[] for _ in range(count)]
        soft: list[list[tuple[Array, float]]] = [[] for _ in range(count)]
        for k, (a, b) in enumerate(self.edges.ends):
            along = self.edges.corners[b] - self.edges.corners[a]
            normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)  # to the left
            line = self._line(k, normal, change)
            real = self.key(self.edges.left[k]) != self.key(self.edges.right[k])
            for corner, speed in ((a, line.start), (b, line.stop)):
                (hard if real else soft)[corner].append((normal, speed))
        return np.array([self._corner(k, hard[k], soft[k], change) for k in range(count)])

    def _corner(
        self, k: int, hard: list[tuple[Array, float]], soft: list[tuple[Array, float]], change: Change
    ) -> Array:
        """The velocity with the wanted normal components; edges of one material give way."""
        velocity, free = np.zeros(2), np.eye(2)
        scale = max((abs(speed) for _, speed in hard + soft), default=0.0)
        for rows, must in ((hard, True), (soft, False)):
            if not rows or not (free.size or must):
                continue
            normals = np.array([normal for normal, _ in rows])
            wanted = np.array([speed for _, speed in rows])
            inside = normals @ free
            u, s, vt = np.linalg.svd(inside)
            rank = int((s > 1e-6).sum())  # 1e-6: singular value, of unit normals, below which edges count as parallel
            missing = wanted - normals @ velocity
            step = vt[:rank].T @ ((u[:, :rank].T @ missing) / s[:rank])
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
        """The outline that draws edge ``k`` after a small motion in either direction."""
        a, b = self.edges.corners[self.edges.ends[k]]
        lines = []
        for name, side in self._drawing[k]:
            outline, velocity = self.outlines[name], change.outlines.get(name, np.zeros((4, 2)))
            ends = [_interpolated(outline, velocity, side, point) @ normal for point in (a, b)]
            inward = outline[(side + 1) % 4] - outline[side]
            encloses = 1 if inward @ (b - a) > 0 else -1  # outlines run counterclockwise: inside lies to the left
            lines.append(Line(name, float(ends[0]), float(ends[1]), encloses))
        scale = max(abs(end) for line in lines for end in (line.start, line.stop))
        first = lines[0]
        if all(abs(x.start - first.start) + abs(x.stop - first.stop) <= AGREE * scale for x in lines):
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

    @property
    def _drawing(self) -> list[list[tuple[str, int]]]:
        """For every edge the outlines that draw it, each with the number of its side."""
        if self._drawn is None:
            self._drawn = []
            for a, b in self.edges.corners[self.edges.ends]:
                found = []
                for name, outline in self.outlines.items():
                    sides = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
                    near = [
                        k for k, side in enumerate(sides) if distance(np.stack([a, b]), side[None]).max() < self.slack
                    ]
                    found += [(name, k) for k in near[:1]]
                self._drawn.append(found)
        return self._drawn

    def _stays(self, k: int, chosen: Line, lines: list[Line], direction: int) -> bool:
        """Whether both sides of edge ``k`` keep their material and role when the edge moves as ``chosen``."""
        offsets = sorted({0.0, *(direction * line.middle for line in lines)})
        places = [(x + y) / 2 for x, y in pairwise([offsets[0] - 1, *offsets, offsets[-1] + 1]) if y > x]
        sides = self.key(self.edges.left[k]), self.key(self.edges.right[k])
        middle = self.edges.corners[self.edges.ends[k]].mean(axis=0)
        drawn = {line.name: line for line in lines}
        for y in places:
            owner = None
            for name in reversed(self.outlines):
                if name in drawn:
                    line = drawn[name]
                    inside = line.side * (y - direction * line.middle) > 0
                else:
                    inside = self._contains(name, middle)
                if inside:
                    owner = name
                    break
            if self.key(owner) != sides[0 if y > direction * chosen.middle else 1]:
                return False
        return True

    def _contains(self, name: str, point: Array) -> bool:
        """Whether the outline of a layer or part goes round a point."""
        polygon: Any = shapely.Polygon(self.outlines[name] / GRID)
        return bool(polygon.contains(shapely.Point(point / GRID)))


def _interpolated(outline: Array, velocity: Array, side: int, point: Array) -> Array:
    """Velocity of a point on one side of an outline."""
    start, stop = outline[side], outline[(side + 1) % 4]
    along = stop - start
    share = float((point - start) @ along / (along @ along))
    return velocity[side] + share * (velocity[(side + 1) % 4] - velocity[side])
