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

SAME_LINE = 1e-13  # m; lines nearer than this, which move alike, are one
SAMPLE_MEMBERS = 300  # members at which coefficients are compared
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
        gaps = np.diff(position, axis=-1)
        b = gaps / np.diff(self.base)
        a = position[..., :-1] - b * self.base[:-1]
        return a, b

    def moved(self, x: Array, interval: NDArray[np.intp], offset: Array) -> Array:
        """Positions, at parameters middle + ``offset``, of reference points x that lie in the given intervals."""
        a, b = self.maps(offset)
        return a[interval] + b[interval] * x


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Lines across both axes, and the c cells between them that are meshed.

    left, lower [shape (c,)]: interval across r and z of each cell.
    owner [sequence of str]: layer or part of each cell.
    """

    box: Box
    r: Axis
    z: Axis
    left: NDArray[np.intp]
    lower: NDArray[np.intp]
    owner: Sequence[str]

    @classmethod
    def of(cls, box: Box) -> CellGrid:
        """Make the grid from the geometry in the middle of the box.

        Raises NotAffineError: a wall that leans, a shell, or lines that meet inside the box.
        """
        base = box.base
        if base.kind == "straight" or base.probes:
            raise NotAffineError("it has no weight 2 pi r, or shells around parts and copies off the axis")
        ranges = box.low - box.middle, box.high - box.middle
        heated = [part for part in base.parts if part.heated]
        radii = [x for part in heated for x in (part.inner_radius, part.outer_radius)]
        heights = [x for part in heated for x in (part.bottom, part.top)]
        across_r, across_z = _lines(base, box.changes)
        r = _with_companions(_ordered(across_r, ranges), ranges, radii)
        z = _with_companions(_ordered(across_z, ranges), ranges, heights)
        return cls(box, r, z, *_cells(base, r.base, z.base))

    @cached_property
    def _materials(self) -> tuple[list[str], NDArray[np.intp]]:
        """Names of all materials, each once, and for each cell the index of its material, shape (c,)."""
        material = [self.box.base.material_of(name).name for name in self.owner]
        names = list(dict.fromkeys(material))
        return names, np.array([names.index(name) for name in material])

    def coefficients(self, rows: Array, at: Properties) -> tuple[Array, Array, Array]:
        """Coefficients of stiffness (n, 4 c), capacity (n, 2 c) and volume (n, 2 c) for parameters (n, p)."""
        names, index = self._materials

        def around(numbers: dict[str, Array]) -> Array:
            """2 pi times a property, of every member and cell."""
            table = np.array([numbers[material] for material in names])
            return 2 * np.pi * table[index].T

        offset = rows - self.box.middle
        a, b = self.r.maps(offset)
        _, d = self.z.maps(offset)
        a = a[:, self.left]
        b = b[:, self.left]
        d = d[:, self.lower]
        ratio = d / b
        area = 2 * np.pi * b * d
        along_r = around(at.k_r) * ratio
        along_z = around(at.k_z) / ratio
        stiffness = np.hstack([along_r * a, along_r * b, along_z * a, along_z * b])
        volume = np.hstack([area * a, area * b])
        c = np.tile(around(at.capacity), 2)
        return stiffness, c * volume / (2 * np.pi), volume


def _lines(base: CrossSection, changes: Sequence[Change]) -> tuple[Axis, Axis]:
    """Lines across r and across z on which the outlines lie, unsorted; NotAffineError where a wall leans."""
    still = np.zeros((4, 2))
    axes = []
    for axis, begin, end in ((0, [0, 1], [3, 2]), (1, [0, 2], [1, 3])):  # both ends of two sides each
        positions = []
        slopes = []
        for name, outline in outlines(base).items():
            velocity = np.array([change.outlines.get(name, still) for change in changes])  # (p, 4, 2)
            straight = 1e-9 * np.abs(outline).max()  # 1e-9 of a length: a wall that leans less runs along z
            position = outline[begin, axis]
            slope = velocity[:, begin, axis]
            lean = np.abs(position - outline[end, axis])
            turn = np.abs(slope - velocity[:, end, axis])
            if lean.max() > straight or turn.max() > 1e-12:
                raise NotAffineError(f"the walls of {name!r} lean")
            positions.append(position)
            slopes.append(slope.T)
        axes.append(Axis(np.concatenate(positions), np.concatenate(slopes)))
    r, z = axes
    return r, z


def _ordered(axis: Axis, ranges: tuple[Array, Array]) -> Axis:
    """Sort the lines and drop those that coincide over the whole box; NotAffineError where two lines meet inside it.

    ranges [two arrays, shape (p,)]: ends of the parameters, counted from the middle of the box.
    """
    low, high = ranges
    half = np.maximum(high, -low)  # the larger distance of an end from the middle
    order = np.lexsort((*axis.slope.T, axis.base))
    base = axis.base[order]
    slope = axis.slope[order]
    different: list[int] = []
    for k in range(len(base)):
        turn = np.abs(slope[different] - slope[k])
        apart = np.abs(base[different] - base[k]) + turn @ half
        if np.all(apart >= SAME_LINE):
            different.append(k)
    lines = Axis(base[different], slope[different])
    gaps, _ = _gaps(lines, ranges)
    if gaps.min(initial=np.inf) <= SAME_LINE:
        place = lines.base[int(gaps.argmin())]
        raise NotAffineError(f"two outlines near {place:g} m meet inside the box")
    return lines


def _gaps(axis: Axis, ranges: tuple[Array, Array]) -> tuple[Array, Array]:
    """Smallest and largest gap of each two neighbouring lines over the box in m, each of shape (l - 1,)."""
    base = np.diff(axis.base)
    slope = np.diff(axis.slope, axis=0)
    moves = np.stack([slope * end for end in ranges])
    inwards = moves.min(axis=0).sum(axis=1)
    outwards = moves.max(axis=0).sum(axis=1)
    return base + inwards, base + outwards


def _with_companions(axis: Axis, ranges: tuple[Array, Array], walls: Sequence[float]) -> Axis:
    """Add lines near walls of heated parts that move along with the wall, where a gap changes over the box."""
    low, high = _gaps(axis, ranges)
    base = list(axis.base)
    slope = list(axis.slope)
    for k in range(len(low)):
        if high[k] < 1.1 * low[k]:  # 1.1: a gap that changes by less over the box needs no such line
            continue
        ends = [e for e in (k, k + 1) if np.abs(axis.base[e] - walls).min() < SAME_LINE]
        # 1e-6 m; at most this far from a heated part a line moves along with it
        away = min(1e-6, low[k] / (len(ends) + 1))
        for e in ends:
            inwards = away if e == k else -away
            base.append(axis.base[e] + inwards)
            slope.append(axis.slope[e])
    order = np.argsort(base)
    return Axis(np.array(base)[order], np.array(slope)[order])


def _cells(base: CrossSection, r: Array, z: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], list[str]]:
    """Interval across r, interval across z, and owning layer or part of every meshed cell."""
    shapes = outlines(base)
    void = {part.name for part in base.parts if part.material == VOID}
    left: list[int] = []
    lower: list[int] = []
    owners: list[str] = []
    for i, j in np.ndindex(len(r) - 1, len(z) - 1):
        middle = np.array([r[i] + r[i + 1], z[j] + z[j + 1]]) / 2
        owner = ""
        for name, outline in shapes.items():
            above = middle > outline.min(axis=0)
            below = middle < outline.max(axis=0)
            if np.all(above & below):
                owner = name  # the last one drawn
        if owner and owner not in void:
            left.append(i)
            lower.append(j)
            owners.append(owner)
    return np.array(left), np.array(lower), owners


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
        rho, zeta = self.place.T
        along_r, along_z = self.along.T
        i, j = self.interval.T
        a, b = grid.r.maps(offset)
        c, d = grid.z.maps(offset)
        b = b[:, i]
        d = d[:, j]
        r = a[:, i] + b * rho
        z = c[:, j] + d * zeta
        measure = 2 * np.pi * r * np.hypot(b * along_r, d * along_z)
        height = z - _source(grid, offset)[:, None]
        h = np.empty(r.shape)
        for q, names in enumerate(self.series):
            if names:
                h[:, q] = 1 / sum(at.resistance[name] for name in names)
                continue
            x = r[:, q]
            y = height[:, q]
            material = self.material[q]
            normal_r, normal_z = self.outward[q]
            square = x**2 / at.k_r[material] + y**2 / at.k_z[material]
            h[:, q] = (normal_r * x + normal_z * y) / square
        return measure * h


def _source(grid: CellGrid, offset: Array) -> Array:
    """z in m of the middle of the first heated part, shape (n,), at parameters middle + ``offset`` (n, p)."""
    part = grid.box.base.first_heated
    positions = grid.z.at(offset)
    low = int(np.abs(grid.z.base - part.bottom).argmin())
    high = int(np.abs(grid.z.base - part.top).argmin())
    return (positions[:, low] + positions[:, high]) / 2


def surface_points(heat: HeatProblem, intervals: NDArray[np.intp]) -> tuple[SurfacePoints, Any] | None:
    """Quadrature points of a heat problem on the reference mesh, and the sparse traces U, shape (q, unknowns).

    intervals [shape (triangles, 2)]: across r and z. None where the geometry has no such surfaces.
    """
    surfaces = heat.discretization.surfaces
    mesh = heat.discretization.basis.mesh
    none = np.empty(0, dtype=np.intp)
    groups = [(surfaces.open, none, "open")]
    groups += [(facets, other, "") for facets, other in surfaces.contacts.values()]
    for facets in surfaces.convection.values():
        ends = mesh.p[:, mesh.facets[:, facets]]
        r, z = ends.mean(axis=1)
        for side in ("top", "bottom", "outer"):
            here = heat.geometry.on_boundary(side, r, z)
            groups.append((facets[here], none, side))
    points = []
    traces = []
    for facets, other, where in groups:
        if len(facets):
            of_group, trace = _on(heat, intervals, facets, other, where)
            points.append(of_group)
            traces.append(trace)
    if not points:
        return None
    arrays = {}
    for name in ARRAYS:
        arrays[name] = np.concatenate([getattr(of_group, name) for of_group in points])
    series = [names for of_group in points for names in of_group.series]
    material = [name for of_group in points for name in of_group.material]
    return SurfacePoints(**arrays, series=series, material=material), vstack(traces).tocsr()


def _trace(side: Side) -> Any:
    """Values of all n functions at the three Gauss points of each of f facets, sparse, shape (3 f, n)."""
    values = side.shape
    f, _, q = values.shape
    point = np.arange(f * q).reshape(f, 1, q)
    rows = np.broadcast_to(point, values.shape).ravel()
    columns = np.broadcast_to(side.dofs[..., None], values.shape).ravel()
    return csr_matrix((values.ravel(), (rows, columns)), shape=(f * q, side.basis.N))


def _on(
    heat: HeatProblem, intervals: NDArray[np.intp], facets: NDArray[np.intp], other: NDArray[np.intp], where: str
) -> tuple[SurfacePoints, Any]:
    """Quadrature points on facets, and the traces of all functions there (on a contact their jump), sparse.

    facets, other [int arrays]: the facets, and for a contact those on its other side, else none.
    where: side of the domain, "open", or "" for a contact.
    """
    names = np.array(heat.mesh.region_names)
    sides = [Side.of(heat.discretization.basis, each) for each in (facets, other) if len(each)]
    regions = [names[heat.mesh.region[side.cells]].tolist() for side in sides]
    series = _in_series(heat, regions, where)
    material = [heat.geometry.material_of(name).name for name in regions[0]]
    first = sides[0]
    count = len(first.at)
    along = first.ends[:, 1] - first.ends[:, 0]  # (2, f)
    right = np.array([along[1], -along[0]])
    normal = first.outward * right / np.hypot(*along)
    weighted = along[:, None] * first.weight[:, None]
    points = SurfacePoints(
        place=first.along(first.ends).T.reshape(-1, 2),
        along=weighted.T.reshape(-1, 2),
        interval=np.repeat(intervals[first.cells], count, axis=0),
        outward=np.repeat(normal.T, count, axis=0),
        series=[resistance for resistance in series for _ in range(count)],
        material=[name for name in material for _ in range(count)],
    )
    trace = _trace(first)
    for second in sides[1:]:
        trace = trace - _trace(second)
    return points, trace


def _in_series(heat: HeatProblem, regions: list[list[str]], where: str) -> list[tuple[str, ...]]:
    """Names of the resistances in series at every facet; ``regions``: those beside it, of each of its sides."""
    contacts = resistances(heat.geometry)
    if where == "open":
        return [()] * len(regions[0])
    exchanging = bool(where) and bool(getattr(heat.geometry, where).exchange)
    outside = (f"boundary.{where}",) if exchanging else ()
    series = []
    for beside in zip(*regions, strict=True):
        inside = (f"interface.{part}" for part in beside if part in contacts)
        series.append((*outside, *inside))
    return series


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
        least = 1e-13 * s[0] * np.sqrt(len(scale))
        rank = max(1, int((s > least).sum()))
        leading = u[:, :rank]
        _, _, order = qr(leading.T, pivoting=True, mode="economic")
        chosen = order[:rank]
        relative = leading @ np.linalg.inv(leading[chosen])
        modes = scale[:, None] * relative / scale[chosen]
        return cls(every.pick(chosen), modes)
