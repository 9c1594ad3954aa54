"""Members by projection on one basis, K(p) = V^T K_mesh(p) V: small symmetric matrices, and the models of them.

Affine members sum projected matrices, about a millisecond; members on moved meshes are assembled and projected one by
one, some tens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import eigh

from thermofem import assemble, checks
from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.heat_problem import on_mesh
from thermofem.mesh import Mesh
from thermofem.mesh.mesh_motion import Motion

from .affine_matrices import Coefficients
from .parameter_box import Box


@dataclass(frozen=True, eq=False)
class MemberModes:
    """A member in modes: Z_ab(s) = sum_i port_ai port_bi / (1 + s tau_i).

    tau [shape (k,), s]
    ports [shape (ports, k)]: square root of K/W.
    """

    tau: Array
    ports: Array

    def R(self, heated: int = 0, read: int = 0) -> Array:
        """Thermal resistances of the poles in K/W."""
        return np.asarray(self.ports[heated] * self.ports[read])

    def step_response(self, times: Array, heated: int = 0, read: int = 0) -> Array:
        """Rise in K/W after a unit step."""
        return np.asarray(-np.expm1(-times[:, None] / self.tau) @ self.R(heated, read))


@dataclass(frozen=True, eq=False)
class MemberMatrices:
    """K (N, N) in W/K, M (N, N) in J/K and port functionals (ports, N) of one member."""

    K: Array
    M: Array
    ports: Array

    def modes(self) -> MemberModes:
        """Solve M v = tau K v with v^T K v = 1: errors are relative to the largest time constant and to R_th."""
        tau, v = eigh(self.M, self.K, check_finite=False)
        return MemberModes(np.maximum(tau, 0.0), self.ports @ v)

    def resistances(self, heated: int, count: int | None = None) -> Array:
        """Static gains in K/W of the first ``heated`` ports, read by all, in the first functions."""
        ports = self.ports[:, :count]
        return np.asarray(ports[:heated] @ np.linalg.solve(self.K[:count, :count], ports.T))

    def first(self, count: int) -> MemberMatrices:
        """The member in the first functions alone."""
        return MemberMatrices(self.K[:count, :count], self.M[:count, :count], self.ports[:, :count])


TIMES = np.geomspace(1e-9, 1e-3, 61)  # s; at which errors of step responses are looked at


def difference(modes: MemberModes, truth: MemberModes, heated: int = 1) -> float:
    """Largest relative difference of R_th and of the step response from 1 ns on, over all channels.

    The first ``heated`` ports carry heat, all are read.

    Relative to the value itself where a part reads its own heat, to the static value of the channel elsewhere.
    """
    worst = 0.0
    for a in range(heated):
        for b in range(len(truth.ports)):
            static = truth.R(a, b).sum()
            rise = truth.step_response(TIMES, a, b)
            off = np.abs(modes.step_response(TIMES, a, b) - rise) / (rise if a == b else abs(static))
            worst = max(worst, float(abs(modes.R(a, b).sum() / static - 1)), float(off.max()))
    return worst


@dataclass(frozen=True, eq=False)
class AffineMembers:
    """Packed matrices of a family on lines.

    K, M [shape (terms, N (N + 1)/2)]: upper triangles, row by row.
    ports [shape (ports, 2 c, N)]
    volumes [shape (ports, 2 c)]
    statics: first functions, from which the thermal resistance is taken; `Trainer` says how many are enough.
    """

    coefficients: Coefficients
    K: Array
    M: Array
    ports: Array
    volumes: Array
    statics: int
    engine = "affine"

    @classmethod
    def of(
        cls, coefficients: Coefficients, terms: tuple[Array, Array, Array], volumes: Array, statics: int
    ) -> AffineMembers:
        """Pack square terms."""
        K, M, ports = terms
        upper = np.triu_indices(K.shape[1])
        return cls(coefficients, K[:, *upper], M[:, *upper], ports, volumes, statics)

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.ports.shape[2])

    def rotated(self, T: Array, statics: int) -> AffineMembers:
        """In other functions, the columns of T."""
        K, M = (np.array([T.T @ self._square(x) @ T for x in packed]) for packed in (self.K, self.M))
        return AffineMembers.of(self.coefficients, (K, M, self.ports @ T), self.volumes, statics)

    def _square(self, packed: Array) -> Array:
        n = self.size
        full, upper = np.zeros((n, n)), self._upper
        full[upper] = packed
        full.T[upper] = packed
        return full

    @cached_property
    def _upper(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        i, j = np.triu_indices(self.size)
        return i, j

    @cached_property
    def _static_terms(self) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Array, Array]:
        """Places and terms of K between the static functions, and the ports of those."""
        n, upper = self.statics, np.triu_indices(self.size)
        kept = np.flatnonzero((upper[0] < n) & (upper[1] < n))
        return (upper[0][kept], upper[1][kept]), np.ascontiguousarray(self.K[:, kept]), self.ports[:, :, :n]

    def member(self, row: Array) -> MemberMatrices:
        """Matrices of one member."""
        K, M, volume = self.coefficients(row[None])
        mean = np.einsum("c,pcn->pn", volume[0], self.ports) / (self.volumes @ volume[0])[:, None]
        return MemberMatrices(self._square(K[0] @ self.K), self._square(M[0] @ self.M), mean)

    def resistances(self, rows: Array, heated: int, read: int) -> Array:
        """Static gain of many members, shape (n,), from the static functions."""
        n, (at, terms, ports) = self.statics, self._static_terms
        result = np.empty(len(rows))
        for start in range(0, len(rows), CHUNK):
            K, _, volume = self.coefficients(rows[start : start + CHUNK])
            packed = K @ terms
            full = np.zeros((len(packed), n, n))
            full[:, at[0], at[1]] = full[:, at[1], at[0]] = packed
            b, c = ((volume @ ports[k]) / (volume @ self.volumes[k])[:, None] for k in (heated, read))
            result[start : start + CHUNK] = np.einsum("nk,nk->n", c, np.linalg.solve(full, b[..., None])[..., 0])
        return result


CHUNK = 512  # members at once


class MovedMeshEngine:
    """Full matrices on moved meshes; a reduced member is their projection, some tens of milliseconds.

    accuracy: of the base mesh.
    reference: the base problem, where it is there already.
    """

    name = "moved mesh"

    def __init__(self, box: Box, accuracy: float, reference: HeatProblem | None = None) -> None:
        self.box, self.accuracy = box, accuracy
        self.reference = reference or assemble(box.base, accuracy)
        self.mesh = self.reference.mesh
        self._motion = Motion(self.mesh, box.base)

    def __reduce__(self) -> tuple[Any, ...]:
        """For other processes: the mesh, without factors."""
        return MovedMeshEngine.on, (self.box, self.accuracy, self.mesh)

    @classmethod
    def on(cls, box: Box, accuracy: float, mesh: Mesh) -> MovedMeshEngine:
        """The engine on an existing base mesh."""
        return cls(box, accuracy, on_mesh(box.base, mesh, accuracy))

    @property
    def unknowns(self) -> int:
        """Unknowns of the base mesh."""
        return self.reference.unknowns

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved mesh.

        Raises InputError: the mesh cannot follow: a face appears or vanishes inside the box, or triangles turn over.
        """
        geometry = self.box.geometry(row)
        try:
            moved = replace(self.mesh, points=self._motion.moved(geometry))
        except checks.InputError as error:
            where = ", ".join(f"{name} = {value:g}" for name, value in zip(self.box.names, row, strict=True))
            raise checks.InputError(f"no family over this box: at {where} {error}; take smaller ranges") from None
        return on_mesh(geometry, moved, self.accuracy)


@dataclass(frozen=True, eq=False)
class MovedMeshMembers:
    """Members whose full matrices are assembled on the moved mesh and projected on the basis.

    basis [shape (unknowns, N)]
    """

    moved: MovedMeshEngine
    basis: Array
    ports: tuple[str, ...]
    engine = "moved mesh"

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.basis.shape[1])

    def member(self, row: Array) -> MemberMatrices:
        """Matrices of one member."""
        return projected(self.moved.heat(row), self.basis, self.ports)

    def resistances(self, rows: Array, heated: int, read: int) -> Array:
        """Static gain of many members, shape (n,)."""
        small = (self.member(row) for row in rows)
        return np.array([one.ports[read] @ np.linalg.solve(one.K, one.ports[heated]) for one in small])


def projected(heat: HeatProblem, V: Array, ports: tuple[str, ...]) -> MemberMatrices:
    """A member in the functions V, from its full matrices."""
    d = heat.discretization
    K, M = (V.T @ (matrix @ V) for matrix in (d.K, d.E))
    return MemberMatrices((K + K.T) / 2, (M + M.T) / 2, np.array([d.means[name][d.free] @ V for name in ports]))
