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
from ..arrays import Array, NDArray
from ..materials.material_library import VOID
from .section_parts import THINNEST, Layer, layer_edges

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

    @cached_property
    def polygon(self) -> Any:
        """The face as a shapely polygon in units of `GRID`."""
        return shapely.Polygon(self.rings[0] / GRID, [hole / GRID for hole in self.rings[1:]])

    @property
    def area(self) -> float:
        """Integral of dA in m^2."""
        return float(self.polygon.area) * GRID**2

    def volume(self, depth: float | None = None) -> float:
        """Integral of 2 pi r dA in m^3, exact for a polygon (Pappus): 2 pi r_centroid A; or A times a depth in m."""
        return self.area * (2 * np.pi * float(self.polygon.centroid.x) * GRID if depth is None else depth)

    def edges(self) -> Array:
        """All its edges in m, shape (n, 2 ends, 2)."""
        return np.concatenate([_closed(ring) for ring in self.rings])


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
    ends: NDArray[np.intp]
    beside: NDArray[np.intp]
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

    def on_side(self, side: str, r: Array, z: Array) -> NDArray[np.bool_]:
        """Which points (r, z) in m lie on ``side``, round-off allowed for."""
        edges = self.sides[checks.choice("side", side, SIDES)]
        points = np.stack(np.broadcast_arrays(r, z), axis=-1)
        return distance(points, edges) < max(100 * GRID, 1e-9 * float(np.abs(self.corners).max()))


