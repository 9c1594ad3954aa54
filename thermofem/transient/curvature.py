"""Terms of second order in k(T) and c_p(T), projected on a few fields.

With x = V z, V^T E V = 1, F and H of `nonlinear`, and every law replaced by the parabola through ambient and the rise
`HOT`,

    f(z) = V^T [F(x) - K x] = flow[z, z],    e(z) = V^T [H(x) - E x] = content[z, z],

with Q[y, z]_i = sum_jk Q_ijk y_j z_k. Where the enthalpy is no parabola, as of a table with a kink, its difference from
the parabola is added to e(z) at the mean fields of `GROUPS` groups of nodes. The inverse of the enthalpy's
slope is 1 - inverse[z, .], by the parabola of the rise over the enthalpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from ..algebra.krylov import Basis
from ..arrays import Array, NDArray
from ..materials.property_laws import Law
from .nonlinear import NodalOperator, NonlinearEquations

# K; of 5, 10 and 15 K the one with fewest solves for a ring that pulses up to 10 K; it changes the work alone
HOT = 10.0
GROUPS = 32  # 16 take a third more steps where pulses cross a kink of c_p, 64 the same (measured); they change the work
ROWS = 4096  # of amplitudes whose products are held at once


@dataclass(frozen=True, eq=False)
class Departure:
    """Deviation of the integral of one law from its parabola, d(x) = integral - x - chord x^2, at groups of nodes.

    fields [shape (groups, k)]: mean of V over a group.
    loads [shape (groups, k), J/K]: what the heat in a group adds to the amplitudes.
    """

    law: Law
    ambient: float
    reference: float
    chord: float
    fields: Array
    loads: Array

    def of(self, x: Array) -> Array:
        """d(x) in K."""
        return np.asarray(self.law.integral(self.ambient, x) / self.reference - x - self.chord * x**2)

    def __call__(self, z: Array) -> Array:
        """Contribution of this law to the quadratic correction e(z); z [shape (times, k)]: amplitudes."""
        return np.asarray(self.of(z @ self.fields.T) @ self.loads)

    def along(self, z: Array, slope: Array) -> Array:
        """Its derivative where z moves with ``slope``."""
        x = z @ self.fields.T
        steep = self.law.factor(self.ambient + x) / self.reference - 1 - 2 * self.chord * x
        return np.asarray((steep * (slope @ self.fields.T)) @ self.loads)


@dataclass(frozen=True, eq=False)
class Curvature:
    """The forms of the module, each of shape (k, k, k) and symmetric in its last two indices.

    flow [1/(K s) in amplitudes of K]
    content, inverse [1/K]
    departures: of c_p.
    """

    flow: Array
    content: Array
    inverse: Array
    departures: tuple[Departure, ...] = ()

    def __call__(self, z: Array) -> tuple[Array, Array]:
        """f(z) and e(z) of amplitudes of shape (times, k)."""
        flow, content = self._forms(z, z)
        return flow, sum((one(z) for one in self.departures), content)

    def along(self, z: Array, slope: Array) -> tuple[Array, Array]:
        """Their derivatives where z moves with ``slope``."""
        flow, content = self._forms(z, 2 * slope)
        return flow, sum((one.along(z, slope) for one in self.departures), content)

    def _forms(self, y: Array, z: Array) -> tuple[Array, Array]:
        """flow[y, z] and content[y, z]."""
        k = self.flow.shape[0]
        flat = np.concatenate([self.flow, self.content]).reshape(2 * k, k * k).T
        parts = []
        for at in range(0, len(y), ROWS):
            products = y[at : at + ROWS, :, None] * z[at : at + ROWS, None, :]
            parts.append(products.reshape(len(products), k * k) @ flat)
        both = np.concatenate(parts)
        return both[:, :k], both[:, k:]


def curvature(system: NonlinearEquations, basis: Basis) -> Curvature:
    """Return the forms for the fields V of a basis, shape (n, k)."""
    V = basis.vectors
    flow, content, inverse = (np.zeros((V.shape[1],) * 3) for _ in range(3))
    T0, departures = system.flow.ambient, []
    for law, at, block in operators(system.flow):
        flow += _chord(law, T0) * cubic_form(block.T @ V, V[at])
    for law, at, block in operators(system.content):
        loads, reference, chord = block.T @ V, float(law.factor(T0)), _chord(law, T0)
        form = cubic_form(loads, V[at])
        content += chord * form
        inverse += 2 * chord / (1 + chord * HOT) ** 2 * form  # x = h - a h^2/(1 + a HOT)^2
        if groups := _groups(V[at] * np.linalg.norm(basis.heating / basis.rate[:, None], axis=1)):
            means = np.stack([V[at][group].mean(axis=0) for group in groups])
            sums = np.stack([loads[group].sum(axis=0) for group in groups])
            one = Departure(law, T0, reference, chord, means, sums)
            # 2e-5 of `HOT`: with 1e-4, pulses under the tables of Si and SiO2 are 1.9 mK off, not 0.8 (measured)
            if np.abs(one.of(np.linspace(0, HOT, 64))).max() > 2e-5 * HOT:
                departures.append(one)
    return Curvature(flow, content, inverse, tuple(departures))


def _groups(points: Array) -> list[NDArray[np.intp]]:
    """Parts of the points, at most `GROUPS`: again and again the widest is cut across its longest axis.

    Source: P. Heckbert, Computer Graphics 16(3), 297 (1982) (median cut).
    """

    def cut(part: NDArray[np.intp]) -> tuple[float, Array, NDArray[np.intp]]:
        apart = points[part] - points[part].mean(axis=0)
        width, axes = np.linalg.eigh(apart.T @ apart)
        return float(width[-1]), apart @ axes[:, -1], part

    cuts = [cut(np.arange(len(points)))] if points.size else []
    while cuts and len(cuts) < GROUPS:
        cuts.sort(key=itemgetter(0))
        _, along, part = cuts[-1]
        if np.all(along < 0) or np.all(along >= 0):  # equal points are left
            break
        cuts[-1:] = [cut(part[along < 0]), cut(part[along >= 0])]
    return [part for *_, part in cuts]


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
