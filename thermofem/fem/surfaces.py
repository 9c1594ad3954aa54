"""Boundary conditions and contacts: their facets, their weak forms in the stiffness, and the derivatives of those.

K_ij += int 2 pi r h u_i u_j ds                               where heat h (T - T0) is exchanged with the ambient,
                                                              1/(1/h + R) for h where the part has a resistance R
K_ij += int 2 pi r (u_i^+ - u_i^-) (u_j^+ - u_j^-) / R ds     over every contact of resistance R
K_ij += int 2 pi r (n . d) / (d . k^-1 d) u_i u_j ds          over open sides, d from the source
K_ij += int 2 pi r (n . d) / (d . k^-1 d) / c(d/L) u_i u_j ds over open sides of a straight section of length L

In a straight section L (2 L of a mirrored one) stands for 2 pi r.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, ArrayLike, NDArray
from ..mesh.triangles import radii
from .mesh_division import beside, contacts

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.parameter_paths import Change
    from ..mesh import Mesh
    from .heat_problem import HeatProblem


@dataclass(frozen=True, eq=False)
class Side:
    """Facets, each from its first to its second vertex, with m functions and q Gauss points.

    basis [anything with mesh, elem, element_dofs and N]
    facets, cells [shape (f,)]: numbers, and the triangle beside each.
    dofs [shape (f, m)]
    shape [shape (f, m, q)]: the functions at the points.
    at, weight [shape (q,)]: positions 0 to 1 and weights of the Gauss points.
    ends [shape (2, 2 ends, f), m]
    outward [shape (f,)]: 1 or -1: (dz, -dr) of the facet times it points away from the triangle.
    """

    basis: Any
    facets: NDArray[np.intp]
    cells: NDArray[np.intp]
    dofs: NDArray[np.intp]
    shape: Array
    at: Array
    weight: Array
    ends: Array
    outward: Array

    @classmethod
    def of(cls, basis: Any, facets: NDArray[np.intp]) -> Side:
        """Functions, points and orientation on some facets of a basis."""
        grid = basis.mesh
        cells = grid.f2t[0, facets]
        local = (grid.t2f[:, cells] == facets).argmax(axis=0)
        vertices = grid.facets[:, facets]
        corners, ends = grid.p[:, grid.t[:, cells]], grid.p[:, vertices]
        first = grid.t[_edges(basis)[local, 0], cells]
        turned = (first != vertices[0]).astype(np.intp)
        kind: Any = type(basis.elem)
        numbers, shapes, at, weight = _tables(kind)
        along, inward = ends[:, 1] - ends[:, 0], corners.mean(axis=1) - ends.mean(axis=1)
        outward = np.sign(along[0] * inward[1] - along[1] * inward[0])
        dofs = basis.element_dofs[numbers[local].T, cells].T
        return cls(basis, facets, cells, dofs, shapes[local, turned], at, weight, ends, outward)

    @property
    def round(self) -> bool:
        """Whether the section is that of a ring, with the weight 2 pi r."""
        return self.basis.mesh.depth is None

    @property
    def radius(self) -> Array:
        """`radii` of the points, shape (q, f)."""
        return radii(self.along(self.ends[0]), self.basis.mesh.depth)

    def along(self, ends: Array) -> Array:
        """A linear function at the points, shape (..., q, f), from its values at the ends, shape (..., 2, f)."""
        return ends[..., 0, None, :] * (1 - self.at[:, None]) + ends[..., 1, None, :] * self.at[:, None]

    def matrix(self, other: Side, values: Array) -> Any:
        """Sparse sum of values u v, with u on this side and v on the other one."""
        from scipy.sparse import csr_matrix

        local = np.einsum("faq,fbq,q,qf->fab", other.shape, self.shape, self.weight, values, optimize=True)
        rows = np.broadcast_to(other.dofs[:, :, None], local.shape).ravel()
        columns = np.broadcast_to(self.dofs[:, None, :], local.shape).ravel()
        return csr_matrix((local.ravel(), (rows, columns)), shape=(self.basis.N,) * 2)


def _edges(basis: Any) -> NDArray[np.intp]:
    """Corners of the three edges of the reference triangle, shape (3, 2)."""
    return np.array(basis.elem.refdom.facets)


@cache
def _tables(element: Any) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """For each edge its functions (3, m), and those at Gauss points along and against it (3, 2, m, q); the points."""
    elem = element()
    nodes, weights = np.polynomial.legendre.leggauss(elem.maxdeg + 1)
    at, weight = (1 + nodes) / 2, weights / 2
    corners, numbers, shapes = elem.refdom.p, [], []
    for a, b in elem.refdom.facets:
        X = corners[:, a, None] * (1 - at) + corners[:, b, None] * at
        values = np.array([elem.lbasis(X, k)[0] for k in range(len(elem.doflocs))])
        # 1e-9: a function below this at all points of an edge vanishes there
        there = np.flatnonzero(np.abs(values).max(axis=1) > 1e-9)
        numbers.append(there)
        shapes.append([values[there], values[there][:, ::-1]])
    return np.array(numbers), np.array(shapes), at, weight


Facets = NDArray[np.intp]
Pair = tuple[Facets, Facets]  # on both sides of a contact


def _none() -> Facets:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Boundary conditions and contacts on facets, numbered as scikit-fem does on the same mesh.

    held: at the ambient temperature; where a part with a resistance R lies there, `convection` has it with 1/R.
    convection [dict from h in W/(m^2 K) to an array of int]
    open: beyond which the material goes on, see `section_parts.Boundary`.
    source [shape (2,), m]: place (r, z) of the heat, from which the open sides are seen; r = 0 for a ring.
    length [m]: of the line source in a straight section; None for 1/d.
    contacts [dict from resistance in m^2 K/W to two arrays of int]: facets that lie on each other, both in the same
        order.
    """

    held: Facets = field(default_factory=_none)
    convection: Mapping[float, Facets] = field(default_factory=dict)
    open: Facets = field(default_factory=_none)
    source: tuple[float, float] = (0.0, 0.0)
    length: float | None = None
    contacts: Mapping[float, Pair] = field(default_factory=dict)

    @property
    def any(self) -> bool:
        """Whether any of them adds to the stiffness."""
        return bool(self.convection or self.contacts or len(self.open))


