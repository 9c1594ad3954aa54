"""How the vertices of a mesh move with the outlines of its geometry.

Vertices on edges of the subdivision move with them, linearly between their ends; the others follow a harmonic field
that is stiffer where triangles are small, so that the small ones hardly change their shape:

    sum over triangles of weight grad v . grad w = 0,    weight = 1/longest edge
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..factor import factorize
from ..geometry.motion import Motion

if TYPE_CHECKING:
    from ..geometry.change import Change
    from ..geometry.cross_section import CrossSection
    from ..mesh import Mesh

Array = NDArray[np.float64]


def vertex_velocities(
    geometry: CrossSection, mesh: Mesh, changes: Sequence[Change], *, roles: Collection[str] = ()
) -> Array:
    """Velocity of every vertex for every parameter, in m per unit; shape (parameters, vertices, 2).

    Parameters
    ----------
    geometry : CrossSection
    mesh : Mesh
        of this geometry, cut open along interfaces or not.
    changes : sequence of Change
    roles : collection of str
        regions that are heated or read.

    Raises
    ------
    InputError
        a face would appear or vanish.
    """
    total = np.zeros((len(changes), *mesh.points.shape))
    moving = [k for k, change in enumerate(changes) if change.moves]
    if not moving:
        return total
    motion = Motion(geometry, roles)
    corners = np.array([motion.corner_velocities(changes[k]) for k in moving])
    node, edge, share = on_edges(motion, mesh.points)
    start, stop = (corners[:, motion.edges.ends[edge, end]] for end in (0, 1))
    there = start + share[:, None] * (stop - start)
    fixed = np.zeros((len(moving), *mesh.points.shape))
    fixed[:, node] = there
    total[moving] = spread(mesh, node, fixed)
    return total


def on_edges(motion: Motion, points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Vertices that lie on an edge of the subdivision: their numbers, the edge, and how far along it (0 to 1)."""
    edge = np.full(len(points), -1, dtype=np.intp)
    share = np.zeros(len(points))
    for k, (a, b) in enumerate(motion.edges.corners[motion.edges.ends]):
        along = b - a
        place = (points - a) @ along / (along @ along)
        away = np.abs((points - a) @ np.array([-along[1], along[0]])) / np.linalg.norm(along)
        slack = motion.slack / np.linalg.norm(along)
        here = (away < motion.slack) & (place > -slack) & (place < 1 + slack)
        edge[here], share[here] = k, np.clip(place[here], 0, 1)
    node = np.flatnonzero(edge >= 0)
    return node, edge[node], share[node]


def spread(mesh: Mesh, node: NDArray[np.intp], fixed: Array) -> Array:
    """Velocities of all vertices from those at ``node``; shapes (parameters, vertices, 2)."""
    from scipy.sparse import csr_matrix

    t = mesh.triangles
    corners = mesh.points[t]
    opposite = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)  # the edge opposite to each corner
    first, second = opposite[:, 0], opposite[:, 1]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    longest = np.linalg.norm(opposite, axis=-1).max(axis=1)
    local = np.einsum("eia,eja->eij", opposite, opposite) / (4 * area * longest)[:, None, None]
    rows, columns = (np.broadcast_to(x, local.shape).ravel() for x in (t[:, :, None], t[:, None, :]))
    matrix = csr_matrix((local.ravel(), (rows, columns)), shape=(len(mesh.points),) * 2)
    inner = np.setdiff1d(np.arange(len(mesh.points)), node)
    result = fixed.copy()
    if inner.size:
        solve = factorize(matrix[inner][:, inner])
        coupling = matrix[inner][:, node]
        for velocity in result:
            for component in range(2):
                if np.any(velocity[node, component]):
                    velocity[inner, component] = -solve(coupling @ velocity[node, component])
    return result
