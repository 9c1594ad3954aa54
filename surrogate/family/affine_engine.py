"""The affine engine: matrices of a member as sums of fixed matrices, with coefficients that depend on the parameters.

On cell (i, j), with r = a_i + b_i rho and z = c_j + d_j zeta,

    K = 2 pi sum_ij [k_r (d_j/b_i) (a_i K^rr0 + b_i K^rr1) + k_z (b_i/d_j) (a_i K^zz0 + b_i K^zz1)] + surfaces
    M = 2 pi sum_ij rho c_p b_i d_j (a_i M^0 + b_i M^1)

where the superscript 1 has the weight rho. Heating and reading are sums of the same kind over the volume of a region.
Surfaces (convection, open sides, contacts) are in `surface_weights`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.assembly import on_mesh, resistances
from thermofem.fem.mesh_division import split
from thermofem.fem.weak_forms import maps, reference
from thermofem.geometry.regions import Face
from thermofem.mesh import Mesh
from thermofem.mesh.element_sizes import size_function, sizes
from thermofem.mesh.gmsh_mesher import make_faces

from .affine_grid import SAMPLES, CellGrid, SampledWeights, points
from .members import MemberMatrices
from .parameter_box import Box

CHUNK = 512  # members at once


def element_terms(basis: Any) -> tuple[Array, Array, Array]:
    """Matrices of every triangle: stiffness (4, t, b, b) as rr0, rr1, zz0, zz1; capacity (2, t, b, b); load (2, t, b).

    Without the factor 2 pi; the weight is 1 or the radius.
    """
    inverse, det, r = maps(basis.mesh)
    integrals, t, n = reference(basis), basis.nelems, basis.Nbfun
    stiffness, capacity, load = [], [], []
    for along in (0, 1):
        metric = det * inverse[:, None, along] * inverse[None, :, along]
        for weight in (np.ones_like(r), r):
            share = (metric[:, :, None] * weight).reshape(-1, t)
            stiffness.append((share.T @ integrals.stiffness).reshape(t, n, n))
    for weight in (np.ones_like(r), r):
        share = det * weight
        capacity.append((share.T @ integrals.mass).reshape(t, n, n))
        load.append(share.T @ integrals.load)
    return np.array(stiffness), np.array(capacity), np.array(load)


def group_proportional(samples: Array) -> tuple[NDArray[np.intp], Array]:
    """Group the coefficients that are multiples of each other: group of each, and its ratio to the first of the group.

    ``samples`` has shape (n, q): q coefficients at n random members.
    """
    size = np.linalg.norm(samples, axis=0)
    kind, ratio = np.full(samples.shape[1], -1), np.zeros(samples.shape[1])
    count = 0
    for k in range(samples.shape[1]):
        if kind[k] >= 0:
            continue
        if size[k] == 0:
            kind[k], ratio[k] = count, 1.0
            count += 1
            continue
        unit = samples[:, k] / size[k]
        rest = np.flatnonzero((kind < 0) & (size > 0))
        off = np.linalg.norm(samples[:, rest] / size[rest] - unit[:, None], axis=0)
        alike = rest[off < 1e-12]  # 1e-12: two coefficients whose ratio is constant to this over the box are one
        kind[alike], ratio[alike] = count, size[alike] / size[k]
        count += 1
    return kind, ratio


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of all terms as functions of the parameters; with the matrices they make a member.

    stiffness, capacity [(int array, array)]: which term each coefficient of `CellGrid.coefficients` belongs to, and its
        factor.
    """

    grid: CellGrid
    stiffness: tuple[NDArray[np.intp], Array]
    capacity: tuple[NDArray[np.intp], Array]
    surface: SampledWeights | None

    def __call__(self, rows: Array) -> tuple[Array, Array, Array]:
        """Coefficients of K (n, q), of M (n, m) and of volumes (n, 2 c) for parameters (n, p)."""
        at = self.grid.box.properties(rows)
        stiffness, capacity, volume = self.grid.coefficients(rows, at)
        K, M = (
            each[:, np.unique(kind, return_index=True)[1]]  # the first coefficient of every kind
            for each, (kind, _) in ((stiffness, self.stiffness), (capacity, self.capacity))
        )
        if self.surface is not None:
            K = np.concatenate([K, self.surface.points.weights(self.grid, rows, at)], axis=1)
        return K, M, volume


