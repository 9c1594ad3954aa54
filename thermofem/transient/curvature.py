"""What k(T) and c_p(T) do to a few fields, to second order in the rise.

With x = V z, V^T E V = 1, and every law replaced by the parabola through ambient and the rise `HOT`,

    V^T [F(x) - K x] = flow[z, z],    V^T [H(x) - E x] = content[z, z],    Q[y, z]_i = sum_jk Q_ijk y_j z_k

for F and H of `nonlinear`. The inverse of the enthalpy's slope is 1 - inverse[z, .], by the chord of 1/c_p.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, NDArray
from ..materials.laws import Law
from .nonlinear import NodalOperator, NonlinearEquations

# K; of 5, 10 and 15 K the one with fewest solves for a ring that pulses up to 10 K; it changes the work alone
HOT = 10.0
ROWS = 4096  # of amplitudes whose products are held at once


@dataclass(frozen=True, eq=False)
class Curvature:
    """The forms of the module, each of shape (k, k, k) and symmetric in its last two indices.

    flow [1/(K s) in amplitudes of K]
    content, inverse [1/K]
    """

    flow: Array
    content: Array
    inverse: Array

    def __call__(self, y: Array, z: Array) -> tuple[Array, Array]:
        """flow[y, z] and content[y, z] of amplitudes of shape (times, k)."""
        k = self.flow.shape[0]
        flat = np.concatenate([self.flow, self.content]).reshape(2 * k, k * k).T
        parts = []
        for at in range(0, len(y), ROWS):
            products = y[at : at + ROWS, :, None] * z[at : at + ROWS, None, :]
            parts.append(products.reshape(len(products), k * k) @ flat)
        both = np.concatenate(parts)
        return both[:, :k], both[:, k:]


def curvature(system: NonlinearEquations, V: Array) -> Curvature:
    """Return the forms for the fields V, shape (n, k)."""
    flow, content, inverse = (np.zeros((V.shape[1],) * 3) for _ in range(3))
    T0 = system.flow.ambient
    for law, at, block in operators(system.flow):
        flow += _chord(law, T0) * cubic_form(block.T @ V, V[at])
    for law, at, block in operators(system.content):
        form = cubic_form(block.T @ V, V[at])
        content += _chord(law, T0) * form
        inverse += (1 - law.factor(T0) / law.factor(T0 + HOT)) / HOT * form
    return Curvature(flow, content, inverse)


def flow_of(system: NonlinearEquations, V: Array) -> Callable[[Array], Array]:
    """Return the quadratic part of F(V z) - K V z as a function of products z z^T, (m, k, k) to (m, n)."""
    n, k = V.shape
    parts = [(_chord(law, system.flow.ambient) * block, at) for law, at, block in operators(system.flow)]

    def flow(products: Array) -> Array:
        m = len(products)
        wide = (V @ products.transpose(1, 0, 2).reshape(k, m * k)).reshape(n, m, k)  # one product of matrices
        squares = np.einsum("nmk,nk->nm", wide, V)
        return np.asarray(sum((block @ squares[at] for block, at in parts), np.zeros_like(squares)).T)

    return flow


def _chord(law: Law, T0: float) -> float:
    """a of x + a x^2, which the integral of the law is at no rise and at `HOT`."""
    return float((law.integral(T0, HOT) / law.factor(T0) - HOT) / HOT**2)


def operators(operator: NodalOperator) -> Iterator[tuple[Law, NDArray[np.intp], Any]]:
    """Every law with its nodes and its part of the matrix."""
    start = operator.matrix.shape[1] - sum(at.size for _, at in operator.laws)
    for law, at in operator.laws:
        yield law, at, operator.matrix[:, start : start + at.size]
        start += at.size


def cubic_form(left: Array, right: Array) -> Array:
    """sum over nodes of left_i right_j right_k, shape (n, n, n), from arrays of shape (nodes, n)."""
    n = right.shape[1]
    j, k = np.triu_indices(n)
    form = np.empty((n, n, n))
    form[:, j, k] = form[:, k, j] = left.T @ (right[:, j] * right[:, k])
    return form
