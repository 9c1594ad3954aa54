"""The additional functions of cubic elements: one on every edge, one in every triangle.

    l_a l_b (l_a - l_b) on the edge a b,    l_0 l_1 l_2 inside

with l the barycentric coordinates. With the quadratic functions they span the cubics, in a basis in which the two
levels hardly couple: solved for alone, with the quadratic part kept as it is, the cubic functions add 0.82 to 0.98 of
the energy that they add together with it (measured on 12 random cross-sections at six shifts each).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from skfem import ElementTriP2
from skfem.element.element_h1 import ElementH1
from skfem.refdom import RefTri

from ..arrays import Array, NDArray
from .surfaces import surface_terms
from .weak_forms import element_capacity, element_conduction

if TYPE_CHECKING:
    from .heat_problem import HeatProblem
    from .weak_forms import Discretization

_EDGES = ((0, 1), (1, 2), (0, 2))
_SLOPES = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])  # of the barycentric coordinates
_QUADRATIC, _CUBIC = [0, 1, 2, 3, 5, 7], [4, 6, 8, 9]  # local functions of `ElementTriP2Enriched`


class ElementTriP2Enriched(ElementH1):
    """Triangle with quadratic and additional cubic functions: corners, (quadratic, cubic) on each edge, inside."""

    nodal_dofs, facet_dofs, interior_dofs, maxdeg = 1, 2, 1, 3
    dofnames = ("u", "u", "c", "c")
    doflocs = np.array([[0, 0], [1, 0], [0, 1], *([[0.5, 0]] * 2), *([[0.5, 0.5]] * 2), *([[0, 0.5]] * 2), [1 / 3] * 2])
    refdom = RefTri

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Function ``i`` and its gradient on the reference triangle."""
        if i < 3:
            return ElementTriP2().lbasis(X, i)
        edge, cubic = divmod(i - 3, 2)
        if edge < 3 and not cubic:
            return ElementTriP2().lbasis(X, 3 + edge)
        corner = np.array([1 - X[0] - X[1], X[0], X[1]])
        if edge == 3:
            others = np.array([corner[1] * corner[2], corner[2] * corner[0], corner[0] * corner[1]])
            return corner.prod(axis=0), np.tensordot(_SLOPES, others, axes=(0, 0))
        a, b = _EDGES[edge]
        p, q = corner[a], corner[b]
        slope = np.multiply.outer(_SLOPES[a], 2 * p * q - q * q) + np.multiply.outer(_SLOPES[b], p * p - 2 * p * q)
        return p * q * (p - q), slope


@dataclass(frozen=True, eq=False)
class Functions:
    """The quadratic functions of a mesh in the order of its basis, then the cubic ones: edges, triangles.

    It has what `weak_forms` and `surfaces` ask of a scikit-fem basis.
    """

    Nbfun: ClassVar[int] = 10  # on each triangle

    mesh: Any
    elem: Any
    element_dofs: NDArray[np.intp]
    N: int
    quadratic: int

    @property
    def nelems(self) -> int:
        """Number of triangles."""
        return int(self.element_dofs.shape[1])

    @classmethod
    def of(cls, basis: Any) -> Functions:
        """Number the cubic functions behind those of a quadratic basis."""
        grid, count, dofs = basis.mesh, basis.N, basis.element_dofs
        edges = count + grid.t2f.astype(np.intp)
        inside = count + grid.facets.shape[1] + np.arange(basis.nelems)
        rows = [*dofs[:3], dofs[3], edges[0], dofs[4], edges[1], dofs[5], edges[2], inside]
        total = count + grid.facets.shape[1] + basis.nelems
        return cls(grid, ElementTriP2Enriched(), np.stack(rows), total, count)


