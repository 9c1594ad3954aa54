"""Boundary conditions and contacts: their facets, and their weak forms in the stiffness.

K_ij += int 2 pi r h u_i u_j ds                               where heat h (T - T0) is exchanged with the ambient,
                                                              1/(1/h + R) for h where the part has a resistance R
K_ij += int 2 pi r (u_i^+ - u_i^-) (u_j^+ - u_j^-) / R ds     over every contact of resistance R
K_ij += int 2 pi r (n . d) / (d . k^-1 d) u_i u_j ds          over open sides, d from the source
K_ij += int 2 pi r (n . d) / (d . k^-1 d) / c(d/L) u_i u_j ds over open sides of a straight section of length L

In a straight section L (2 L of a mirrored one) stands for 2 pi r.

A thermal boundary resistance makes the temperature jump by resistance times flux. Every node of such a surface is there
once for each side; the flux between the two sides is (T^+ - T^-)/resistance. Where two surfaces lie on each other their
resistances add. On a side of the domain that the ambient holds or cools, the resistance is in series with it. Where
regions touch in one point only, two silicon corners between voids for instance, no heat flows through it: the mesh is
parted there, with one vertex for each group of triangles that edges hold together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from ..arrays import Array, ArrayLike, Indices, Mask, NDArray, scattered
from ..mesh.triangles import Mesh, radii

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection


@dataclass(frozen=True, eq=False)
class Side:
    """Facets, each from its first to its second vertex, with m functions and q Gauss points.

    basis [anything with mesh, elem, element_dofs and N]
    cells [shape (f,)]: the triangle beside each.
    dofs [shape (f, m)]
    shape [shape (f, m, q)]: the functions at the points.
    at, weight [shape (q,)]: positions 0 to 1 and weights of the Gauss points.
    ends [shape (2, 2 ends, f), m]
    outward [shape (f,)]: 1 or -1, the sign with which (dz, -dr) of the facet points away from the triangle.
    """

    basis: Any
    cells: Indices
    dofs: Indices
    shape: Array
    at: Array
    weight: Array
    ends: Array
    outward: Array

    @classmethod
    def of(cls, basis: Any, facets: Indices, points: Any = None) -> Side:
        """Functions, Gauss points and orientation on some facets; ``points``: vertices as in `weak_forms.maps`."""
        grid = basis.mesh
        p = grid.p if points is None else points
        cells = grid.f2t[0, facets]
        local = (grid.t2f[:, cells] == facets).argmax(axis=0)
        vertices = grid.facets[:, facets]
        corners = p[:, grid.t[:, cells]]
        ends = p[:, vertices]
        first = grid.t[np.array(basis.elem.refdom.facets)[local, 0], cells]
        turned = (first != vertices[0]).astype(np.intp)
        kind: Any = type(basis.elem)
        numbers, shapes, at, weight = _tables(kind)
        along = ends[:, 1] - ends[:, 0]
        inward = corners.mean(axis=1) - ends.mean(axis=1)
        outward = np.sign((along[0] * inward[1] - along[1] * inward[0]).real)
        dofs = basis.element_dofs[numbers[local].T, cells].T
        return cls(basis, cells, dofs, shapes[local, turned], at, weight, ends, outward)

    @property
    def radius(self) -> Array:
        """`radii` of the Gauss points in m, shape (q, f)."""
        return radii(self.along(self.ends[0]), self.basis.mesh.depth)

    def along(self, ends: Array) -> Array:
        """Interpolate linearly from the ends of the facets, shape (..., 2, f), to the Gauss points (..., q, f)."""
        share = self.at[:, None]
        return ends[..., 0, None, :] * (1 - share) + ends[..., 1, None, :] * share

    def matrix(self, other: Side, values: Array) -> Any:
        """Sparse matrix of integrals of values u v over the facets, u on this side (columns), v on ``other`` (rows)."""
        local = np.einsum("faq,fbq,q,qf->fab", other.shape, self.shape, self.weight, values, optimize=True)
        return scattered(local, other.dofs, self.dofs, self.basis.N)


@cache
def _tables(element: Any) -> tuple[Indices, Array, Array, Array]:
    """Functions of each edge (3, m), their values at Gauss points in both directions (3, 2, m, q), points, weights."""
    elem = element()
    nodes, weights = np.polynomial.legendre.leggauss(elem.maxdeg + 1)
    at = (1 + nodes) / 2
    weight = weights / 2
    corners = elem.refdom.p
    numbers = []
    shapes = []
    for a, b in elem.refdom.facets:
        X = corners[:, a, None] * (1 - at) + corners[:, b, None] * at
        values = np.array([elem.lbasis(X, k)[0] for k in range(len(elem.doflocs))])
        # 1e-9: a function below this at all points of an edge vanishes there
        there = np.flatnonzero(np.abs(values).max(axis=1) > 1e-9)
        numbers.append(there)
        shapes.append([values[there], values[there][:, ::-1]])
    return np.array(numbers), np.array(shapes), at, weight


Pair = tuple[Indices, Indices]  # on both sides of a contact


def _none() -> Indices:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Boundary conditions and contacts on facets, numbered as scikit-fem does on the same mesh.

    held: facets at the ambient temperature; those of a part with a resistance R are in `convection`, with h = 1/R.
    convection [dict from h in W/(m^2 K) to an array of int]
    open: beyond which the material goes on, see `section_parts.Boundary`.
    source [shape (2,), m]: position (r, z) of the heat, from which d of open sides counts; r = 0 for a ring.
    length [m]: of the line source in a straight section; None for 1/d.
    contacts [dict from resistance in m^2 K/W to two arrays of int]: facets that lie on each other, both in the same
        order.
    """

    held: Indices = field(default_factory=_none)
    convection: Mapping[float, Indices] = field(default_factory=dict)
    open: Indices = field(default_factory=_none)
    source: tuple[float, float] = (0.0, 0.0)
    length: float | None = None
    contacts: Mapping[float, Pair] = field(default_factory=dict)

    @property
    def any(self) -> bool:
        """Whether any surface adds to the stiffness."""
        return bool(self.convection or self.contacts or len(self.open))


