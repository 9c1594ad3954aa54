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
from thermofem.fem.assembly import on_mesh
from thermofem.fem.surfaces import resistances, split
from thermofem.fem.weak_forms import maps, reference
from thermofem.geometry.regions import Face
from thermofem.mesh import Mesh
from thermofem.mesh.element_sizes import size_function, sizes
from thermofem.mesh.gmsh_mesher import make_faces

from .affine_grid import SAMPLES, CellGrid, SampledWeights, surface_points
from .members import MemberMatrices
from .parameter_box import Box

CHUNK = 512  # members at once


def element_terms(basis: Any) -> tuple[Array, Array, Array]:
    """Matrices of every triangle: stiffness (4, t, b, b) as rr0, rr1, zz0, zz1; capacity (2, t, b, b); load (2, t, b).

    Without the factor 2 pi; 0 and 1 stand for the weights 1 and rho, as in this module's formulas.
    """
    inverse, det, r = maps(basis.mesh)
    integrals, t, n = reference(basis), basis.nelems, basis.Nbfun
    weights = np.ones_like(r), r
    metrics = [det * inverse[:, None, along] * inverse[None, :, along] for along in (0, 1)]
    stiffness = [(m[:, :, None] * w).reshape(-1, t).T @ integrals.stiffness for m in metrics for w in weights]
    shares = [(det * w).T for w in weights]
    capacity = [share @ integrals.mass for share in shares]
    load = [share @ integrals.load for share in shares]
    return np.reshape(stiffness, (4, t, n, n)), np.reshape(capacity, (2, t, n, n)), np.array(load)