def _closed(ring: Array) -> Array:
    """Edges of the closed polygon through the corners ``ring``, shape (n, 2 ends, 2)."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def distance(points: Array, edges: Array) -> Array:
    """Distance in m from points, shape (..., 2), to the nearest of the edges, shape (n, 2, 2); inf without edges."""
    return nearest(points, edges)[0]


def nearest(points: Array, edges: Array) -> tuple[Array, NDArray[np.intp], Array]:
    """`distance` from points to the edges, index of the nearest edge, and fraction of it at the nearest point."""
    away = np.full(points.shape[:-1], np.inf)
    index = np.zeros(away.shape, dtype=np.intp)
    place = np.zeros(away.shape)
    for k, (start, stop) in enumerate(edges):
        along = stop - start
        share = np.clip((points - start) @ along / (along @ along), 0, 1)
        far = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        index = np.where(far < away, k, index)
        place = np.where(far < away, share, place)
        away = np.minimum(far, away)
    return away, index, place


def subdivide(geometry: CrossSection) -> Subdivision:
    """Cut the plane into faces: a later part covers earlier parts and layers, and a void leaves a hole.

    Raises InputError: a part that is wholly hidden, or a face thinner than an atom.
    """
    found = outlines(geometry)
    shown = cut(found)
    voids = {part.name for part in geometry.parts if part.material == VOID}
    for part in geometry.parts:
        if part.name in found and part.name not in {face.owner for face in shown}:
            own = shapely.Polygon(found[part.name])
            over = [other.name for other in geometry.parts if shapely.Polygon(found[other.name]).intersects(own)]
            covers = ", ".join(repr(name) for name in over if name != part.name)
            raise checks.InputError(f"part {part.name!r} is wholly covered by {covers}; change their order")
    faces = tuple(face for face in shown if face.owner not in voids)
    for face in faces:
        _check_thickness(face, found)
    number: dict[tuple[float, float], int] = {}
    beside: dict[tuple[int, int], list[int]] = {}
    for k, face in enumerate(faces):
        for edge in face.edges().tolist():
            a, b = (number.setdefault((r, z), len(number)) for r, z in edge)
            key, side = ((a, b), 0) if a < b else ((b, a), 1)
            beside.setdefault(key, [-1, -1])[side] = k
    corners = np.array(list(number))
    ends = np.array(list(beside))
    both = np.array(list(beside.values()))
    return Subdivision(faces, corners, ends, both, _sides(geometry, faces, corners[ends], both))


def cut(
    found: Mapping[str, Array], *, ground: str | None = None, holes: Container[str] = (), grid: float = GRID
) -> list[Face]:
    """Visible faces of overlapping outlines, of which a later one covers earlier ones, in the order of the outlines.

    ground: name of the outline that bounds all; it also owns what the outlines in ``holes`` cover.
    grid [m]: step to which coordinates are rounded; those of the outlines are restored exactly.
    """
    shapes = {name: shapely.Polygon(np.rint(outline / grid)) for name, outline in found.items()}
    corners = np.concatenate(list(found.values()))
    exact_r = _exact(corners[:, 0], grid)
    exact_z = _exact(corners[:, 1], grid)
    lines = shapely.unary_union([shape.exterior for shape in shapes.values()], grid_size=1)
    cells = np.array(shapely.polygonize([lines]).geoms)
    inside = shapely.point_on_surface(cells)
    if ground is not None:
        kept = shapely.contains(shapes[ground], inside)
        cells, inside = cells[kept], inside[kept]
    which, of = shapely.STRtree(list(shapes.values())).query(inside, predicate="within")
    last = np.full(len(cells), -1)
    np.maximum.at(last, which, of)
    names = [ground if name in holes else name for name in found]

    def restored(ring: Any) -> Array:
        points = np.asarray(ring.coords)[:-1]
        return np.array([(exact_r.get(round(r), r * grid), exact_z.get(round(z), z * grid)) for r, z in points])

    faces = []
    for name in found:
        own = cells[[k >= 0 and names[k] == name for k in last]]
        polygons = map(orient, shapely.normalize(shapely.get_parts(shapely.union_all(own, grid_size=1))))
        for polygon in sorted(polygons, key=lambda polygon: polygon.bounds):
            faces.append(Face(name, tuple(map(restored, (polygon.exterior, *polygon.interiors)))))
    return faces


def _exact(values: Array, grid: float) -> dict[int, float]:
    """Coordinates in m along one axis, by their place on the grid.

    Each axis has its own: a depth that equals a width but for round-off would otherwise take its value.
    """
    return {round(x / grid): x for x in values.tolist()}


def outlines(geometry: CrossSection, *, whole: bool = False) -> dict[str, Array]:
    """Corners of every layer and part in m; of a mirrored section those with x >= 0, or of the ``whole`` one."""
    found, left = {part.name: part.outline() for part in geometry.parts if part.height}, geometry.inner_end
    if geometry.mirrored and whole:
        left = -geometry.outer_radius
    elif geometry.mirrored:
        found = {name: outline for name, outline in found.items() if outline[1:3, 0].min() > 0}
        found = {name: np.maximum(outline, [0.0, -np.inf]) for name, outline in found.items()}
    return boxes(geometry.layers, left, geometry.outer_radius) | found


def boxes(layers: Sequence[Layer], left: float, right: float) -> dict[str, Array]:
    """Corners of every layer between two ends, in m."""
    z = layer_edges(layers)
    return {
        layer.name: np.array([(left, z[k]), (right, z[k]), (right, z[k + 1]), (left, z[k + 1])])
        for k, layer in enumerate(layers)
    }


def _check_thickness(face: Face, known: dict[str, Array]) -> None:
    """Raise InputError where a corner of the face is closer than an atom to an edge that does not end there."""
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


def _sides(geometry: CrossSection, faces: Sequence[Face], edges: Array, beside: NDArray[np.intp]) -> NDArray[np.str_]:
    """The side of the domain on which every edge lies, shape (edges,); "" where there are faces on both sides."""
    bottom, left, right = geometry.bottom_z, geometry.inner_end, geometry.outer_radius
    stack = shapely.box(left / GRID, bottom / GRID, right / GRID, geometry.top_z / GRID)
    filled = shapely.union_all([stack, *(face.polygon for face in faces)], grid_size=1)
    skin = shapely.union_all(shapely.get_exterior_ring(shapely.get_parts(filled)))  # voids and enclosed gaps filled
    r, z = np.moveaxis(edges, 2, 0)

    def at(x: Array, *ends: float) -> NDArray[np.bool_]:
        return np.isin(x, ends).all(axis=1) & (x[:, 0] == x[:, 1])

    on_skin = shapely.distance(skin, shapely.points(edges.mean(axis=1) / GRID)) <= 1
    there = [(beside >= 0).all(axis=1), at(r, 0.0) & (left == 0), at(r, left, right), at(z, bottom), on_skin]
    return np.select(there, ["", "axis", "outer", "bottom", "top"], "wall")


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
    cut = geometry.subdivision
    inner, count = cut.beside[cut.side == ""], len(cut.faces)
    piece = connected_components(coo_matrix((np.ones(len(inner)), inner.T), shape=(count, count)))[1]
    holding = [side for side in ("bottom", "top", "outer") if getattr(geometry, side).holds]
    loose = ~np.isin(piece, piece[cut.beside[np.isin(cut.side, holding)].max(axis=1)])
    if loose.any():
        first = piece[loose.argmax()]
        raise _cut_off(geometry, [face for face, of in zip(cut.faces, piece, strict=True) if of == first])


def _cut_off(geometry: CrossSection, piece: list[Face]) -> checks.InputError:
    """InputError for a connected piece that touches no side of fixed temperature."""
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
