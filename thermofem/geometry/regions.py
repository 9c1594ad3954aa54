"""Cutting the (r, z) plane into faces with one owner each, however layers and parts overlap.

All cuts are made on a grid of one femtometre, so that coordinates which differ by round-off only are one; afterwards
every coordinate that the geometry knows gets its own value back, to the last bit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry.polygon import orient

from .. import checks
from ..arrays import Array, NDArray
from ..materials.material_library import VOID
from .section_parts import THINNEST

if TYPE_CHECKING:
    from .cross_section import CrossSection

GRID = 1e-15  # m
SIDES = ("bottom", "top", "outer", "axis", "wall")


@dataclass(frozen=True, eq=False)
class Face:
    """A polygon in (r, z) that belongs to one layer or part.

    ``rings``: the outer ring counterclockwise, then holes clockwise, each of shape (n, 2) in m.
    """

    owner: str
    rings: tuple[Array, ...]

    @property
    def area(self) -> float:
        """Integral of dA in m^2."""
        return self._moments()[1]

    def volume(self, depth: float | None = None) -> float:
        """Integral of 2 pi r dA in m^3, exact for a polygon (Pappus): 2 pi r_centroid A; or A times a depth in m."""
        origin, area, moment = self._moments()
        return 2 * np.pi * (origin * area + moment) if depth is None else area * depth

    def _moments(self) -> tuple[float, float, float]:
        """A radius near the face, the area, and the integral of (r - that radius) dA: nothing cancels."""
        origin = self.rings[0].mean(axis=0)
        area = moment = 0.0
        for ring in self.rings:
            (r, z), (s, t) = (ring - origin).T, np.roll(ring - origin, -1, axis=0).T
            cross = r * t - s * z
            area += float(cross.sum()) / 2
            moment += float(((r + s) * cross).sum()) / 6
        return float(origin[0]), area, moment

    def edges(self) -> Array:
        """All its edges in m, shape (n, 2 ends, 2)."""
        return np.concatenate([_closed(ring) for ring in self.rings])


@dataclass(frozen=True, eq=False)
class Subdivision:
    """Faces, and the edges of every side of the domain in m, shape (n, 2 ends, 2).

    Sides: "axis" (r = 0, or the mirror plane x = 0), "bottom", "outer", "top" (what faces up or stands above the
    stack), "wall" (of a void).
    """

    faces: tuple[Face, ...]
    sides: dict[str, Array]

    def volumes(self, depth: float | None = None) -> dict[str, float]:
        """Volume of every owner in m^3, in the order of the faces."""
        total: dict[str, float] = {}
        for face in self.faces:
            total[face.owner] = total.get(face.owner, 0.0) + face.volume(depth)
        return total

    def on_side(self, side: str, r: Array, z: Array) -> NDArray[np.bool_]:
        """Which points (r, z) in m lie on ``side``, round-off allowed for."""
        edges = self.sides[checks.choice("side", side, SIDES)]
        points = np.stack(np.broadcast_arrays(r, z), axis=-1)
        slack = max(100 * GRID, 1e-9 * float(max(np.abs(face.rings[0]).max() for face in self.faces)))
        return distance(points, edges) < slack


def _closed(ring: Array) -> Array:
    """Edges of a closed line through the corners, shape (n, 2 ends, 2)."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def distance(points: Array, edges: Array) -> Array:
    """Distance in m from points, shape (..., 2), to the nearest of the edges, shape (n, 2, 2); inf without edges."""
    return nearest(points, edges)[0]


def nearest(points: Array, edges: Array) -> tuple[Array, NDArray[np.intp], Array]:
    """`distance` from points to the edges, index of the nearest edge, and share of its length up to the foot."""
    away = np.full(points.shape[:-1], np.inf)
    index, place = np.zeros(away.shape, dtype=np.intp), np.zeros(away.shape)
    for k, (start, stop) in enumerate(edges):
        along = stop - start
        share = np.clip((points - start) @ along / (along @ along), 0, 1)
        far = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        index, place = np.where(far < away, k, index), np.where(far < away, share, place)
        away = np.minimum(far, away)
    return away, index, place


def subdivide(geometry: CrossSection) -> Subdivision:
    """Cut the plane into faces: a later part covers earlier parts and layers, and a void leaves a hole.

    Raises InputError: a part that is wholly hidden, or a face thinner than an atom.
    """
    found = outlines(geometry)
    shapes = {name: shapely.Polygon(np.rint(outline / GRID)) for name, outline in found.items()}
    polygons, voids = list(shapely.polygonize(_visible_edges(geometry, shapes)).geoms), _voids(geometry)
    faces = [
        (owner, orient(shapely.normalize(polygon)))
        for polygon, owner in zip(polygons, _owners(shapes, polygons), strict=True)
        if owner is not None and owner not in voids
    ]
    order = list(found)
    faces.sort(key=lambda face: (order.index(face[0]), face[1].bounds))
    exact = {round(x / GRID): float(x) for outline in found.values() for x in outline.ravel()}
    cut = tuple(_face(owner, polygon, exact) for owner, polygon in faces)
    for face in cut:
        _check_thickness(face, found)
    return Subdivision(cut, _sides(geometry, faces, exact))