def group_proportional(samples: Array) -> tuple[NDArray[np.intp], Array]:
    """Group coefficients that are proportional to each other.

    samples [shape (n, q)]: q coefficients at n random members.
    Returns: group of each coefficient, and its ratio to the first one of the group; shape (q,) each.
    """
    size = np.maximum(np.linalg.norm(samples, axis=0), 1e-300)
    # 11 digits: two coefficients of constant ratio over the box are one; where round-off parts them they stay two
    _, first, kind = np.unique((samples / size).round(11), axis=1, return_index=True, return_inverse=True)
    return kind, size / size[first[kind]]


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of the terms of K and M as functions of the parameters.

    stiffness, capacity [(int array, array)]: group of each coefficient of `CellGrid.coefficients`, and its ratio to the
        first one of the group (`group_proportional`).
    """

    grid: CellGrid
    stiffness: tuple[NDArray[np.intp], Array]
    capacity: tuple[NDArray[np.intp], Array]
    surface: SampledWeights | None

    def __call__(self, rows: Array) -> tuple[Array, Array, Array]:
        """Coefficients of the terms of K (n, q) and of M (n, m), and of volumes (n, 2 c), for parameters (n, p)."""
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
    """Full and projected matrices of a family whose outlines all run along r or z.

    The reference mesh is stretched cell by cell, so that K and M are sums of cell matrices with known weights.

    accuracy: relative, of the reference mesh.
    made: that mesh, and the cell of each triangle; None makes them.
    """

    def __init__(self, box: Box, accuracy: float, made: tuple[Mesh, NDArray[np.intp]] | None = None) -> None:
        self.box, self.grid, self.accuracy = box, CellGrid.of(box), accuracy
        self.made = made or _mesh(self.grid, accuracy)
        self.mesh, self.cell = split(self.made[0], resistances(box.base)), self.made[1]
        self.reference = on_mesh(box.base, self.mesh, accuracy)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle box, accuracy and mesh; another process makes matrices and factors anew."""
        return AffineEngine, (self.box, self.accuracy, self.made)

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved reference mesh."""
        offset, grid = row - self.box.middle, self.grid
        cell = np.zeros(len(self.mesh.points), dtype=np.intp)  # one that each vertex touches: its lines give the place
        cell[self.mesh.triangles.ravel()] = np.repeat(self.cell, 3)
        r = grid.r.moved(self.mesh.points[:, 0], grid.left[cell], offset)
        z = grid.z.moved(self.mesh.points[:, 1], grid.lower[cell], offset)
        moved = replace(self.mesh, points=np.stack([r, z], axis=1))
        return on_mesh(self.box.geometry(row), moved, self.accuracy)

    @cached_property
    def _sampled(self) -> tuple[Coefficients, Any]:
        """Coefficients of all terms, and the sparse traces at the surface points (None without such surfaces)."""
        rows = self.box.draw(SAMPLES, seed=1)
        at = self.box.properties(rows)
        stiffness, capacity, _ = self.grid.coefficients(rows, at)
        intervals = np.stack([self.grid.left, self.grid.lower], axis=1)[self.cell]
        surface = traces = None
        if (found := surface_points(self.reference, intervals)) is not None:
            every, traces = found
            surface = SampledWeights.of(every, every.weights(self.grid, rows, at))
        kinds = group_proportional(stiffness), group_proportional(capacity)
        return Coefficients(self.grid, *kinds, surface), traces

    def project(self, V: Array, ports: tuple[str, ...]) -> AffineMembers:
        """Project the family on the functions V, shape (free unknowns, N)."""
        basis, (coefficients, traces) = self.reference.discretization.basis, self._sampled
        full = np.zeros((basis.N, V.shape[1]))
        full[self.reference.discretization.free] = V
        terms = element_terms(basis)
        count, n = len(self.grid.owner), V.shape[1]
        K = np.zeros((4, count, n, n))
        M = np.zeros((2, count, n, n))
        L = np.zeros((2, count, n))
        volume = np.zeros((2, count))
        for c in range(count):
            here = np.flatnonzero(self.cell == c)
            local = full[basis.element_dofs.T[here]]  # (t, b, N)
            flat = local.reshape(-1, n)
            stiffness, capacity, load = (term[:, here] for term in terms)
            K[:, c] = [flat.T @ np.matmul(term, local).reshape(-1, n) for term in stiffness]
            M[:, c] = [flat.T @ np.matmul(term, local).reshape(-1, n) for term in capacity]
            L[:, c] = np.einsum("ktb,tbn->kn", load, local)
            volume[:, c] = load.sum(axis=(1, 2))
        K_terms = _summed(K.reshape(-1, n, n), coefficients.stiffness)
        if coefficients.surface is not None:
            U = traces @ full
            extra = [U.T @ (mode[:, None] * U) for mode in coefficients.surface.modes.T]
            K_terms = np.concatenate([K_terms, np.array(extra)])
        M_terms = _summed(M.reshape(-1, n, n), coefficients.capacity)
        inside = np.array([[owner == name for owner in self.grid.owner] for name in ports])[:, None]
        P = inside[..., None] * L
        volumes = inside * volume
        K = (K_terms + K_terms.transpose(0, 2, 1)) / 2
        M = (M_terms + M_terms.transpose(0, 2, 1)) / 2
        size = len(ports), -1
        return AffineMembers(coefficients, K, M, P.reshape(*size, n), volumes.reshape(size))


def _summed(terms: Array, kinds: tuple[NDArray[np.intp], Array]) -> Array:
    kind, ratio = kinds
    total = np.zeros((kind.max() + 1, *terms.shape[1:]))
    np.add.at(total, kind, ratio[:, None, None] * terms)
    return total


def _mesh(grid: CellGrid, accuracy: float) -> tuple[Mesh, NDArray[np.intp]]:
    """A mesh with edges along all lines, its regions named after layers and parts, and the cell of every triangle."""
    r, z, base = grid.r.base, grid.z.base, grid.box.base
    faces = tuple(
        Face(str(k), (np.array([(r[i], z[j]), (r[i + 1], z[j]), (r[i + 1], z[j + 1]), (r[i], z[j + 1])]),))
        for k, (i, j) in enumerate(zip(grid.left, grid.lower, strict=True))
    )
    mesh = make_faces(faces, size_function(base, sizes(accuracy)), base.name)
    cell = np.array([int(name) for name in mesh.region_names])[mesh.region]
    names = tuple(name for name in base.region_names if name in grid.owner)
    region = np.array([names.index(owner) for owner in grid.owner])[cell]
    return Mesh(mesh.points, mesh.triangles, region, names), cell


@dataclass(frozen=True, eq=False)
class AffineMembers:
    """Projected matrices of a family; sums of the terms, weighted by `Coefficients`, make a member.

    K, M [shape (terms, N, N)]
    ports [shape (ports, 2 c, N)]: integrals of the functions over each cell of each region, weights 1 and rho.
    volumes [shape (ports, 2 c)]: the same of 1.
    """

    coefficients: Coefficients
    K: Array
    M: Array
    ports: Array
    volumes: Array
    engine = "affine"

    @property
    def size(self) -> int:
        """Number of basis functions."""
        return int(self.ports.shape[2])

    def member(self, row: Array) -> MemberMatrices:
        """Projected matrices of the member with parameters ``row``, shape (p,)."""
        K, M, volume = self.coefficients(row[None])
        mean = np.einsum("c,pcn->pn", volume[0], self.ports) / (self.volumes @ volume[0])[:, None]
        return MemberMatrices(np.tensordot(K[0], self.K, 1), np.tensordot(M[0], self.M, 1), mean)

    def resistances(self, rows: Array, heated: int, read: int) -> Array:
        """R_th in K/W from port ``heated`` to port ``read`` of members with parameters ``rows`` (n, p); shape (n,)."""
        result = np.empty(len(rows))
        for start in range(0, len(rows), CHUNK):
            K, _, volume = self.coefficients(rows[start : start + CHUNK])
            b = volume @ self.ports[heated] / (volume @ self.volumes[heated])[:, None]
            c = volume @ self.ports[read] / (volume @ self.volumes[read])[:, None]
            fields = np.linalg.solve(np.tensordot(K, self.K, 1), b[..., None])[..., 0]
            result[start : start + CHUNK] = np.einsum("nk,nk->n", c, fields)
        return result
