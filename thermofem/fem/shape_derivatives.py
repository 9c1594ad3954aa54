"""Derivatives of the matrices and means of the heat equation with respect to one parameter of the geometry.

The matrices are analytic functions f of the vertices x of the mesh, of k, of rho c_p and of the surfaces' coefficients.
With velocities v of the vertices, dk and so on per unit of the parameter, a complex step gives their derivatives to
round-off, without cancellation:

    df = Im f(x + i h v, k + i h dk, ...)/h,     h = `COMPLEX_STEP`

Source: W. Squire, G. Trapp, SIAM Rev. 40, 110 (1998).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, NDArray
from ..checks import InputError
from ..geometry.section_parts import LIGHT
from ..optics.mode_derivatives import light_slope
from .probe_means import shell_integral
from .surfaces import surface_terms
from .weak_forms import assembled, element_capacity, element_conduction, properties, volume

if TYPE_CHECKING:
    from ..geometry.parameter_paths import Change
    from .heat_problem import HeatProblem

COMPLEX_STEP = 1e-30  # of the parameter in SI: its square vanishes beside 1, and no product with it underflows


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives of matrices and means with respect to one parameter, on all unknowns.

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
    mesh = heat.mesh
    materials = [heat.geometry.material_of(name).name for name in mesh.region_names]
    of_k = np.array([change.conductivity.get(name, (0.0, 0.0)) for name in materials])
    of_c = np.array([change.heat_capacity.get(name, 0.0) for name in materials])
    conductivity, heat_capacity = properties(heat.geometry, mesh)
    k = conductivity + 1j * COMPLEX_STEP * of_k.T[:, mesh.region]
    c = heat_capacity + 1j * COMPLEX_STEP * of_c[mesh.region]
    points = basis.mesh.p + 1j * COMPLEX_STEP * velocity.T
    surfaces = heat.discretization.surfaces
    source = surfaces.source + 1j * COMPLEX_STEP * _source(heat, change)
    surfaces = replace(surfaces, source=(source[0], source[1]))

    def series(*facets: NDArray[np.intp]) -> Any:
        slope = sum(_resistance(heat, change, side) for side in facets)
        return 1j * COMPLEX_STEP * slope

    K = assembled(basis, element_conduction(basis, k, points).imag / COMPLEX_STEP)
    K = K + surface_terms(basis, k, surfaces, points, series).imag / COMPLEX_STEP
    M = assembled(basis, element_capacity(basis, c, points).imag / COMPLEX_STEP)
    return Tangent(K, M, {name: _mean(heat, change, points, name) for name in names})


def _source(heat: HeatProblem, change: Change) -> Array:
    """Derivative of the place (r, z) of the heat (`surfaces.source_of`) in m per unit of the parameter, shape (2,)."""
    part = next(part for part in heat.geometry.parts if part.heated)
    velocity = change.outlines.get(part.name, np.zeros((4, 2)))
    moves = part.straight and not heat.geometry.mirrored
    r = velocity[:, 0].mean() * moves
    z = (velocity[0, 1] + velocity[3, 1]) / 2
    return np.array([r, z])


def _resistance(heat: HeatProblem, change: Change, facets: NDArray[np.intp]) -> Array:
    """Derivative of contact resistance + 1/h in m^2 K/W with respect to the parameter, at each facet."""
    grid = heat.discretization.basis.mesh
    geometry = heat.geometry
    of_part = np.array([change.contact.get(name, 0.0) for name in heat.mesh.region_names])
    region = heat.mesh.region[grid.f2t[0, facets]]
    slope = of_part[region]
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    for side, of_h in change.exchange.items():
        h = getattr(geometry, side).exchange
        slope[geometry.on_boundary(side, r, z)] -= of_h / h**2
    return slope


def _mean(heat: HeatProblem, change: Change, points: Any, name: str) -> Array:
    """Derivative of the mean functional of a region, the light or a probe with respect to the parameter."""
    basis = heat.discretization.basis
    mesh = heat.mesh
    if name == LIGHT and heat.light is not None:
        return light_slope(heat.light, basis, change)
    if name in mesh.region_names:
        integral = volume(basis, mesh.region == mesh.region_names.index(name), points)
        return np.asarray((integral / integral.sum()).imag / COMPLEX_STEP)
    probe = next(probe for probe in heat.geometry.probes if probe.name == name)
    if probe.shell is not None:
        thicker = 1j * COMPLEX_STEP * change.shell.get(name, 0.0)
        integral = shell_integral(heat.geometry, mesh, basis, probe, points, thicker)
        return np.asarray((integral / integral.sum()).imag / COMPLEX_STEP)
    if change.moves:
        raise InputError(
            f"{change.name}: the mean over {name!r}, a copy off the axis, has no derivative with respect to lengths, "
            "only to materials and surfaces"
        )
    return np.zeros_like(heat.discretization.means[name])