def surfaces_of(geometry: CrossSection, mesh: Mesh, resistance: dict[str, float]) -> Surfaces:
    """Held, convective and open facets, and contacts."""
    grid = mesh.skfem
    facets = grid.boundary_facets()
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    none = np.empty(0, dtype=np.intp)
    where = {"isothermal": none, "open": none, "insulated": none}
    convection: dict[float, Facets] = {}
    for side in ("bottom", "top", "outer"):
        boundary = getattr(geometry, side)
        there = facets[geometry.on_boundary(side, r, z)]
        h = boundary.exchange(geometry.ambient)
        series = beside(mesh, resistance, there) * (h > 0 or boundary.kind == "isothermal")
        if not h:
            where[boundary.kind] = np.append(where[boundary.kind], there[series == 0])
        for through, those in exchanged(there, h, series).items():
            convection[through] = np.append(convection.get(through, none), those)
    return Surfaces(
        held=where["isothermal"],
        convection=convection,
        open=where["open"],
        source=source_of(geometry),
        length=geometry.length,
        contacts=contacts(mesh, resistance),
    )


def source_of(geometry: CrossSection) -> tuple[float, float]:
    """The place (r, z) in m from which open sides are seen: the middle of the first heated part, the axis of a ring."""
    heat = next(part for part in geometry.parts if part.heated)
    middle = heat.x if heat.x is not None and not geometry.mirrored else 0.0
    return middle, heat.bottom + heat.height / 2


def line_source(u: ArrayLike) -> Array:
    """Mean over its length of the field of a line source on a half space, c(u) = asinh(1/u) - sqrt(1 + u^2) + u.

    u = d/L; the field is P c/(pi k L). c is ln(2/u) - 1 near the line and 1/(2 u) far from it.
    """
    u = np.asarray(u, dtype=float)
    far = 1 / (np.sqrt(1 + u**2) + u)  # sqrt(1 + u^2) - u without cancellation
    return np.asarray(np.arcsinh(1 / u) - far)


