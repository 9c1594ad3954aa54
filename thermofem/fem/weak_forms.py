"""Weak forms of the heat equation on a mesh: capacity, conduction, boundaries, contacts and volume means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import skfem
from skfem.quadrature import get_quadrature

from ..algebra.factor import Pencil
from ..arrays import Array, ArrayLike, Indices, Mask, scattered, summed
from ..geometry.section_parts import AMBIENT
from ..mesh.triangles import radii
from ..models import StateSpace
from .surfaces import Surfaces, surface_terms

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..mesh import Mesh
    from ..mesh.triangles import Grid


@dataclass(frozen=True, eq=False)
class Discretization:
    """Matrices of the heat equation on all unknowns, before any temperature is held.

    Attributes
    ----------
    basis : skfem.CellBasis
        P2 on triangles.
    mass, stiffness : sparse, shape (n, n); J/K and W/K
        stiffness includes convective and open boundaries, and contacts.
    means : dict from region name to array, shape (n,)
        functional of the volume mean; its entries sum to one.
    held : array of int
        unknowns at the ambient temperature.
    surfaces : Surfaces
    """

    basis: Any
    mass: Any
    stiffness: Any
    means: Mapping[str, Array]
    held: Indices
    surfaces: Surfaces = field(default_factory=Surfaces)

    @cached_property
    def free(self) -> Indices:
        """Unknowns that are not held."""
        return np.setdiff1d(np.arange(self.mass.shape[0]), self.held)

    @cached_property
    def E(self) -> Any:
        """Capacity of the free unknowns, sparse, J/K."""
        return self.mass[self.free][:, self.free]

    @cached_property
    def K(self) -> Any:
        """Conduction between the free unknowns, sparse, W/K."""
        return self.stiffness[self.free][:, self.free]

    @cached_property
    def factors(self) -> Pencil:
        """Factorizations of combinations of E and K."""
        return Pencil(self.E, self.K)

    @cached_property
    def inflow(self) -> Array:
        """Heat into the free unknowns f per kelvin of the ambient, K_ff 1, in W/K, shape (free,).

            M_ff dx/dt = -K_ff x + (-K_fh 1 + int 2 pi r h u_f ds) T_a - M_fh 1 dT_a/dt,    h: held unknowns

        Conduction and contacts have zero row sums, so the bracket is K_ff 1: of convective and open sides, and of what
        is held. The last term is left out: it would ask for a direct path from T_a to the outputs. On a slab of 30 um
        of oxide in triangles of up to 4 um, T_top/T_bottom = 1/cosh(L sqrt(s/D)) is then met to 5e-5 of the static gain
        (to 3e-6 with that term), see tests/thermofem/test_ambient.py.
        """
        # in extended precision: the sum of a row is 1e-4 of its entries or less
        rows = np.add.reduceat(self.K.data.astype(np.longdouble), self.K.indptr[:-1])
        return np.asarray(rows, dtype=float)

    def state_space(self, heated: tuple[str, ...], read: tuple[str, ...]) -> StateSpace:
        """StateSpace E = M, A = -K on the free unknowns, with B and C from the volume means, or B from `inflow`."""
        B = np.array([self.inflow if name == AMBIENT else self.means[name][self.free] for name in heated])
        C = np.array([self.means[name][self.free] for name in read])
        return StateSpace(E=self.E, A=-self.K, B=B.T, C=C, inputs=heated, outputs=read)


def discretize(
    mesh: Mesh, conductivity: ArrayLike, heat_capacity: ArrayLike, surfaces: Surfaces, *, degree: int = 2
) -> Discretization:
    """Assemble M, K and the volume means.

        M_ij = int 2 pi r rho c_p u_i u_j dA,   K_ij = int 2 pi r k grad u_i . grad u_j dA + terms of the surfaces

    Parameters
    ----------
    mesh : Mesh
    conductivity : array, shape (triangles,) or (2, triangles) for k_r and k_z, or scalar; W/(m K)
    heat_capacity : array, shape (triangles,), or scalar; J/(m^3 K)
    surfaces : Surfaces
    degree : int
        of the polynomials: 2, or 3 for references.
    """
    element = {2: skfem.ElementTriP2, 3: skfem.ElementTriP3}[degree]()
    basis = skfem.Basis(mesh.skfem, element, intorder=2 * degree + 1)
    K = element_conduction(basis, conductivity)
    M = element_capacity(basis, heat_capacity)
    both = assembled(basis, K + 1j * M)  # one sparsity pattern for both
    stiffness = both.real
    if surfaces.any:
        stiffness = stiffness + surface_terms(basis, conductivity, surfaces)
    means = {name: mean(basis, mesh.region == index) for index, name in enumerate(mesh.region_names)}
    held = np.empty(0, dtype=np.intp)
    if len(surfaces.held):
        held = basis.get_dofs(surfaces.held).all()
    return Discretization(basis, both.imag, stiffness.tocsr(), means, held, surfaces)


def properties(geometry: CrossSection, mesh: Mesh) -> tuple[Array, Array]:
    """k_r, k_z in W/(m K), shape (2, triangles), and rho c_p in J/(m^3 K), at the ambient temperature."""
    rows = [geometry.material_of(name).at(geometry.ambient) for name in mesh.region_names]
    k_r, k_z, capacity = np.transpose(rows)[:, mesh.region]
    return np.stack([k_r, k_z]), capacity


def conduction(basis: Any, conductivity: ArrayLike) -> Any:
    """K_ij = int 2 pi r (k_r du_i/dr du_j/dr + k_z du_i/dz du_j/dz) dA, sparse."""
    return assembled(basis, element_conduction(basis, conductivity))


def capacity(basis: Any, heat_capacity: ArrayLike) -> Any:
    """M_ij = int 2 pi r rho c_p u_i u_j dA, sparse."""
    return assembled(basis, element_capacity(basis, heat_capacity))


def element_conduction(basis: Any, conductivity: ArrayLike, points: Any = None) -> Array:
    """K of every triangle, shape (triangles, b, b) with b its basis functions; exact, as r is linear.

    points: as of `maps`.

    With J its map from the reference triangle, r_i the radius of corner i and reference integrals S,

        K = 2 pi sum_mni (J^-1 diag(k_r, k_z) J^-T)_mn |det J| r_i S_mni,   S_mni = int l_i d_m u d_n u^T
    """
    inverse, det, r = maps(basis.mesh, points)
    k = np.broadcast_to(np.asarray(conductivity), (2, basis.nelems))
    metric = 2 * np.pi * det * np.einsum("mde,de,nde->mne", inverse, k, inverse)
    weights = (metric[:, :, None] * r).reshape(-1, basis.nelems)
    elements = weights.T @ reference(basis).stiffness
    return elements.reshape(basis.nelems, basis.Nbfun, basis.Nbfun)


def element_capacity(basis: Any, heat_capacity: ArrayLike, points: Any = None) -> Array:
    """M of every triangle, shape (triangles, b, b): 2 pi rho c_p |det J| sum_i r_i int l_i u u^T."""
    _, det, r = maps(basis.mesh, points)
    capacities = np.broadcast_to(np.asarray(heat_capacity), basis.nelems)
    weights = 2 * np.pi * det * capacities * r
    elements = weights.T @ reference(basis).mass
    return elements.reshape(basis.nelems, basis.Nbfun, basis.Nbfun)


def assembled(basis: Any, elements: Array, local: Any = slice(None)) -> Any:
    """Assemble the matrices of all triangles, or the rows of their ``local`` functions, to a sparse matrix."""
    dofs = basis.element_dofs.T
    return scattered(elements, dofs[:, local], dofs, basis.N)


def maps(grid: Grid, points: Any = None) -> tuple[Array, Array, Array]:
    """Maps of the triangles from the reference triangle: J^-1, |det J| and `radii` of the corners.

    Their shapes are (2, 2, triangles), (triangles,) and (3, triangles), with J = d(r, z)/d(reference).

    points [shape (2, vertices), m]: default those of the grid; complex where a derivative is taken by a complex step.
    """
    corners = (grid.p if points is None else points)[:, grid.t]
    a, c = corners[:, 1] - corners[:, 0]
    b, d = corners[:, 2] - corners[:, 0]
    det = a * d - b * c
    inverse = np.array([[d, -b], [-c, a]]) / det
    return inverse, magnitude(det), radii(corners[0], grid.depth)


def magnitude(det: Any) -> Any:
    """|det| of real numbers, continued analytically to complex ones."""
    return det * np.sign(det.real)


class ReferenceTriangle(NamedTuple):
    """Integrals on the reference triangle, with l_i linear and u the b functions of the element.

    load [shape (3, b)]: of l_i u.
    mass [shape (3, b b)]: of l_i u u^T.
    stiffness [shape (2 2 3, b b)]: of l_i d_m u d_n u^T.
    """

    load: Array
    mass: Array
    stiffness: Array


def reference(basis: Any) -> ReferenceTriangle:
    """Integrals on the reference triangle for the element of a basis."""
    kind: Any = type(basis.elem)
    return _integrals(kind)


@cache
def _integrals(element: Any) -> ReferenceTriangle:
    elem = element()
    X, W = get_quadrature(elem.refdom, 2 * elem.maxdeg + 1)
    u, du = map(np.array, zip(*(elem.lbasis(X, k) for k in range(len(elem.doflocs))), strict=True))
    corner = np.array([1 - X[0] - X[1], X[0], X[1]])
    mass = np.einsum("iq,aq,bq,q->iab", corner, u, u, W)
    stiff = np.einsum("iq,amq,bnq,q->mniab", corner, du, du, W)
    return ReferenceTriangle(np.einsum("iq,aq,q->ia", corner, u, W), mass.reshape(3, -1), stiff.reshape(12, -1))


def mean(basis: Any, inside: Mask) -> Array:
    """Functional of the volume mean over the triangles ``inside``, shape (n,); its entries sum to one."""
    integral = volume(basis, inside)
    return integral / integral.sum()


def volume(basis: Any, inside: Mask, points: Any = None) -> Any:
    """Integral of 2 pi r times each basis function over the triangles ``inside``, in m^3; ``points`` as of `maps`."""
    _, det, r = maps(basis.mesh, points)
    weights = 2 * np.pi * det[inside] * r[:, inside]
    return summed(basis.element_dofs.T[inside], weights.T @ reference(basis).load, basis.N)
