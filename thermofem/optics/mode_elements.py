"""Nedelec and Lagrange elements for (e_r, e_z) and e_phi of a mode, and the two matrices of its eigenproblem.

With s = r/R for a ring of radius R and 1 for a straight guide, lengths in um, E = (e, i beta p/s) exp(i beta R phi):

    int s curl e curl v - k0^2 eps s e.v  +  beta^2 int (1/s) [(grad p - e).(grad q - v) - k0^2 eps p q]  =  0

for all (v, q): A x + beta^2 B x = 0 with symmetric A and B. grad of the Lagrange functions lies in the space of e, so
that no spurious modes exist. A perfectly matched layer stretches r and z by complex s_r, s_z (s from the stretched r);
e and grad p are 1-forms, so that only the weights change.

Source: derived; the form of J.-F. Lee, D.-K. Sun, Z. J. Cendes, IEEE Trans. Microw. Theory Tech. 39, 1262 (1991).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import skfem
from scipy.sparse.linalg import LinearOperator, eigs, splu

from ..algebra.factor import factorize
from ..arrays import Array, Indices, Mask, scattered

STRENGTH = 3.0  # of the layer's stretch 1 + i STRENGTH (depth/whole depth)^2


@dataclass(frozen=True, eq=False)
class Space:
    """The finite-element space of a mode.

    mesh: scikit-fem's triangles in um, x = r - R; corners sorted.
    order: 2 or 3 of both elements.
    radius [um]: R; inf for a straight guide.
    layers [um]: depths of the matched layers at the inner, outer, bottom and top side; () for none.
    wall: which points of the sides, shape (2, n) in um, lie on electric walls; the others are magnetic walls.
    """

    mesh: Any
    order: int = 2
    radius: float = np.inf
    layers: tuple[float, ...] = ()
    wall: Callable[[Array], Mask] | None = None

    def __post_init__(self) -> None:
        if not np.all(np.diff(self.mesh.t, axis=0) > 0):  # else the elements would be wrong without an error
            raise AssertionError("Nedelec elements need triangles with sorted corners")

    @cached_property
    def bases(self) -> tuple[Any, Any]:
        """scikit-fem's bases of e and of p, on the same quadrature points."""
        order = 2 * self.order
        if np.isfinite(self.radius) or self.layers:
            order += 2
        bases = []
        for kind in "NP":
            element = getattr(skfem, f"ElementTri{kind}{self.order}")()
            bases.append(skfem.Basis(self.mesh, element, intorder=order))
        e, p = bases
        return e, p

    @cached_property
    def functions(self) -> tuple[Array, Array, Array, Array]:
        """Functions e, shape (functions, 2, triangles, points), curl e, p and grad p at the quadrature points."""
        of_e, of_p = self.bases
        shape = self.dx.shape

        def full(values: Any, *first: int) -> Array:
            return np.broadcast_to(np.asarray(values), (*first, *shape))

        return (
            np.stack([full(f, 2) for (f,) in of_e.basis]),
            np.stack([full(f.curl) for (f,) in of_e.basis]),
            np.stack([full(f) for (f,) in of_p.basis]),
            np.stack([full(f.grad, 2) for (f,) in of_p.basis]),
        )

    @cached_property
    def dx(self) -> Array:
        """Quadrature weights in um^2, shape (triangles, points)."""
        return self.bases[0].dx

    @cached_property
    def points(self) -> Array:
        """x and y of the quadrature points in um, shape (2, triangles, points)."""
        return self.bases[0].global_coordinates()

    @cached_property
    def dofs(self) -> Indices:
        """Unknowns of every triangle, those of e first, shape (triangles, functions)."""
        e, p = self.bases
        return np.vstack([e.element_dofs, p.element_dofs + e.N]).T

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.bases[0].N + self.bases[1].N)

    @cached_property
    def free(self) -> Indices:
        """Unknowns that no electric wall holds."""
        if self.wall is None:
            return np.arange(self.size)
        e, p = self.bases
        facets = self.mesh.facets_satisfying(self.wall, boundaries_only=True)
        of_e = e.get_dofs(facets).all()
        of_p = p.get_dofs(facets).all()
        return np.setdiff1d(np.arange(self.size), np.concatenate([of_e, of_p + e.N]))

    @cached_property
    def arc(self) -> Array:
        """r/R at the quadrature points, with r real also in matched layers; 1 for a straight guide."""
        return 1 + self.points[0] / self.radius

    @cached_property
    def stretch(self) -> tuple[Any, Any, Any]:
        """s = r/R with the stretched r, and the stretches s_r and s_z of matched layers, at the quadrature points."""
        x, y = self.points
        if not self.layers:
            return self.arc, np.ones_like(x), np.ones_like(x)
        left, bottom = self.mesh.p.min(axis=1)
        right, top = self.mesh.p.max(axis=1)
        inner, outer, lower, upper = self.layers
        s_left, r_left = _layer(left - x, inner, -1)
        s_right, r_right = _layer(right - x, outer, 1)
        s_bottom, _ = _layer(bottom - y, lower, -1)
        s_top, _ = _layer(top - y, upper, 1)
        s = 1 + (x + r_left + r_right) / self.radius
        return s, 1 + s_left + s_right, 1 + s_bottom + s_top

    def matrices(self, eps: Array, k0: float) -> tuple[Any, Any]:
        """A and B for the permittivity eps of every triangle, shape (triangles, 1), and k0 in 1/um."""
        s, s_r, s_z = self.stretch
        q = k0**2 * eps
        e, rot, p, grad = self.functions
        n = len(e)
        functions = n + len(p)
        A = np.zeros((len(self.dx), functions, functions), dtype=s.dtype)
        B = np.zeros_like(A)
        both = np.concatenate([-e, grad])
        ratios = s_z / s_r, s_r / s_z
        for k, ratio in enumerate(ratios):
            A[:, :n, :n] += self._products(e[:, k], -q * s * ratio)
            B += self._products(both[:, k], ratio / s)
        A[:, :n, :n] += self._products(rot, s / (s_r * s_z))
        B[:, n:, n:] += self._products(p, -q * s_r * s_z / s)
        whole_A = scattered(A, self.dofs, self.dofs, self.size)
        whole_B = scattered(B, self.dofs, self.dofs, self.size)
        return whole_A.tocsc(), whole_B.tocsc()

    def _products(self, f: Array, weight: Array) -> Array:
        """int weight f_i f_j of every triangle, shape (triangles, functions, functions)."""
        weighted = f * (weight * self.dx)
        return np.matmul(weighted.transpose(1, 0, 2), f.transpose(1, 2, 0))


