"""Derivatives of the matrices and means of the heat equation with respect to one parameter of the geometry.

The element matrices are functions of the corners of their triangle, of k and of rho c_p. With velocities v of the
corners, dk and d(rho c_p) per unit of the parameter, their derivatives are exact for the mesh that moves along:

    dK = sum over elements of (dK_e/d corners) v + (dK_e/dk) dk,    and the same for M, surfaces and means.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, NDArray
from ..checks import InputError
from ..geometry.guides import LIGHT
from ..geometry.regions import nearest
from ..mesh.triangles import radii
from ..optics.shape import light_slope
from .probe_means import FINENESS, Cut, cut_shell, shell_integral
from .surfaces import surface_tangent
from .weak_forms import assembled, maps, properties, reference

if TYPE_CHECKING:
    from ..geometry.parameter_paths import Change
    from .heat_problem import HeatProblem


@dataclass(frozen=True, eq=False)
class _Maps:
    """Jacobians, their determinants and radii of the corners of all triangles, and their derivatives."""

    J: Array
    r: Array
    det: Array
    of_J: Array
    of_r: Array
    of_det: Array

    @classmethod
    def of(cls, basis: Any, moved: Array) -> _Maps:
        J, r = maps(basis.mesh)
        of_J, of_r = maps(basis.mesh, moved)
        det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
        of_det = of_J[0, 0] * J[1, 1] + J[0, 0] * of_J[1, 1] - of_J[0, 1] * J[1, 0] - J[0, 1] * of_J[1, 0]
        return cls(J, r, det, of_J, of_r, of_det)


def element_conduction_tangent(basis: Any, k: Array, of_k: Array, moved: Array) -> Array:
    """Derivative of `weak_forms.element_conduction`; with A = adj J its metric is A diag(k) A^T / |det J|."""
    m, integrals = _Maps.of(basis, moved), reference(basis)
    A, of_A = (np.array([[J[1, 1], -J[0, 1]], [-J[1, 0], J[0, 0]]]) for J in (m.J, m.of_J))
    metric = np.einsum("mde,de,nde->mne", A, k, A)
    cross = np.einsum("mde,de,nde->mne", of_A, k, A)
    of_metric = cross + cross.swapaxes(0, 1) + np.einsum("mde,de,nde->mne", A, of_k, A) - metric * m.of_det / m.det
    weights = 2 * np.pi / np.abs(m.det) * (of_metric[:, :, None] * m.r + metric[:, :, None] * m.of_r)
    return _elements(basis, weights.reshape(-1, basis.nelems), integrals.stiffness)


def element_capacity_tangent(basis: Any, c: Array, of_c: Array, moved: Array) -> Array:
    """Derivative of `weak_forms.element_capacity`."""
    m = _Maps.of(basis, moved)
    share = of_c + c * m.of_det / m.det
    weights = 2 * np.pi * np.abs(m.det) * (share * m.r + c * m.of_r)
    return _elements(basis, weights, reference(basis).mass)


def _elements(basis: Any, weights: Array, integrals: Array) -> Array:
    return (weights.T @ integrals).reshape(basis.nelems, basis.Nbfun, basis.Nbfun)


def volume_tangent(basis: Any, inside: NDArray[np.bool_], moved: Array) -> Array:
    """Derivative of `weak_forms.volume`."""
    m, integrals = _Maps.of(basis, moved), reference(basis)
    weights = 2 * np.pi * np.abs(m.det) * (m.r * m.of_det / m.det + m.of_r)
    shares = weights[:, inside].T @ integrals.load
    places = basis.element_dofs.T[inside].ravel()
    return np.asarray(np.bincount(places, shares.ravel(), minlength=basis.N), dtype=float)


def shell_tangent(heat: HeatProblem, change: Change, moved: Array, name: str) -> Array:
    """Derivative of `probe_means.shell_integral` of a probe; ``moved`` has the velocities of the vertices, (2, n).

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


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives per unit of one parameter, on all unknowns.

    K, M [sparse]
    means [dict from what is heated or read to array]
    """

    K: Any
    M: Any
    means: dict[str, Array]


def tangent(heat: HeatProblem, change: Change, velocity: Array, names: tuple[str, ...]) -> Tangent:
    """Differentiate the matrices of a heat problem and the means of ``names``.

    velocity [shape (vertices, 2)]: m per unit of the parameter.
    """
    basis = heat.discretization.basis
    conductivity, heat_capacity = properties(heat.geometry, heat.mesh)
    of_k, of_c = _properties(heat, change)
    moved = velocity.T  # (2, vertices), as scikit-fem holds points
    K = assembled(basis, element_conduction_tangent(basis, conductivity, of_k, moved))
    M = assembled(basis, element_capacity_tangent(basis, heat_capacity, of_c, moved))
    K = K + surface_tangent(heat, change, moved, conductivity, of_k)
    return Tangent(K, M, {name: _mean(heat, change, moved, name) for name in names})


def _properties(heat: HeatProblem, change: Change) -> tuple[Array, Array]:
    """d(k_r, k_z), shape (2, triangles), and d(rho c_p), shape (triangles,)."""
    materials = [heat.geometry.material_of(name).name for name in heat.mesh.region_names]
    of_k = np.array([change.conductivity.get(name, (0.0, 0.0)) for name in materials]).T
    of_c = np.array([change.heat_capacity.get(name, 0.0) for name in materials])
    return of_k[:, heat.mesh.region], of_c[heat.mesh.region]


def _mean(heat: HeatProblem, change: Change, moved: Array, name: str) -> Array:
    """Derivative of the volume mean over a region or a shell."""
    basis, mesh = heat.discretization.basis, heat.mesh
    if name == LIGHT and heat.light is not None:
        return light_slope(heat.light, basis, change)
    if name not in mesh.region_names:
        return _probe(heat, change, moved, name)
    inside = mesh.region == mesh.region_names.index(name)
    of_integral = volume_tangent(basis, inside, moved)
    volume = mesh.volumes()[name]
    return (of_integral - heat.discretization.means[name] * of_integral.sum()) / volume


def _probe(heat: HeatProblem, change: Change, moved: Array, name: str) -> Array:
    """Derivative of the mean that a probe reads."""
    probe = next(probe for probe in heat.geometry.probes if probe.name == name)
    if probe.shell is not None:
        return shell_tangent(heat, change, moved, name)
    if change.moves:
        raise InputError(
            f"{change.name}: the mean over {name!r}, a copy off the axis, has no derivative with respect to lengths, "
            "only to materials and surfaces"
        )
    return np.zeros_like(heat.discretization.means[name])