def surfaces_of(
    geometry: CrossSection,
    mesh: Mesh,
    resistance: dict[str, float],
    sides: Mapping[str, Mask] | None = None,
) -> Surfaces:
    """`Surfaces` of a mesh: held, convective and open facets, and contacts.

    resistance: of each part with a contact, in m^2 K/W (`resistances`).
    sides: which facets of the mesh's boundary lie on "bottom", "top" and "outer"; default by the geometry.
    """
    grid = mesh.skfem
    facets = grid.boundary_facets()
    if sides is None:
        r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
        sides = {side: geometry.on_boundary(side, r, z) for side in ("bottom", "top", "outer")}
    none = _none()
    where = {"isothermal": none, "open": none, "insulated": none}
    convection: dict[float, Indices] = {}
    for side, on in sides.items():
        boundary = getattr(geometry, side)
        there = facets[on]
        h = boundary.exchange
        conducts = h > 0 or boundary.kind == "isothermal"
        series = beside(mesh, resistance, there) * conducts
        if not h:
            where[boundary.kind] = np.append(where[boundary.kind], there[series == 0])
        # 1/(1/h + R) of the parts there, or 1/R where h is 0; facets of a held side without R are held
        for R in np.unique(series[(series > 0) | (h > 0)]):
            through = _in_series(h, float(R))
            before = convection.get(through, none)
            convection[through] = np.append(before, there[series == R])
    return Surfaces(
        held=where["isothermal"],
        convection=convection,
        open=where["open"],
        source=source_of(geometry),
        length=geometry.length,
        contacts=contacts(mesh, resistance),
    )


def _in_series(h: float, R: float) -> float:
    """Coefficient in W/(m^2 K) of an exchange h behind a resistance R; h = 0: a held side."""
    if not R:
        return h
    return 1 / (R + (1 / h if h else 0.0))


def source_of(geometry: CrossSection) -> tuple[float, float]:
    """Position (r, z) in m from which d of open sides counts: the middle of the first heated part, r = 0 for a ring."""
    part = geometry.first_heated
    x = 0.0 if part.x is None or geometry.mirrored else part.x
    return x, part.middle


def line_source(u: Array) -> Array:
    """Mean over its length of the field of a line source on a half space, c(u) = asinh(1/u) - sqrt(1 + u^2) + u.

    u = d/L; the field is P c/(pi k L). c is ln(2/u) - 1 near the line and 1/(2 u) far from it.
    """
    far = 1 / (np.sqrt(1 + u**2) + u)  # sqrt(1 + u^2) - u without cancellation
    return np.arcsinh(1 / u) - far


def surface_terms(
    basis: Any,
    conductivity: ArrayLike,
    surfaces: Surfaces,
    points: Any = None,
    series: Callable[..., Any] | None = None,
) -> Any:
    """Matrix of convection, open sides and contacts in the stiffness, sparse, W/K.

    points [shape (2, vertices), m]: as of `weak_forms.maps`.
    series: function of facets (or of both sides of a contact) that returns a resistance in m^2 K/W, added to 1/h.
    """
    total = csr_matrix((basis.N, basis.N))

    def through(h: float, *facets: Indices) -> Any:
        return h if series is None else 1 / (1 / h + series(*facets))

    for h, facets in surfaces.convection.items():
        side = Side.of(basis, facets, points)
        total = total + side.matrix(side, exchange(side, through(h, facets)))
    if len(surfaces.open):
        side = Side.of(basis, surfaces.open, points)
        k = np.broadcast_to(np.asarray(conductivity), (2, basis.element_dofs.shape[1]))
        total = total + side.matrix(side, outlet(side, k[:, side.cells], surfaces))
    for resistance, pair in surfaces.contacts.items():
        both = [Side.of(basis, facets, points) for facets in pair]
        for side in both:
            weights = exchange(side, through(1 / resistance, *pair))
            for other in both:
                sign = 1 if side is other else -1
                total = total + sign * side.matrix(other, weights)
    return total