def line_source_slope(u: ArrayLike) -> Array:
    """dc/du of `line_source`: 1 - sqrt(1 + u^2)/u."""
    u = np.asarray(u, dtype=float)
    return np.asarray(-1 / (u * (np.sqrt(1 + u**2) + u)))


def exchanged(facets: Facets, h: float, series: Array) -> dict[float, Facets]:
    """Facets of a side by the coefficient through which they lose heat, W/(m^2 K): 1/(1/h + R), or 1/R where h is 0.

    series [shape of ``facets``, m^2 K/W]: R of the parts there. Facets of a held side without R are left out.
    """
    found = {}
    for own in np.unique(series[(series > 0) | (h > 0)]):
        found[float(1 / (own + (1 / h if h else 0.0)) if own else h)] = facets[series == own]
    return found


def surface_terms(basis: Any, conductivity: ArrayLike, surfaces: Surfaces) -> Any:
    """Terms of convection, open sides and contacts in the stiffness, sparse."""
    cells = basis.element_dofs.shape[1]

    def open_side(side: Side) -> Array:
        k = np.broadcast_to(np.asarray(conductivity, dtype=float), (2, cells))
        return outlet(side, k[:, side.cells], surfaces)

    def contact(side: Side, resistance: float, pair: Pair) -> Array:
        return exchange(side, 1 / resistance)

    return surface_sum(basis, surfaces, exchange, open_side, contact)


def surface_sum(
    basis: Any,
    surfaces: Surfaces,
    convection: Callable[[Side, float], Array],
    outlet: Callable[[Side], Array],
    contact: Callable[[Side, float, Pair], Array],
) -> Any:
    """Sparse sum over all surfaces of weights, shape (q, f), that follow from a side and its coefficient."""
    from scipy.sparse import csr_matrix

    total = csr_matrix((basis.N, basis.N))
    for h, facets in surfaces.convection.items():
        side = Side.of(basis, facets)
        total = total + side.matrix(side, convection(side, h))
    if len(surfaces.open):
        side = Side.of(basis, surfaces.open)
        total = total + side.matrix(side, outlet(side))
    for resistance, pair in surfaces.contacts.items():
        both = [Side.of(basis, facets) for facets in pair]
        for one in both:
            for other in both:
                sign = 1 if one is other else -1
                total = total + sign * one.matrix(other, contact(one, resistance, pair))
    return total


def exchange(side: Side, h: float) -> Array:
    """2 pi r h ds at the points, shape (q, f)."""
    return 2 * np.pi * h * side.radius * np.linalg.norm(side.ends[:, 1] - side.ends[:, 0], axis=0)


def outlet(side: Side, k: Array, surfaces: Surfaces) -> Array:
    """2 pi r (n . d)/(d . k^-1 d) ds at the points, shape (q, f), for k (2, f); over c(d/L) with a length L."""
    dr, dz = (side.ends[:, 1] - side.ends[:, 0]) * side.outward
    r, z = (x - origin for x, origin in zip(side.along(side.ends), surfaces.source, strict=True))
    value = 2 * np.pi * side.radius * (dz * r - dr * z) / (r**2 / k[0] + z**2 / k[1])
    return np.asarray(value if surfaces.length is None else value / line_source(np.hypot(r, z) / surfaces.length))


def surface_tangent(heat: HeatProblem, change: Change, moved: Array, k: Array, of_k: Array) -> Any:
    """Derivative of `surface_terms`; ``moved`` (2, vertices) and ``of_k`` (2, triangles) are d of points and k."""
    surfaces = heat.discretization.surfaces

    def convection(side: Side, h: float) -> Array:
        of_h = h**2 * (_of_sides(heat, change, side.facets) - _contact(heat, change, side.facets))
        return _exchange(side, moved, h, of_h)

    def outlet(side: Side) -> Array:
        return _outlet(side, moved, k[:, side.cells], of_k[:, side.cells], surfaces, _source(heat, change))

    def contact(side: Side, resistance: float, pair: Pair) -> Array:
        of_h = -(_contact(heat, change, pair[0]) + _contact(heat, change, pair[1])) / resistance**2
        return _exchange(side, moved, 1 / resistance, of_h)

    return surface_sum(heat.discretization.basis, surfaces, convection, outlet, contact)


