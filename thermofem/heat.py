"""The axisymmetric heat equation on a meshed cross-section, as matrices.

    rho c_p dT/dt = div(k grad T) + q,    q = P / V_part in a heated part,    dT = mean of T - T0 over a part

With the weight 2 pi r everywhere and P2 triangles this is  M dx/dt = -K x + c P,  dT = c^T x: the same functional c
(volume mean over the part) heats and reads, so the system is symmetric and passive.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks
from .model import StateSpace
from .transient import Ledger

if TYPE_CHECKING:
    from .geometry import CrossSection
    from .mesh import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Discretization:
    """Matrices of the heat equation on all unknowns, before any temperature is held.

    Attributes
    ----------
    basis : skfem.CellBasis
        P2 on triangles.
    mass, stiffness : sparse, shape (n, n); J/K and W/K
        stiffness includes the convective boundaries.
    means : dict from region name to array, shape (n,)
        functional of the volume mean; its entries sum to one.
    held : array of int
        unknowns at the ambient temperature.
    """

    basis: Any
    mass: Any
    stiffness: Any
    means: Mapping[str, Array]
    held: NDArray[np.intp]

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Unknowns that are not held."""
        return np.setdiff1d(np.arange(self.mass.shape[0]), self.held)

    def state_space(self, heated: tuple[str, ...], read: tuple[str, ...]) -> StateSpace:
        """E = M, A = -K on the free unknowns; B and C from the volume means."""
        free = self.free
        return StateSpace(
            E=self.mass[free][:, free],
            A=-self.stiffness[free][:, free],
            B=np.column_stack([self.means[name][free] for name in heated]),
            C=np.vstack([self.means[name][free] for name in read]),
            inputs=heated,
            outputs=read,
        )

    @cached_property
    def ledger(self) -> Ledger:
        """Heat stored is 1^T M x; heat leaves through held unknowns and convective boundaries.

        The rows of the held unknowns, left out of the system, give their reaction: -(M dx/dt + K x) is the heat that
        flows out there; 1^T K x over all rows is the convective loss, as K of pure conduction has zero column sums.
        """
        free, held = self.free, self.held
        convective = np.asarray(self.stiffness.sum(axis=0)).ravel()[free]
        return Ledger(
            storage=np.asarray(self.mass.sum(axis=0)).ravel()[free],
            drain_A=convective - np.asarray(self.stiffness[held].sum(axis=0)).ravel()[free],
            drain_E=-np.asarray(self.mass[held].sum(axis=0)).ravel()[free],
        )


def discretize(
    mesh: Mesh,
    conductivity: ArrayLike,
    heat_capacity: ArrayLike,
    *,
    held: NDArray[np.intp],
    convection: Mapping[float, NDArray[np.intp]] | None = None,
) -> Discretization:
    """Assemble M, K and the volume means.

        M_ij = int 2 pi r rho c_p u_i u_j dA,   K_ij = int 2 pi r k grad u_i . grad u_j dA + int 2 pi r h u_i u_j ds

    Parameters
    ----------
    mesh : Mesh
    conductivity, heat_capacity : array, shape (triangles,) or scalar; W/(m K) and J/(m^3 K)
    held : array of int
        boundary facets at the ambient temperature (numbered as `facets` does).
    convection : dict from h in W/(m^2 K) to an array of facets
    """
    import skfem
    from skfem.helpers import dot, grad

    grid = skfem_mesh(mesh)
    basis = skfem.Basis(grid, skfem.ElementTriP2(), intorder=5)
    cells = np.ones(grid.nelements)

    @skfem.BilinearForm
    def capacity(u, v, w):  # type: ignore[no-untyped-def]
        return 2 * np.pi * w.x[0] * w["rho_c"] * u * v

    @skfem.BilinearForm
    def conduction(u, v, w):  # type: ignore[no-untyped-def]
        return 2 * np.pi * w.x[0] * w["k"] * dot(grad(u), grad(v))

    @skfem.BilinearForm
    def exchange(u, v, w):  # type: ignore[no-untyped-def]
        return 2 * np.pi * w.x[0] * w["h"] * u * v

    @skfem.LinearForm
    def volume(v, w):  # type: ignore[no-untyped-def]
        return 2 * np.pi * w.x[0] * w["inside"] * v

    def per_cell(values: ArrayLike) -> Array:
        """A value in each triangle, spread over its quadrature points."""
        return np.broadcast_to((np.asarray(values) * cells)[:, None], basis.dx.shape)

    stiffness = conduction.assemble(basis, k=per_cell(conductivity))
    for h, where in (convection or {}).items():
        stiffness = stiffness + exchange.assemble(basis.boundary(where), h=h)
    means = {}
    for index, name in enumerate(mesh.region_names):
        integral = volume.assemble(basis, inside=per_cell(mesh.region == index))
        means[name] = integral / integral.sum()
    return Discretization(
        basis=basis,
        mass=capacity.assemble(basis, rho_c=per_cell(heat_capacity)).tocsr(),
        stiffness=stiffness.tocsr(),
        means=means,
        held=basis.get_dofs(held).all() if len(held) else np.empty(0, dtype=np.intp),
    )


def skfem_mesh(mesh: Mesh) -> Any:
    """The triangles as scikit-fem holds them."""
    import skfem

    return skfem.MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))
