"""Thermal boundary resistance: the mesh cut open along the surfaces of parts, and the facets that face each other.

The temperature jumps by resistance times flux. Every node of such a surface is there once for each side; the flux
between the two sides is (T^+ - T^-)/resistance. Where two surfaces lie on each other their resistances add. On a side
of the domain that the ambient holds or cools, the resistance is in series with it (`surfaces`).

Where regions touch in one point only, two silicon corners between voids for instance, no heat flows through it: the
mesh is parted there, with one vertex for each group of triangles that edges hold together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..mesh.triangles import Mesh

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection

PERFECT = 1e-14  # m^2 K/W; a hundredth of a picometre of oxide: a smaller resistance, such as 0, counts as this one


def resistances(geometry: CrossSection) -> dict[str, float]:
    """Sum of the thermal boundary resistances of each part that has one, in m^2 K/W; `PERFECT` at least."""
    found: dict[str, float] = {}
    for interface in geometry.interfaces:
        found[interface.part] = found.get(interface.part, 0.0) + interface.resistance
    return {part: max(value, PERFECT) for part, value in found.items()}


def split(mesh: Mesh, resistance: Mapping[str, float]) -> Mesh:
    """The mesh with nodes doubled on the surface of every region in ``resistance`` (m^2 K/W), and at `pinched` points.

    Points keep their place; those of one side follow each other in the order that they had.
    """
    side = _side(mesh, resistance)
    if not side.any():
        return parted(mesh)
    count = len(mesh.points)
    pairs = side[:, None] * count + mesh.triangles
    used, triangles = np.unique(pairs, return_inverse=True)
    return parted(replace(mesh, points=mesh.points[used % count], triangles=triangles.reshape(-1, 3).astype(np.int64)))


def contacts(mesh: Mesh, resistance: Mapping[str, float]) -> dict[float, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Facets of a mesh from `split` that lie on each other: for each total resistance both sides, in the same order."""
    side = _side(mesh, resistance)
    if not side.any():
        return {}
    grid = mesh.skfem
    facets = grid.boundary_facets()
    ends = np.sort(_place(mesh)[grid.facets[:, facets]], axis=0).T
    order = np.lexsort(ends.T)
    twins = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    first, second = facets[order[twins]], facets[order[twins + 1]]
    total = beside(mesh, resistance, first) + beside(mesh, resistance, second)
    return {float(value): (first[total == value], second[total == value]) for value in np.unique(total)}


def beside(mesh: Mesh, resistance: Mapping[str, float], facets: NDArray[np.intp]) -> NDArray[np.float64]:
    """Resistance in m^2 K/W that the region beside each boundary facet has on its surface."""
    own = np.array([0.0, *resistance.values()])
    return np.asarray(own[_side(mesh, resistance)[mesh.skfem.f2t[0, facets]]])


def _side(mesh: Mesh, resistance: Mapping[str, float]) -> NDArray[np.int64]:
    """For each triangle 0, or one more than the place of its region among those with a resistance."""
    names = list(resistance)
    number = np.array([names.index(name) + 1 if name in names else 0 for name in mesh.region_names], dtype=np.int64)
    return number[mesh.region]


def _place(mesh: Mesh) -> NDArray[np.intp]:
    """A number for each point, the same for points that lie on each other."""
    return np.unique(mesh.points, axis=0, return_inverse=True)[1].ravel()


def parted(mesh: Mesh) -> Mesh:
    """The mesh with one vertex for each group of triangles that hold together by edges there; else the mesh itself.

    Vertices keep their order, the copies follow.
    """
    grid, count = mesh.skfem, len(mesh.points)
    ends = grid.facets[:, grid.boundary_facets()]
    pinched = np.flatnonzero(np.bincount(ends.ravel(), minlength=count) > 2)  # two edges of the boundary otherwise
    if not pinched.size:
        return mesh
    triangles = mesh.triangles.copy()
    copied: list[int] = []
    for vertex in pinched:
        around = np.flatnonzero((mesh.triangles == vertex).any(axis=1))
        group = groups(mesh.triangles[around], int(vertex))
        for number in range(1, group.max() + 1):
            own = around[group == number]
            triangles[own] = np.where(triangles[own] == vertex, count + len(copied), triangles[own])
            copied.append(int(vertex))
    return replace(mesh, points=np.concatenate([mesh.points, mesh.points[copied]]), triangles=triangles)


def groups(triangles: NDArray[np.int64], vertex: int) -> NDArray[np.intp]:
    """For each of the triangles around a vertex the number of its group, which edges at the vertex hold together."""
    number = np.arange(len(triangles))
    first: dict[int, int] = {}
    for k, corners in enumerate(triangles.tolist()):
        for end in corners:
            if end != vertex:  # its other triangle, if there is one
                number[number == number[k]] = number[first.setdefault(end, k)]
    return np.unique(number, return_inverse=True)[1].ravel()
