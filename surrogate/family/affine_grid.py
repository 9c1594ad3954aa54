"""Where a family is affine: outlines on lines across r and z, the cells between them, and surfaces along them.

Every outline that runs along r or z lies on a line; its position is linear in the parameters. Between two lines

    r = a_i + b_i rho,    z = c_j + d_j zeta

with rho and zeta the coordinates of the reference geometry. Lines near the heated parts move along with them, so that
the mesh there keeps its sizes. Convection, open sides and contacts are quadrature points with weights that depend on
the parameters,

    K += sum_q w_q(mu) U_q U_q^T

with U_q the trace at point q, or the jump of both sides. All w(mu) lie in a space of few dimensions: an SVD of samples
gives a basis, pivoted QR the points at which the weights are evaluated (discrete empirical interpolation,
S. Chaturantabut, D. C. Sorensen, SIAM J. Sci. Comput. 32, 2737 (2010); the points after Z. Drmac, S. Gugercin,
SIAM J. Sci. Comput. 38, A631 (2016)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import qr
from scipy.sparse import csr_matrix, vstack

from thermofem import CrossSection
from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.surfaces import Side, resistances
from thermofem.geometry.parameter_paths import Change
from thermofem.geometry.regions import outlines
from thermofem.materials.material_library import VOID

from .parameter_box import Box, Properties

SAME = 1e-13  # m; lines nearer than this, which move alike, are one
SAMPLES = 300  # members at which coefficients are compared
ARRAYS = "place", "along", "interval", "outward"  # fields of `SurfacePoints` that are arrays


class NotAffineError(ValueError):
    """Raised where the parameters do not keep the outlines on lines in a fixed order; the message says why."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Lines across one axis, in increasing order.

    base [shape (l,), m]: positions in the reference geometry.
    slope [shape (l, p)]: change of each position per unit of each parameter.
    """

    base: Array
    slope: Array

    def at(self, offset: Array) -> Array:
        """Positions of the lines in m at parameters middle of the box + ``offset``, shape (..., p) -> (..., l)."""
        return self.base + offset @ self.slope.T

    def maps(self, offset: Array) -> tuple[Array, Array]:
        """Coefficients a and b of the map r = a + b rho in every interval, each of shape (..., l - 1)."""
        position = self.at(offset)
        b = np.diff(position, axis=-1) / np.diff(self.base)
        return position[..., :-1] - b * self.base[:-1], b

    def moved(self, x: Array, interval: NDArray[np.intp], offset: Array) -> Array:
        """Positions, at parameters middle + ``offset``, of reference points x that lie in the given intervals."""
        a, b = self.maps(offset)
        return a[interval] + b[interval] * x


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Lines across both axes, and the c cells between them that are meshed.

    left, lower [shape (c,)]: interval across r and z of each cell.
    owner [list of str]: layer or part of each cell.
    """

    box: Box
    r: Axis
    z: Axis
    left: NDArray[np.intp]
    lower: NDArray[np.intp]
    owner: list[str]

    @classmethod
    def of(cls, box: Box) -> CellGrid:
        """Make the grid from the geometry in the middle of the box.

        Raises NotAffineError: a wall that leans, a shell, or lines that meet inside the box.
        """
        base, half = box.base, np.maximum(box.high - box.middle, box.middle - box.low)
        if base.kind == "straight" or base.probes:
            raise NotAffineError("it has no weight 2 pi r, or shells around parts and copies off the axis")
        ranges = box.low - box.middle, box.high - box.middle
        heated = [part for part in base.parts if part.heated]
        r, z = (_ordered(axis, ranges, half) for axis in _lines(base, box.changes))
        r = _with_companions(r, ranges, [x for part in heated for x in (part.inner_radius, part.outer_radius)])
        z = _with_companions(z, ranges, [x for part in heated for x in (part.bottom, part.top)])
        return cls(box, r, z, *_cells(base, r.base, z.base))

    @cached_property
    def _materials(self) -> tuple[list[str], NDArray[np.intp]]:
        """Names of all materials, each once, and for each cell the index of its material, shape (c,)."""
        material = [self.box.base.material_of(name).name for name in self.owner]
        names = list(dict.fromkeys(material))
        return names, np.array([names.index(one) for one in material])

    def coefficients(self, rows: Array, at: Properties) -> tuple[Array, Array, Array]:
        """Coefficients of stiffness (n, 4 c), capacity (n, 2 c) and volume (n, 2 c) for parameters (n, p)."""
        names, index = self._materials
        k_r = 2 * np.pi * np.array([at.k_r[m] for m in names])[index].T
        k_z = 2 * np.pi * np.array([at.k_z[m] for m in names])[index].T
        c = 2 * np.pi * np.array([at.capacity[m] for m in names])[index].T
        offset = rows - self.box.middle
        a, b = (x[:, self.left] for x in self.r.maps(offset))
        d = self.z.maps(offset)[1][:, self.lower]
        ratio = d / b
        area = 2 * np.pi * b * d
        along_r = k_r * ratio
        along_z = k_z / ratio
        stiffness = np.concatenate([along_r * a, along_r * b, along_z * a, along_z * b], axis=1)
        volume = np.concatenate([area * a, area * b], axis=1)
        return stiffness, np.concatenate([c, c], axis=1) * volume / (2 * np.pi), volume


