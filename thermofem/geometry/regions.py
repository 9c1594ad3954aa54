"""Cutting the (r, z) plane into faces with one owner each, however layers and parts overlap.

All cuts are made on a grid of one femtometre, so that coordinates which differ by round-off only are one; afterwards
every coordinate that the geometry knows gets its own value back, to the last bit.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry.polygon import orient

from .. import checks
from ..arrays import Array, Indices, Mask, NDArray
from ..checks import InputError
from ..materials.material_library import VOID
from .section_parts import THINNEST, Layer, layer_edges

if TYPE_CHECKING:
    from .cross_section import CrossSection

CUT_GRID = 1e-15  # m
SIDES = ("bottom", "top", "outer", "axis", "wall")


@dataclass(frozen=True, eq=False)
class Face:
    """A polygon in (r, z) that belongs to one layer or part.

    ``rings``: the outer ring counterclockwise, then holes clockwise, each of shape (n, 2) in m.
    """

    owner: str
    rings: tuple[Array, ...]

    @cached_property
    def polygon(self) -> Any:
        """The face as a shapely polygon in units of `CUT_GRID`."""
        shell, *holes = self.rings
        return shapely.Polygon(shell / CUT_GRID, [hole / CUT_GRID for hole in holes])

    @property
    def area(self) -> float:
        """Integral of dA in m^2."""
        return float(self.polygon.area) * CUT_GRID**2

    def volume(self, depth: float | None = None) -> float:
        """Integral of 2 pi r dA in m^3, exact for a polygon (Pappus): 2 pi r_centroid A; or A times a depth in m."""
        if depth is not None:
            return self.area * depth
        centroid = float(self.polygon.centroid.x)
        return self.area * (2 * np.pi * centroid * CUT_GRID)

    def edges(self) -> Array:
        """All its edges in m, shape (n, 2 ends, 2)."""
        return np.concatenate([closed(ring) for ring in self.rings])


@dataclass(frozen=True, eq=False)
class Subdivision:
    """Faces and their edges, each edge once.

    corners [shape (c, 2), m]: of all faces.
    ends [shape (e, 2)]: corners of each edge.
    beside [shape (e, 2)]: faces on its left and on its right; -1 where nothing is meshed.
    side [shape (e,)]: of the domain on which it lies, else "": "axis" (r = 0, or the mirror plane x = 0), "bottom",
        "outer", "top" (what faces up or stands above the stack), "wall" (of a void).
    """

    faces: tuple[Face, ...]
    corners: Array
    ends: Indices
    beside: Indices
    side: NDArray[np.str_]

    @cached_property
    def owners(self) -> list[tuple[str | None, str | None]]:
        """Names of what lies on the left and on the right of every edge; None where nothing is meshed."""
        names = [*(face.owner for face in self.faces), None]
        return [(names[left], names[right]) for left, right in self.beside]

    @property
    def sides(self) -> dict[str, Array]:
        """The edges of every side of the domain in m, shape (n, 2 ends, 2)."""
        return {side: self.corners[self.ends[self.side == side]] for side in SIDES}

    def volumes(self, depth: float | None = None) -> dict[str, float]:
        """Volume in m^3 of every layer and part, in the order of the faces."""
        total: dict[str, float] = {}
        for face in self.faces:
            total[face.owner] = total.get(face.owner, 0.0) + face.volume(depth)
        return total

    def on_side(self, side: str, r: Array, z: Array) -> Mask:
        """Which points (r, z) in m lie on ``side``, round-off allowed for."""
        edges = self.sides[checks.choice("side", side, SIDES)]
        points = np.stack(np.broadcast_arrays(r, z), axis=-1)
        size = float(np.abs(self.corners).max())
        return distance(points, edges) < max(100 * CUT_GRID, 1e-9 * size)


def closed(ring: Array) -> Array:
    """Edges of the closed polygon through the corners ``ring``, shape (n, 2 ends, 2)."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def distance(points: Array, edges: Array) -> Array:
    """Distance in m from points, shape (..., 2), to the nearest of the edges, shape (n, 2, 2); inf without edges."""
    return nearest(points, edges)[0]


def nearest(points: Array, edges: Array) -> tuple[Array, Indices, Array]:
    """`distance` from points to the edges, index of the nearest edge, and fraction of it at the nearest point."""
    away = np.full(points.shape[:-1], np.inf)
    index = np.zeros(away.shape, dtype=np.intp)
    place = np.zeros(away.shape)
    for k, (start, stop) in enumerate(edges):
        along = stop - start
        offset = points - start
        share = np.clip(offset @ along / (along @ along), 0, 1)
        normal = offset - share[..., None] * along
        gap = np.linalg.norm(normal, axis=-1)
        nearer = gap < away
        index = np.where(nearer, k, index)
        place = np.where(nearer, share, place)
        away = np.minimum(gap, away)
    return away, index, place


