"""What cubic elements add to quadratic ones: one function on every edge, one in every triangle.

    l_a l_b (l_a - l_b) on the edge a b,    l_0 l_1 l_2 inside

with l the barycentric coordinates. With the quadratic functions they span the cubics, in a basis in which the two
levels hardly couple, so that a few conjugate gradients find what the second level adds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import ElementTriP2
from skfem.element.element_h1 import ElementH1
from skfem.refdom import RefTri

Array = NDArray[np.float64]

_EDGES = ((0, 1), (1, 2), (0, 2))
_SLOPES = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])  # of the barycentric coordinates


class ElementTriP2Enriched(ElementH1):
    """Quadratic functions and the enrichment; local order: corners, then (quadratic, cubic) on each edge, inside."""

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


def quadratic(basis: Any) -> NDArray[np.intp]:
    """Which functions of a basis of these elements are the quadratic ones, in the order of `ElementTriP2`."""
    return np.concatenate([basis.nodal_dofs[0], basis.facet_dofs[0]])
