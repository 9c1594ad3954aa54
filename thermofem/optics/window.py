"""The part of a cross-section that a mode reaches, as triangles in um about the core: x = r - R, y = z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, NDArray
from ..checks import InputError, prefixed
from ..geometry.regions import Face, outlines
from ..materials.material_library import VOID, Material, find
from ..mesh.element_sizes import size_function, sizes

if TYPE_CHECKING:
    from ..geometry import CrossSection, Part
    from ..mesh import Mesh

AIR = "air"  # what lies above the stack and in voids, where the heat problem has no triangles
UM = 1e6  # um in a metre

Box = tuple[float, float, float, float]  # left, right, bottom, top in m


@dataclass(frozen=True, eq=False)
class Window:
    """Triangles about the core.

    mesh: scikit-fem's, in um about (R, 0), corners of every triangle sorted as Nedelec elements need them.
    region [shape (triangles,)]: index into ``names`` and ``materials``.
    """

    mesh: Any
    region: NDArray[np.intp]
    names: tuple[str, ...]
    materials: tuple[Material, ...]

    @classmethod
    def of(
        cls, geometry: CrossSection, mesh: Mesh, radius: float, keep: NDArray[np.bool_] | slice = slice(None)
    ) -> Window:
        """Triangles of a mesh in m; points doubled along contacts are joined, and a half on x >= 0 is reflected."""
        import skfem

        corners, of = mesh.points[mesh.triangles[keep]], mesh.region[keep]
        if geometry.mirrored and corners[..., 0].min() >= 0:
            corners, of = np.concatenate([corners, corners * [-1.0, 1.0]]) + 0.0, np.tile(of, 2)
        points, place = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
        about = (points - [radius, 0.0]) * UM
        grid = skfem.MeshTri(np.ascontiguousarray(about.T), np.ascontiguousarray(place.reshape(-1, 3).T))
        there, region = np.unique(of, return_inverse=True)
        names = tuple(mesh.region_names[k] for k in there)
        return cls(grid, region.ravel(), names, tuple(material_of(geometry, name) for name in names))

    def inside(self, *names: str) -> NDArray[np.bool_]:
        """Which triangles belong to regions or materials of these names."""
        found = [name in names or material.name in names for name, material in self._pairs]
        return np.array(found)[self.region]

    @property
    def _pairs(self) -> list[tuple[str, Material]]:
        return list(zip(self.names, self.materials, strict=True))


def material_of(geometry: CrossSection, region: str) -> Material:
    """Material of a region; air where nothing is meshed."""
    known = {one.name for one in geometry.layers} | {one.name for one in geometry.parts}
    return geometry.material_of(region) if region in known else find(AIR, geometry.materials)


def window(geometry: CrossSection, mesh: Mesh, box: Box, radius: float, accuracy: float) -> Window:
    """The heat mesh cut to a box by its centroids, or triangles drawn there where the heat mesh has gaps."""
    left, right, bottom, top = box
    r, z = mesh.points[mesh.triangles].mean(axis=1).T
    keep = (r > left) & (r < right) & (z > bottom) & (z < top)
    if _gaps(geometry, box):
        return drawn(geometry, box, radius, accuracy)
    return Window.of(geometry, mesh, radius, keep)


def drawn(
    geometry: CrossSection,
    box: Box,
    radius: float,
    accuracy: float,
    largest: Callable[[float, float], float] | None = None,
    beyond: tuple[float, float] | None = None,
) -> Window:
    """Triangles that fill a box with straight sides, sizes at most ``largest``; air where nothing is meshed.

    beyond [m]: z to which the bottom and the top of the box are then moved, with what lies there.
    """
    from ..mesh.gmsh_mesher import make_faces

    size = size_function(geometry, sizes(accuracy))
    faces = _clipped(geometry, box)
    if beyond is not None:
        new = dict(zip(box[2:], beyond, strict=True))
        faces = [
            Face(f.owner, tuple(np.array([(r, new.get(z, z)) for r, z in ring]) for ring in f.rings)) for f in faces
        ]

    def smaller(r: float, z: float) -> float:
        own = size(abs(r), z)
        return own if largest is None else min(own, largest(r, z))

    return Window.of(geometry, make_faces(faces, smaller, geometry.name, geometry.depth), radius)


def _shapes(geometry: CrossSection) -> list[tuple[str, Any]]:
    """Owners and polygons in um of the faces, whole ones of a mirrored section."""
    import shapely

    found = []
    for face in geometry.subdivision.faces:
        shape = shapely.Polygon(face.rings[0] * UM, [hole * UM for hole in face.rings[1:]])
        if geometry.mirrored:
            shape = shapely.union(shape, shapely.transform(shape, lambda xy: xy * [-1.0, 1.0]), grid_size=1e-6)
        found.append((face.owner, shape))
    return found


def _gaps(geometry: CrossSection, box: Box) -> bool:
    import shapely

    solid = shapely.union_all([shape for _, shape in _shapes(geometry)])
    whole = shapely.box(box[0] * UM, box[2] * UM, box[1] * UM, box[3] * UM)
    return bool(whole.difference(solid).area > 1e-9 * whole.area)


def _clipped(geometry: CrossSection, box: Box) -> list[Face]:
    """The faces of a geometry inside a box, and air in what is left of it."""
    import shapely
    from shapely.geometry.polygon import orient

    left, right, bottom, top = box
    grid = 1e-6  # um
    rest = whole = shapely.box(left * UM, bottom * UM, right * UM, top * UM)
    found: list[tuple[str, Any]] = []
    for owner, shape in _shapes(geometry):
        found.append((owner, shapely.intersection(shape, whole, grid_size=grid)))
        rest = shapely.difference(rest, shape, grid_size=grid)
    found.append((AIR, rest))
    pieces = [
        (owner, piece)
        for owner, shape in found
        for piece in getattr(shape, "geoms", [shape])
        if piece.geom_type == "Polygon" and piece.area > 1e-9
    ]
    lines = shapely.unary_union([shapely.boundary(piece) for _, piece in pieces], grid_size=grid)  # shared points
    cells = [orient(cell) for cell in shapely.polygonize([lines]).geoms]
    owners = [next((o for o, piece in pieces if piece.contains(cell.representative_point())), None) for cell in cells]
    sides = {round(end * UM / grid): end for end in box}  # to the last bit

    def exact(ring: Any) -> Array:
        return np.array([[sides.get(round(x / grid), x / UM) for x in point] for point in np.asarray(ring.coords)[:-1]])

    return [
        Face(owner, tuple(exact(ring) for ring in (cell.exterior, *cell.interiors)))
        for owner, cell in zip(owners, cells, strict=True)
        if owner is not None
    ]


def limits(geometry: CrossSection, part: Part, wavelength: float) -> tuple[Box, dict[str, float]]:
    """The box about a part that ends where something else guides or absorbs; distances in m of these things.

    Left out are layers of at least the part's index that do not touch it (a substrate), and materials without an index.

    Raises InputError: a material without an index touches the part.
    """
    corners = part.outline()
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    own = index_of(geometry.material_of(part.name), wavelength, part.name)
    axis = 0.02 * left if geometry.kind == "ring" else -geometry.outer_radius
    box, away = [axis, geometry.outer_radius, geometry.bottom_z, np.inf], {}
    layers = {layer.name for layer in geometry.layers}
    for name, outline in outlines(geometry).items():
        material = geometry.material_of(name)
        if name == part.name or material.name == VOID:
            continue
        touches = _meets(geometry, name, part.name)
        guides = name in layers and not touches and material.index and material.index.index(wavelength) > 0.99 * own
        if material.index is not None and not guides:
            continue
        if touches:
            index_of(material, wavelength, name)
        (r0, z0), (r1, z1) = outline.min(axis=0), outline.max(axis=0)
        gaps = (left - r1, r0 - right, bottom - z1, z0 - top)
        side = int(np.argmax(gaps))
        if gaps[side] >= 0:
            away[name] = float(gaps[side])
            nearer = max if side in (0, 2) else min
            box[side] = nearer(box[side], (r1, r0, z1, z0)[side])
    if geometry.mirrored:
        box[0] = -box[1]
    return (float(box[0]), float(box[1]), float(box[2]), float(box[3])), away


def _meets(geometry: CrossSection, first: str, second: str) -> bool:
    """Whether two regions share an edge."""
    edges = [
        {
            frozenset(map(tuple, edge))
            for face in geometry.subdivision.faces
            if face.owner == name
            for edge in face.edges().tolist()
        }
        for name in (first, second)
    ]
    return bool(edges[0] & edges[1])


def index_of(material: Material, wavelength: float, region: str) -> float:
    """Refractive index of a region's material.

    Raises InputError: the material has none, or the wavelength lies outside the range of its law.
    """
    if material.index is None:
        raise InputError(
            f"{region!r}: material {material.name!r} has no refractive index and lies within the mode's reach",
            f'give it in [material.{material.name}] index = 1.444, or "Si, Salzberg 1957", or move it away',
        )
    with prefixed(f"index of {material.name!r}, the material of {region!r}"):
        return material.index.index(wavelength)


def energy_index(materials: tuple[Material, ...], names: tuple[str, ...], wavelength: float) -> tuple[Array, Array]:
    """eps = n^2 and n n_gm = n (n - lambda dn/dlambda) of every region."""
    n = np.array([index_of(m, wavelength, name) for m, name in zip(materials, names, strict=True)])
    group = np.array([m.index.group_index(wavelength) for m in materials if m.index is not None])
    return n**2, n * group