def outlines(geometry: CrossSection) -> dict[str, Array]:
    """Corners of every layer and part in m; of a mirrored section those with x >= 0."""
    z, left, right = geometry.layer_edges, geometry.inner_end, geometry.outer_radius
    boxes = {
        layer.name: np.array([(left, z[k]), (right, z[k]), (right, z[k + 1]), (left, z[k + 1])])
        for k, layer in enumerate(geometry.layers)
    }
    found = {part.name: part.outline() for part in geometry.parts if part.height}
    if geometry.mirrored:
        found = {name: outline for name, outline in found.items() if outline[1:3, 0].min() > 0}
        found = {name: np.maximum(outline, [0.0, -np.inf]) for name, outline in found.items()}
    return boxes | found


def _visible_edges(geometry: CrossSection, shapes: dict[str, Any]) -> list[Any]:
    """Edges of all outlines, cut where they meet, without those that have the same owner on both sides."""
    lines = shapely.unary_union([shape.exterior for shape in shapes.values()], grid_size=1)
    owners: dict[tuple[Any, ...], list[str | None]] = {}
    cells = list(shapely.polygonize([lines]).geoms)
    shown, voids = _owners(shapes, cells), _voids(geometry)
    for cell, owner in zip(cells, shown, strict=True):
        for edge in _edges(cell):
            owners.setdefault(edge, []).append(None if owner in voids else owner)
    for part in geometry.parts:
        if part.name in shapes and part.name not in shown:
            later = [other.name for other in geometry.parts if shapes[other.name].intersects(shapes[part.name])]
            covers = ", ".join(repr(name) for name in later if name != part.name)
            raise checks.InputError(f"part {part.name!r} is wholly covered by {covers}; change their order")
    return [
        shapely.LineString(edge) for edge, sides in owners.items() if len({*sides, *[None] * (2 - len(sides))}) == 2
    ]


def _owners(shapes: dict[str, Any], polygons: list[Any]) -> list[str | None]:
    """For each polygon the last part, or else the layer, that contains it; None outside all of them."""
    inside = [polygon.representative_point() for polygon in polygons]
    which, of = shapely.STRtree(list(shapes.values())).query(inside, predicate="within")
    last = np.zeros(len(polygons), dtype=int)
    np.maximum.at(last, which, of + 1)
    names = [None, *shapes]
    return [names[k] for k in last]


def _voids(geometry: CrossSection) -> set[str]:
    """Names of the parts that are holes."""
    return {part.name for part in geometry.parts if part.material == VOID}


def _edges(polygon: Any) -> list[tuple[Any, ...]]:
    """Edges as pairs of points, the same for both polygons that share one."""
    return [tuple(sorted(pair)) for ring in (polygon.exterior, *polygon.interiors) for pair in pairwise(ring.coords)]


def _face(owner: str, polygon: Any, exact: dict[int, float]) -> Face:
    def restored(ring: Any) -> Array:
        points = np.asarray(ring.coords)[:-1]
        return np.array([[exact.get(round(x), x * GRID) for x in point] for point in points])

    return Face(owner, (restored(polygon.exterior), *(restored(hole) for hole in polygon.interiors)))


def _check_thickness(face: Face, known: dict[str, Array]) -> None:
    """Raise InputError where a corner of the face comes too near to an edge that does not end there."""
    edges = face.edges()
    corners, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    offset = corners[:, None] - corners
    share = np.clip(np.einsum("cex,ex->ce", offset, along) / np.einsum("ex,ex->e", along, along), 0, 1)
    gap = np.linalg.norm(offset - share[..., None] * along, axis=-1)
    gap[(corners[:, None, None] == edges).all(axis=-1).any(axis=-1)] = np.inf  # its own edges
    if gap.min() < THINNEST:
        r, z = place = corners[gap.min(axis=1).argmin()]
        near = [name for name in known if distance(place, _closed(known[name])) < THINNEST]
        raise checks.InputError(
            f"{face.owner!r} has a sliver of {gap.min():.2g} m near r = {r:g} m, z = {z:g} m, thinner than an "
            f"atom; make the outlines of {' and '.join(map(repr, near))} agree there"
        )


