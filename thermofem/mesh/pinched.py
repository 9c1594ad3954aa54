"""Vertices at which triangles meet without sharing an edge: doubled, as no heat flows through a point.

Continuous elements would conduct there: the shared vertex has one temperature, and its conductance falls only with
1/log of the triangles' size.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .triangles import Mesh


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
