"""The part of a cross-section that a mode reaches, as triangles in um about the core: x = r - R, y = z."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import skfem

from ..arrays import Array, Indices, Mask
from ..checks import InputError, prefixed
from ..geometry.regions import Face, cut, outlines
from ..materials.material_library import VOID, Material, find
from ..mesh.element_sizes import size_function, sizes
from ..mesh.gmsh_mesher import make_faces

if TYPE_CHECKING:
    from ..geometry import CrossSection
    from ..mesh import Mesh

AIR = "air"  # what lies above the stack and in voids, where the heat problem has no triangles
UM = 1e6  # um in a metre
ROOM = 293.15  # K, at which index laws hold: they were measured at 20 to 26 C, and 6 K change silicon by 1e-3

Box = tuple[float, float, float, float]  # left, right, bottom, top in m


@dataclass(frozen=True, eq=False)
class Window:
    """Triangles about the core on which modes are solved.

    mesh: scikit-fem's, in um about (R, 0), corners of every triangle sorted as Nedelec elements need them.
    region [shape (triangles,)]: index into ``names`` and ``materials``.
    ambient [K]: temperature of the indices.
    """

    mesh: Any
    region: Indices
    names: tuple[str, ...]
    materials: tuple[Material, ...]
    ambient: float = ROOM

    @classmethod
    def of(cls, geometry: CrossSection, mesh: Mesh, radius: float, keep: Mask | slice = slice(None)) -> Window:
        """Make a window of a mesh in m; doubled points are joined, and a mirrored half (x >= 0) is completed."""
        corners = mesh.points[mesh.triangles[keep]]
        of = mesh.region[keep]
        if geometry.mirrored and corners[..., 0].min() >= 0:
            corners = np.concatenate([corners, corners * [-1.0, 1.0]]) + 0.0
            of = np.tile(of, 2)
        points, place = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
        about = (points - [radius, 0.0]) * UM
        triangles = place.reshape(-1, 3)
        grid = skfem.MeshTri(np.ascontiguousarray(about.T), np.ascontiguousarray(triangles.T))
        there, region = np.unique(of, return_inverse=True)
        names = tuple(mesh.region_names[k] for k in there)
        materials = tuple(material_of(geometry, name) for name in names)
        return cls(grid, region.ravel(), names, materials, geometry.ambient)

    @property
    def regions(self) -> dict[str, Material]:
        """Material of every region by name."""
        return dict(zip(self.names, self.materials, strict=True))

    def inside(self, *names: str) -> Mask:
        """Which triangles belong to regions, or to materials, of these names; shape (triangles, 1)."""
        inside = np.array([bool({region, m.name}.intersection(names)) for region, m in self.regions.items()])
        return inside[self.region, None]

    def of_materials(self, value: Callable[[Material], float]) -> Array:
        """``value`` of the material of every triangle, shape (triangles, 1)."""
        values = np.array([value(material) for material in self.materials])
        return values[self.region, None]

    def indices(self, wavelength: float) -> tuple[Array, Array]:
        """eps = n^2 and n n_gm = n (n - lambda dn/dlambda) of every triangle, shape (triangles, 1)."""
        of_regions = np.array([index_of(m, wavelength, name, self.ambient) for name, m in self.regions.items()])
        n = of_regions[self.region, None]
        n_g = self.of_materials(lambda m: group_index_of(m, wavelength, self.ambient))
        return n**2, n * n_g


def material_of(geometry: CrossSection, region: str) -> Material:
    """Material of a region; air where nothing is meshed."""
    return find(AIR, geometry.materials) if region == AIR else geometry.material_of(region)


def window(geometry: CrossSection, mesh: Mesh, box: Box, radius: float, accuracy: float) -> Window:
    """Heat mesh cut to a box, by the triangles' centroids; a new mesh of the box where the heat mesh has gaps."""
    if any(face.owner == AIR for face in _clipped(geometry, box)):
        return drawn(geometry, box, radius, accuracy)
    left, right, bottom, top = box
    r, z = mesh.points[mesh.triangles].mean(axis=1).T
    inside = (r > left) & (r < right) & (z > bottom) & (z < top)
    return Window.of(geometry, mesh, radius, inside)


def drawn(
    geometry: CrossSection,
    box: Box,
    radius: float,
    accuracy: float,
    largest: Callable[[float], float] = lambda z: np.inf,
    beyond: tuple[float, float] | None = None,
) -> Window:
    """Mesh a box with straight sides; air fills what has no material.

    largest [m]: of the triangles at a height z in m.
    beyond [m]: z to which bottom and top of the box are then moved, together with the materials there.
    """
    size = size_function(geometry, sizes(accuracy))
    faces = _clipped(geometry, box)
    if beyond is not None:
        moved = dict(zip(box[2:], beyond, strict=True))

        def prolonged(ring: Array) -> Array:
            return np.array([(r, moved.get(z, z)) for r, z in ring])

        faces = [Face(face.owner, tuple(map(prolonged, face.rings))) for face in faces]

    def length(r: float, z: float) -> float:
        return min(size(abs(r), z), largest(z))

    mesh = make_faces(faces, length, geometry.name, geometry.depth)
    return Window.of(geometry, mesh, radius)


def _clipped(geometry: CrossSection, box: Box) -> list[Face]:
    """Faces of a geometry inside a box (both halves of a mirrored section), and faces of air where there are none."""
    left, right, bottom, top = box
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    voids = {part.name for part in geometry.parts if part.material == VOID}
    everything = {"": corners} | outlines(geometry, whole=True)
    # faces are cut on a grid of 1e-12 m at the sides of a window
    faces = cut(everything, ground="", holes=voids, grid=1e-12)
    return [replace(face, owner=face.owner or AIR) for face in reversed(faces)]  # the core, meshed finest, first


def index_of(material: Material, wavelength: float, region: str, temperature: float) -> float:
    """Refractive index of a region's material at a temperature in K: n + dn/dT (T - `ROOM`).

    An index law holds at `ROOM`; without dn/dT it holds at any temperature.

    Raises InputError: the material has none, or the wavelength lies outside the range of its law.
    """
    if material.index is None:
        raise InputError(
            f"{region!r}: material {material.name!r} has no refractive index and lies within the mode's reach",
            f'give it in [material.{material.name}] index = 1.444, or "Si, Salzberg 1957", or move it away',
        )
    with prefixed(f"index of {material.name!r}, the material of {region!r}"):
        return material.index.index(wavelength) + _heated(material, temperature)


def group_index_of(material: Material, wavelength: float, temperature: float) -> float:
    """Group index of a material at a temperature in K; 1 without an index. dn/dT is taken without dispersion."""
    if material.index is None:
        return 1.0
    return material.index.group_index(wavelength) + _heated(material, temperature)


def _heated(material: Material, temperature: float) -> float:
    """Change of the refractive index from `ROOM` to a temperature in K."""
    return (material.thermo_optic or 0.0) * (temperature - ROOM)