def subdivide(geometry: CrossSection) -> Subdivision:
    """Cut the plane into faces: a later part covers earlier parts and layers, and a void leaves a hole.

    Raises InputError: a part that is wholly hidden, or a face thinner than an atom.
    """
    boundaries = outlines(geometry)
    shown = cut(boundaries)
    owners = {face.owner for face in shown}
    voids = {part.name for part in geometry.parts if part.material == VOID}
    for part in geometry.parts:
        if part.name in boundaries and part.name not in owners:
            covers = ", ".join(repr(name) for name in _touching(geometry, part.name, boundaries))
            raise InputError(f"part {part.name!r} is wholly covered by {covers}; change their order")
    faces = tuple(face for face in shown if face.owner not in voids)
    for face in faces:
        _check_thickness(face, boundaries)
    number: dict[tuple[float, float], int] = {}
    beside: dict[tuple[int, int], list[int]] = {}
    for k, face in enumerate(faces):
        for start, stop in face.edges().tolist():
            a = number.setdefault(tuple(start), len(number))
            b = number.setdefault(tuple(stop), len(number))
            pair = beside.setdefault((min(a, b), max(a, b)), [-1, -1])
            side = 0 if a < b else 1
            pair[side] = k
    corners = np.array(list(number))
    ends = np.array(list(beside))
    both = np.array(list(beside.values()))
    side_of = _sides(geometry, faces, corners[ends], both)
    return Subdivision(faces, corners, ends, both, side_of)


def _touching(geometry: CrossSection, name: str, boundaries: Mapping[str, Array]) -> list[str]:
    """Names of the other parts whose outlines meet that of a part."""
    polygon = shapely.Polygon(boundaries[name])
    others = [part.name for part in geometry.parts if part.name != name and part.name in boundaries]
    return [other for other in others if shapely.Polygon(boundaries[other]).intersects(polygon)]


def cut(
    boundaries: Mapping[str, Array], *, ground: str | None = None, holes: Container[str] = (), grid: float = CUT_GRID
) -> list[Face]:
    """Visible faces of overlapping outlines, of which a later one covers earlier ones, in the order of the outlines.

    ground: name of the outline that bounds all; it also owns what the outlines in ``holes`` cover.
    grid [m]: step to which coordinates are rounded; those of the outlines are restored exactly.
    """
    shapes = {name: shapely.Polygon(np.rint(outline / grid)) for name, outline in boundaries.items()}
    corners = np.concatenate(list(boundaries.values()))
    exact_r = _exact(corners[:, 0], grid)
    exact_z = _exact(corners[:, 1], grid)
    exteriors = [shape.exterior for shape in shapes.values()]
    lines = shapely.unary_union(exteriors, grid_size=1)
    cells = np.array(shapely.polygonize([lines]).geoms)
    inside = shapely.point_on_surface(cells)
    if ground is not None:
        in_ground = shapely.contains(shapes[ground], inside)
        cells = cells[in_ground]
        inside = inside[in_ground]
    tree = shapely.STRtree(list(shapes.values()))
    cell, cover = tree.query(inside, predicate="within")
    last = np.full(len(cells), -1)
    np.maximum.at(last, cell, cover)
    names = [ground if name in holes else name for name in boundaries]

    def restored(ring: Any) -> Array:
        corners = []
        for r, z in np.asarray(ring.coords)[:-1]:
            exact = (exact_r.get(round(r), r * grid), exact_z.get(round(z), z * grid))
            corners.append(exact)
        return np.array(corners)

    faces = []
    for name in boundaries:
        belongs = [k >= 0 and names[k] == name for k in last]
        union = shapely.union_all(cells[belongs], grid_size=1)
        pieces = shapely.normalize(shapely.get_parts(union))
        for polygon in sorted(map(orient, pieces), key=lambda polygon: polygon.bounds):
            rings = (polygon.exterior, *polygon.interiors)
            faces.append(Face(name, tuple(map(restored, rings))))
    return faces


def _exact(values: Array, grid: float) -> dict[int, float]:
    """Coordinates in m along one axis, by their place on the grid.

    Each axis has its own: a depth that equals a width but for round-off would otherwise take its value.
    """
    return {round(x / grid): x for x in values.tolist()}


def outlines(geometry: CrossSection, *, whole: bool = False) -> dict[str, Array]:
    """Corners of every layer and part in m; of a mirrored section those with x >= 0, or of the ``whole`` one."""
    parts = {part.name: part.outline() for part in geometry.parts if part.height}
    left = geometry.inner_end
    if geometry.mirrored and whole:
        left = -geometry.outer_radius
    elif geometry.mirrored:
        reaching = {name: outline for name, outline in parts.items() if outline[1:3, 0].min() > 0}
        parts = {name: np.maximum(outline, [0.0, -np.inf]) for name, outline in reaching.items()}
    return boxes(geometry.layers, left, geometry.outer_radius) | parts


def boxes(layers: Sequence[Layer], left: float, right: float) -> dict[str, Array]:
    """Corners of every layer between two ends, in m."""
    z = layer_edges(layers)
    outline_of = {}
    for layer, low, high in zip(layers, z[:-1], z[1:], strict=True):
        outline_of[layer.name] = np.array([(left, low), (right, low), (right, high), (left, high)])
    return outline_of