def _layer(inward: Array, depth: float, sign: int) -> tuple[Any, Any]:
    """What a matched layer adds to the stretch at points, and to their coordinate.

    inward [um]: from the points to the layer's outer end, times ``sign``, that of its outward direction.
    """
    t = np.clip(1 - sign * inward / depth, 0, None) if depth else 0 * inward
    return 1j * STRENGTH * t**2, sign * 1j * STRENGTH * depth * t**3 / 3


def eigenpairs(space: Space, A: Any, B: Any, shift: float, count: int) -> list[tuple[complex, Array]]:
    """beta^2 in 1/um^2 and x, with x.B x = 1, of the ``count`` modes with beta^2 nearest to ``shift``, by ARPACK.

    Real where no layer absorbs, and then without modes that carry no power forward; each value is the Rayleigh quotient
    of its vector.
    """
    A = A[space.free][:, space.free]
    B = B[space.free][:, space.free]
    n = A.shape[0]
    real = A.dtype.kind == "f"
    shifted = A + shift * B
    if real:
        solve = factorize(shifted)
    else:
        options = {"SymmetricMode": True}
        solve = splu(shifted.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=1e-3, options=options).solve

    def image(v: Array) -> Array:
        return solve(np.ascontiguousarray(-(B @ v)))

    inverse = LinearOperator((n, n), matvec=image, dtype=A.dtype)
    start = np.random.default_rng(0).standard_normal(n).astype(A.dtype)
    _, vectors = eigs(inverse, k=count, which="LM", tol=1e-10, v0=start, ncv=max(12, 4 * count))
    pairs = []
    for v in vectors.T:
        if real:
            v = (v / v[np.argmax(np.abs(v))]).real
        flow = v @ (B @ v)
        x = np.zeros(space.size, dtype=A.dtype)
        square = -(v @ (A @ v)) / flow
        if square.real > 0 and (flow.real > 0 or not real):
            x[space.free] = v / np.sqrt(flow)
            pairs.append((square, x))
    return pairs
