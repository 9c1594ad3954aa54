"""Facets of a mesh with the functions that do not vanish there, and matrices of sums over them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..arrays import Array, NDArray
from ..mesh.triangles import radii

ZERO = 1e-9  # a function below this at all points of an edge vanishes there


@dataclass(frozen=True, eq=False)
class Side:
    """Facets, each from its first to its second vertex, with m functions and q Gauss points.

    basis [anything with mesh, elem, element_dofs and N]
    facets, cells [shape (f,)]: numbers, and the triangle beside each.
    dofs [shape (f, m)]
    shape [shape (f, m, q)]: the functions at the points.
    at, weight [shape (q,)]: places 0 to 1 and weights of the points.
    ends [shape (2, 2 ends, f), m]
    outward [shape (f,)]: 1 or -1: (dz, -dr) of the facet times it points away from the triangle.
    """

    basis: Any
    facets: NDArray[np.intp]
    cells: NDArray[np.intp]
    dofs: NDArray[np.intp]
    shape: Array
    at: Array
    weight: Array
    ends: Array
    outward: Array

    @classmethod
    def of(cls, basis: Any, facets: NDArray[np.intp]) -> Side:
        """The side that some facets make."""
        grid = basis.mesh
        cells = grid.f2t[0, facets]
        local = (grid.t2f[:, cells] == facets).argmax(axis=0)
        vertices = grid.facets[:, facets]
        corners, ends = grid.p[:, grid.t[:, cells]], grid.p[:, vertices]
        first = grid.t[_edges(basis)[local, 0], cells]
        turned = (first != vertices[0]).astype(np.intp)
        kind: Any = type(basis.elem)
        numbers, shapes, at, weight = _tables(kind)
        along, inward = ends[:, 1] - ends[:, 0], corners.mean(axis=1) - ends.mean(axis=1)
        outward = np.sign(along[0] * inward[1] - along[1] * inward[0])
        dofs = basis.element_dofs[numbers[local].T, cells].T
        return cls(basis, facets, cells, dofs, shapes[local, turned], at, weight, ends, outward)

    @property
    def round(self) -> bool:
        """Whether the section is that of a ring, with the weight 2 pi r."""
        return self.basis.mesh.depth is None

    @property
    def radius(self) -> Array:
        """`radii` of the points, shape (q, f)."""
        return radii(self.along(self.ends[0]), self.basis.mesh.depth)

    def along(self, ends: Array) -> Array:
        """A linear function at the points, shape (..., q, f), from its values at the ends, shape (..., 2, f)."""
        return ends[..., 0, None, :] * (1 - self.at[:, None]) + ends[..., 1, None, :] * self.at[:, None]

    def matrix(self, other: Side, values: Array) -> Any:
        """Sparse sum of values u v, with u on this side and v on the other one."""
        from scipy.sparse import csr_matrix

        local = np.einsum("faq,fbq,q,qf->fab", other.shape, self.shape, self.weight, values, optimize=True)
        rows = np.broadcast_to(other.dofs[:, :, None], local.shape).ravel()
        columns = np.broadcast_to(self.dofs[:, None, :], local.shape).ravel()
        return csr_matrix((local.ravel(), (rows, columns)), shape=(self.basis.N,) * 2)


def _edges(basis: Any) -> NDArray[np.intp]:
    """Corners of the three edges of the reference triangle, shape (3, 2)."""
    return np.array(basis.elem.refdom.facets)


@cache
def _tables(element: Any) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """For each edge its functions (3, m), and those at Gauss points along and against it (3, 2, m, q); the points."""
    elem = element()
    nodes, weights = np.polynomial.legendre.leggauss(elem.maxdeg + 1)
    at, weight = (1 + nodes) / 2, weights / 2
    corners, numbers, shapes = elem.refdom.p, [], []
    for a, b in elem.refdom.facets:
        X = corners[:, a, None] * (1 - at) + corners[:, b, None] * at
        values = np.array([elem.lbasis(X, k)[0] for k in range(len(elem.doflocs))])
        there = np.flatnonzero(np.abs(values).max(axis=1) > ZERO)
        numbers.append(there)
        shapes.append([values[there], values[there][:, ::-1]])
    return np.array(numbers), np.array(shapes), at, weight
