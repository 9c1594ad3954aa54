"""Boundary conditions and contacts: their facets, their weak forms in the stiffness, and the derivatives of those.

K_ij += int 2 pi r h u_i u_j ds                               where heat h (T - T0) is exchanged with the ambient
K_ij += int 2 pi r (u_i^+ - u_i^-) (u_j^+ - u_j^-) / R ds     over every contact of resistance R
K_ij += int 2 pi r (n . d) / (d . k^-1 d) u_i u_j ds          over open sides, d from the source
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .interface import PERFECT, contacts

if TYPE_CHECKING:
    from ..geometry.change import Change
    from ..geometry.cross_section import CrossSection
    from ..mesh import Mesh
    from .problem import HeatProblem

Array = NDArray[np.float64]
Facets = NDArray[np.intp]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # of scikit-fem's facets of quadratic triangles, too
_GAUSS, _WEIGHT = (1 + _NODES) / 2, _WEIGHTS / 2


def _none() -> Facets:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Boundary conditions and contacts on facets, numbered as scikit-fem does on the same mesh.

    Attributes
    ----------
    held : array of int
        at the ambient temperature.
    convection : dict from h in W/(m^2 K) to an array of int
    open : array of int
        beyond which the material goes on, see `parts.Boundary`.
    source : float, m
        height z of the heat, from which the open sides are seen.
    contacts : dict from resistance in m^2 K/W to two arrays of int
        facets that lie on each other, both in the same order.
    """

    held: Facets = field(default_factory=_none)
    convection: Mapping[float, Facets] = field(default_factory=dict)
    open: Facets = field(default_factory=_none)
    source: float = 0.0
    contacts: Mapping[float, tuple[Facets, Facets]] = field(default_factory=dict)


def surfaces_of(geometry: CrossSection, mesh: Mesh, resistance: dict[str, float]) -> Surfaces:
    """Held, convective and open facets, and contacts."""
    grid = mesh.skfem
    facets = grid.boundary_facets()
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    none = np.empty(0, dtype=np.intp)
    where = {"isothermal": none, "open": none, "insulated": none}
    convection: dict[float, Facets] = {}
    for side in ("bottom", "top", "outer"):
        boundary = getattr(geometry, side)
        there = facets[geometry.on_boundary(side, r, z)]
        h = boundary.exchange(geometry.ambient)
        if h:
            convection[h] = np.append(convection.get(h, none), there)
        else:
            where[boundary.kind] = np.append(where[boundary.kind], there)
    heat = next(part for part in geometry.parts if part.heated)
    return Surfaces(
        held=where["isothermal"],
        convection=convection,
        open=where["open"],
        source=heat.bottom + heat.height / 2,
        contacts=contacts(mesh, resistance),
    )


def surface_terms(basis: Any, conductivity: ArrayLike, surfaces: Surfaces) -> Any:
    """Terms of convection, open sides and contacts in the stiffness, sparse."""
    import skfem
    from scipy.sparse import csr_matrix

    @skfem.BilinearForm
    def exchange(u, v, w):  # type: ignore[no-untyped-def]
        return 2 * np.pi * w.x[0] * w["h"] * u * v

    @skfem.BilinearForm
    def outlet(u, v, w):  # type: ignore[no-untyped-def]
        r, z = w.x[0], w.x[1] - surfaces.source
        slope = (w.n[0] * r + w.n[1] * z) / (r**2 / w["k_r"] + z**2 / w["k_z"])
        return 2 * np.pi * w.x[0] * slope * u * v

    total = csr_matrix((basis.N, basis.N))
    for h, where in surfaces.convection.items():
        total = total + exchange.assemble(basis.boundary(where), h=h)
    if len(surfaces.open):
        side = basis.boundary(surfaces.open)
        k = np.broadcast_to(np.asarray(conductivity, dtype=float), (2, basis.nelems))[:, side.tind]
        k_r, k_z = (np.broadcast_to(values[:, None], side.dx.shape) for values in k)
        total = total + outlet.assemble(side, k_r=k_r, k_z=k_z)
    for resistance, pair in surfaces.contacts.items():
        sides = [basis.boundary(facets) for facets in pair]
        for one in sides:
            for other in sides:
                sign = 1 if one is other else -1
                total = total + sign * exchange.assemble(one, other, h=1 / resistance)
    return total


def surface_tangent(heat: HeatProblem, change: Change, moved: Array, k: Array, of_k: Array) -> Any:
    """Derivative of `surface_terms`: facets move, coefficients change."""
    from scipy.sparse import csr_matrix

    d = heat.discretization
    total = csr_matrix((d.basis.N, d.basis.N))
    for h, facets in d.surfaces.convection.items():
        sides = _sides_of(heat, facets)
        of_h = np.array([change.convection.get(side, 0.0) for side in sides])
        side = _Side.of(d.basis, facets, moved)
        total = total + side.matrix(side, side.exchange(h, of_h))
    if len(d.surfaces.open):
        side = _Side.of(d.basis, d.surfaces.open, moved)
        cells = d.basis.mesh.f2t[0, d.surfaces.open]
        values = side.outlet(k[:, cells], of_k[:, cells], d.surfaces.source, _source(heat, change))
        total = total + side.matrix(side, values)
    for resistance, pair in d.surfaces.contacts.items():
        of_h = -(_contact(heat, change, pair[0]) + _contact(heat, change, pair[1])) / resistance**2
        both = [_Side.of(d.basis, facets, moved) for facets in pair]
        for one in both:
            for other in both:
                sign = 1 if one is other else -1
                total = total + sign * one.matrix(other, one.exchange(1 / resistance, of_h))
    return total