class AffineEngine:
    """Full and reduced matrices of a family on lines.

    accuracy: of the reference mesh.
    """

    name = "affine"

    def __init__(self, box: Box, accuracy: float) -> None:
        self.box, self.grid, self.accuracy = box, CellGrid.of(box), accuracy
        mesh, cell = _mesh(self.grid, accuracy)
        self.mesh, self.cell = split(mesh, resistances(box.base)), cell
        vertex = np.zeros(len(self.mesh.points), dtype=np.intp)
        vertex[self.mesh.triangles.ravel()] = np.repeat(cell, 3)
        self._vertex = vertex  # a cell that each vertex touches: its lines give the vertex' place
        self.reference = on_mesh(box.base, self.mesh, accuracy)

    def __getstate__(self) -> dict[str, Any]:
        """For other processes: the mesh, without matrices and factors."""
        return {name: value for name, value in self.__dict__.items() if name not in ("reference", "_sampled")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.reference = on_mesh(self.box.base, self.mesh, self.accuracy)

    @property
    def unknowns(self) -> int:
        """Unknowns of the reference mesh."""
        return self.reference.unknowns

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved reference mesh."""
        offset, (i, j, _) = row - self.box.middle, self.grid.cells
        r = self.grid.r.moved(self.mesh.points[:, 0], i[self._vertex], offset)
        z = self.grid.z.moved(self.mesh.points[:, 1], j[self._vertex], offset)
        moved = replace(self.mesh, points=np.stack([r, z], axis=1))
        return on_mesh(self.box.geometry(row), moved, self.accuracy)

    @cached_property
    def _sampled(self) -> tuple[Coefficients, Any]:
        """Coefficients of all terms, and the sparse traces on the surfaces or None."""
        rows = self.box.draw(SAMPLES, seed=1)
        at = self.box.properties(rows)
        stiffness, capacity, _ = self.grid.coefficients(rows, at)
        i, j, _ = self.grid.cells
        surface = traces = None
        if (found := points(self.reference, np.stack([i, j], axis=1)[self.cell])) is not None:
            every, traces = found
            surface = SampledWeights.of(every, every.weights(self.grid, rows, at))
        kinds = group_proportional(stiffness), group_proportional(capacity)
        return Coefficients(self.grid, *kinds, surface), traces

    @property
    def coefficients(self) -> Coefficients:
        """Coefficients of all terms."""
        return self._sampled[0]

    def project(self, V: Array, ports: tuple[str, ...]) -> tuple[Array, Array, Array]:
        """Terms of K (q, N, N), of M (m, N, N) and of the ports (len(ports), 2 c, N) between fields V (free, N)."""
        basis = self.reference.discretization.basis
        full = np.zeros((basis.N, V.shape[1]))
        full[self.reference.discretization.free] = V
        stiffness, capacity, load = element_terms(basis)
        count, n = len(self.grid.cells[0]), V.shape[1]
        K, M = np.zeros((4, count, n, n)), np.zeros((2, count, n, n))
        L = np.zeros((2, count, n))
        for c in range(count):
            here = np.flatnonzero(self.cell == c)
            local = full[basis.element_dofs.T[here]]  # (t, b, N)
            flat = local.reshape(-1, n)
            for target, terms in ((K, stiffness), (M, capacity)):
                for k, term in enumerate(terms):
                    target[k, c] = flat.T @ np.matmul(term[here], local).reshape(-1, n)
            L[:, c] = np.einsum("ktb,tbn->kn", load[:, here], local)
        coefficients, traces = self._sampled
        K_terms = _summed(K.reshape(-1, n, n), coefficients.stiffness)
        if coefficients.surface is not None:
            U = traces @ full
            extra = [U.T @ (mode[:, None] * U) for mode in coefficients.surface.modes.T]
            K_terms = np.concatenate([K_terms, np.array(extra)])
        M_terms = _summed(M.reshape(-1, n, n), coefficients.capacity)
        P = self._inside(ports)[:, None, :, None] * L
        return K_terms, M_terms, P.reshape(len(ports), -1, n)

    def _inside(self, ports: tuple[str, ...]) -> NDArray[np.bool_]:
        """Which cells each port covers, shape (ports, c)."""
        return np.array([[owner == name for owner in self.grid.cells[2]] for name in ports])

    def volumes(self, ports: tuple[str, ...]) -> Array:
        """Terms of the volume of every port, shape (len(ports), 2 c)."""
        basis = self.reference.discretization.basis
        _, _, load = element_terms(basis)
        each = np.array([np.bincount(self.cell, x.sum(axis=1), minlength=len(self.grid.cells[0])) for x in load])
        return (self._inside(ports)[:, None, :] * each).reshape(len(ports), -1)


def _summed(terms: Array, kinds: tuple[NDArray[np.intp], Array]) -> Array:
    kind, ratio = kinds
    total = np.zeros((kind.max() + 1, *terms.shape[1:]))
    np.add.at(total, kind, ratio[:, None, None] * terms)
    return total


def _mesh(grid: CellGrid, accuracy: float) -> tuple[Mesh, NDArray[np.intp]]:
    """A mesh that conforms to all lines, regions named after owners, and the cell of every triangle."""
    r, z, base, (left, lower, owners) = grid.r.base, grid.z.base, grid.box.base, grid.cells
    faces = tuple(
        Face(str(k), (np.array([(r[i], z[j]), (r[i + 1], z[j]), (r[i + 1], z[j + 1]), (r[i], z[j + 1])]),))
        for k, (i, j) in enumerate(zip(left, lower, strict=True))
    )
    mesh = make_faces(faces, size_function(base, sizes(accuracy)), base.name)
    cell = np.array([int(name) for name in mesh.region_names])[mesh.region]
    names = tuple(name for name in base.region_names if name in owners)
    region = np.array([names.index(owner) for owner in owners])[cell]
    return Mesh(mesh.points, mesh.triangles, region, names), cell


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
