"""Small structured meshes for verification problems."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import skfem

import thermofem as th


def tensor_mesh(r, z, region: Callable | None = None, names: tuple[str, ...] = ("body",)) -> th.mesh.Mesh:
    """Triangles on the lines r x z (m); ``region(r, z)`` of the centroids gives indices into ``names``."""
    grid = skfem.MeshTri.init_tensor(np.asarray(r, float), np.asarray(z, float))
    centre = grid.p[:, grid.t].mean(axis=1)
    index = np.zeros(grid.nelements, dtype=np.int64) if region is None else region(*centre).astype(np.int64)
    return th.mesh.Mesh(grid.p.T.copy(), grid.t.T.astype(np.int64), index, names)


def facets_where(mesh: th.mesh.Mesh, where: Callable) -> np.ndarray:
    """Boundary facets whose midpoint satisfies ``where(r, z)``."""
    grid = mesh.skfem
    return grid.facets_satisfying(lambda x: where(*x), boundaries_only=True)


def graded(*edges: float, finest: float, growth: float = 1.5, largest: float = np.inf) -> np.ndarray:
    """Coordinates from the first to the last edge, with each interval refined geometrically towards both its ends."""
    lines = []
    for start, stop in itertools.pairwise(edges):
        half, step = [0.0], finest
        while half[-1] < (stop - start) / 2:
            half.append(half[-1] + step)
            step = min(step * growth, largest)
        share = np.array(half) / half[-1] * (stop - start) / 2
        lines += [start + share, stop - share[::-1]]
    return np.unique(np.round(np.concatenate(lines), 15))