def exchange(side: Side, h: Any) -> Array:
    """Weights 2 pi r h ds of heat exchange at the Gauss points, in W/K, shape (q, f)."""
    along = side.ends[:, 1] - side.ends[:, 0]
    length = np.sqrt((along**2).sum(axis=0))
    return 2 * np.pi * h * side.radius * length


def outlet(side: Side, k: Array, surfaces: Surfaces) -> Array:
    """Weights of an open side at the Gauss points in W/K, shape (q, f), for k (2, f) in W/(m K).

    2 pi r (n . d)/(d . k^-1 d) ds, divided by c(d/L) in a straight section of length L.
    """
    dr, dz = (side.ends[:, 1] - side.ends[:, 0]) * side.outward
    at_r, at_z = side.along(side.ends)
    r = at_r - surfaces.source[0]
    z = at_z - surfaces.source[1]
    weights = 2 * np.pi * side.radius * (dz * r - dr * z) / (r**2 / k[0] + z**2 / k[1])
    if surfaces.length is None:
        return weights
    distance = np.sqrt(r**2 + z**2)
    return weights / line_source(distance / surfaces.length)


PERFECT = 1e-14  # m^2 K/W; a hundredth of a picometre of oxide: a smaller resistance, such as 0, counts as this one


def resistances(geometry: CrossSection) -> dict[str, float]:
    """Thermal boundary resistance in m^2 K/W of each part with interfaces, summed over them; at least `PERFECT`."""
    total: dict[str, float] = {}
    for interface in geometry.interfaces:
        total[interface.part] = total.get(interface.part, 0.0) + interface.resistance
    return {part: max(value, PERFECT) for part, value in total.items()}


def split(mesh: Mesh, resistance: Mapping[str, float]) -> Mesh:
    """The mesh with nodes doubled on the surface of every region in ``resistance`` (m^2 K/W), and where regions touch.

    At a vertex, each group of triangles of one side that are connected by edges gets a node of its own. Nodes of one
    side keep their order, those of further groups come last; the same mesh is returned where nothing is doubled.
    """
    grid = mesh.skfem
    side = _side(mesh, resistance)
    first, second = grid.f2t
    inner = (second >= 0) & (side[first] == side[second])
    first = first[inner]
    second = second[inner]
    joined = np.concatenate([_corners(mesh, end, first, second) for end in grid.facets[:, inner]], axis=1)
    count = mesh.triangles.size
    links = np.ones(joined.shape[1])
    graph = coo_matrix((links, joined), shape=(count, count))
    number, group = connected_components(graph, directed=False)
    if number == len(mesh.points):
        return mesh
    corner = np.unique(group, return_index=True)[1]  # the first one of each group
    place = mesh.triangles.ravel()[corner]
    of_side = side[corner // 3]
    order = np.lexsort([corner, place, of_side])
    same_place = np.diff(place[order]) == 0
    same_side = np.diff(of_side[order]) == 0
    again = np.append(False, same_place & same_side)
    order = np.concatenate([order[~again], order[again]])
    new = np.empty(number, dtype=np.int64)
    new[order] = np.arange(number)
    return replace(mesh, points=mesh.points[place[order]], triangles=new[group].reshape(-1, 3))


def _corners(mesh: Mesh, vertices: Indices, *triangles: Indices) -> Indices:
    """Number the corners of triangles: 3 t + k, where corner k of triangle t is the vertex that is given for it.

    triangles: arrays as long as ``vertices``; each makes one row of the result.
    """
    rows = []
    for t in triangles:
        corner = (mesh.triangles[t] == vertices[:, None]).argmax(axis=1)
        rows.append(3 * t + corner)
    return np.array(rows)


def contacts(mesh: Mesh, resistance: Mapping[str, float]) -> dict[float, Pair]:
    """Coinciding facets of a mesh from `split`, by total resistance in m^2 K/W: both sides in the same order."""
    side = _side(mesh, resistance)
    if not side.any():
        return {}
    grid = mesh.skfem
    facets = grid.boundary_facets()
    ends = np.sort(_place(mesh)[grid.facets[:, facets]], axis=0).T
    order = np.lexsort(ends.T)
    twins = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    first = facets[order[twins]]
    second = facets[order[twins + 1]]
    total = beside(mesh, resistance, first) + beside(mesh, resistance, second)
    return {float(value): (first[total == value], second[total == value]) for value in np.unique(total)}


def beside(mesh: Mesh, resistance: Mapping[str, float], facets: Indices) -> Array:
    """Resistance in m^2 K/W that the region beside each boundary facet has on its surface."""
    values = np.array([0.0, *resistance.values()])
    triangles = mesh.skfem.f2t[0, facets]
    return values[_side(mesh, resistance)[triangles]]


def _side(mesh: Mesh, resistance: Mapping[str, float]) -> NDArray[np.int64]:
    """Number of the region with a resistance that each triangle belongs to, from 1; 0 for any other region."""
    names = list(resistance)
    number = np.array([names.index(name) + 1 if name in names else 0 for name in mesh.region_names], dtype=np.int64)
    return number[mesh.region]


def _place(mesh: Mesh) -> Indices:
    """Number of each mesh point; points that coincide have the same number."""
    return np.unique(mesh.points, axis=0, return_inverse=True)[1].ravel()
