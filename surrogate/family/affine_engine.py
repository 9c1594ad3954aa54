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

from .affine_grid import SAMPLE_MEMBERS, CellGrid, SampledWeights, surface_points
from .members import MemberMatrices
from .parameter_box import Box


def element_terms(basis: Any) -> tuple[Array, Array, Array]:
    """Matrices of every triangle: stiffness (4, t, b, b) as rr0, rr1, zz0, zz1; capacity (2, t, b, b); load (2, t, b).

    Without the factor 2 pi; 0 and 1 stand for the weights 1 and rho, as in this module's formulas.
    """
    inverse, det, r = maps(basis.mesh)
    integrals = reference(basis)
    t = basis.nelems
    n = basis.Nbfun
    weights = np.ones_like(r), r
    stiffness = []
    for slopes in inverse.transpose(1, 0, 2):  # of the reference coordinates, along r and along z
        metric = det * slopes[:, None] * slopes
        for weight in weights:
            weighted = metric[:, :, None] * weight
            stiffness.append(weighted.reshape(-1, t).T @ integrals.stiffness)
    measures = [(det * weight).T for weight in weights]
    capacity = [measure @ integrals.mass for measure in measures]
    load = [measure @ integrals.load for measure in measures]
    return np.reshape(stiffness, (4, t, n, n)), np.reshape(capacity, (2, t, n, n)), np.array(load)