def _of_sides(heat: HeatProblem, change: Change, facets: NDArray[np.intp]) -> Array:
    """Derivative of -1/h of the side of the domain on which each facet lies; 0 on an isothermal one."""
    grid, geometry = heat.discretization.basis.mesh, heat.geometry
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    found = np.zeros(len(facets))
    for side, of_h in change.convection.items():
        there = geometry.on_boundary(side, r, z)
        found[there] = of_h / getattr(geometry, side).exchange(geometry.ambient) ** 2
    return found


def _contact(heat: HeatProblem, change: Change, facets: NDArray[np.intp]) -> Array:
    """Derivative of the contact resistance of the part beside each facet."""
    cells = heat.discretization.basis.mesh.f2t[0, facets]
    there = np.array([change.contact.get(name, 0.0) for name in heat.mesh.region_names])
    return there[heat.mesh.region[cells]]


def _source(heat: HeatProblem, change: Change) -> Array:
    """Derivative of `source_of`."""
    part = next(part for part in heat.geometry.parts if part.heated)
    velocity = change.outlines.get(part.name)
    if velocity is None:
        return np.zeros(2)
    moves = part.straight and not heat.geometry.mirrored
    return np.array([velocity[:, 0].mean() * moves, (velocity[0, 1] + velocity[3, 1]) / 2])


def _velocity(side: Side, moved: Array) -> Array:
    """Velocity of the ends of the facets, shape (2, 2 ends, f)."""
    return np.asarray(moved[:, side.basis.mesh.facets[:, side.facets]])


def _exchange(side: Side, moved: Array, h: float, of_h: Array) -> Array:
    """Derivative of `exchange`."""
    velocity = _velocity(side, moved)
    along, of_along = (x[:, 1] - x[:, 0] for x in (side.ends, velocity))
    length = np.linalg.norm(along, axis=0)
    of_length = np.einsum("xf,xf->f", along, of_along) / length
    r, of_r = side.radius, side.along(velocity[0]) * side.round
    return np.asarray(2 * np.pi * (of_r * h * length + r * of_h * length + r * h * of_length))


def _outlet(side: Side, moved: Array, k: Array, of_k: Array, surfaces: Surfaces, of_source: Array) -> Array:
    """Derivative of `outlet`."""
    velocity = _velocity(side, moved)
    along, of_along = (x[:, 1] - x[:, 0] for x in (side.ends, velocity))
    n, of_n = (np.array([x[1], -x[0]]) * side.outward for x in (along, of_along))
    radius, of_radius = side.radius, side.along(velocity[0]) * side.round
    r, z = (x - origin for x, origin in zip(side.along(side.ends), surfaces.source, strict=True))
    of_r, of_z = (x - origin for x, origin in zip(side.along(velocity), of_source, strict=True))
    flux = n[0] * r + n[1] * z
    of_flux = of_n[0] * r + n[0] * of_r + of_n[1] * z + n[1] * of_z
    square = r**2 / k[0] + z**2 / k[1]
    of_square = 2 * r * of_r / k[0] - r**2 * of_k[0] / k[0] ** 2
    of_square = of_square + 2 * z * of_z / k[1] - z**2 * of_k[1] / k[1] ** 2
    value = 2 * np.pi * radius * flux / square
    of_value = 2 * np.pi * ((of_radius * flux + radius * of_flux) / square - radius * flux * of_square / square**2)
    if surfaces.length is None:
        return np.asarray(of_value)
    d = np.hypot(r, z)
    c, of_c = line_source(d / surfaces.length), line_source_slope(d / surfaces.length) / surfaces.length
    return np.asarray(of_value / c - value / c**2 * of_c * (r * of_r + z * of_z) / d)
