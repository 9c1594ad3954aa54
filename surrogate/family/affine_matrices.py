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

from .affine_grid import CellGrid, Properties, member_properties
from .parameter_box import Box
from .surface_weights import SAMPLES, SampledWeights, SurfacePoints, points


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a grid that are meshed.

    i, j [shape (c,)]: interval across r and z.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    owner: list[str]
    material: list[str]

    @classmethod
    def of(cls, grid: CellGrid, box: Box) -> Cells:
        """Number them."""
        found = [(i, j, name) for i, column in enumerate(grid.owner) for j, name in enumerate(column) if name]
        i, j, owner = zip(*found, strict=True)
        return cls(np.array(i), np.array(j), list(owner), [box.base.material_of(name).name for name in owner])

    @cached_property
    def _materials(self) -> tuple[list[str], NDArray[np.intp]]:
        """Every material once, and which one each cell has."""
        names = list(dict.fromkeys(self.material))
        return names, np.array([names.index(m) for m in self.material])

    def properties(self, at: Properties) -> tuple[Array, Array, Array]:
        """2 pi times k_r, k_z and rho c_p of every cell, each of shape (n or 1, c)."""
        names, index = self._materials
        k_r, k_z, c = (2 * np.pi * np.array([x[m] for m in names])[index].T for x in (at.k_r, at.k_z, at.capacity))
        return k_r, k_z, c

    def coefficients(
        self, grid: CellGrid, box: Box, rows: Array, at: Properties | None = None
    ) -> tuple[Array, Array, Array]:
        """Coefficients of stiffness (n, 4 c), capacity (n, 2 c) and volume (n, 2 c) for parameters (n, p)."""
        k_r, k_z, c = self.properties(at or member_properties(box, rows))
        a, b, d = self.cell_maps(grid, rows - box.middle)
        volume = self.volume(a, b, d)
        return self.stiffness(k_r, k_z, a, b, d), np.concatenate([c, c], axis=1) * volume / (2 * np.pi), volume

    def cell_maps(self, grid: CellGrid, offset: Array) -> tuple[Array, Array, Array]:
        """a, b and d of every cell, each of shape (n, c)."""
        a, b = grid.r.maps(offset)
        return a[:, self.i], b[:, self.i], grid.z.maps(offset)[1][:, self.j]

    @staticmethod
    def stiffness(k_r: Array, k_z: Array, a: Array, b: Array, d: Array) -> Array:
        """Coefficients of the stiffness, shape (n, 4 c)."""
        ratio = d / b
        along_r, along_z = k_r * ratio, k_z / ratio
        return np.concatenate([along_r * a, along_r * b, along_z * a, along_z * b], axis=1)

    @staticmethod
    def volume(a: Array, b: Array, d: Array) -> Array:
        """Coefficients of volumes, shape (n, 2 c)."""
        area = 2 * np.pi * b * d
        return np.concatenate([area * a, area * b], axis=1)


def element_terms(basis: Any) -> tuple[Array, Array, Array]:
    """Matrices of every triangle: stiffness (4, t, b, b) as rr0, rr1, zz0, zz1; capacity (2, t, b, b); load (2, t, b).

    Without the factor 2 pi; the weight is 1 or the radius.
    """
    J, r = maps(basis.mesh)
    det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
    inverse = np.array([[J[1, 1], -J[0, 1]], [-J[1, 0], J[0, 0]]]) / det
    integrals, t, n = reference(basis), basis.nelems, basis.Nbfun
    stiffness, capacity, load = [], [], []
    for along in (0, 1):
        metric = np.abs(det) * inverse[:, None, along] * inverse[None, :, along]
        for weight in (np.ones_like(r), r):
            share = (metric[:, :, None] * weight).reshape(-1, t)
            stiffness.append((share.T @ integrals.stiffness).reshape(t, n, n))
    for weight in (np.ones_like(r), r):
        share = np.abs(det) * weight
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


PROPERTIES = ("ambient", "material", "interface", "boundary")  # kinds of paths that `member_properties` reads


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of all terms as functions of the parameters; with the matrices they make a member.

    stiffness, capacity [(int array, array)]: which term each coefficient of `Cells.coefficients` belongs to, and its
        factor.
    """

    box: Box
    grid: CellGrid
    cells: Cells
    stiffness: tuple[NDArray[np.intp], Array]
    capacity: tuple[NDArray[np.intp], Array]
    surface: SampledWeights | None

    def __call__(self, rows: Array) -> tuple[Array, Array, Array]:
        """Coefficients of K (n, q), of M (n, m) and of volumes (n, 2 c) for parameters (n, p)."""
        K, volume, c = self._static(rows)
        first = self._firsts[1]
        return K, c[:, first % c.shape[1]] * volume[:, first] / (2 * np.pi), volume

    def static(self, rows: Array) -> tuple[Array, Array]:
        """Those of K and of volumes alone."""
        return self._static(rows)[:2]

    def _static(self, rows: Array) -> tuple[Array, Array, Array]:
        """Coefficients of K and of volumes, and 2 pi rho c_p of every cell."""
        if (fixed := self._fixed) is not None:
            k_r, k_z, c = fixed
        else:
            at = member_properties(self.box, rows)
            k_r, k_z, c = self.cells.properties(at)
        a, b, d = self.cells.cell_maps(self.grid, rows - self.box.middle)
        K = self.cells.stiffness(k_r, k_z, a, b, d)[:, self._firsts[0]]
        if self.surface is not None:
            K = np.concatenate([K, self.surface.points.weights(self.grid, self.box, rows, at)], axis=1)
        return K, self.cells.volume(a, b, d), c

    @cached_property
    def _fixed(self) -> tuple[Array, Array, Array] | None:
        """Laws of the cells that hold for all members; None where a parameter changes one, or surfaces need more."""
        paths = [path for v in self.box.campaign.variations for path in v.paths]
        if self.surface is not None or any(path.split(".")[0] in PROPERTIES for path in paths):
            return None
        return self.cells.properties(member_properties(self.box, self.box.middle[None]))

    @cached_property
    def _firsts(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The first coefficient of every kind."""
        first = [np.unique(kind, return_index=True)[1] for kind, _ in (self.stiffness, self.capacity)]
        return first[0], first[1]


