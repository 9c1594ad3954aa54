"""A mesh that the user brings: its groups are the layers and parts of a geometry, which names materials and sides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .. import checks
from ..arrays import NDArray
from ..geometry.regions import SIDES
from ..materials.material_library import VOID
from ..mesh.triangles import Mesh, load

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection

HINT = "matrices of any other domain enter as th.StateSpace(E, A, B, C)"


def own_mesh(geometry: CrossSection, mesh: Mesh | str | Path) -> Mesh:
    """Return a mesh, of a file if it is a path, after checks that it fills the domain of the geometry.

    Its triangles say what shape a layer or part has; the geometry says of what it is made, and what the sides do.

    Raises InputError: groups that the geometry does not have, a heated part without triangles, an outline that is not
    that of the geometry.
    """
    found = mesh if isinstance(mesh, Mesh) else load(checks.path("mesh", mesh))
    materials = {layer.name: layer.material for layer in geometry.layers}
    materials |= {part.name: part.material for part in geometry.parts}
    solid = [name for name, material in materials.items() if material != VOID]
    for name in found.region_names:
        checks.choice("mesh: group", name, solid, hint="groups are named after layers and parts of the geometry")
    for name in geometry.heated:
        checks.choice("mesh: heated part", name, found.region_names, hint="each heated part needs a group of triangles")
    _check_outline(geometry, found)
    return found


def _check_outline(geometry: CrossSection, mesh: Mesh) -> None:
    """Check that the outline of a mesh, without holes, lies on the sides of the geometry, and reaches all of them."""
    ends = mesh.points[_outline(mesh)]
    r, z = ends.mean(axis=1).T
    on_side = np.array([geometry.on_boundary(side, r, z) for side in SIDES])
    outside = ~on_side.any(axis=0)
    if outside.any():
        k = int(np.argmax(outside))
        raise checks.InputError(
            f"the outline of the mesh at r = {r[k]:g} m, z = {z[k]:g} m lies on no side of {geometry.name!r}; its "
            "layers and outer_radius must be those of the mesh",
            HINT,
        )
    corners = geometry.subdivision.corners
    span = np.array([ends.min(axis=(0, 1)), ends.max(axis=(0, 1))])
    expected = np.array([corners.min(axis=0), corners.max(axis=0)])
    # 1e-6: gmsh's files round coordinates
    if np.abs(span - expected).max() > 1e-6 * np.abs(expected).max():
        (r0, z0), (r1, z1) = span
        raise checks.InputError(
            f"the mesh spans r = {r0:g} to {r1:g} m and z = {z0:g} to {z1:g} m, not the domain of {geometry.name!r}",
            HINT,
        )


def _outline(mesh: Mesh) -> NDArray[np.intp]:
    """Return the facets of the outer loop of a mesh, shape (facets, 2): those connected to its outermost vertex."""
    grid = mesh.skfem
    facets = grid.facets[:, grid.boundary_facets()]
    count = len(mesh.points)
    graph = coo_matrix((np.ones(facets.shape[1]), facets), shape=(count, count))
    _, loop = connected_components(graph, directed=False)
    outermost = facets[0, np.argmax(mesh.points[facets[0], 0])]
    return np.asarray(facets[:, loop[facets[0]] == loop[outermost]].T)