def _sides_of(heat: HeatProblem, facets: NDArray[np.intp]) -> list[str]:
    """The side of the domain on which each facet lies."""
    grid = heat.discretization.basis.mesh
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    found = np.full(len(facets), "", dtype=object)
    for side in ("bottom", "top", "outer"):
        found[heat.geometry.on_boundary(side, r, z)] = side
    return list(found)


def _contact(heat: HeatProblem, change: Change, facets: NDArray[np.intp]) -> Array:
    """d of the resistance that the part beside each facet brings."""
    cells = heat.discretization.basis.mesh.f2t[0, facets]
    resistance: dict[str, float] = {}
    for interface in heat.geometry.interfaces:
        resistance[interface.part] = resistance.get(interface.part, 0.0) + interface.resistance
    there = [change.contact.get(name, 0.0) * (resistance.get(name, 0.0) > PERFECT) for name in heat.mesh.region_names]
    return np.array(there)[heat.mesh.region[cells]]


def _source(heat: HeatProblem, change: Change) -> float:
    """d of the height from which open sides are seen: the middle of the first heated part."""
    part = next(part for part in heat.geometry.parts if part.heated)
    velocity = change.outlines.get(part.name)
    return 0.0 if velocity is None else float((velocity[0, 1] + velocity[3, 1]) / 2)


@dataclass(frozen=True, eq=False)
class _Side:
    """Facets with quadratic functions on them: ends a and b, then the middle.

    Attributes
    ----------
    dofs : int array, shape (3, f)
    ends, of_ends : array, shape (2, 2 ends, f), m
        positions and velocities.
    inward : array, shape (2, f)
        from the facet's middle to the triangle's third corner.
    """

    basis: Any
    dofs: NDArray[np.intp]
    ends: Array
    of_ends: Array
    inward: Array

    @classmethod
    def of(cls, basis: Any, facets: NDArray[np.intp], moved: Array) -> _Side:
        grid = basis.mesh
        vertices = grid.facets[:, facets]
        dofs = np.vstack([basis.nodal_dofs[0][vertices], basis.facet_dofs[0][facets]])
        centre = grid.p[:, grid.t[:, grid.f2t[0, facets]]].mean(axis=1)
        ends = grid.p[:, vertices]
        return cls(basis, dofs, ends, moved[:, vertices], centre - ends.mean(axis=1))

    @property
    def _shape(self) -> Array:
        """Quadratic functions at the Gauss points, shape (3, q)."""
        x = _GAUSS
        return np.array([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)])

    def _at(self, ends: Array) -> Array:
        """A linear function at the Gauss points, shape (..., q, f)."""
        return ends[..., 0, None, :] * (1 - _GAUSS[:, None]) + ends[..., 1, None, :] * _GAUSS[:, None]

    def _length(self) -> tuple[Array, Array]:
        along, of_along = (x[:, 1] - x[:, 0] for x in (self.ends, self.of_ends))
        length = np.linalg.norm(along, axis=0)
        return length, np.einsum("xf,xf->f", along, of_along) / length

    def exchange(self, h: float, of_h: Array) -> Array:
        """d(2 pi r h ds) at the Gauss points, shape (q, f)."""
        length, of_length = self._length()
        r, of_r = self._at(self.ends[0]), self._at(self.of_ends[0])
        return 2 * np.pi * (of_r * h * length + r * of_h * length + r * h * of_length)

    def outlet(self, k: Array, of_k: Array, source: float, of_source: float) -> Array:
        """d(2 pi r (n . d)/(d . k^-1 d) ds) at the Gauss points, shape (q, f); n ds turns the edge by 90 degrees."""
        along, of_along = (x[:, 1] - x[:, 0] for x in (self.ends, self.of_ends))
        outward = np.sign(-(along[1] * self.inward[0] - along[0] * self.inward[1]))
        n, of_n = (np.array([x[1], -x[0]]) * outward for x in (along, of_along))
        (r, z), (of_r, of_z) = self._at(self.ends), self._at(self.of_ends)
        z, of_z = z - source, of_z - of_source
        flux = n[0] * r + n[1] * z
        of_flux = of_n[0] * r + n[0] * of_r + of_n[1] * z + n[1] * of_z
        square = r**2 / k[0] + z**2 / k[1]
        of_square = 2 * r * of_r / k[0] - r**2 * of_k[0] / k[0] ** 2
        of_square = of_square + 2 * z * of_z / k[1] - z**2 * of_k[1] / k[1] ** 2
        return 2 * np.pi * ((of_r * flux + r * of_flux) / square - r * flux * of_square / square**2)

    def matrix(self, other: _Side, values: Array) -> Any:
        """Sparse sum of values u v, with u on this side and v on the other one."""
        from scipy.sparse import csr_matrix

        local = np.einsum("aq,bq,q,qf->fab", self._shape, self._shape, _WEIGHT, values)
        rows = np.broadcast_to(other.dofs.T[:, :, None], local.shape).ravel()
        columns = np.broadcast_to(self.dofs.T[:, None, :], local.shape).ravel()
        return csr_matrix((local.ravel(), (rows, columns)), shape=(self.basis.N,) * 2)
