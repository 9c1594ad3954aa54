"""Vertices at which the temperature is strongly singular: where conductivities alternate around them.

Near a vertex T = T_0 + C rho^lambda phi(angle), with lambda^2 the smallest eigenvalue, but for 0, of

    -(k phi')' = lambda^2 k phi    around the vertex,    phi' = 0 on insulated sides, phi = 0 on held ones.

For four right angles with k_1 < k_2 in turn, lambda = (4/pi) arctan sqrt(k_1/k_2): 0.13 for silicon in oxide, with no
lower limit. It is 1/2 or more at the corner of one material in another. The energy that elements of size h miss is
proportional to h^(2 lambda): where lambda is small, dividing them or adding cubic functions finds little of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, NDArray

if TYPE_CHECKING:
    from .matrices import Discretization

# of a quadratic element of length 1: int phi' phi', int phi phi
_SLOPES = np.array([[7.0, 1.0, -8.0], [1.0, 7.0, -8.0], [-8.0, -8.0, 16.0]]) / 3
_VALUES = np.array([[4.0, -1.0, 2.0], [-1.0, 4.0, 2.0], [2.0, 2.0, 16.0]]) / 30
STRONG = 0.5  # lambda below which a vertex is looked at


def saturation(exponent: float) -> float:
    """The exact energy over what cubic functions add in the triangles at a vertex, at most, for lambda < `STRONG`.

    Measured at six corners with contrasts of 10, 94 and 1000 (`tests/audit/corners.py`), lambda from 0.028 to 0.39: at
    most 1.13 lambda^-1.23. Cubic functions in the whole would leave 1/(1 - (2/3)^(4 lambda)).
    """
    return 1.2 * exponent**-1.25


def strong(d: Discretization, conductivity: Array, region: NDArray[np.int64]) -> dict[int, float]:
    """Every vertex with lambda < `STRONG`, and lambda.

    conductivity [shape (2, triangles), W/(m K)]: k_r and k_z.
    region [shape (triangles,)]
    """
    held = _ends(d, d.surfaces.held)
    found = {int(v): _exponent(d, conductivity, int(v), held) for v in _candidates(d, region, held)}
    return {vertex: exponent for vertex, exponent in found.items() if exponent < STRONG}


def _candidates(d: Discretization, region: NDArray[np.int64], held: NDArray[np.int64]) -> NDArray[np.intp]:
    """Vertices where three edges between regions meet; on the boundary two, or one where a held side ends."""
    grid = d.basis.mesh
    count, (first, second) = grid.p.shape[1], grid.f2t
    inner = second >= 0
    between = np.flatnonzero(inner & (region[first] != region[np.where(inner, second, first)]))
    meeting = np.bincount(grid.facets[:, between].ravel(), minlength=count)
    outside = np.bincount(grid.facets[:, ~inner].ravel(), minlength=count) > 0
    on_held = np.bincount(held.ravel(), minlength=count) == 1
    return np.flatnonzero(np.where(outside, meeting + on_held >= 2, meeting >= 3))


def _ends(d: Discretization, facets: NDArray[np.intp]) -> NDArray[np.int64]:
    """Vertices of some facets, shape (2, n)."""
    return np.asarray(d.basis.mesh.facets[:, facets])


def _exponent(d: Discretization, conductivity: Array, vertex: int, held: NDArray[np.int64]) -> float:
    """lambda at a vertex, by quadratic functions of the angle on each of its triangles.

    Where k_r and k_z differ, angles are those of r/sqrt(k_r), z/sqrt(k_z) and k is sqrt(k_r k_z): exact as lambda -> 0.
    """
    from scipy.linalg import eigh

    t, p = d.basis.mesh.t, d.basis.mesh.p
    around = np.flatnonzero((t == vertex).any(axis=0))
    corners = t[:, around].T
    others = corners[corners != vertex].reshape(-1, 2)  # the edges at the vertex, by their other ends
    k = conductivity[:, around]
    x, y = ((p[:, end] - p[:, [vertex]]) / np.sqrt(k) for end in others.T)
    angle = np.abs(np.arctan2(x[0] * y[1] - x[1] * y[0], (x * y).sum(axis=0)))
    edges, number = np.unique(others, return_inverse=True)
    nodes = np.column_stack([number.reshape(-1, 2), len(edges) + np.arange(len(around))])
    slopes, values = np.zeros((2, len(edges) + len(around), len(edges) + len(around)))
    for own, kt, length in zip(nodes, np.sqrt(k[0] * k[1]), angle, strict=True):
        slopes[np.ix_(own, own)] += kt / length * _SLOPES
        values[np.ix_(own, own)] += kt * length * _VALUES
    fixed = held[:, (held == vertex).any(axis=0)]
    free = np.flatnonzero(~np.isin(np.append(edges, np.full(len(around), -1)), fixed))
    squares = eigh(slopes[np.ix_(free, free)], values[np.ix_(free, free)], eigvals_only=True)
    return float(np.sqrt(max(squares[1 if len(free) == len(slopes) else 0], 0.0)))
