"""Probes as functionals of the field: shells around parts, and copies of parts off the axis.

A shell is all within a distance of a part; triangles may be cut by its edge.

Means of the axisymmetric field over a copy of a part off the axis, such as a neighbouring ring.

The copy's centre lies at the distance d from the axis. A point (r, phi) of the copy is at rho from the axis, so

    mean = 1/V int_part 2 pi r [1/pi int_0^pi T(rho, z) dphi] dA,    rho^2 = d^2 + r^2 + 2 d r cos(phi)

which is linear in the unknowns of the mesh: one more row of C. In a straight section the copy lies at x + d.
The cross-section is integrated by a rule of degree 8 on
a few triangles, the angle at n equal steps.

Error of the angle. With L the gap between the copy and the heated part, a smooth field that varies over L leaves
exp(-2 pi L/step), which is nothing at 40 steps a gap. Quadratic elements of size h have kinks of slope
h^2 T'''. Each leaves at most step^2/12 h^2 T'''; T''' is about T/L^3, and h, which grows with the distance, at most
L/2. With a step of L/40 that is 1.3e-5 of T for one kink; measured for their sum, at gaps of 0.2 to 14 um, 5e-7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from scipy.spatial import cKDTree
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from ..arrays import Array, summed
from ..geometry.regions import distance, nearest
from ..mesh.triangles import radii, sampled, sides
from .weak_forms import magnitude, volume

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.section_parts import Probe
    from ..mesh import Mesh

FINENESS = 24  # small triangles along each edge of a triangle that the shell's edge cuts


def shell_integral(
    geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe, points: Any = None, thicker: complex = 0.0
) -> Any:
    """Integral of 2 pi r times each basis function over a shell; the sum of the entries is its volume in m^3.

    Triangles well inside are integrated exactly, those near the edge by `FINENESS`^2 small triangles each, which count
    by the share that lies inside. Where vertices move, the nearest point of the part's outline stays at
    its fraction of the edge (envelope theorem).

    points [shape (2, vertices), m]: as of `weak_forms.maps`; the part's outline moves along.
    thicker [m]: added to the thickness of the probe.
    """
    edges = [face.edges() for face in geometry.subdivision.faces if face.owner == probe.part]
    outline = np.concatenate(edges)
    grid = basis.mesh
    thickness = float(probe.shell or 0)
    corners = np.moveaxis(grid.p[:, grid.t], (0, 1, 2), (2, 1, 0))  # in the order of the basis, which may not be ours
    far = distance(corners, outline)
    lengths = np.linalg.norm(sides(corners), axis=-1)
    longest = lengths.max(axis=1)
    outside = mesh.region != mesh.region_names.index(probe.part)
    inside = outside & (far.max(axis=1) + longest / 2 <= thickness)
    reached = far.min(axis=1) - longest <= thickness
    cells = np.flatnonzero(outside & ~inside & reached)
    local = _centroids(FINENESS)
    weights = np.column_stack([1 - local.sum(axis=1), local])
    _, index, place = nearest(np.einsum("qk,ckx->cqx", weights, corners[cells]), outline)
    if points is not None:
        corners = np.moveaxis(points[:, grid.t], (0, 1, 2), (2, 1, 0))
        _, vertices = cKDTree(grid.p.T).query(outline)
        outline = points.T[vertices]
    small = np.einsum("qk,ckx->cqx", weights, corners[cells])
    begins = outline[index, 0]
    along = outline[index, 1] - begins
    feet = begins + place[..., None] * along
    far = np.sqrt(((small - feet) ** 2).sum(axis=-1))
    edge = sides(corners)[cells, lengths[cells].argmax(axis=1)]
    size = np.sqrt((edge**2).sum(axis=-1)) / FINENESS
    depth = (thickness + thicker - far) / size[:, None]
    on_edge = np.abs(depth.real) < 0.5
    share = np.where(on_edge, 0.5 + depth, depth.real > 0)
    x, y = (corners[cells, 1] - corners[cells, 0]).T
    s, t = (corners[cells, 2] - corners[cells, 0]).T
    area = magnitude(x * t - s * y) / 2
    each = share * area[:, None] / len(local)
    weight = 2 * np.pi * radii(small[..., 0], grid.depth) * each
    total = volume(basis, inside, points)
    for k in range(basis.Nbfun):
        values, _ = basis.elem.lbasis(local.T, k)
        total = total + summed(basis.element_dofs[k, cells], weight @ values, basis.N)
    return total


def _centroids(n: int) -> Array:
    """Centroids of the n^2 equal triangles that fill the reference triangle, shape (n^2, 2)."""
    index = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2)
    diagonal = index.sum(axis=1)
    upwards = index[diagonal < n] + 1 / 3
    downwards = index[diagonal < n - 1] + 2 / 3
    return np.concatenate([upwards, downwards]) / n


FEWEST_STEPS, MOST_STEPS = 64, 2000  # steps of the angle


def off_axis_points(geometry: CrossSection, probe: Probe) -> tuple[Array, Array]:
    """Quadrature points (rho, z) in m on a copy, shape (n, 2), and weights in m^3."""
    r, z, area = _cross_section(geometry, probe)
    d = float(probe.distance or 0)
    if geometry.length is not None:
        if geometry.mirrored:
            r = np.append(r, -r)
            z = np.append(z, z)
            area = np.append(area, area)
        return np.stack([r + d, z], axis=-1), geometry.length * area
    gaps = np.pi * r.max() / _gap(geometry, probe)
    steps = int(np.clip(np.ceil(40 * gaps), FEWEST_STEPS, MOST_STEPS))
    angle = np.pi * (np.arange(steps) + 0.5) / steps
    column = r[:, None]
    rho = np.sqrt(d**2 + column**2 + 2 * d * column * np.cos(angle))
    heights = np.broadcast_to(z[:, None], rho.shape)
    points = np.stack([rho, heights], axis=-1).reshape(-1, 2)
    weights = 2 * np.pi * r * area / steps
    return points, np.repeat(weights, steps)


def _gap(geometry: CrossSection, probe: Probe) -> float:
    """Gap in m between the copy and the outermost heated part, at least a hundredth of the distance of their axes."""
    heated = max(part.outer_radius for part in geometry.parts if part.heated)
    copy = geometry.part(probe.part).outer_radius
    d = float(probe.distance or 0)
    return max(d - heated - copy, d / 100)


def _cross_section(geometry: CrossSection, probe: Probe) -> tuple[Array, Array, Array]:
    """Quadrature points r, z in m on the cross-section of the probe's part, and weights in m^2; shape (n,) each."""
    polygons = []
    for face in geometry.subdivision.faces:
        if face.owner == probe.part:
            rings = [ring * 1e6 for ring in face.rings]  # in um, as GEOS has tolerances
            polygons.append(shapely.Polygon(rings[0], rings[1:]))
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons)).tolist()
    pieces = [piece for shape in triangles for piece in getattr(shape, "geoms", [shape])]
    corners = np.array([np.asarray(piece.exterior.coords)[:3] for piece in pieces]) * 1e-6
    (X, Y), W = get_quadrature(RefTri, 8)  # a rule of degree 8
    barycentric = np.array([1 - X - Y, X, Y])
    points = np.einsum("kq,ckx->cqx", barycentric, corners)
    a, b = (corners[:, 1] - corners[:, 0]).T
    c, e = (corners[:, 2] - corners[:, 0]).T
    cross = np.abs(a * e - b * c)
    area = cross[:, None] * W
    return points[..., 0].ravel(), points[..., 1].ravel(), area.ravel()


def probe_integral(geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe) -> Array:
    """Integrals of the basis functions over the volume of a probe, which give its mean from the unknowns x.

        v_i = int 2 pi r u_i dA  in m^3, shape (n,),    mean = v . x / sum_i v_i

    with u_i the n basis functions; in a straight section its length stands for 2 pi r.
    """
    if probe.shell is None:
        return sampled(basis, *off_axis_points(geometry, probe))
    return shell_integral(geometry, mesh, basis, probe)