@dataclass(frozen=True, eq=False)
class Enrichment:
    """The cubic functions of a mesh: their matrices with themselves and with the quadratic ones, triangle by triangle.

    across [shapes (triangles, 4, 6); W/K and J/K]: K and M of the cubic functions of each triangle (rows) with its
        quadratic ones.
    own [shapes (4, 4, triangles)]: K and M between the cubic functions of each triangle, numbers side by side.
    quadratic, cubic [shapes (triangles, 6) and (triangles, 4)]: numbers of these functions; the cubic ones counted from
        0.
    surface [sparse, shape (cubic functions, all functions), or None]: what convection, open sides and contacts add to
        K.
    held: cubic functions on edges at the ambient temperature.
    """

    functions: Functions
    across: tuple[Array, Array]
    own: tuple[Array, Array]
    quadratic: NDArray[np.intp]
    cubic: NDArray[np.intp]
    surface: Any
    held: NDArray[np.intp]

    @classmethod
    def of(cls, d: Discretization, conductivity: Array, heat_capacity: Array) -> Enrichment:
        """Assemble it for k_r, k_z in W/(m K), shape (2, triangles), and rho c_p in J/(m^3 K), shape (triangles,)."""
        functions = Functions.of(d.basis)
        both = element_conduction(functions, conductivity), element_capacity(functions, heat_capacity)
        rows = [each[:, _CUBIC] for each in both]
        across = rows[0][:, :, _QUADRATIC], rows[1][:, :, _QUADRATIC]
        K, M = (np.ascontiguousarray(each[:, :, _CUBIC].transpose(1, 2, 0)) for each in rows)
        dofs, count, surface = functions.element_dofs.T, functions.quadratic, None
        if d.surfaces.any:
            surface = surface_terms(functions, conductivity, d.surfaces).tocsr()[count:]
        held = np.asarray(d.surfaces.held, dtype=np.intp)
        return cls(functions, across, (K, M), dofs[:, _QUADRATIC], dofs[:, _CUBIC] - count, surface, held)

    def mean(self, heat: HeatProblem, name: str) -> Array:
        """Functional of the mean over a region, a probe or the light, for the cubic functions."""
        integral, count = heat.integral(name, self.functions), self.functions.quadratic
        return np.asarray(integral[count:] / integral[:count].sum())

    def added(self, shifts: Array, quadratic: Array, load: Array) -> tuple[Array, Array]:
        """Correction of quadratic solutions by the cubic functions, and its energy in every triangle.

        shifts [shape (s,), 1/s]
        quadratic [shape (quadratic functions, s, n), K/W]: solutions of (K + s M) u = c.
        load [shape (cubic functions, n)]: c for the cubic functions.
        Returns [shape (s, n, n), K/W]: c_i^T x_j of the correction x.
        Returns [shape (s, n, triangles), K/W]: the share of c_i^T x_i in every triangle, without the surfaces.
        """
        count, s = load.shape[1], np.asarray(np.repeat(shifts, load.shape[1]), dtype=float)
        u = quadratic.reshape(len(quadratic), -1)[self.quadratic]
        lacking = self.across[0] @ u + (self.across[1] @ u) * s
        rest = np.tile(load, len(shifts)) - self._sum(lacking.transpose(1, 0, 2))
        on_diagonal = [np.bincount(self.cubic.ravel(), np.einsum("iit->ti", each).ravel()) for each in self.own]
        diagonal = on_diagonal[0][:, None] + np.multiply.outer(on_diagonal[1], s)
        if self.surface is not None:
            rest -= self.surface[:, : self.functions.quadratic] @ quadratic.reshape(len(quadratic), -1)
            diagonal = diagonal + self.surface.diagonal(self.functions.quadratic)[:, None]
        blocks = self.own[0][..., None] + self.own[1][..., None] * s
        found = self._gradients(blocks, rest, diagonal)
        each = found[self.cubic.T]
        split = (*each.shape[:2], len(shifts), count)
        image = (blocks * each).sum(axis=1).reshape(split)
        each = each.reshape(split)
        total = np.einsum("itsa,itsb->sab", each, image, optimize=True)
        if self.surface is not None:
            out = self.surface[:, self.functions.quadratic :] @ found
            total += np.einsum("isa,isb->sab", *(x.reshape(len(x), len(shifts), count) for x in (found, out)))
        return total, np.einsum("itsa,itsa->sat", each, image)

    def _gradients(self, blocks: Array, rest: Array, diagonal: Array) -> Array:
        """A few conjugate gradients for each column, scaled by the diagonal.

        ``blocks``, shape (4, 4, triangles, columns): K + s M of each triangle with the s of each column.
        """
        rest[self.held] = 0.0
        found = np.zeros_like(rest)
        step = rest / diagonal
        direction, size = step.copy(), np.einsum("ia,ia->a", rest, step)
        for _ in range(3):  # 3 steps of conjugate gradients; they find 0.9 to 0.999 of the energy (measured as above)
            image = self._sum((blocks * direction[self.cubic.T]).sum(axis=1))
            if self.surface is not None:
                image += self.surface[:, self.functions.quadratic :] @ direction
            image[self.held] = 0.0
            energy = np.einsum("ia,ia->a", direction, image)
            length = np.divide(size, energy, out=np.zeros_like(size), where=energy > 0)
            found += length * direction
            rest = rest - length * image
            step = rest / diagonal
            last, size = size, np.einsum("ia,ia->a", rest, step)
            direction = step + np.divide(size, last, out=np.zeros_like(size), where=last > 0) * direction
        return found

    def _sum(self, each: Array) -> Array:
        """Sum the triangles into each cubic function; shapes (4, triangles, n) and (functions, n)."""
        count = self.functions.N - self.functions.quadratic
        places = self.cubic.T.ravel()
        return np.stack(
            [np.bincount(places, column, minlength=count) for column in each.reshape(-1, each.shape[-1]).T], 1
        )