def _check_thickness(face: Face, boundaries: dict[str, Array]) -> None:
    """Raise InputError where a corner of the face is closer than an atom to an edge that does not end there."""
    edges = face.edges()
    corners = edges[:, 0]
    gap = shapely.distance(shapely.points(corners)[:, None], shapely.linestrings(edges))
    ends_there = (corners[:, None, None] == edges).all(axis=-1).any(axis=-1)
    gap[ends_there] = np.inf
    thickness = gap.min()
    if thickness < THINNEST:
        place = corners[gap.min(axis=1).argmin()]
        r, z = place
        outlines_there = [name for name in boundaries if distance(place, closed(boundaries[name])) < THINNEST]
        raise InputError(
            f"{face.owner!r} has a sliver of {thickness:.2g} m near r = {r:g} m, z = {z:g} m, thinner than an "
            f"atom; make the outlines of {' and '.join(map(repr, outlines_there))} agree there"
        )


def _sides(geometry: CrossSection, faces: Sequence[Face], edges: Array, beside: Indices) -> NDArray[np.str_]:
    """The side of the domain on which every edge lies, shape (edges,); "" where there are faces on both sides."""
    bottom = geometry.bottom_z
    left = geometry.inner_end
    right = geometry.outer_radius
    stack = shapely.box(left / CUT_GRID, bottom / CUT_GRID, right / CUT_GRID, geometry.top_z / CUT_GRID)
    polygons = [face.polygon for face in faces]
    filled = shapely.union_all([stack, *polygons], grid_size=1)
    exteriors = shapely.get_exterior_ring(shapely.get_parts(filled))  # voids and enclosed gaps filled
    skin = shapely.union_all(exteriors)
    r, z = np.moveaxis(edges, 2, 0)

    def along(x: Array, *ends: float) -> Mask:
        both = np.isin(x, ends).all(axis=1)
        return both & (x[:, 0] == x[:, 1])

    inner = (beside >= 0).all(axis=1)
    axis = along(r, 0.0) & (left == 0)
    middles = shapely.points(edges.mean(axis=1) / CUT_GRID)
    on_skin = shapely.distance(skin, middles) <= 1
    where = [inner, axis, along(r, left, right), along(z, bottom), on_skin]
    return np.select(where, ["", "axis", "outer", "bottom", "top"], "wall")


def check_places(geometry: CrossSection) -> None:
    """Raise InputError for a part outside the stack, or one that crosses its top."""
    low = geometry.bottom_z
    high = geometry.top_z
    along, end = ("r", "outer_radius") if geometry.kind == "ring" else ("|x|", "half_width")
    for part in geometry.parts:
        where = f"part {part.name!r} (z = {part.bottom:g} .. {part.top:g} m)"
        reach = float(np.abs(part.outline()[:, 0]).max())
        if reach > geometry.outer_radius + CUT_GRID:
            raise InputError(
                f"part {part.name!r} reaches {along} = {reach:g} m, outside {end} = {geometry.outer_radius:g} m"
            )
        if part.bottom < low - CUT_GRID:
            raise InputError(f"{where} lies outside the stack, which begins at z = {low:g} m")
        crosses = part.bottom < high - CUT_GRID and part.top > high + CUT_GRID
        if crosses and part.material != VOID:
            raise InputError(
                f"{where} sticks out of the stack, which ends at z = {high:g} m; lower it, raise the top layer, or "
                "make it two parts, one below and one above that height"
            )


def check_held(geometry: CrossSection) -> None:
    """Raise InputError unless every connected piece touches a side that holds the temperature."""
    plane = geometry.subdivision
    inner = plane.beside[plane.side == ""]
    count = len(plane.faces)
    neighbours = coo_matrix((np.ones(len(inner)), inner.T), shape=(count, count))
    _, piece = connected_components(neighbours)
    holding = [side for side in ("bottom", "top", "outer") if getattr(geometry, side).holds]
    at_holding = plane.beside[np.isin(plane.side, holding)].max(axis=1)
    loose = ~np.isin(piece, piece[at_holding])
    if loose.any():
        first = piece[loose.argmax()]
        faces = [face for face, number in zip(plane.faces, piece, strict=True) if number == first]
        raise _cut_off(geometry, faces)


def _cut_off(geometry: CrossSection, piece: list[Face]) -> InputError:
    """InputError for a connected piece that touches no side of fixed temperature."""
    heated = (face for face in piece if face.owner in geometry.heated)
    face = next(heated, piece[0])
    r, z = face.rings[0].mean(axis=0)
    edges = np.concatenate([face.edges() for face in piece])
    middles = edges.mean(axis=1)
    around = []
    for part in geometry.parts:
        if part.material == VOID and part.height:
            gaps = distance(middles, closed(part.outline()))
            if gaps.min() < 100 * CUT_GRID:
                around.append(part.name)
    if around:
        where = f"is cut off from the stack by the void {' and '.join(map(repr, around))}"
    else:
        where = f"lies outside the stack, which {geometry.layers[-1].name!r} ends at z = {geometry.top_z:g} m"
    return InputError(
        f"{face.owner!r} near r = {r:g} m, z = {z:g} m {where}: it touches no side that holds the temperature, so its "
        "heat has no way out"
    )
