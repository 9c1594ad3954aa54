"""The mesh of the heat problem: refined where the error is large, and cut open along thermal boundary resistances.

At every shift whose error is above `AIM` of the target the triangles with the largest shares are divided: as few of
them as bring the sum down to `AIM` if dividing leaves `LEFT` of a share, or those with `BULK` of the sum where even all
would not do (W. Doerfler, SIAM J. Numer. Anal. 33, 1106 (1996)).

Marked triangles are divided into four, their neighbours into two to four, without hanging nodes. A triangle with a
divided edge has its longest edge divided too, so that angles stay above half of the smallest one (M. C. Rivara, Int. J.
Numer. Methods Eng. 20, 745 (1984)).

A thermal boundary resistance makes the temperature jump by resistance times flux. Every node of such a surface is there
once for each side; the flux between the two sides is (T^+ - T^-)/resistance. Where two surfaces lie on each other their
resistances add. On a side of the domain that the ambient holds or cools, the resistance is in series with it
(`surfaces`). Where regions touch in one point only, two silicon corners between voids for instance, no heat flows
through it: the mesh is parted there, with one vertex for each group of triangles that edges hold together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..arrays import Array, NDArray
from ..mesh.triangles import Mesh

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from .error_estimate import Estimate

AIM = 0.8  # of the target
LEFT = 0.15  # of the share of a triangle after it was divided in four: 1/16 where the field is smooth, 0.4 at a corner
BULK = 0.8  # of the sum
FINEST = 1e-8  # of the largest coordinate: ten times `mesh_motion.NEAR`, within which a vertex is at a corner


def divided(mesh: Mesh, estimate: Estimate, target: float) -> Mesh | None:
    """The next mesh; None where triangles would have to be finer than `FINEST`.

    mesh: of the estimate, without doubled nodes.

    At a vertex where the field is strongly singular the triangles are divided several times at once, as often as makes
    their error fall as it does at an ordinary corner.
    """
    finest = FINEST * float(np.abs(mesh.points).max())
    at = {point: _touching(mesh, point) for point in estimate.corners}
    stuck = np.any([there & (_longest(mesh) < 2 * finest) for there in at.values()], axis=0) if at else None
    chosen = marked(estimate, target, stuck)
    if not chosen.any():
        return None
    deeper = [point for point, there in at.items() if (there & chosen).any()]
    mesh = refined(mesh, chosen)
    for point in deeper:
        # 2 / 3: exponent of the field at the corner of a good conductor
        for _ in range(round((2 / 3) / estimate.corners[point]) - 1):
            there = _touching(mesh, point) & (_longest(mesh) >= 2 * finest)
            mesh = refined(mesh, there) if there.any() else mesh
    return mesh


def marked(estimate: Estimate, target: float, stuck: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Select the triangles to divide.

    stuck [shape (triangles,)]: not to be divided. Half of the target is left to them, even where their error is larger;
        the others are divided until their error is within the rest.
    """
    chosen = np.zeros(0, dtype=bool)
    for channel, errors in estimate.errors.items():
        own = target / max(estimate.weights[channel], 1e-12)
        for error, share in zip(errors, estimate.shares[channel], strict=True):
            chosen = chosen if chosen.size else np.zeros(share.size, dtype=bool)
            if stuck is None or not stuck.any():
                left, wanted = error, own
            else:
                there, share = float(share[stuck].sum()), np.where(stuck, 0.0, share)
                left, wanted = error - there, own - min(there, own / 2)
            if left > wanted:
                chosen |= _largest(share, AIM * wanted)
    return chosen


def _touching(mesh: Mesh, point: tuple[float, float]) -> NDArray[np.bool_]:
    """Which triangles have a corner there."""
    return np.asarray((mesh.points == point).all(axis=1)[mesh.triangles].any(axis=1))


def _longest(mesh: Mesh) -> Array:
    """Longest edge of each triangle in m."""
    corners = mesh.points[mesh.triangles]
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1))


def _largest(share: Array, wanted: float) -> NDArray[np.bool_]:
    """The fewest triangles whose division reduces the sum of the shares to ``wanted``, at most `BULK` of it."""
    order = np.argsort(share)[::-1]
    so_far, total = np.cumsum(share[order]), float(share.sum())
    needed = min((total - wanted) / (1 - LEFT), BULK * total)
    chosen = np.zeros(share.size, dtype=bool)
    chosen[order[: int(np.searchsorted(so_far, needed)) + 1]] = True
    return chosen


