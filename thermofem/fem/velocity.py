"""Velocities of the mesh vertices with respect to each parameter of the geometry."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..geometry.corners import CornerMotion

if TYPE_CHECKING:
    from ..geometry.change import Change
    from ..geometry.cross_section import CrossSection
    from ..mesh import Mesh


def vertex_velocities(
    geometry: CrossSection, mesh: Mesh, changes: Sequence[Change], *, roles: Collection[str] = ()
) -> Array:
    """Velocity of every vertex for every parameter, in m per unit; shape (parameters, vertices, 2).

    mesh: of this geometry, cut open along interfaces or not.
    roles: regions that are heated or read.
    Raises InputError: a face would appear or vanish.
    """
    from ..mesh.motion import Motion

    total = np.zeros((len(changes), *mesh.points.shape))
    moving = [k for k, change in enumerate(changes) if change.moves]
    if not moving:
        return total
    outlines, motion = CornerMotion(geometry, roles), Motion(mesh, geometry)
    number = {(r, z): k for k, (r, z) in enumerate(outlines.edges.corners.tolist())}
    order = [number[r, z] for r, z in motion.corners.tolist()]
    for k in moving:
        total[k] = motion.velocity(outlines.corner_velocities(changes[k])[order])
    return total
