"""Derivatives of the matrices of the heat equation with respect to one parameter of the geometry.

The element matrices are functions of the corners of their triangle, of k and of rho c_p. With velocities v of the
corners, dk and d(rho c_p) per unit of the parameter, their derivatives are exact for the mesh that moves along:

    dK = sum over elements of (dK_e/d corners) v + (dK_e/dk) dk,    and the same for M, surfaces and means.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..checks import InputError
from .element_tangent import element_capacity_tangent, element_conduction_tangent, volume_tangent
from .matrices import assembled, properties
from .shell_tangent import shell_tangent
from .surfaces import surface_tangent

if TYPE_CHECKING:
    from ..geometry.change import Change
    from .problem import HeatProblem


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
