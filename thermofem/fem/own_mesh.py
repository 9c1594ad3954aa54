"""A mesh of the user's own: it must fill the domain of the geometry, in groups named after its layers and parts."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .. import checks
from ..arrays import Indices
from ..checks import InputError
from ..geometry.cross_section import CrossSection
from ..geometry.regions import CUT_GRID, SIDES
from ..materials.material_library import VOID
from ..mesh import Mesh, load
from ..mesh.triangles import signed_areas

log = logging.getLogger("thermofem")
OTHER_DOMAIN = "matrices of any other domain enter as th.StateSpace(E, A, B, C)"


def own_mesh(geometry: CrossSection, mesh: Mesh | str | Path) -> Mesh:
    """Return a mesh, of a file if it is a path, after checks that it fills the domain of the geometry.

    Its triangles say what shape a layer or part has; the geometry says of what it is made, and what the sides do.

    Raises InputError: groups that the geometry does not have, a heated part without triangles, an outline that is not
    that of the geometry.
    """
    if not isinstance(mesh, Mesh):
        mesh = load(checks.path("mesh", mesh))
    groups, region = np.unique(mesh.region, return_inverse=True)  # a name without triangles is no group
    names = tuple(mesh.region_names[k] for k in groups)
    mesh = replace(mesh, region=region, region_names=names)
    solid = [name for name, material in geometry.material_names.items() if material != VOID]
    for name in mesh.region_names:
        checks.choice("mesh: group", name, solid, hint="groups are named after layers and parts of the geometry")
    for name in geometry.heated:
        checks.choice("mesh: heated part", name, mesh.region_names, hint="each heated part needs a group of triangles")
    _check_outline(geometry, mesh)
    _warn_of_places(geometry, mesh)
    return mesh


def _warn_of_places(geometry: CrossSection, mesh: Mesh) -> None:
    """Say which groups lie for the most part outside of the layer or part that they are named after."""
    area = signed_areas(mesh.points, mesh.triangles)
    r, z = mesh.points[mesh.triangles].mean(axis=1).T / CUT_GRID
    inside = np.zeros(len(area), dtype=bool)
    for face in geometry.subdivision.faces:
        in_face = shapely.contains_xy(face.polygon, r, z)
        if face.owner in mesh.region_names:
            inside |= in_face & (mesh.region == mesh.region_names.index(face.owner))
    for k, name in enumerate(mesh.region_names):
        group = mesh.region == k
        outside = area[group & ~inside].sum() / area[group].sum()
        if outside > 0.5:
            log.warning(
                "mesh: %.0f %% of the group %r lies outside of %r in the geometry %r; are the names exchanged?",
                100 * outside,
                name,
                name,
                geometry.name,
            )


def _check_outline(geometry: CrossSection, mesh: Mesh) -> None:
    """Check that the outline of a mesh, without holes, lies on the sides of the geometry, and reaches all of them."""
    ends = mesh.points[_outline(mesh)]
    r, z = ends.mean(axis=1).T
    on_side = np.array([geometry.on_boundary(side, r, z) for side in SIDES])
    outside = ~on_side.any(axis=0)
    if outside.any():
        k = int(np.argmax(outside))
        raise InputError(
            f"the outline of the mesh at r = {r[k]:g} m, z = {z[k]:g} m lies on no side of {geometry.name!r}; its "
            "layers and outer_radius must be those of the mesh",
            OTHER_DOMAIN,
        )
    corners = geometry.subdivision.corners
    span = np.array([ends.min(axis=(0, 1)), ends.max(axis=(0, 1))])
    expected = np.array([corners.min(axis=0), corners.max(axis=0)])
    # 1e-6: gmsh's files round coordinates
    if np.abs(span - expected).max() > 1e-6 * np.abs(expected).max():
        (r0, z0), (r1, z1) = span
        raise InputError(
            f"the mesh spans r = {r0:g} to {r1:g} m and z = {z0:g} to {z1:g} m, not the domain of {geometry.name!r}",
            OTHER_DOMAIN,
        )


def _outline(mesh: Mesh) -> Indices:
    """Return the facets of the outer loop of a mesh, shape (facets, 2): those connected to its outermost vertex."""
    grid = mesh.skfem
    facets = grid.facets[:, grid.boundary_facets()]
    count = len(mesh.points)
    graph = coo_matrix((np.ones(facets.shape[1]), facets), shape=(count, count))
    _, loop = connected_components(graph, directed=False)
    outermost = facets[0, np.argmax(mesh.points[facets[0], 0])]
    return facets[:, loop[facets[0]] == loop[outermost]].T
