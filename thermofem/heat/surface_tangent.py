"""Derivatives of convection, open sides and contacts: facets move, coefficients change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .interface import PERFECT

if TYPE_CHECKING:
    from ..geometry.change import Change
    from .problem import HeatProblem

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # of scikit-fem's facets of quadratic triangles, too
_GAUSS, _WEIGHT = (1 + _NODES) / 2, _WEIGHTS / 2


def surface_tangent(heat: HeatProblem, change: Change, moved: Array, k: Array, of_k: Array) -> Any:
    """d of `matrices.surface_terms`."""
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
