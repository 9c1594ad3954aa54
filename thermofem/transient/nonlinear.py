"""Heat conduction with k(T) and c_p(T): the linear matrices and temperature laws at the nodes.

    d/dt H(x) = -F(x) + B P,    H(x) = sum_l M_l h_l(x),    F(x) = sum_l K_l g_l(x)

for the rise x over the ambient temperature T0. The sums run over the laws of the materials, M_l and K_l are the
capacity and conduction of the triangles that follow law l at T0, and

    g_l(x) = int_T0^(T0 + x) k_l(T)/k_l(T0) dT,    h_l(x) = int_T0^(T0 + x) c_l(T)/c_l(T0) dT

are the Kirchhoff variable and the enthalpy, taken at the nodes: k(T) grad T = grad g, interpolated to the same order
as T itself. Heat is conserved whatever the step, and at a small rise this is the linear system.

Terms of second order, projected on a few fields x = V z with V^T E V = 1, every law replaced by the parabola through
ambient and the rise `HOT`:

    f(z) = V^T [F(x) - K x] = flow[z, z],    e(z) = V^T [H(x) - E x] = content[z, z],

with Q[y, z]_i = sum_jk Q_ijk y_j z_k. The inverse of the enthalpy's slope is 1 - inverse[z, .], by the parabola of the
rise over the enthalpy.

Sources: I. Christie et al., IMA J. Numer. Anal. 1, 253 (1981) (laws at the nodes: product approximation); G. Kirchhoff,
Vorlesungen ueber die Theorie der Waerme (Teubner, 1894).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, hstack, identity, vstack
from scipy.sparse.linalg import splu

from ..algebra.krylov import Basis
from ..arrays import Array, Indices
from ..materials.material_laws import Law, check_positive

CANCELS = 1e-12  # of the numbers that are added: a sum that is smaller is round-off


@dataclass(frozen=True, eq=False)
class NodalOperator:
    """Nonlinear operator matrix @ [x, g_1(x), g_2(x), ...] with every law's integral g_l taken at its own nodes.

    matrix [sparse, shape (rows, n + sum of nodes)]: the first n columns hold the part that does not depend on
        temperature.
    laws [tuple of (law, nodes)]: nodes: array of int, which unknowns the law is taken at.
    ambient [K]
    """

    matrix: Any
    laws: tuple[tuple[Law, Indices], ...]
    ambient: float

    @cached_property
    def references(self) -> list[float]:
        """Value f(T0) of every law at the ambient temperature."""
        return [float(law.factor(self.ambient)) for law, _ in self.laws]

    def slopes(self, x: Array, *, positive: bool = False) -> list[Array]:
        """Derivatives dg_l/dx of every law at its nodes, from the rise x of shape (n,).

        Raises InputError: a law that is not positive, if ``positive``.
        """
        factors = [law.factor(self.ambient + x[at]) for law, at in self.laws]
        if positive:
            for (law, at), factor in zip(self.laws, factors, strict=True):
                check_positive(law, self.ambient + x[at], factor)
        return [factor / reference for factor, reference in zip(factors, self.references, strict=True)]

    def extended(self, x: Array) -> Array:
        """[x, g_1(x), g_2(x), ...] in K, from x of shape (..., n)."""
        if not self.laws:
            return x
        integrals = []
        for (law, nodes), reference in zip(self.laws, self.references, strict=True):
            integrals.append(law.integral(self.ambient, x[..., nodes]) / reference)
        return np.concatenate([x, *integrals], axis=-1)

    def __call__(self, x: Array) -> Array:  # noqa: D102 - the class says what it is
        return self.matrix @ self.extended(x)

    def jacobian(self, x: Array) -> Any:
        """Jacobian matrix at the rise ``x``, sparse."""
        blocks = [identity(x.size)]
        for (_, nodes), slope in zip(self.laws, self.slopes(x), strict=True):
            blocks.append(at_nodes(slope, nodes, x.size))
        return self.matrix @ vstack(blocks, format="csr")

    def derivative(self, x: Array) -> Callable[[Array], Array]:
        """Jacobian at the rise ``x`` as a function of a direction, without forming the matrix."""
        slopes = self.slopes(x)

        def along(v: Array) -> Array:
            changes = [slope * v[nodes] for (_, nodes), slope in zip(self.laws, slopes, strict=True)]
            return self.matrix @ np.concatenate([v, *changes])

        return along

    def parts(self) -> Iterator[tuple[Law, Indices, Any]]:
        """Every law, the nodes where it is taken, and its columns of the matrix."""
        columns = sum(nodes.size for _, nodes in self.laws)
        start = self.matrix.shape[1] - columns
        for law, nodes in self.laws:
            stop = start + nodes.size
            yield law, nodes, self.matrix[:, start:stop]
            start = stop


def at_nodes(values: Array, nodes: Indices, count: int) -> csr_matrix:
    """Matrix that picks the nodes out of ``count`` unknowns, each times its value; sparse, shape (nodes, count)."""
    return csr_matrix((values, nodes, np.arange(nodes.size + 1)), shape=(nodes.size, count))


@dataclass(frozen=True, eq=False)
class NonlinearEquations:
    """d/dt H(x) = -F(x) + B P and the outputs y = C x; `thermofem.models.NonlinearSystem` makes it a thermal model.

    linear: the same at small power, around the ambient temperature.
    flow, content: F(x) in W and H(x) in J.
    """

    linear: Any
    flow: NodalOperator
    content: NodalOperator


def factorize_general(matrix: Any) -> Any:
    """Factorize a sparse matrix that need not be symmetric, and return ``solve(right-hand side)``."""
    return splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A").solve


@dataclass(frozen=True, eq=False)
class Ledger:
    """Terms of the energy balance: heat stored, and heat flowing out = drain - d(held)/dt + direct P.

    stored, held [NodalOperator with one row; J]: enthalpy of everything, and the part of it that belongs to the held
        unknowns.
    drain [NodalOperator with one row; W]: heat that flows out through held unknowns and convective boundaries.
    direct: fraction of the power that enters at held unknowns, where a heated part touches a held boundary.
    """

    stored: NodalOperator
    held: NodalOperator
    drain: NodalOperator
    direct: float = 0.0

    def content(self, x: Array) -> float:
        """Heat in the field in J."""
        return float(self.stored(x)[0])

    def outflow(self, h: float, weights: Array, states: Array) -> float:
        """Heat in J that left during one step of length h, by the quadrature ``weights`` of its stages."""
        drains = self.drain.extended(states) @ self.drain.matrix.toarray()[0]
        gained_by_held = self.held(states[-1])[0] - self.held(states[0])[0]
        return h * float(weights @ drains) - float(gained_by_held)


def nodal_operator(parts: Sequence[tuple[Any, Law]], rest: Any, free: Indices, ambient: float) -> NodalOperator:
    """Make a NodalOperator, with rows for all unknowns, from one matrix for each law and a matrix ``rest`` without law.

    parts [sequence of (sparse matrix on all unknowns, law)]
    rest [sparse matrix]: the total matrix minus those of the laws.
    free: unknowns that are not held; the operator acts on them.
    ambient [K]
    """
    rest = rest.tocsr(copy=True)
    if parts:
        largest = max(abs(matrix).max() for matrix, _ in parts)
        rest.data[np.abs(rest.data) < CANCELS * largest] = 0.0
        rest.eliminate_zeros()
    blocks = [rest[:, free]]
    laws = []
    for matrix, law in parts:
        columns = matrix[:, free].tocsc()
        columns.eliminate_zeros()  # triangles of other laws
        nodes = np.flatnonzero(np.diff(columns.indptr))
        blocks.append(columns[:, nodes])
        laws.append((law, nodes))
    return NodalOperator(hstack(blocks, format="csr"), tuple(laws), ambient)


def rows(operator: NodalOperator, matrix: Any) -> NodalOperator:
    """NodalOperator ``matrix`` @ operator, such as some rows or sums of them, with the nodes that it needs."""
    matrix = csr_matrix(matrix)
    total = (matrix @ operator.matrix).toarray()
    sizes = (abs(matrix) @ abs(operator.matrix)).toarray()
    total[np.abs(total) <= CANCELS * sizes] = 0.0
    needed = np.abs(total).max(axis=0) > 0
    start = total.shape[1] - sum(at.size for _, at in operator.laws)
    needed[:start] = True
    laws = []
    for law, at in operator.laws:
        kept = at[needed[start : start + at.size]]
        start += at.size
        if kept.size:
            laws.append((law, kept))
    return NodalOperator(csr_matrix(total[:, needed]), tuple(laws), operator.ambient)


def ledger_of(flow: NodalOperator, content: NodalOperator, held: Indices) -> Ledger:
    """The `Ledger` of operators F and H with the rows of all unknowns, of which those of ``held`` do not move.

    The rows of the held unknowns, left out of the system, give their reaction: -(dH/dt + F) is the heat that flows out
    there. The sum of F over all rows is the loss by convection, as conduction and contacts have zero column sums.
    """
    ones = np.ones((1, content.matrix.shape[0]))
    of_held = np.zeros_like(ones)
    of_held[0, held] = 1
    return Ledger(rows(content, ones), rows(content, of_held), rows(flow, ones - of_held))


# K; of 5, 10 and 15 K the one with fewest solves for a ring that pulses up to 10 K; it changes the work alone
HOT = 10.0


@dataclass(frozen=True, eq=False)
class Curvature:
    """Quadratic forms flow, content and inverse of this module, (k, k, k), symmetric in the last two indices.

    flow [1/(K s) in amplitudes of K]
    content, inverse [1/K]
    """

    flow: Array
    content: Array
    inverse: Array

    def __call__(self, z: Array) -> tuple[Array, Array]:
        """f(z) and e(z) for amplitudes z, all of shape (times, k)."""
        return self.along(z, z / 2)

    def along(self, z: Array, slope: Array) -> tuple[Array, Array]:
        """Derivatives of f(z) and e(z) in the direction ``slope``, for z of shape (times, k); shape (times, k) each."""
        products = 2 * z[:, :, None] * slope[:, None, :]
        flow = np.tensordot(products, self.flow, ((1, 2), (1, 2)))
        content = np.tensordot(products, self.content, ((1, 2), (1, 2)))
        return flow, content


def curvature(system: NonlinearEquations, basis: Basis) -> Curvature:
    """Curvature for the k fields of a basis."""
    V = basis.vectors
    flow, content, inverse = np.zeros((3, *[basis.rate.size] * 3))
    T0 = system.flow.ambient
    for law, at, block in system.flow.parts():
        flow += _chord(law, T0) * cubic_form(block.T @ V, V[at])
    for law, at, block in system.content.parts():
        chord = _chord(law, T0)
        form = cubic_form(block.T @ V, V[at])
        content += chord * form
        inverse += 2 * chord / (1 + chord * HOT) ** 2 * form  # x = h - a h^2/(1 + a HOT)^2
    return Curvature(flow, content, inverse)


def flow_of(system: NonlinearEquations, V: Array) -> Callable[[Array], Array]:
    """Return the heat flow F(V z) - K V z in W, to second order in z, as a function of the matrices z z^T.

    Each law of k adds its chord coefficient times its columns of F times (V z)^2 at its nodes. The function takes m
    matrices, shape (m, k, k), and returns shape (m, n).
    """
    n, k = V.shape
    T0 = system.flow.ambient
    terms = [(nodes, _chord(law, T0) * columns) for law, nodes, columns in system.flow.parts()]

    def flow(products: Array) -> Array:
        m = len(products)
        side_by_side = products.transpose(1, 0, 2).reshape(k, m * k)
        Vzz = (V @ side_by_side).reshape(n, m, k)  # one product of matrices
        squares = np.einsum("nmk,nk->nm", Vzz, V)  # (V z)^2 at every node
        total = np.zeros_like(squares)
        for nodes, columns in terms:
            total += columns @ squares[nodes]
        return total.T

    return flow


def _chord(law: Law, T0: float) -> float:
    """Coefficient a in 1/K of the parabola x + a x^2 through the law's integral at rise 0 and at rise `HOT`."""
    integral = law.integral(T0, HOT) / law.factor(T0)
    return float((integral - HOT) / HOT**2)


def cubic_form(left: Array, right: Array) -> Array:
    """sum over nodes of left_i right_j right_k, shape (n, n, n), from arrays of shape (nodes, n)."""
    n = right.shape[1]
    j, k = np.triu_indices(n)
    form = np.empty((n, n, n))
    sums = left.T @ (right[:, j] * right[:, k])
    form[:, j, k] = sums
    form[:, k, j] = sums
    return form
