"""Convection, open sides and contacts of a family on lines: quadrature points with weights that depend on parameters.

    K += sum_q w_q(mu) U_q U_q^T

with U_q the trace at point q, or the jump of both sides. All w(mu) lie in a space of few dimensions: an SVD of samples
gives a basis, pivoted QR the points at which the weights are evaluated (discrete empirical interpolation,
S. Chaturantabut, D. C. Sorensen, SIAM J. Sci. Comput. 32, 2737 (2010); the points after Z. Drmac, S. Gugercin,
SIAM J. Sci. Comput. 38, A631 (2016)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import qr
from scipy.sparse import csr_matrix, vstack

from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.mesh_division import resistances

from .affine_grid import CellGrid
from .parameter_box import Properties

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # as scikit-fem integrates facets of quadratic triangles
GAUSS, WEIGHT = (1 + _NODES) / 2, _WEIGHTS / 2
SAMPLES = 300
ARRAYS = "kind", "ends", "gauss", "interval", "material", "outward"  # fields with a row for each point


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Quadrature points on surfaces, in the reference geometry.

    kind [shape (q,)]: "convection SIDE" (also of an isothermal side under a contact resistance), "open" or "contact".
    ends [shape (q, 2 ends, 2), m]: of the facet.
    gauss [shape (q,)]: which of the three points.
    interval [shape (q, 2)]: cells across r and z beside the facet.
    material: beside it.
    outward [shape (q, 2)]: unit normal.
    parts: whose contact resistances add.
    """

    kind: NDArray[Any]
    ends: Array
    gauss: NDArray[np.intp]
    interval: NDArray[np.intp]
    material: NDArray[Any]
    outward: Array
    parts: list[tuple[str, ...]]

    def pick(self, chosen: NDArray[np.intp]) -> SurfacePoints:
        """Some of the points."""
        arrays = {name: getattr(self, name)[chosen] for name in ARRAYS}
        return SurfacePoints(**arrays, parts=[self.parts[k] for k in chosen])

    def weights(self, grid: CellGrid, rows: Array, at: Properties) -> Array:
        """w at every point for parameters of shape (n, p); shape (n, q)."""
        offset = rows - grid.box.middle
        place = []
        for axis, line in enumerate((grid.r, grid.z)):
            a, b = line.maps(offset)
            a, b = a[:, self.interval[:, axis]], b[:, self.interval[:, axis]]
            place.append(a[:, :, None] + b[:, :, None] * self.ends[None, :, :, axis])
        r, z = place
        length = np.hypot(r[..., 1] - r[..., 0], z[..., 1] - z[..., 0])
        x = GAUSS[self.gauss]
        r, z = (y[..., 0] * (1 - x) + y[..., 1] * x for y in (r, z))
        measure = 2 * np.pi * r * length * WEIGHT[self.gauss]
        return measure * self._exchange(grid, offset, at, r, z)

    def _exchange(self, grid: CellGrid, offset: Array, at: Properties, r: Array, z: Array) -> Array:
        """Heat per area and kelvin at every point."""
        h = np.zeros(r.shape)
        for q, kind in enumerate(self.kind):
            if kind != "open":  # contacts in series, and with the convection of a side, if it has any
                own = [1 / at.convection[side] for side in kind.split()[1:] if side in at.convection]
                h[:, q] = 1 / sum([*own, *(at.contact[part] for part in self.parts[q])])
            else:
                height = z[:, q] - _source(grid, offset)
                n, m = self.outward[q], self.material[q]
                square = r[:, q] ** 2 / at.k_r[m] + height**2 / at.k_z[m]
                h[:, q] = (n[0] * r[:, q] + n[1] * height) / square
        return h


def _source(grid: CellGrid, offset: Array) -> Array:
    """Height of the middle of the first heated part."""
    part = next(part for part in grid.box.base.parts if part.heated)
    positions = grid.z.at(offset)
    low, high = (int(np.abs(grid.z.base - z).argmin()) for z in (part.bottom, part.top))
    return np.asarray((positions[:, low] + positions[:, high]) / 2)


