"""Triangles in (r, z) with named regions, and their files."""

import logging
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import skfem

from .. import checks
from ..arrays import Array, Indices, NDArray, summed
from ..checks import InputError
from ..data import files

WIDE = 0.1  # m, the largest length of a geometry file

_COUNT = re.compile(rb"(?<!\S)[0-9]{9,}(?!\S)")  # memory that meshio takes before it knows that the numbers are there
_log = logging.getLogger("thermofem")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in (r, z) with named regions.

    Parameters
    ----------
    points : array, shape (n, 2), m
        (r, z).
    triangles : int array, shape (m, 3)
        indices into ``points``; clockwise triangles are turned round.
    region : int array, shape (m,)
        index into ``region_names``.
    region_names : tuple of str
    depth : float, m
        length that a straight section stands for, see `CrossSection.depth`; None for a ring.
    """

    points: Array
    triangles: NDArray[np.int64]
    region: NDArray[np.int64]
    region_names: tuple[str, ...]
    depth: float | None = None

    def __post_init__(self) -> None:
        names = checks.check_names("region_names", self.region_names)
        points = checks.numbers("points", self.points)
        triangles = np.asarray(self.triangles)
        region = np.asarray(self.region)
        if points.shape[1:] != (2,) or triangles.shape[1:] != (3,) or not len(triangles):
            raise InputError(f"points of shape {points.shape} and triangles of shape {triangles.shape} are no mesh")
        innermost = points[:, 0].min()
        round_off = 1e-12 * np.abs(points).max()  # of gmsh on the axis
        if self.depth is None and innermost < -round_off:
            raise InputError(f"r = {innermost:g} m of the mesh lies beyond the axis; r counts from the axis on")
        checks.shape("region", region, (len(triangles),))
        longest = (sides(points[triangles]) ** 2).sum(axis=2).max(axis=1)
        area = signed_areas(points, triangles)
        # 1e-10: a triangle whose height is a smaller share of its longest side has no area
        flat = 2 * np.abs(area) <= 1e-10 * longest
        if flat.any():
            raise InputError(f"triangle {int(np.argmax(flat))} of the mesh has no area ({int(flat.sum())} of them)")
        triangles = np.where(area[:, None] < 0, triangles[:, ::-1], triangles)
        checked = {"region_names": names, "points": points, "triangles": triangles, "region": region}
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @cached_property
    def skfem(self) -> Any:
        """The triangles as scikit-fem holds them."""
        points = np.ascontiguousarray(self.points.T)
        triangles = np.ascontiguousarray(self.triangles.T)
        return Grid(points, triangles, depth=self.depth)

    def volumes(self) -> dict[str, float]:
        """Volume of every region in m^3: the sum of 2 pi r_centroid area, or of depth area; exact for triangles."""
        radius = radii(self.points[:, 0], self.depth)[self.triangles].mean(axis=1)
        each = 2 * np.pi * radius * signed_areas(self.points, self.triangles)
        volumes = np.bincount(self.region, each, minlength=len(self.region_names))
        return dict(zip(self.region_names, map(float, volumes), strict=True))

    def save(self, path: str | Path) -> None:
        """Write a binary gmsh file (format 2.2: the one that keeps region names and reads back everywhere).

        The file appears under its name only when it is complete.
        """
        import meshio

        path = checks.path("path", path)
        cells = [("triangle", self.triangles.astype(np.int32))]
        tags = [(self.region + 1).astype(np.int32)]
        names = {name: np.array([k, 2]) for k, name in enumerate(self.region_names, start=1)}
        points = np.column_stack([self.points, np.zeros(len(self.points))])
        cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        mesh = meshio.Mesh(points, cells, cell_data=cell_data, field_data=names)
        files.write_whole(path, lambda p: meshio.gmsh.write(p, mesh, fmt_version="2.2", binary=True))


@dataclass(repr=False)
class Grid(skfem.MeshTri):
    """scikit-fem's triangles, with the depth of a straight section in m (None for a ring)."""

    depth: float | None = None


def radii(r: Array, depth: float | None) -> Array:
    """Radius in m in the weight 2 pi radius of points at r: r itself in a ring, depth/(2 pi) in a straight section."""
    return r if depth is None else np.full_like(r, depth / (2 * np.pi))


def sides(corners: Array) -> Array:
    """Sides of triangles as vectors, for corners of shape (triangles, 3, 2): to each corner from the one before it."""
    return corners - np.roll(corners, 1, axis=1)


def signed_areas(points: Array, triangles: NDArray[np.int64]) -> Array:
    """Area of each triangle in m^2, positive where its corners run counterclockwise."""
    corners = points[triangles]
    u, v = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2


