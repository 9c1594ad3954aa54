"""Heat conduction with k(T) and c_p(T): the linear matrices and temperature laws at the nodes.

    d/dt H(x) = -F(x) + B P,    H(x) = sum_l M_l h_l(x),    F(x) = sum_l K_l g_l(x)

for the rise x over the ambient temperature T0. The sums run over the laws of the materials, M_l and K_l are the
capacity and conduction of the triangles that follow law l at T0, and

    g_l(x) = int_T0^(T0 + x) k_l(T)/k_l(T0) dT,    h_l(x) = int_T0^(T0 + x) c_l(T)/c_l(T0) dT

are the Kirchhoff variable and the enthalpy, taken at the nodes: k(T) grad T = grad g, interpolated to the same order
as T itself. Heat is conserved whatever the step, and at a small rise this is the linear system.

Sources: I. Christie et al., IMA J. Numer. Anal. 1, 253 (1981) (laws at the nodes: product approximation); G. Kirchhoff,
Vorlesungen ueber die Theorie der Waerme (Teubner, 1894).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array, NDArray
from ..materials.property_laws import Law, check_positive


@dataclass(frozen=True, eq=False)
class NodalOperator:
    """A nonlinear operator ``matrix @ [x, g_1(x), g_2(x), ...]``, every law at its own nodes.

    matrix [sparse, shape (rows, n + sum of nodes)]: the first n columns hold the part that does not depend on
        temperature.
    laws [tuple of (law, nodes)]: nodes: array of int, which unknowns the law is taken at.
    ambient [K]
    """

    matrix: Any
    laws: tuple[tuple[Law, NDArray[np.intp]], ...]
    ambient: float

    @cached_property
    def references(self) -> list[float]:
        """Every law at the ambient temperature."""
        return [float(law.factor(self.ambient)) for law, _ in self.laws]

    def slopes(self, x: Array) -> list[Array]:
        """Derivative of every g at its nodes, from x of shape (n,)."""
        both = zip(self.laws, self.references, strict=True)
        return [law.factor(self.ambient + x[at]) / reference for (law, at), reference in both]

    def positive_slopes(self, x: Array) -> list[Array]:
        """`slopes` at a state that was reached; InputError where a law is not positive there."""
        found = self.slopes(x)
        for ((law, at), reference), slope in zip(zip(self.laws, self.references, strict=True), found, strict=True):
            check_positive(law, self.ambient + x[at], slope * reference)
        return found

    def extreme(self, x: Array) -> tuple[float, str]:
        """The largest change of a law since ambient, as a logarithm, and in words."""
        found = [(0.0, "")]
        for (law, at), slope in zip(self.laws, self.slopes(x), strict=True):
            change = np.abs(np.log(np.maximum(slope, np.finfo(float).tiny)))
            k = int(np.argmax(change))
            words = f"the law {law} gives {slope[k]:.3g} of its value at ambient at {self.ambient + x[at[k]]:.5g} K"
            found.append((float(change[k]), words))
        return max(found)

    def extended(self, x: Array) -> Array:
        """[x, g_1(x), g_2(x), ...] in K, from x of shape (..., n)."""
        if not self.laws:
            return x
        both = zip(self.laws, self.references, strict=True)
        laws = [law.integral(self.ambient, x[..., at]) / reference for (law, at), reference in both]
        return np.concatenate([x, *laws], axis=-1)

    def __call__(self, x: Array) -> Array:  # noqa: D102 - the class says what it is
        return np.asarray(self.matrix @ self.extended(x))

    def jacobian(self, x: Array) -> Any:
        """d/dx at ``x``, sparse."""
        from scipy.sparse import csr_matrix, identity, vstack

        blocks = [identity(x.size, format="csr")]
        for (_, at), slope in zip(self.laws, self.slopes(x), strict=True):
            blocks.append(csr_matrix((slope, (np.arange(at.size), at)), shape=(at.size, x.size)))
        return self.matrix @ vstack(blocks, format="csr")

    def derivative(self, x: Array) -> Callable[[Array], Array]:
        """The derivative at ``x`` as a function of the direction, without its matrix."""
        slopes = [(slope, at) for (_, at), slope in zip(self.laws, self.slopes(x), strict=True)]
        return lambda v: np.asarray(self.matrix @ np.concatenate([v, *(slope * v[at] for slope, at in slopes)]))


@dataclass(frozen=True, eq=False)
class NonlinearEquations:
    """d/dt H(x) = -F(x) + B P and the outputs y = C x; `thermofem.models.NonlinearSystem` makes it a thermal model.

    linear: the same at small power, around the ambient temperature.
    flow, content: F(x) in W and H(x) in J.
    """

    linear: Any
    flow: NodalOperator
    content: NodalOperator

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""
        return tuple(self.linear.inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""
        return tuple(self.linear.outputs)

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.linear.order)


def factorize_general(matrix: Any) -> Any:
    """Factorize a sparse matrix that need not be symmetric, and return ``solve(right-hand side)``."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    return splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A").solve


@dataclass(frozen=True, eq=False)
class NonlinearLedger:
    """Closes the energy balance with enthalpies.

    stored, held [NodalOperator with one row; J]: enthalpy of everything, and the part of it that belongs to the held
        unknowns.
    drain [NodalOperator with one row; W]: heat that flows out through held unknowns and convective boundaries.
    direct: share of the power that enters at held unknowns.
    """

    stored: NodalOperator
    held: NodalOperator
    drain: NodalOperator
    direct: float = 0.0

    def content(self, x: Array) -> float:
        """Heat in the field in J."""
        return float(self.stored(x)[0])

    def outflow(self, h: float, weights: Array, states: Array, slopes: Array) -> float:
        """Heat in J that left during one step."""
        flow = float(weights @ (self.drain.extended(states) @ self.drain.matrix.toarray()[0]))
        return h * flow - float(self.held(states[-1])[0] - self.held(states[0])[0])


def nodal_operator(
    parts: Sequence[tuple[Any, Law]], rest: Any, free: NDArray[np.intp], ambient: float
) -> NodalOperator:
    """All rows of an operator from its matrices: ``rest`` follows no law, every other its own.

    parts [sequence of (sparse matrix on all unknowns, law)]
    rest [sparse matrix]: what is left when they are taken away from the whole.
    free: unknowns that are not held; the operator acts on them.
    ambient [K]
    """
    from scipy.sparse import hstack

    rest = rest.tocsr(copy=True)
    if parts:
        rest.data[np.abs(rest.data) < 1e-12 * max(abs(matrix).max() for matrix, _ in parts)] = 0.0
        rest.eliminate_zeros()
    blocks, laws = [rest[:, free]], []
    for matrix, law in parts:
        columns = matrix[:, free].tocsc()
        columns.eliminate_zeros()  # triangles of other laws
        at = np.flatnonzero(np.diff(columns.indptr))
        blocks.append(columns[:, at])
        laws.append((law, at))
    return NodalOperator(hstack(blocks, format="csr"), tuple(laws), ambient)


def rows(operator: NodalOperator, matrix: Any) -> NodalOperator:
    """The operator with ``matrix`` in front: some rows or sums of them, with the laws at the nodes they need."""
    from scipy.sparse import csr_matrix

    matrix = csr_matrix(matrix)
    total = (matrix @ operator.matrix).toarray()
    total[np.abs(total) <= 1e-12 * (abs(matrix) @ abs(operator.matrix)).toarray()] = 0.0  # what cancels inside
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