class AffineEngine:
    """Full and reduced matrices of a family on lines.

    accuracy: of the reference mesh.
    """

    name = "affine"

    def __init__(self, box: Box, accuracy: float) -> None:
        self.box, self.grid, self.accuracy = box, CellGrid.of(box), accuracy
        self.cells = Cells.of(self.grid, box)
        mesh, cell = _mesh(self.grid, self.cells, box, accuracy)
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
        offset = row - self.box.middle
        i, j = self.cells.i[self._vertex], self.cells.j[self._vertex]
        r = self.grid.r.moved(self.mesh.points[:, 0], i, offset)
        z = self.grid.z.moved(self.mesh.points[:, 1], j, offset)
        moved = replace(self.mesh, points=np.stack([r, z], axis=1))
        return on_mesh(self.box.geometry(row), moved, self.accuracy)

    @cached_property
    def _sampled(self) -> tuple[Coefficients, SurfacePoints, Any]:
        rows = self.box.draw(SAMPLES, seed=1)
        stiffness, capacity, _ = self.cells.coefficients(self.grid, self.box, rows)
        every, traces = points(self.reference, self.cell, self.cells.i, self.cells.j)
        surface = None
        if len(every.kind):
            surface = SampledWeights.of(
                every, every.weights(self.grid, self.box, rows, member_properties(self.box, rows))
            )
        found = Coefficients(
            self.box, self.grid, self.cells, group_proportional(stiffness), group_proportional(capacity), surface
        )
        return found, every, traces

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
        count = len(self.cells.i)
        n = V.shape[1]
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
        coefficients, _, traces = self._sampled
        K_terms = _summed(K.reshape(-1, n, n), coefficients.stiffness)
        if coefficients.surface is not None:
            U = traces @ full
            extra = [U.T @ (mode[:, None] * U) for mode in coefficients.surface.modes.T]
            K_terms = np.concatenate([K_terms, np.array(extra)])
        M_terms = _summed(M.reshape(-1, n, n), coefficients.capacity)
        inside = np.array([[owner == name for owner in self.cells.owner] for name in ports])
        P = inside[:, None, :, None] * L
        return K_terms, M_terms, P.reshape(len(ports), -1, n)

    def volumes(self, ports: tuple[str, ...]) -> Array:
        """Terms of the volume of every port, shape (len(ports), 2 c)."""
        basis = self.reference.discretization.basis
        _, _, load = element_terms(basis)
        each = np.array([np.bincount(self.cell, x.sum(axis=1), minlength=len(self.cells.i)) for x in load])
        inside = np.array([[owner == name for owner in self.cells.owner] for name in ports])
        return (inside[:, None, :] * each).reshape(len(ports), -1)


def _summed(terms: Array, kinds: tuple[NDArray[np.intp], Array]) -> Array:
    kind, ratio = kinds
    total = np.zeros((kind.max() + 1, *terms.shape[1:]))
    np.add.at(total, kind, ratio[:, None, None] * terms)
    return total


def _mesh(grid: CellGrid, cells: Cells, box: Box, accuracy: float) -> tuple[Mesh, NDArray[np.intp]]:
    """A mesh that conforms to all lines, regions named after owners, and the cell of every triangle."""
    r, z = grid.r.base, grid.z.base
    faces = tuple(
        Face(str(k), (np.array([(r[i], z[j]), (r[i + 1], z[j]), (r[i + 1], z[j + 1]), (r[i], z[j + 1])]),))
        for k, (i, j) in enumerate(zip(cells.i, cells.j, strict=True))
    )
    mesh = make_faces(faces, size_function(box.base, sizes(accuracy)), box.base.name)
    cell = np.array([int(name) for name in mesh.region_names])[mesh.region]
    names = tuple(name for name in box.base.region_names if name in cells.owner)
    region = np.array([names.index(owner) for owner in cells.owner])[cell]
    return Mesh(mesh.points, mesh.triangles, region, names), cell