def points(heat: HeatProblem, intervals: NDArray[np.intp]) -> tuple[SurfacePoints, Any] | None:
    """Quadrature points of a heat problem on the reference mesh, and the sparse traces U, shape (q, unknowns).

    intervals [shape (triangles, 2)]: across r and z. None where the geometry has no such surfaces.
    """
    d, found, traces = heat.discretization, [], []
    s = d.surfaces
    grid = d.basis.mesh
    for facets in s.convection.values():
        r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
        for side in ("top", "bottom", "outer"):
            there = facets[heat.geometry.on_boundary(side, r, z)]
            if len(there):
                found.append(_on(heat, there, intervals, f"convection {side}"))
                traces.append(_trace(d.basis, there))
    if len(s.open):
        found.append(_on(heat, s.open, intervals, "open"))
        traces.append(_trace(d.basis, s.open))
    for one, other in s.contacts.values():
        found.append(_on(heat, one, intervals, "contact", other))
        traces.append(_trace(d.basis, one) - _trace(d.basis, other))
    if not found:
        return None
    arrays = {name: np.concatenate([getattr(one, name) for one in found]) for name in ARRAYS}
    every = SurfacePoints(**arrays, parts=[part for one in found for part in one.parts])
    return every, vstack(traces).tocsr()


def _trace(basis: Any, facets: NDArray[np.intp]) -> Any:
    """Properties of all functions at the three Gauss points of each facet, sparse, shape (3 f, n)."""
    x = GAUSS
    shape = np.array([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)])  # (function, point)
    dofs = np.vstack([basis.nodal_dofs[0][basis.mesh.facets[:, facets]], basis.facet_dofs[0][facets]])
    values = np.broadcast_to(shape.T, (len(facets), 3, 3))
    columns = np.broadcast_to(dofs.T[:, None, :], values.shape)
    rows = np.broadcast_to(np.arange(3 * len(facets)).reshape(-1, 3, 1), values.shape)
    return csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * len(facets), basis.N))


def _on(
    heat: HeatProblem,
    facets: NDArray[np.intp],
    intervals: NDArray[np.intp],
    kind: str,
    other: NDArray[np.intp] | None = None,
) -> SurfacePoints:
    """Points of facets; ``other`` are the same facets of a contact, on its other side."""
    grid = heat.discretization.basis.mesh
    beside = grid.f2t[0, facets]
    ends = np.moveaxis(grid.p[:, grid.facets[:, facets]], (0, 1, 2), (2, 1, 0))  # (f, end, axis)
    centre = grid.p[:, grid.t[:, beside]].mean(axis=1).T
    along = ends[:, 1] - ends[:, 0]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    normal *= np.sign(np.einsum("fx,fx->f", normal, ends.mean(axis=1) - centre))[:, None]
    names = heat.mesh.region_names
    limit = resistances(heat.geometry)
    owners = [[names[r] for r in heat.mesh.region[beside]]]
    if other is not None:
        owners.append([names[r] for r in heat.mesh.region[grid.f2t[0, other]]])
    parts = [tuple(name for name in pair if name in limit) for pair in zip(*owners, strict=True)]
    material = np.array([heat.geometry.material_of(name).name for name in owners[0]])
    return SurfacePoints(
        kind=np.repeat(np.full(len(facets), kind, dtype=object), 3),
        ends=np.repeat(ends, 3, axis=0),
        gauss=np.tile(np.arange(3), len(facets)),
        interval=np.repeat(intervals[beside], 3, axis=0),
        material=np.repeat(material.astype(object), 3),
        outward=np.repeat(normal, 3, axis=0),
        parts=[part for part in parts for _ in range(3)],
    )


@dataclass(frozen=True, eq=False)
class SampledWeights:
    """Weights from a few of their points: w = modes @ weights at those points."""

    points: SurfacePoints
    modes: Array

    @classmethod
    def of(cls, every: SurfacePoints, samples: Array) -> SampledWeights:
        """Choose points from weights at many members, shape (n, q)."""
        scale = np.abs(samples).max(axis=0)  # far points carry small weights, and count as well
        u, s, _ = np.linalg.svd((samples / scale).T, full_matrices=False)
        # 1e-13: singular values below this share of the first are round-off
        rank = max(1, int((s > 1e-13 * s[0] * np.sqrt(len(scale))).sum()))
        _, _, order = qr(u[:, :rank].T, pivoting=True, mode="economic")
        chosen = order[:rank]
        modes = scale[:, None] * (u[:, :rank] @ np.linalg.inv(u[chosen, :rank])) / scale[chosen]
        return cls(every.pick(chosen), modes)
