"""The axisymmetric heat equation on a meshed cross-section, as matrices.

    rho c_p dT/dt = div(k grad T) + q,    q = P / V_part in a heated part,    dT = mean of T - T0 over a part

With the weight 2 pi r everywhere and P2 triangles this is  M dx/dt = -K x + c P,  dT = c^T x: the same functional c
(volume mean over the part) heats and reads, so the system is symmetric and passive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks
from .factor import Solve, factorize
from .model import StateSpace
from .transient import Ledger

if TYPE_CHECKING:
    from .geometry import CrossSection
    from .mesh import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeatProblem:
    """The heat problem of one cross-section: what `assemble` gives back.

    Attributes
    ----------
    geometry : CrossSection
    mesh : Mesh
    discretization : Discretization
    accuracy : float
        for which the mesh was sized.
    """

    geometry: CrossSection
    mesh: Mesh
    discretization: Discretization
    accuracy: float

    @property
    def heated(self) -> tuple[str, ...]:
        """Names of the parts that may carry absorbed power."""
        return self.geometry.heated

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of every layer and part; each can be read."""
        return self.mesh.region_names

    @property
    def unknowns(self) -> int:
        """Number of temperatures solved for."""
        return int(self.discretization.free.size)

    @cached_property
    def system(self) -> StateSpace:
        """The FEM itself as a thermal model: every heated part is an input and an output."""
        return self.channels(self.heated, self.heated)

    def channels(
        self, heated: str | Sequence[str] | None = None, read: str | Sequence[str] | None = None
    ) -> StateSpace:
        """The FEM with chosen inputs and outputs.

        Parameters
        ----------
        heated : str or sequence of str
            heated parts; default all of them.
        read : str or sequence of str
            layers or parts whose mean is read; default the heated ones.

        Raises
        ------
        InputError
            a name that is no heated part, or no region.
        """
        inputs = _names("heated", heated, self.heated, self.heated)
        outputs = _names("read", read, self.regions, inputs)
        return self.discretization.state_space(inputs, outputs)

    @cached_property
    def _static(self) -> Solve:
        """Solve K x = right-hand side on the free unknowns."""
        free = self.discretization.free
        return factorize(self.discretization.stiffness[free][:, free])

    def thermal_resistance(self, heated: str | None = None, read: str | None = None) -> float:
        """Steady mean rise of ``read`` per watt in ``heated``, in K/W; defaults: the first heated part, and itself.

        >>> round(assemble(strip_ring()).thermal_resistance("core") / 1e3, 2)  # K/mW
        7.86
        """
        channel = self.channels(heated or self.heated[0], read or heated or self.heated[0])
        return float(channel.C[0] @ self._static(channel.B[:, 0]))

    def field(self, state: ArrayLike) -> Array:
        """Temperature rise in K at every vertex of the mesh, from states of shape (..., unknowns) of the system."""
        state = np.asarray(state, dtype=float)
        everywhere = np.zeros((*state.shape[:-1], self.discretization.mass.shape[0]))
        everywhere[..., self.discretization.free] = state
        return everywhere[..., self.discretization.basis.nodal_dofs[0]]


def assemble(geometry: CrossSection, accuracy: float = 1e-3) -> HeatProblem:
    """Mesh a cross-section and assemble its heat problem.

    Parameters
    ----------
    geometry : CrossSection
    accuracy : float
        wanted relative error of R_th and of the step response from 1 ns on; it picks the mesh sizes. The meshes of the
        reference strip are committed; any other is made by gmsh.

    Raises
    ------
    InputError
        accuracy out of range, or a feature that this version does not build.
    MissingLibraryError
        a mesh must be made and gmsh cannot be loaded.
    """
    from .mesh import mesh_for

    geometry.check_buildable()
    mesh = mesh_for(geometry, accuracy)
    materials = [geometry.material_of(name) for name in mesh.region_names]
    conductivity = np.array([m.conductivity for m in materials])[mesh.region]
    heat_capacity = np.array([m.heat_capacity for m in materials])[mesh.region]
    held, convection = _boundaries(geometry, mesh)
    discretization = discretize(mesh, conductivity, heat_capacity, held=held, convection=convection)
    return HeatProblem(geometry, mesh, discretization, accuracy)


def _boundaries(geometry: CrossSection, mesh: Mesh) -> tuple[NDArray[np.intp], dict[float, NDArray[np.intp]]]:
    """Held facets, and the facets of every convection coefficient."""
    grid = skfem_mesh(mesh)
    facets = grid.boundary_facets()
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    held: list[NDArray[np.intp]] = [np.empty(0, dtype=np.intp)]
    convection: dict[float, NDArray[np.intp]] = {}
    for side in ("bottom", "top", "outer"):
        boundary = getattr(geometry, side)
        where = facets[geometry.on_boundary(side, r, z)]
        if boundary.kind == "isothermal":
            held.append(where)
        elif boundary.kind == "convection":
            convection[boundary.coefficient] = np.append(convection.get(boundary.coefficient, held[0]), where)
    return np.concatenate(held), convection


def _names(
    argument: str, given: str | Sequence[str] | None, known: Sequence[str], default: Sequence[str]
) -> tuple[str, ...]:
    """One or several names, each checked against the known ones."""
    names = tuple(default) if given is None else (given,) if isinstance(given, str) else tuple(given)
    if not names:
        raise checks.InputError(f"{argument} is empty; give at least one of {', '.join(known)}")
    return tuple(checks.choice(argument, name, known) for name in names)


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