def _lines(base: CrossSection, changes: Sequence[Change]) -> tuple[Axis, Axis]:
    """Lines across r and across z on which the outlines lie, unsorted; NotAffineError where a wall leans."""
    found: tuple[list[Any], list[Any]] = ([], [])
    for name, outline in outlines(base).items():
        velocity = np.array([change.outlines.get(name, np.zeros((4, 2))) for change in changes])  # (p, 4, 2)
        for axis, begin, end in ((0, [0, 1], [3, 2]), (1, [0, 2], [1, 3])):  # both ends of two sides each
            apart = np.abs(outline[begin, axis] - outline[end, axis]).max()
            turns = np.abs(velocity[:, begin, axis] - velocity[:, end, axis]).max()
            # 1e-9 of a length: a wall that leans less runs along z
            if apart > 1e-9 * np.abs(outline).max() or turns > 1e-12:
                raise NotAffineError(f"the walls of {name!r} lean")
            found[axis].append((outline[begin, axis], velocity[:, begin, axis].T))
    r, z = (Axis(*map(np.concatenate, zip(*each, strict=True))) for each in found)
    return r, z


def _ordered(axis: Axis, ranges: tuple[Array, Array], half: Array) -> Axis:
    """Sort the lines and drop those that coincide over the whole box; NotAffineError where two lines meet inside it.

    ranges [two arrays, shape (p,)]: ends of the parameters, counted from the middle of the box.
    half [shape (p,)]: the larger distance of an end from the middle.
    """
    order = np.lexsort((*axis.slope.T, axis.base))
    base, slope = axis.base[order], axis.slope[order]
    kept: list[int] = []
    for k in range(len(base)):
        apart = np.abs(base[kept] - base[k]) + np.abs(slope[kept] - slope[k]) @ half
        if np.all(apart >= SAME):
            kept.append(k)
    lines = Axis(base[kept], slope[kept])
    low, _ = _gaps(lines, ranges)
    if low.min(initial=np.inf) <= SAME:
        raise NotAffineError(f"two outlines near {lines.base[int(low.argmin())]:g} m meet inside the box")
    return lines


def _gaps(axis: Axis, ranges: tuple[Array, Array]) -> tuple[Array, Array]:
    """Smallest and largest gap of each two neighbouring lines over the box in m, each of shape (l - 1,)."""
    base = np.diff(axis.base)
    slope = np.diff(axis.slope, axis=0)
    each = np.stack([slope * ranges[0], slope * ranges[1]])
    return base + each.min(axis=0).sum(axis=1), base + each.max(axis=0).sum(axis=1)


