"""Means over shells around a part: all points within a distance of it; triangles may be cut by its edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array, NDArray
from ..geometry.regions import distance
from ..mesh.triangles import radii
from .matrices import volume

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.parts import Probe
    from ..mesh import Mesh

FINENESS = 24  # small triangles along each edge of a triangle that the shell's edge cuts


@dataclass(frozen=True, eq=False)
class Cut:
    """Intersection of a shell with the triangles of a mesh.

    outline [shape (edges, 2 ends, 2), m]: of the part.
    thickness [m]
    inside [shape (triangles,)]: wholly in the shell.
    cells: triangles near its edge.
    local [shape (small triangles, 2)]: centroids of the small triangles in each of them.
    longest [shape (triangles,), m]: edge of each triangle.
    """

    outline: Array
    thickness: float
    inside: NDArray[np.bool_]
    cells: NDArray[np.intp]
    local: Array
    longest: Array


def cut_shell(geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe) -> Cut:
    """Find the triangles inside a shell and those that its edge cuts; InputError where the part is not meshed."""
    edges = [face.edges() for face in geometry.subdivision.faces if face.owner == probe.part]
    if not edges:
        raise checks.InputError(f"probe {probe.name!r}: nothing of part {probe.part!r} is left to lie around")
    outline = np.concatenate(edges)
    corners = _corners(basis)
    far = distance(corners, outline)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    thickness = float(probe.shell or 0)
    outside = mesh.region != mesh.region_names.index(probe.part)
    inside = outside & (far.max(axis=1) + longest / 2 <= thickness)
    cells = np.flatnonzero(outside & ~inside & (far.min(axis=1) - longest <= thickness))
    return Cut(outline, thickness, inside, cells, _centroids(FINENESS), longest)


def shell_integral(geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe) -> Array:
    """Integral of 2 pi r times each basis function over a shell; the sum of the entries is its volume in m^3.

    Triangles well inside are integrated exactly, those near the edge by `FINENESS`^2 small triangles each, which count
    by the share that lies inside.

    Raises InputError: the part is not meshed: nothing of it is left.
    """
    cut = cut_shell(geometry, mesh, basis, probe)
    total = volume(basis, cut.inside)
    local, cells, corners = cut.local, cut.cells, _corners(basis)[cut.cells]
    r, z = np.einsum("qk,ckx->xcq", np.column_stack([1 - local.sum(axis=1), local]), corners)
    far = distance(np.stack([r, z], axis=-1), cut.outline)
    depth = (cut.thickness - far) / (cut.longest[cells, None] / FINENESS)
    weight = 2 * np.pi * radii(r, basis.mesh.depth) * np.clip(0.5 + depth, 0, 1) * _areas(corners)[:, None] / len(local)
    for k in range(basis.Nbfun):
        shape = basis.elem.lbasis(local.T, k)[0]
        total += np.bincount(basis.element_dofs[k, cells], weight @ shape, minlength=basis.N)
    return total


def _corners(basis: Any) -> Array:
    """Corners of all triangles, shape (triangles, 3, 2), in the order of the basis, which may not be ours."""
    grid = basis.mesh
    return np.moveaxis(grid.p[:, grid.t], (0, 1, 2), (2, 1, 0))


def _centroids(n: int) -> Array:
    """Centroids of the n^2 equal triangles that fill the reference triangle, shape (n^2, 2)."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    up, down = i + j < n, i + j < n - 1
    return np.concatenate([np.column_stack([i, j])[up] + 1 / 3, np.column_stack([i, j])[down] + 2 / 3]) / n


def _areas(corners: Array) -> Array:
    (x, y), (s, t) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return np.abs(x * t - s * y) / 2