def locate(grid: Any, points: Array) -> tuple[Indices, Array]:
    """Index of the triangle around each point (-1 where there is none), and the point's reference coordinates in it.

    points [shape (n, 2)]: in the unit of the mesh; the reference coordinates have shape (2, n).
    """
    corners = np.moveaxis(grid.p[:, grid.t], (0, 1, 2), (2, 1, 0))
    tree = shapely.STRtree(shapely.polygons(corners))
    which, around = tree.query(shapely.points(points), predicate="intersects")
    inside, first = np.unique(which, return_index=True)  # a point on an edge lies in two triangles
    cells = np.full(len(points), -1)
    cells[inside] = around[first]
    origin = corners[cells, 0]
    a, c = (corners[cells, 1] - origin).T
    b, d = (corners[cells, 2] - origin).T
    x, y = (points - origin).T
    return cells, np.array([d * x - b * y, a * y - c * x]) / (a * d - b * c)


def sampled(basis: Any, points: Array, weights: Array, mesh: Any = None) -> Array:
    """Sum over points (r, z) in m of weight times each function of a scalar basis, shape (functions,).

    mesh: scikit-fem mesh with moved vertices, in place of that of the basis.
    Raises InputError: a point that lies in no triangle.
    """
    cells, local = locate(basis.mesh if mesh is None else mesh, points)
    if cells.min() < 0:
        r, z = points[cells.argmin()]
        raise InputError(f"the point r = {r:g} m, z = {z:g} m lies in no triangle of the mesh")
    functions = np.array([basis.elem.lbasis(local, k)[0] for k in range(basis.Nbfun)])
    return summed(basis.element_dofs[:, cells], weights * functions, basis.N)


def load(path: str | Path) -> Mesh:
    """Read a mesh in m that `Mesh.save` or gmsh wrote: triangles in the plane z = 0 whose physical groups are named.

    The log says where it spans more than 10 cm: gmsh's files state no unit.

    Formats 2.2 and 4.1, as text or binary. Clockwise triangles are turned round; points of no triangle are left out.

    Raises
    ------
    InputError
        no such file, a damaged one, elements other than triangles, groups without names, triangles without area, beyond
        the axis or out of the plane, and triangles that overlap or do not share the points where they meet.
    """
    # 100_000_000 of a file: about a million triangles as text
    content = files.read_bytes(path, "mesh", most=100_000_000)
    with checks.prefixed(f"mesh file {str(path)!r} cannot be read", Exception):  # of any kind, where bytes are damaged
        if _COUNT.search(content):
            raise InputError("it holds a count or number of a point beyond 1e8; that many do not fit into it")
        mesh = _read(path)
    span = float(np.ptp(mesh.points, axis=0).max())
    if span > WIDE:
        _log.warning(
            "mesh file %r spans %.3g m; lengths are in m: Mesh.ScalingFactor = 1e-6 turns um into m", str(path), span
        )
    return mesh


def _read(path: str | Path) -> Mesh:
    """Read the triangles in named physical groups, and the points that they use; coinciding points become one."""
    import meshio

    content = meshio.gmsh.read(path)
    others = {block.type for block in content.cells} - {"vertex", "line", "triangle"}
    if others:
        raise InputError(
            f"it holds elements of type {min(others)!r}, which are no triangles of three corners",
            "mesh with triangles of first order, without quadrangles (no Recombine) and volumes",
        )
    corners = content.cells_dict.get("triangle", np.empty((0, 3), dtype=int))
    groups = content.cell_data_dict.get("gmsh:physical", {})
    tags = groups.get("triangle", np.zeros(len(corners), dtype=int))
    names = {int(tag): name for name, (tag, dimension) in content.field_data.items() if dimension == 2}
    if not len(corners) or corners.min() < 0:
        raise InputError("it has no triangles, or one with a corner that is none of its points")
    used = np.unique(tags).tolist()
    unnamed = set(used) - set(names)
    if unnamed:
        raise InputError(
            f"the physical groups {sorted(unnamed)} have no names",
            "name them in gmsh, or by meshio's cell_data['gmsh:physical'] and field_data (cell_sets are not written)",
        )
    points = content.points
    if np.abs(points[:, 2]).max() > 1e-12 * np.abs(points).max():
        raise InputError("it has points out of the plane z = 0; gmsh's x and y are r and z here")
    _, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    joined = first[place.ravel()][corners]
    vertices, triangles = np.unique(joined, return_inverse=True)
    region = np.searchsorted(used, tags)
    region_names = tuple(names[tag] for tag in used)
    mesh = Mesh(points[vertices, :2], triangles.reshape(corners.shape), region, region_names)
    each = mesh.points[mesh.triangles]
    shapes = shapely.polygons(np.concatenate([each, each[:, :1]], axis=1))
    span = np.ptp(mesh.points, axis=0).max()
    # points closer than 1e-9 of the mesh's size are one
    if not shapely.coverage_is_valid(shapes, gap_width=1e-9 * span):
        rule = "its triangles overlap, or meet without sharing their points: no heat would flow there"
        raise InputError(rule, "gmsh's Coherence or BooleanFragments joins the parts")
    return mesh