def group_proportional(samples: Array) -> tuple[NDArray[np.intp], Array]:
    """Group coefficients that are proportional to each other.

    samples [shape (n, q)]: q coefficients at n random members.
    Returns: the first coefficient of each of g groups, shape (g,), and the ratios of all coefficients to that of their
    group, shape (g, q), zero in the others.
    """
    size = np.maximum(np.linalg.norm(samples, axis=0), 1e-300)
    # 11 digits: two coefficients of constant ratio over the box are one; where round-off parts them they stay two
    directions = (samples / size).round(11)
    _, first, kind = np.unique(directions, axis=1, return_index=True, return_inverse=True)
    ratios = np.zeros((len(first), len(size)))
    ratios[kind, np.arange(len(size))] = size / size[first[kind]]
    return first, ratios


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of the terms of K and M as functions of the parameters.

    stiffness, capacity [int arrays]: those of `CellGrid.coefficients` that are not proportional to an earlier one.
    """

    grid: CellGrid
    stiffness: NDArray[np.intp]
    capacity: NDArray[np.intp]
    surface: SampledWeights | None

    def __call__(self, rows: Array) -> tuple[Array, Array, Array]:
        """Coefficients of the terms of K (n, q) and of M (n, m), and of volumes (n, 2 c), for parameters (n, p)."""
        at = self.grid.box.properties(rows)
        stiffness, capacity, volume = self.grid.coefficients(rows, at)
        K = stiffness[:, self.stiffness]
        M = capacity[:, self.capacity]
        if self.surface is not None:
            weights = self.surface.points.weights(self.grid, rows, at)
            K = np.concatenate([K, weights], axis=1)
        return K, M, volume


class AffineEngine:
    """Full and projected matrices of a family whose outlines all run along r or z.

    The reference mesh is stretched cell by cell, so that K and M are sums of cell matrices with known weights.

    accuracy: relative, of the reference mesh.
    made: that mesh, and the cell of each triangle; None makes them.
    """

    def __init__(self, box: Box, accuracy: float, made: tuple[Mesh, NDArray[np.intp]] | None = None) -> None:
        self.box = box
        self.accuracy = accuracy
        self.grid = CellGrid.of(box)
        self.made = made or _mesh(self.grid, accuracy)
        whole, self.cell = self.made
        self.mesh = split(whole, resistances(box.base))
        self.reference = on_mesh(box.base, self.mesh, accuracy)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle box, accuracy and mesh; another process makes matrices and factors anew."""
        return AffineEngine, (self.box, self.accuracy, self.made)

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved reference mesh."""
        grid = self.grid
        offset = row - self.box.middle
        rho, zeta = self.mesh.points.T
        cell = np.zeros(len(rho), dtype=np.intp)  # one that each vertex touches: its lines give the place
        cell[self.mesh.triangles.ravel()] = np.repeat(self.cell, 3)
        r = grid.r.moved(rho, grid.left[cell], offset)
        z = grid.z.moved(zeta, grid.lower[cell], offset)
        moved = replace(self.mesh, points=np.stack([r, z], axis=1))
        return on_mesh(self.box.geometry(row), moved, self.accuracy)

    @cached_property
    def _sampled(self) -> tuple[Coefficients, Array, Array, Any]:
        """Coefficients of all terms, the ratios of `group_proportional` for K and M, and the traces at surface points.

        The traces are sparse, None without such surfaces.
        """
        rows = self.box.draw(SAMPLE_MEMBERS, seed=1)
        at = self.box.properties(rows)
        stiffness, capacity, _ = self.grid.coefficients(rows, at)
        intervals = np.stack([self.grid.left, self.grid.lower], axis=1)
        surface = traces = None
        pair = surface_points(self.reference, intervals[self.cell])
        if pair is not None:
            every, traces = pair
            weights = every.weights(self.grid, rows, at)
            surface = SampledWeights.of(every, weights)
        first_K, ratios_K = group_proportional(stiffness)
        first_M, ratios_M = group_proportional(capacity)
        return Coefficients(self.grid, first_K, first_M, surface), ratios_K, ratios_M, traces

    def project(self, V: Array, ports: tuple[str, ...]) -> AffineMembers:
        """Project the family on the functions V, shape (free unknowns, N)."""
        discretization = self.reference.discretization
        basis = discretization.basis
        coefficients, ratios_K, ratios_M, traces = self._sampled
        n = V.shape[1]
        full = np.zeros((basis.N, n))
        full[discretization.free] = V
        stiffness, capacity, load = element_terms(basis)
        owner = np.array(self.grid.owner)
        count = len(owner)
        K = np.zeros((4, count, n, n))
        M = np.zeros((2, count, n, n))
        L = np.zeros((2, count, n))
        volume = np.zeros((2, count))
        for c in range(count):
            here = np.flatnonzero(self.cell == c)
            local = full[basis.element_dofs.T[here]]  # (t, b, N)
            K[:, c] = _projected(stiffness[:, here], local)
            M[:, c] = _projected(capacity[:, here], local)
            L[:, c] = np.einsum("ktb,tbn->kn", load[:, here], local)
            volume[:, c] = load[:, here].sum(axis=(1, 2))
        K_terms = np.tensordot(ratios_K, K.reshape(-1, n, n), 1)
        if coefficients.surface is not None:
            U = traces @ full
            extra = [U.T @ (mode[:, None] * U) for mode in coefficients.surface.modes.T]
            K_terms = np.concatenate([K_terms, extra])
        M_terms = np.tensordot(ratios_M, M.reshape(-1, n, n), 1)
        inside = np.array([owner == name for name in ports])[:, None]
        P = inside[..., None] * L
        volumes = inside * volume
        K = (K_terms + K_terms.transpose(0, 2, 1)) / 2
        M = (M_terms + M_terms.transpose(0, 2, 1)) / 2
        size = len(ports), -1
        return AffineMembers(coefficients, K, M, P.reshape(*size, n), volumes.reshape(size))


def _projected(terms: Array, functions: Array) -> list[Array]:
    """Sum over t triangles of v^T A v for each of k element matrices A (k, t, b, b) and functions v (t, b, n)."""
    flat = functions.reshape(-1, functions.shape[-1])
    return [flat.T @ np.matmul(A, functions).reshape(flat.shape) for A in terms]


def _mesh(grid: CellGrid, accuracy: float) -> tuple[Mesh, NDArray[np.intp]]:
    """A mesh with edges along all lines, its regions named after layers and parts, and the cell of every triangle."""
    base = grid.box.base
    faces = []
    for k, (i, j) in enumerate(zip(grid.left, grid.lower, strict=True)):
        left, right = grid.r.base[i : i + 2]
        bottom, top = grid.z.base[j : j + 2]
        corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
        faces.append(Face(str(k), (corners,)))
    mesh = make_faces(tuple(faces), size_function(base, sizes(accuracy)), base.name)
    cells = np.array([int(name) for name in mesh.region_names])
    cell = cells[mesh.region]
    names = tuple(name for name in base.region_names if name in grid.owner)
    region = np.array([names.index(owner) for owner in grid.owner])
    return Mesh(mesh.points, mesh.triangles, region[cell], names), cell


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

    @property
    def box(self) -> Box:
        """The box of parameters."""
        return self.coefficients.grid.box

    def matrices(self, rows: Array) -> MemberMatrices:
        """Projected matrices of n members with the parameters ``rows``, shape (n, p), stacked along a first axis."""
        K, M, volume = self.coefficients(rows)
        integrals = np.tensordot(volume, self.ports, (1, 1))
        means = integrals / (volume @ self.volumes.T)[..., None]
        return MemberMatrices(np.tensordot(K, self.K, 1), np.tensordot(M, self.M, 1), means)