def _with_companions(axis: Axis, ranges: tuple[Array, Array], walls: Sequence[float]) -> Axis:
    """Add lines near walls of heated parts that move along with the wall, where a gap changes over the box."""
    low, high = _gaps(axis, ranges)
    base = list(axis.base)
    slope = list(axis.slope)
    for k in range(len(low)):
        if high[k] < 1.1 * low[k]:  # 1.1: a gap that changes by less over the box needs no such line
            continue
        ends = [e for e in (k, k + 1) if np.abs(np.asarray(walls) - axis.base[e]).min() < SAME]
        for e in ends:
            # 1e-6 m; at most this far from a heated part a line moves along with it
            away = min(1e-6, low[k] / (3 if len(ends) > 1 else 2))
            base.append(axis.base[e] + (away if e == k else -away))
            slope.append(axis.slope[e])
    order = np.argsort(base)
    return Axis(np.array(base)[order], np.array(slope)[order])


def _cells(base: CrossSection, r: Array, z: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], list[str]]:
    """Interval across r, interval across z, and owning layer or part of every meshed cell."""
    shapes = {name: (outline.min(axis=0), outline.max(axis=0)) for name, outline in outlines(base).items()}
    void = {part.name for part in base.parts if part.material == VOID}
    found = []
    for i, x in enumerate((r[:-1] + r[1:]) / 2):
        for j, y in enumerate((z[:-1] + z[1:]) / 2):
            inside = (n for n, (low, high) in shapes.items() if low[0] < x < high[0] and low[1] < y < high[1])
            owner = list(inside)[-1:]  # the last one drawn
            if owner and owner[0] not in void:
                found.append((i, j, owner[0]))
    left, lower, owners = zip(*found, strict=True)
    return np.array(left), np.array(lower), list(owners)


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Quadrature points on convective and open sides and on contacts, in the reference geometry.

    place [shape (q, 2), m]: r and z.
    along [shape (q, 2), m]: vector (r, z) along the facet times the quadrature weight of the point.
    interval [shape (q, 2)]: cells across r and z beside the facet.
    outward [shape (q, 2)]: unit normal.
    series [list of tuple of str]: names in `Properties.resistance` that are in series; none on an open side.
    material [list of str]: of the cell beside the point.
    """

    place: Array
    along: Array
    interval: NDArray[np.intp]
    outward: Array
    series: list[tuple[str, ...]]
    material: list[str]

    def pick(self, chosen: NDArray[np.intp]) -> SurfacePoints:
        """The points with the indices ``chosen``."""
        arrays = {name: getattr(self, name)[chosen] for name in ARRAYS}
        series = [self.series[k] for k in chosen]
        material = [self.material[k] for k in chosen]
        return SurfacePoints(**arrays, series=series, material=material)

    def weights(self, grid: CellGrid, rows: Array, at: Properties) -> Array:
        """Weights w_q of all points in W/K, shape (n, q), for members with the parameters ``rows``, shape (n, p)."""
        offset = rows - grid.box.middle
        (a, b), (c, d) = (
            [x[:, self.interval[:, k]] for x in axis.maps(offset)] for k, axis in enumerate((grid.r, grid.z))
        )
        r = a + b * self.place[:, 0]
        z = c + d * self.place[:, 1]
        measure = 2 * np.pi * r * np.hypot(b * self.along[:, 0], d * self.along[:, 1])
        height = z - _source(grid, offset)[:, None]
        h = np.empty(r.shape)
        for q, (names, m, normal) in enumerate(zip(self.series, self.material, self.outward, strict=True)):
            if names:
                h[:, q] = 1 / sum(at.resistance[name] for name in names)
            else:
                square = r[:, q] ** 2 / at.k_r[m] + height[:, q] ** 2 / at.k_z[m]
                h[:, q] = (normal[0] * r[:, q] + normal[1] * height[:, q]) / square
        return np.asarray(measure * h)


def _source(grid: CellGrid, offset: Array) -> Array:
    """z in m of the middle of the first heated part, shape (n,), at parameters middle + ``offset`` (n, p)."""
    part = next(part for part in grid.box.base.parts if part.heated)
    positions = grid.z.at(offset)
    low = int(np.abs(grid.z.base - part.bottom).argmin())
    high = int(np.abs(grid.z.base - part.top).argmin())
    return np.asarray((positions[:, low] + positions[:, high]) / 2)


def surface_points(heat: HeatProblem, intervals: NDArray[np.intp]) -> tuple[SurfacePoints, Any] | None:
    """Quadrature points of a heat problem on the reference mesh, and the sparse traces U, shape (q, unknowns).

    intervals [shape (triangles, 2)]: across r and z. None where the geometry has no such surfaces.
    """
    s, grid = heat.discretization.surfaces, heat.discretization.basis.mesh
    none = np.empty(0, dtype=np.intp)
    groups = [(s.open, none, "open"), *((one, other, "") for one, other in s.contacts.values())]
    for facets in s.convection.values():
        r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
        sides = ("top", "bottom", "outer")
        groups += [(facets[heat.geometry.on_boundary(side, r, z)], none, side) for side in sides]
    pairs = [_on(heat, intervals, *group) for group in groups if len(group[0])]
    if not pairs:
        return None
    found, traces = zip(*pairs, strict=True)
    arrays = {name: np.concatenate([getattr(one, name) for one in found]) for name in ARRAYS}
    series = [x for one in found for x in one.series]
    material = [x for one in found for x in one.material]
    return SurfacePoints(**arrays, series=series, material=material), vstack(traces).tocsr()


def _trace(side: Side) -> Any:
    """Values of all n functions at the three Gauss points of each of f facets, sparse, shape (3 f, n)."""
    (f, _, q), values = side.shape.shape, side.shape
    rows = np.broadcast_to(np.arange(f * q).reshape(f, 1, q), values.shape)
    columns = np.broadcast_to(side.dofs[..., None], values.shape)
    return csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(f * q, side.basis.N))


def _on(
    heat: HeatProblem, intervals: NDArray[np.intp], facets: NDArray[np.intp], other: NDArray[np.intp], where: str
) -> tuple[SurfacePoints, Any]:
    """Quadrature points on facets, and the traces of all functions there (on a contact their jump), sparse.

    facets, other [int arrays]: the facets, and for a contact those on its other side, else none.
    where: side of the domain, "open", or "" for a contact.
    """
    base, limit = heat.geometry, resistances(heat.geometry)
    sides = [Side.of(heat.discretization.basis, each) for each in (facets, other) if len(each)]
    one, names = sides[0], np.array(heat.mesh.region_names)
    own = [names[heat.mesh.region[side.cells]].tolist() for side in sides]
    outside = (f"boundary.{where}",) if where and where != "open" and getattr(base, where).exchange else ()
    series = [(*outside, *(f"interface.{part}" for part in pair if part in limit)) for pair in zip(*own, strict=True)]
    along = one.ends[:, 1] - one.ends[:, 0]  # (2, f)
    normal = one.outward * np.array([along[1], -along[0]]) / np.hypot(*along)
    points = SurfacePoints(
        place=one.along(one.ends).T.reshape(-1, 2),
        along=(along[:, None] * one.weight[:, None]).T.reshape(-1, 2),
        interval=np.repeat(intervals[one.cells], len(one.at), axis=0),
        outward=np.repeat(normal.T, len(one.at), axis=0),
        series=[() if where == "open" else each for each in series for _ in one.at],
        material=[base.material_of(name).name for name in own[0] for _ in one.at],
    )
    return points, _trace(one) - _trace(sides[1]) if len(sides) > 1 else _trace(one)


@dataclass(frozen=True, eq=False)
class SampledWeights:
    """Weights of all surface points as combinations of those of a few points: w = modes @ w(points)."""

    points: SurfacePoints
    modes: Array

    @classmethod
    def of(cls, every: SurfacePoints, samples: Array) -> SampledWeights:
        """Choose the points, by SVD and pivoted QR, from weights at n sample members, shape (n, q)."""
        scale = np.abs(samples).max(axis=0)  # far points carry small weights, and count as well
        u, s, _ = np.linalg.svd((samples / scale).T, full_matrices=False)
        # 1e-13: singular values below this share of the first are round-off
        rank = max(1, int((s > 1e-13 * s[0] * np.sqrt(len(scale))).sum()))
        _, _, order = qr(u[:, :rank].T, pivoting=True, mode="economic")
        chosen = order[:rank]
        modes = scale[:, None] * (u[:, :rank] @ np.linalg.inv(u[chosen, :rank])) / scale[chosen]
        return cls(every.pick(chosen), modes)