def _sides(geometry: CrossSection, faces: list[tuple[str, Any]], exact: dict[int, float]) -> dict[str, Array]:
    """Sort the edges that belong to one face only by the side they lie on."""
    uses: Counter[tuple[Any, ...]] = Counter()
    for _, polygon in faces:
        uses.update(_edges(polygon))
    skin = _skin(geometry, [polygon for _, polygon in faces])
    bottom, left, right = (round(x / GRID) for x in (geometry.bottom_z, geometry.inner_end, geometry.outer_radius))
    sides: dict[str, list[Any]] = {side: [] for side in SIDES}
    for edge in sorted(edge for edge, count in uses.items() if count == 1):
        (r0, z0), (r1, z1) = edge
        if r0 == r1 == left == 0:
            side = "axis"
        elif r0 == r1 and r0 in (left, right):
            side = "outer"
        elif z0 == z1 == bottom:
            side = "bottom"
        else:
            side = "top" if skin.distance(shapely.Point((r0 + r1) / 2, (z0 + z1) / 2)) <= 1 else "wall"
        sides[side].append([[exact.get(round(x), x * GRID) for x in point] for point in edge])
    return {side: np.array(edges).reshape(-1, 2, 2) for side, edges in sides.items()}


def _skin(geometry: CrossSection, polygons: list[Any]) -> Any:
    """The outline of everything, voids and enclosed gaps filled."""
    box = geometry.inner_end, geometry.bottom_z, geometry.outer_radius, geometry.top_z
    filled = shapely.unary_union([shapely.box(*(round(x / GRID) for x in box)), *polygons], grid_size=1)
    return shapely.union_all([shape.exterior for shape in getattr(filled, "geoms", [filled])])


def check_places(geometry: CrossSection) -> None:
    """Raise InputError for a part outside the stack, or one that crosses its top."""
    low, high, slack = geometry.bottom_z, geometry.top_z, GRID
    for part in geometry.parts:
        where = f"part {part.name!r} (z = {part.bottom:g} .. {part.top:g} m)"
        reach = float(np.abs(part.outline()[:, 0]).max())
        if reach > geometry.outer_radius + slack:
            along, end = ("r", "outer_radius") if geometry.kind == "ring" else ("|x|", "half_width")
            raise checks.InputError(
                f"part {part.name!r} reaches {along} = {reach:g} m, outside {end} = {geometry.outer_radius:g} m"
            )
        if part.bottom < low - slack:
            raise checks.InputError(f"{where} lies outside the stack, which begins at z = {low:g} m")
        if part.material != VOID and part.bottom < high - slack and part.top > high + slack:
            raise checks.InputError(
                f"{where} sticks out of the stack, which ends at z = {high:g} m; lower it, raise the top layer, or "
                "make it two parts, one below and one above that height"
            )


def check_held(geometry: CrossSection) -> None:
    """Raise InputError unless every connected piece touches a side that holds the temperature."""
    faces = geometry.subdivision.faces
    seen: dict[Any, int] = {}
    pairs = [
        (k, seen.setdefault(frozenset(map(tuple, edge)), k)) for k, f in enumerate(faces) for edge in f.edges().tolist()
    ]
    piece = connected_components(coo_matrix((np.ones(len(pairs)), np.transpose(pairs)), shape=(len(faces),) * 2))[1]
    held = set()
    for side, boundary in (("bottom", geometry.bottom), ("top", geometry.top), ("outer", geometry.outer)):
        if boundary.holds:
            held |= {piece[seen[frozenset(map(tuple, edge.tolist()))]] for edge in geometry.subdivision.sides[side]}
    for k in range(len(faces)):
        if piece[k] not in held:
            raise _cut_off(geometry, [face for face, other in zip(faces, piece, strict=True) if other == piece[k]])


def _cut_off(geometry: CrossSection, piece: list[Face]) -> checks.InputError:
    """The error of a connected piece that touches no side of fixed temperature."""
    face = next((face for face in piece if face.owner in geometry.heated), piece[0])
    r, z = face.rings[0].mean(axis=0)
    middles = np.concatenate([face.edges() for face in piece]).mean(axis=1)
    voids = [part for part in geometry.parts if part.material == VOID and part.height]
    around = [part.name for part in voids if distance(middles, _closed(part.outline())).min() < 100 * GRID]
    if around:
        where = f"is cut off from the stack by the void {' and '.join(map(repr, around))}"
    else:
        where = f"lies outside the stack, which {geometry.layers[-1].name!r} ends at z = {geometry.top_z:g} m"
    return checks.InputError(
        f"{face.owner!r} near r = {r:g} m, z = {z:g} m {where}: it touches no side that holds the temperature, so its "
        "heat has no way out"
    )
