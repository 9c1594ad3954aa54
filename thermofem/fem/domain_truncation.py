"""Error of a thermal resistance by the finite domain, from a domain that goes on beyond its bottom and outer side.

The facets of a side are drawn outwards in steps that grow by `STEP`, each with the material beside it, and the other
sides go on. The new ends are open: at `FAR` times the size of the domain little is left of what 1/d does not describe
(`section_parts.Boundary`). The mesh of the domain itself is unchanged, and so is what is heated and read. Measured on
slabs and anisotropic substrates, and on 16 random stacks with closed and with open sides, against domains of 2 to 3 mm:
the change of R_th within 3 % from 5e-4 of R_th on; what is less drowns in the difference of the meshes.

In a straight section heat also leaves through the ends of the guide. The mean over the length of a line source's field
on a half space, c(d/L), is the solution of the plane equation with a sink,

    div(k grad T) = k sigma T,    sigma = (d c')'/(d c) = (1 - u/sqrt(1 + u^2))/(L^2 u c(u)),    u = d/L

which the wider domain has everywhere, and the far ends follow 1/d as those of a ring do.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algebra.factor import factorize
from ..arrays import Array, NDArray
from ..mesh import Mesh
from .surfaces import Surfaces, line_source, resistances, surface_terms, surfaces_of
from .weak_forms import capacity, discretize, properties

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from .heat_problem import HeatProblem
    from .weak_forms import Discretization

FAR = 50.0  # far end over the size of the domain; squared where much of R_th comes from beyond it
STEP = 1.6  # ratio of the distances of neighbouring layers of elements


@dataclass(frozen=True, eq=False)
class Wider:
    """A heat problem on the domain that is extended beyond its bottom and outer side.

    place [shape (unknowns,)]: index of each function of the domain among those of the wider one.
    beyond: the part of K that stands for what lies beyond the far ends.
    """

    discretization: Discretization
    place: NDArray[np.intp]
    beyond: Any

    def resistance(self, heat: HeatProblem, heated: str, read: str) -> tuple[float, float]:
        """R_th in K/W between two parts on the wider domain, and the part of it from beyond the far ends.

        The latter is T_h^T K T_r with the fields of 1 W in either part and the open far ends' part of K.
        """
        d = self.discretization
        loads = np.zeros((2, d.basis.N))
        loads[:, self.place] = [heat.discretization.means[name] for name in (heated, read)]
        loads, solve = loads[:, d.free], factorize(d.K)
        first = solve(loads[0])
        second = first if heated == read else solve(loads[1])
        return float(loads[1] @ first), float(first @ (self.beyond @ second))


def wider(heat: HeatProblem, sizes: float = FAR) -> Wider | None:
    """Extend a heat problem beyond its bottom and outer side, unless they exchange heat; None where both do."""
    sides = [side for side in ("bottom", "outer") if not getattr(heat.geometry, side).exchange]
    if not sides:
        return None
    geometry = heat.geometry
    source = heat.discretization.surfaces.source[1]
    R, depth = geometry.outer_radius, source - geometry.bottom_z
    far = sizes * max(R, depth)
    grown = (heat.mesh.points, heat.mesh.triangles, np.arange(len(heat.mesh.triangles)))
    slack = 1e-9 * R
    if "outer" in sides:
        grown = _extended(*grown, 0, R, R * _steps(far / R), slack)
        if geometry.inner_end < 0:
            grown = _extended(*grown, 0, -R, -R * _steps(far / R), slack)
    if "bottom" in sides:
        grown = _extended(*grown, 1, geometry.bottom_z, source - depth * _steps(far / depth), slack)
    points, triangles, owner = grown
    mesh = Mesh(points, triangles, heat.mesh.region[owner], heat.mesh.region_names, geometry.depth)
    k = properties(geometry, heat.mesh)[0][:, owner]
    surfaces = _surfaces(geometry, mesh, sides, far, source - far)
    d = discretize(mesh, k, np.ones(len(mesh.triangles)), surfaces)
    if geometry.length is not None:
        d = replace(d, stiffness=(d.stiffness + capacity(d.basis, k[1] * _sink(heat, mesh))).tocsr())
    beyond = surface_terms(d.basis, k, Surfaces(open=surfaces.open, source=surfaces.source)).tocsr()
    place = np.zeros(heat.discretization.basis.N, dtype=np.intp)
    place[heat.discretization.basis.element_dofs] = d.basis.element_dofs[:, : len(heat.mesh.triangles)]
    return Wider(d, place, beyond[d.free][:, d.free])


def _sink(heat: HeatProblem, mesh: Mesh) -> Array:
    """Sink coefficient sigma in 1/m^2 at the middle of every triangle."""
    L, surfaces = heat.geometry.length or np.inf, heat.discretization.surfaces
    d = mesh.points[mesh.triangles].mean(axis=1) - surfaces.source
    u = np.hypot(*d.T) / L
    return np.asarray((1 - u / np.hypot(1, u)) / (L**2 * u * line_source(u)))


def _steps(ratio: float) -> Array:
    """Distances of the outer ends of the added layers of elements, from above 1 to ``ratio``, in geometric steps."""
    return np.asarray(np.geomspace(1, ratio, int(np.ceil(np.log(ratio) / np.log(STEP))) + 1)[1:])


def _extended(
    points: Array,
    triangles: NDArray[np.int64],
    owner: NDArray[np.intp],
    axis: int,
    at: float,
    levels: Array,
    slack: float,
) -> tuple[Array, NDArray[np.int64], NDArray[np.intp]]:
    """Add layers of triangles from the side r = ``at`` (axis 0) or z = ``at`` (axis 1) outwards to each of ``levels``.

    owner: for each triangle the one of the domain whose material it has.
    """
    on = (np.abs(points[:, axis] - at) <= slack)[triangles]
    rim = on.sum(axis=1) == 2
    ends, beside = triangles[rim][on[rim]].reshape(-1, 2).T, owner[rim]
    vertices, local = np.unique(ends, return_inverse=True)
    local = local.reshape(ends.shape)
    layers = np.repeat(points[vertices][None], len(levels), axis=0)
    layers[:, :, axis] = levels[:, None]
    number = np.arange(layers[..., 0].size).reshape(len(levels), -1) + len(points)
    number = np.vstack([vertices, number])
    a, b = number[:-1, local].swapaxes(0, 1)
    c, e = number[1:, local].swapaxes(0, 1)
    new = np.stack([np.stack([a, b, e], axis=-1), np.stack([a, e, c], axis=-1)]).reshape(-1, 3)
    points = np.concatenate([points, layers.reshape(-1, 2)])
    return points, np.concatenate([triangles, new]), np.concatenate([owner, np.tile(beside, 2 * len(levels))])


def _surfaces(geometry: CrossSection, mesh: Mesh, moved: list[str], reach: float, depth: float) -> Surfaces:
    """Boundary conditions and contacts of the wider domain; its ``moved`` sides are open at r = reach, z = depth."""
    grid = mesh.skfem
    ends = grid.p[:, grid.facets[:, grid.boundary_facets()]]
    r, z = ends.mean(axis=1)

    def at(place: Array, value: float) -> NDArray[np.bool_]:
        return np.asarray(np.abs(place - value).max(axis=0) <= 1e-9 * geometry.outer_radius)

    far = at(np.abs(ends[0]), reach) & ("outer" in moved) | at(ends[1], depth) & ("bottom" in moved)
    lines = {
        "bottom": at(ends[1], geometry.bottom_z),
        "top": at(ends[1], geometry.top_z),
        "outer": at(np.abs(ends[0]), geometry.outer_radius),
    }
    # the other sides are extended in straight lines
    sides = {side: (geometry.on_boundary(side, r, z) | on) & ~far for side, on in lines.items() if side not in moved}
    found = surfaces_of(geometry, mesh, resistances(geometry), sides)
    return replace(found, length=None, open=grid.boundary_facets()[far])


log = logging.getLogger("thermofem")

CLOSED = 'if the chip goes on there, say bottom = "open", outer = "open" in [boundary], or geometry.opened()'
OPEN = "heat that runs along a layer or one axis of a material is still felt at its open sides: move them outwards"
ENDS = "heat also leaves through the ends of the guide, which a section lacks: at most by this R_th is too large"
NOTABLE = 1e-2  # of R_th: a domain that moves it by more is worth a warning, by less a line of information
_reported: set[tuple[object, ...]] = set()


def domain_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Relative change of R_th if the stack continued beyond its bottom and outer side, see `wider`.

    Sides that exchange heat are mounts, not cuts, and stay. For open sides it is what the 1/d law does not describe,
    such as heat that flows along a layer. Where much of R_th comes from beyond the far ends they are moved outwards
    once more, and what then remains counts as error, too: where heat leaves along a plate alone, no domain is wide
    enough. For a straight section it includes the heat that leaves through the ends of the guide.
    """
    if heat.wider is None:
        return 0.0
    here = heat.thermal_resistance(heated, read)
    there, left = heat.wider.resistance(heat, heated, read)
    # 2e-4 of R_th, beyond that end: a solid leaves less, along a plate R_th grows with the logarithm of the size
    if left <= 2e-4 * here or (farther := wider(heat, FAR**2)) is None:
        return abs(there - here) / here
    there, left = farther.resistance(heat, heated, read)
    return (abs(there - here) + left) / here


def warn_of_domain(geometry: CrossSection, domain: float, accuracy: float, what: str = "R_th") -> None:
    """Log that the end of the domain changes R_th, or ``what``, by more than the accuracy, and the remedy.

    A warning above `NOTABLE`, information below: a ring on a finite chip or on a mount is no mistake. Either is logged
    once for geometries of one name, size, length and error to one digit.
    """
    level = logging.WARNING if domain > NOTABLE else logging.INFO
    size = geometry.outer_radius, geometry.bottom_z, geometry.length
    key = geometry.name, what, size, level, f"{domain:.0e}"
    if key in _reported:
        return
    _reported.add(key)
    log.log(
        level,
        "%s: the domain ends %.3g um below and %.3g um beside the axis, which moves %s by %.1e (accuracy = %g); %s",
        geometry.name,
        -geometry.bottom_z * 1e6,
        geometry.outer_radius * 1e6,
        what,
        domain,
        accuracy,
        CLOSED if geometry.opened() != geometry else ENDS if geometry.length else OPEN,
    )