def refined(mesh: Mesh, marked: NDArray[np.bool_]) -> Mesh:
    """The mesh with the marked triangles divided in four equal ones, and neighbours as needed.

    mesh: without nodes that are doubled along contacts. Its points are the first ones of the result.
    marked [shape (triangles,)]
    """
    regions = {name: np.flatnonzero(mesh.region == k) for k, name in enumerate(mesh.region_names)}
    grid = mesh.skfem.with_subdomains(regions).refined(np.flatnonzero(marked))
    region = np.empty(grid.t.shape[1], dtype=np.int64)
    for k, name in enumerate(mesh.region_names):
        region[grid.subdomains[name]] = k
    return replace(mesh, points=grid.p.T, triangles=grid.t.T.astype(np.int64), region=region)


PERFECT = 1e-14  # m^2 K/W; a hundredth of a picometre of oxide: a smaller resistance, such as 0, counts as this one


def resistances(geometry: CrossSection) -> dict[str, float]:
    """Sum of the thermal boundary resistances of each part that has one, in m^2 K/W; `PERFECT` at least."""
    found: dict[str, float] = {}
    for interface in geometry.interfaces:
        found[interface.part] = found.get(interface.part, 0.0) + interface.resistance
    return {part: max(value, PERFECT) for part, value in found.items()}


def split(mesh: Mesh, resistance: Mapping[str, float]) -> Mesh:
    """The mesh with nodes doubled on the surface of every region in ``resistance`` (m^2 K/W), and where regions touch.

    One node for each group of triangles around a vertex that edges of one side hold together. Those of one side follow
    each other in the order that they had, those of further groups come last; the mesh itself where nothing is doubled.
    """
    grid, side = mesh.skfem, _side(mesh, resistance)
    first, second = grid.f2t
    inner = (second >= 0) & (side[first] == side[second])
    first, second = first[inner], second[inner]
    joined = np.concatenate([_corners(mesh, end, first, second) for end in grid.facets[:, inner]], axis=1)
    count = mesh.triangles.size
    graph = coo_matrix((np.ones(joined.shape[1]), joined), shape=(count, count))
    number, group = connected_components(graph, directed=False)
    if number == len(mesh.points):
        return mesh
    corner = np.unique(group, return_index=True)[1]  # the first one of each group
    place, of_side = mesh.triangles.ravel()[corner], side[corner // 3]
    order = np.lexsort([corner, place, of_side])
    again = np.append(False, (np.diff(place[order]) == 0) & (np.diff(of_side[order]) == 0))
    order = np.concatenate([order[~again], order[again]])
    new = np.empty(number, dtype=np.int64)
    new[order] = np.arange(number)
    return replace(mesh, points=mesh.points[place[order]], triangles=new[group].reshape(-1, 3))


def _corners(mesh: Mesh, vertices: NDArray[np.intp], *triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    """Numbers 3 t + k of the corners that are some vertices, of triangles t beside them; a row for each."""
    return np.array([3 * t + (mesh.triangles[t] == vertices[:, None]).argmax(axis=1) for t in triangles])


def contacts(mesh: Mesh, resistance: Mapping[str, float]) -> dict[float, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Facets of a mesh from `split` that lie on each other: for each total resistance both sides, in the same order."""
    side = _side(mesh, resistance)
    if not side.any():
        return {}
    grid = mesh.skfem
    facets = grid.boundary_facets()
    ends = np.sort(_place(mesh)[grid.facets[:, facets]], axis=0).T
    order = np.lexsort(ends.T)
    twins = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    first, second = facets[order[twins]], facets[order[twins + 1]]
    total = beside(mesh, resistance, first) + beside(mesh, resistance, second)
    return {float(value): (first[total == value], second[total == value]) for value in np.unique(total)}


def beside(mesh: Mesh, resistance: Mapping[str, float], facets: NDArray[np.intp]) -> NDArray[np.float64]:
    """Resistance in m^2 K/W that the region beside each boundary facet has on its surface."""
    own = np.array([0.0, *resistance.values()])
    return np.asarray(own[_side(mesh, resistance)[mesh.skfem.f2t[0, facets]]])


def _side(mesh: Mesh, resistance: Mapping[str, float]) -> NDArray[np.int64]:
    """For each triangle 0, or one more than the place of its region among those with a resistance."""
    names = list(resistance)
    number = np.array([names.index(name) + 1 if name in names else 0 for name in mesh.region_names], dtype=np.int64)
    return number[mesh.region]


def _place(mesh: Mesh) -> NDArray[np.intp]:
    """A number for each point, the same for points that lie on each other."""
    return np.unique(mesh.points, axis=0, return_inverse=True)[1].ravel()
