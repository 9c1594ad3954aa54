"""Local mesh refinement: marked triangles are divided into four, their neighbours into two to four; no hanging nodes.

A triangle with a divided edge has its longest edge divided too, so that angles stay above half of the smallest one
(M. C. Rivara, Int. J. Numer. Methods Eng. 20, 745 (1984)).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .triangles import Mesh


def refined(mesh: Mesh, marked: NDArray[np.bool_]) -> tuple[Mesh, NDArray[np.intp]]:
    """Divide the marked triangles in four equal ones and neighbours as needed.

    mesh: without nodes that are doubled along contacts.
    marked [shape (triangles,)]
    Returns: its first points are those of ``mesh``, new ones are midpoints of edges.
    Returns: for each new triangle the one that it lies in.
    """
    count = len(mesh.points)
    ends = np.sort(np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=-1), axis=-1)
    edges, of = np.unique((ends[..., 0] * count + ends[..., 1]).ravel(), return_inverse=True)
    of = of.reshape(-1, 3)  # edge from each corner to the next one
    start, stop = edges // count, edges % count
    length = np.sum((mesh.points[stop] - mesh.points[start]) ** 2, axis=1)
    longest = length[of].argmax(axis=1)
    divided = _closed(of, longest, marked)
    middle = np.full(len(edges), -1)
    middle[divided] = count + np.arange(divided.sum())
    points = np.concatenate([mesh.points, (mesh.points[start[divided]] + mesh.points[stop[divided]]) / 2])
    turn = (longest[:, None] + np.arange(3)) % 3  # the longest edge first
    corners, halves = np.take_along_axis(mesh.triangles, turn, 1), np.take_along_axis(middle[of], turn, 1)
    triangles, parent = _children(corners, halves)
    return replace(mesh, points=points, triangles=triangles, region=mesh.region[parent]), parent


def _closed(of: NDArray[np.intp], longest: NDArray[np.intp], marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Edges to divide: all of the marked triangles, and the longest one wherever another is divided."""
    divided = np.zeros(of.max() + 1, dtype=bool)
    divided[of[marked]] = True
    base = of[np.arange(len(of)), longest]
    while True:
        missing = divided[of].any(axis=1) & ~divided[base]
        if not missing.any():
            return divided
        divided[base[missing]] = True


def _children(corners: NDArray[np.intp], halves: NDArray[np.intp]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Triangles that replace each one, and which they replace; the first edge is divided where any is."""
    (p, q, r), (a, b, c) = corners.T, halves.T
    first, second, third = halves.T >= 0
    patterns = [
        (~first, [(p, q, r)]),
        (first & ~second & ~third, [(p, a, r), (a, q, r)]),
        (first & second & ~third, [(p, a, r), (a, b, r), (a, q, b)]),
        (first & ~second & third, [(p, a, c), (c, a, r), (a, q, r)]),
        (first & second & third, [(p, a, c), (a, q, b), (c, b, r), (a, b, c)]),
    ]
    triangles = [np.stack(corner, axis=1)[where] for where, children in patterns for corner in children]
    parents = [np.flatnonzero(where) for where, children in patterns for _ in children]
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")  # children stay where their parent was
    return np.concatenate(triangles)[order].astype(np.int64), parent[order]
