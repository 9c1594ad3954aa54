"""The derivative of the mean over a shell: vertices, the part's outline and the shell's thickness move."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..geometry.regions import nearest
from ..mesh.triangles import radii
from .element_tangent import volume_tangent
from .shell import FINENESS, Cut, cut_shell, shell_integral

if TYPE_CHECKING:
    from ..geometry.change import Change
    from .problem import HeatProblem


def shell_tangent(heat: HeatProblem, change: Change, moved: Array, name: str) -> Array:
    """Differentiate `shell.shell_mean` of the probe ``name``; ``moved`` has the velocities of the vertices, (2, n).

    The nearest point of the outline moves with the share of the edge at which it lies (envelope theorem).
    """
    basis = heat.discretization.basis
    probe = next(probe for probe in heat.geometry.probes if probe.name == name)
    cut = cut_shell(heat.geometry, heat.mesh, basis, probe)
    of_integral = volume_tangent(basis, cut.inside, moved)
    for k, places, values in _cut_tangent(cut, basis, moved, change.shell.get(name, 0.0)):
        of_integral += np.bincount(basis.element_dofs[k, places], values, minlength=basis.N)
    volume = shell_integral(heat.geometry, heat.mesh, basis, probe).sum()
    return (of_integral - heat.discretization.means[name] * of_integral.sum()) / volume


def _cut_tangent(cut: Cut, basis, moved: Array, of_shell: float):  # type: ignore[no-untyped-def]
    """For every basis function the triangles that the edge of the shell cuts, and the derivative of their shares."""
    grid = basis.mesh
    corners, of_corners = (np.moveaxis(x[:, grid.t[:, cut.cells]], (0, 1, 2), (2, 1, 0)) for x in (grid.p, moved))
    weights = np.column_stack([1 - cut.local.sum(axis=1), cut.local])
    points, of_points = (np.einsum("qk,ckx->cqx", weights, x) for x in (corners, of_corners))
    edges, of_edges = cut.outline, _at_corners(cut.outline, grid.p, moved)
    far, index, place = nearest(points, edges)
    feet, of_feet = (e[index, 0] + place[..., None] * (e[index, 1] - e[index, 0]) for e in (edges, of_edges))
    unit = (points - feet) / np.where(far, far, 1)[..., None]
    of_far = np.einsum("cqx,cqx->cq", unit, of_points - of_feet)
    sides, of_sides = (x - np.roll(x, 1, axis=1) for x in (corners, of_corners))
    length = np.linalg.norm(sides, axis=-1)
    pick = length.argmax(axis=1)
    every = np.arange(len(pick))
    longest = length[every, pick]
    of_longest = np.einsum("cx,cx->c", sides[every, pick], of_sides[every, pick]) / longest
    step, of_step = longest[:, None] / FINENESS, of_longest[:, None] / FINENESS
    depth = (cut.thickness - far) / step
    of_depth = (of_shell - of_far - depth * of_step) / step
    share = np.clip(0.5 + depth, 0, 1)
    of_share = np.where((depth > -0.5) & (depth < 0.5), of_depth, 0.0)
    (x, y), (s, t) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    (of_x, of_y), (of_s, of_t) = (of_corners[:, 1] - of_corners[:, 0]).T, (of_corners[:, 2] - of_corners[:, 0]).T
    det = x * t - s * y
    area, of_area = np.abs(det) / 2, np.sign(det) * (of_x * t + x * of_t - of_s * y - s * of_y) / 2
    r, of_r = radii(points[..., 0], grid.depth), of_points[..., 0] * (grid.depth is None)
    scale = 2 * np.pi / len(cut.local)
    values = of_r * share * area[:, None] + r * of_share * area[:, None] + r * share * of_area[:, None]
    for k in range(basis.Nbfun):
        yield k, cut.cells, scale * values @ basis.elem.lbasis(cut.local.T, k)[0]


def _at_corners(outline: Array, points: Array, moved: Array) -> Array:
    """Velocity of the ends of the outline's edges, shape (edges, 2, 2): that of the vertices there."""
    from scipy.spatial import cKDTree

    return moved.T[cKDTree(points.T).query(outline)[1]]
