"""The temperature as a mode sees it: one more linear functional of the heat problem.

    <T> = int n (dn/dT) T |E|^2 dV / int n (dn/dT) |E|^2 dV,      -dw/w = K <T>

with K `Mode.thermo_optic`. Its entries sum to one like those of a mean over a region.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, NDArray
from .window import UM

if TYPE_CHECKING:
    from .mode import Mode
    from .modes import Light


def light_integral(mode: Mode, basis: Any, mesh: Any = None, shift: float = 0.0) -> Array:
    """Integral of n (dn/dT) |E|^2 times each function of a scalar basis on the heat mesh, shape (functions,).

    mesh, shift: scikit-fem's mesh of the basis with its vertices moved, and by how many m the core's centre moved.
    """
    mesh = basis.mesh if mesh is None else mesh
    light: Light = mode.light  # type: ignore[assignment]
    weight = mode.thermal_density * mode.space.arc * mode.space.dx
    hot = np.flatnonzero(weight.any(axis=1))  # air has no heat and no triangles
    places = mode.space.points[:, hot].reshape(2, -1) / UM + np.array([[light.centre + shift], [0.0]])
    if light.geometry.mirrored:
        places[0] = np.abs(places[0])
    cells, _ = containing(mesh, places)
    return point_sum(basis, mesh, places, cells, weight[hot].ravel())


def point_sum(basis: Any, mesh: Any, places: Array, cells: NDArray[np.intp], weights: Array) -> Array:
    """Sum over points (2, n), which lie in these triangles of a mesh, of weight times each function of a basis."""
    local = mesh.mapping().invF(places[:, :, None], tind=cells)[:, :, 0]
    values = np.array([basis.elem.lbasis(local, k)[0] for k in range(basis.Nbfun)])
    numbers = basis.element_dofs[:, cells].ravel()
    return np.bincount(numbers, (values * weights).ravel(), minlength=basis.N).astype(float)


def containing(mesh: Any, places: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Number of a triangle around each point, and whether there is one; points of shape (2, n)."""
    import shapely

    corners = (mesh.p[:, mesh.t] * UM).transpose(2, 1, 0)
    tree = shapely.STRtree(shapely.polygons(corners))
    which, cells = tree.query(shapely.points(places.T * UM), predicate="intersects")
    found, there = np.zeros(places.shape[1], dtype=np.intp), np.zeros(places.shape[1], dtype=bool)
    found[which], there[which] = cells, True
    return found, there
