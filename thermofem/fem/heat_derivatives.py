"""Derivatives of thermal resistance, step response and impedance with respect to the parameters of a geometry.

Heat and reading use the same functionals, so no adjoint solve is needed: with x(s) = (K + s M)^-1 c,

    dZ(s)/dp = 2 (dc/dp) . x - x^T (dK/dp + s dM/dp) x

The vertices of the mesh move with the outlines (`mesh_motion`), and the derivative is exact for that mesh.
The fields x(s) come from a rational Krylov space that is grown until the derivatives no longer change.

In modes: with M-orthonormal modes V of rates lambda, heat and reading functionals b, c and their projections beta,
gamma,

    Z(s) = sum_m gamma_m beta_m / (lambda_m + s)
    dZ(s) = sum_m (gamma_m db_m + dc_m beta_m)/(lambda_m + s)
            - sum_mn gamma_m (dK_mn + s dM_mn) beta_n / ((lambda_m + s)(lambda_n + s))

dK = V^T (dK/dp) V and so on with V held: exact where V holds the solutions at s. The step response has the same sum
with each fraction over s carried to the time domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from .. import checks
from ..algebra.krylov import Rounds, rates
from ..algebra.pole_responses import pole_responses
from ..arrays import Array, ArrayLike, Complex, Indices
from ..data.dataset import describe
from ..geometry.parameter_paths import Change, changes_of
from ..geometry.section_parts import LIGHT
from ..mesh.mesh_motion import vertex_velocities
from ..optics.mode_derivatives import light_slope
from ..waveforms import Waveform
from .probe_means import shell_integral
from .surfaces import surface_terms
from .weak_forms import assembled, element_capacity, element_conduction, properties, volume

if TYPE_CHECKING:
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
    """Differentiate the matrices of a heat problem and the means of ``names`` with respect to one parameter.

    The matrices are analytic functions f of the vertices x of the mesh, of k, of rho c_p and of the surfaces'
    coefficients. With velocities v of the vertices, dk and so on per unit of the parameter, a complex step gives their
    derivatives to round-off, without cancellation:

        df = Im f(x + i h v, k + i h dk, ...)/h,     h = `COMPLEX_STEP`

    Source: W. Squire, G. Trapp, SIAM Rev. 40, 110 (1998).

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

    def series(*facets: Indices) -> Any:
        slope = sum(_resistance(heat, change, side) for side in facets)
        return 1j * COMPLEX_STEP * slope

    K = assembled(basis, element_conduction(basis, k, points).imag / COMPLEX_STEP)
    K = K + surface_terms(basis, k, surfaces, points, series).imag / COMPLEX_STEP
    M = assembled(basis, element_capacity(basis, c, points).imag / COMPLEX_STEP)
    return Tangent(K, M, {name: _mean(heat, change, points, name) for name in names})


def _source(heat: HeatProblem, change: Change) -> Array:
    """Derivative of the place (r, z) of the heat (`surfaces.source_of`) in m per unit of the parameter, shape (2,)."""
    part = heat.geometry.first_heated
    velocity = change.corners(part.name)
    moves = part.straight and not heat.geometry.mirrored
    r = velocity[:, 0].mean() * moves
    z = (velocity[0, 1] + velocity[3, 1]) / 2
    return np.array([r, z])


def _resistance(heat: HeatProblem, change: Change, facets: Indices) -> Array:
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
        return (integral / integral.sum()).imag / COMPLEX_STEP
    probe = heat.geometry.probe(name)
    if probe.shell is not None:
        thicker = 1j * COMPLEX_STEP * change.shell.get(name, 0.0)
        integral = shell_integral(heat.geometry, mesh, basis, probe, points, thicker)
        return (integral / integral.sum()).imag / COMPLEX_STEP
    if change.moves:
        raise checks.InputError(
            f"{change.name}: the mean over {name!r}, a copy off the axis, has no derivative with respect to lengths, "
            "only to materials and surfaces"
        )
    return np.zeros_like(heat.discretization.means[name])


RATE_STEP = 1e-4  # of a rate: half the width of the difference that gives the answer of a double pole to 1e-8


@dataclass(frozen=True, eq=False)
class ModalDerivative:
    """One channel in modes, and the derivatives of its matrices with respect to p parameters.

    rate [shape (k,), 1/s]
    heating, reading [shape (k,)]: V^T b and V^T c.
    of_K, of_M [shape (p, k, k)]
    of_heating, of_reading [shape (p, k)]: V^T db and V^T dc.
    """

    rate: Array
    heating: Array
    reading: Array
    of_K: Array
    of_M: Array
    of_heating: Array
    of_reading: Array

    @property
    def _source(self) -> Array:
        """gamma_k d(beta_k) + d(gamma_k) beta_k for p parameters and k modes, shape (p, k)."""
        return self.of_heating * self.reading + self.of_reading * self.heating

    @property
    def _pairs(self) -> tuple[Array, Array]:
        """gamma_m dK_mn beta_n, and the same with dM, for p parameters, shape (p, k, k) each."""
        weight = np.outer(self.reading, self.heating)
        return self.of_K * weight, self.of_M * weight

    def resistance(self) -> Array:
        """Derivative of R_th in K/W per unit of each parameter, shape (p,)."""
        K, _ = self._pairs
        x = 1 / self.rate
        return self._source @ x - np.einsum("pmn,m,n->p", K, x, x)

    def impedance(self, frequency: Array) -> Complex:
        """Derivative of the impedance Z(f) in K/W per unit of each parameter, shape (p, f)."""
        K, M = self._pairs
        s = 2j * np.pi * frequency
        x = 1 / (self.rate[:, None] + s)
        by_K = np.einsum("pmn,mf,nf->pf", K, x, x)
        by_M = s * np.einsum("pmn,mf,nf->pf", M, x, x)
        return self._source @ x - (by_K + by_M)

    def step_response(self, times: Array) -> Array:
        """Derivative of the rise after a unit step in K/W per unit of each parameter, shape (p, t).

        1/(s (l + s)) -> (1 - exp(-l t))/l,      1/((l + s)(m + s)) -> D = (exp(-l t) - exp(-m t))/(m - l),
        1/(s (l + s)(m + s)) -> (1 - exp(-l t) - l D)/(l m).
        """
        K, M = self._pairs
        slow = np.minimum(self.rate[:, None], self.rate)
        apart = np.abs(self.rate[:, None] - self.rate)
        nonzero = np.where(apart > 0, apart, 1.0)
        products = np.outer(self.rate, self.rate)
        result = np.empty((len(K), times.size))
        for k, t in enumerate(times):
            decay = np.exp(-slow * t)
            D = decay * np.where(apart > 0, -np.expm1(-apart * t) / nonzero, t)
            of_K = (-np.expm1(-slow * t) - slow * D) / products
            rise = -np.expm1(-self.rate * t) / self.rate
            by_K = np.einsum("pmn,mn->p", K, of_K)
            by_M = np.einsum("pmn,mn->p", M, D)
            result[:, k] = self._source @ rise - by_K - by_M
        return result

    def poles(self) -> tuple[Array, Array]:
        """Derivatives of R_i in K/W and of tau_i in s per unit of each parameter, shape (p, k) each; simple poles only.

        dlambda_i = (dK - lambda_i dM)_ii,
        dv_i = -(dM_ii/2) v_i + sum_{j != i} (dK - lambda_i dM)_ji/(lambda_i - lambda_j) v_j
        """
        rate, b, c = self.rate, self.heating, self.reading
        apart = rate - rate[:, None]  # [j, i] = lambda_i - lambda_j
        itself = apart == 0
        inverse = np.where(itself, 0.0, 1 / np.where(itself, 1.0, apart))
        mixed = self.of_K - rate * self.of_M  # [p, j, i]
        of_rate = np.einsum("pii->pi", mixed)
        stretch = np.einsum("pii->pi", self.of_M) / 2
        turn = mixed * inverse - stretch[:, :, None] * np.eye(rate.size)
        of_b = self.of_heating + np.einsum("j,pji->pi", b, turn)
        of_c = self.of_reading + np.einsum("j,pji->pi", c, turn)
        of_gain = of_b * c + b * of_c
        of_R = of_gain / rate - b * c * of_rate / rate**2
        return of_R, -of_rate / rate**2

    def response(self, wave: Waveform, times: Array, *, periodic: bool = False) -> Array:
        """Derivative of the rise under a power in K per unit of each parameter, shape (p, t); poles must be simple.

        With g_i = R_i lambda_i and the response X_i of a pole of rate lambda_i,
        d(rise) = sum_i dg_i X_i + g_i dX_i/dlambda_i dlambda_i.
        """
        of_R, of_tau = self.poles()
        rate, gain = self.rate, self.heating * self.reading
        of_rate = -of_tau * rate**2
        X = pole_responses(rate * 1, wave, times, periodic=periodic)
        up = pole_responses(rate * (1 + RATE_STEP), wave, times, periodic=periodic)
        down = pole_responses(rate * (1 - RATE_STEP), wave, times, periodic=periodic)
        of_X = (up - down) / (2 * RATE_STEP * rate)
        of_gain = of_R * rate + gain / rate * of_rate
        return of_gain @ X.T + (gain * of_rate) @ of_X.T


Parameter = str | Sequence[str]

# change of a derivative over two rounds, relative to its largest over times; 1e-9 is then left (measured)
SETTLED_DERIVATIVE = 1e-7
FEWEST, ROUNDS = 8, 24  # of the Krylov space: the derivative errs like the field, so more than for the response itself


def step_times(times: ArrayLike) -> Array:
    """Times of a step response, in s; InputError for one before the step."""
    t = checks.array("times", times)
    checks.between("times", t.min(), 0, np.inf, unit="s", hint="the step is at t = 0")
    return t


def derivatives(
    heat: HeatProblem,
    parameters: Parameter | Sequence[Parameter],
    *,
    times: ArrayLike | None = None,
    frequencies: ArrayLike | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Derivatives of the response of one channel, exact for the discretization.

    Parameters
    ----------
    heat : HeatProblem
    parameters : str, or sequence of str or of tuples of str
        paths as in a campaign: "part.core.radius", "layer.box.thickness", "material.SiO2.conductivity",
        "interface.core.resistance", "boundary.top.convection", "probe.near.shell", "outer_radius", "ambient".
        A tuple of paths is one parameter: all of them change together.
    times : array, s
        at which the derivative of the step response is wanted.
    frequencies : array, Hz
        at which the derivative of the impedance is wanted.
    heated, read : str
        the channel; default the first heated part, and itself.

    Returns
    -------
    xarray.Dataset
        over "parameter", all per SI unit of it: ``thermal_resistance``, with times ``step_response`` (parameter, time),
        with frequencies the complex ``impedance`` (parameter, frequency), all in K/W per unit; ``value`` and ``unit``
        of the parameter. The attributes hold the thermal resistance itself. At small power where conductivities depend
        on T.

        Against complex steps on the same mesh: R_th within 1e-10, Z(f) within 1e-8, the step response within 1e-6.
        Against differences of converged meshes at accuracy 1e-4, for the reference strip: radius 4e-5, width 6e-5,
        buried oxide 1.1e-4, cladding 1.5e-4 (measured).

    Raises
    ------
    InputError
        a path that leads nowhere; a motion at which a face would appear or vanish.

    >>> heat = assemble(strip_ring())
    >>> d = derivatives(heat, ["layer.box.thickness", "material.SiO2.conductivity"])
    >>> (d.thermal_resistance * d.value / heat.thermal_resistance()).round(2).values
    array([ 0.37, -0.98])
    """
    heated = checks.choice("heated", heated, heat.heated, default=heat.heated[0])
    read = checks.choice("read", read, heat.readable, default=heated)
    t = None if times is None else step_times(times)
    f = None if frequencies is None else checks.array("frequencies", frequencies)
    changes, tangents = tangents_of(heat, parameters, (heated, read))
    responses = _responses(heat, tangents, (heated, read), t, f)
    rows = [(each.name, each.value, each.unit) for each in changes]
    data = dataset_of(rows, responses, t, f)
    return data.assign_attrs(heated=heated, read=read, thermal_resistance=heat.thermal_resistance(heated, read))


def tangents_of(
    heat: HeatProblem, parameters: Parameter | Sequence[Parameter], channel: tuple[str, str]
) -> tuple[list[Change], list[Tangent]]:
    """The `Change` of each parameter, and the derivatives of the matrices with respect to it."""
    changes = changes_of(heat.geometry, parameters)
    checks.unique("parameters", [each.name for each in changes])
    velocities = vertex_velocities(heat.geometry, heat.mesh, changes, roles=(*heat.heated, channel[1]))
    return changes, [tangent(heat, *pair, channel) for pair in zip(changes, velocities, strict=True)]


def project(
    tangents: Sequence[Tangent], channel: tuple[str, str], free: Indices, V: Array
) -> tuple[Array, Array, Array, Array]:
    """Derivatives dK, dM (p, k, k) and db, dc (p, k) projected on the k fields V, for p parameters."""
    heated, read = channel
    of_K = np.array([V.T @ (each.K[free][:, free] @ V) for each in tangents])
    of_M = np.array([V.T @ (each.M[free][:, free] @ V) for each in tangents])
    of_b = np.array([V.T @ each.means[heated][free] for each in tangents])
    of_c = np.array([V.T @ each.means[read][free] for each in tangents])
    return of_K, of_M, of_b, of_c


Answers = tuple[Array, Array | None, Complex | None]  # of R_th, the step response and the impedance


def _responses(
    heat: HeatProblem, tangents: Sequence[Tangent], channel: tuple[str, str], t: Array | None, f: Array | None
) -> Answers:
    """Derivatives of R_th, step response and impedance, on a Krylov space that grows until they no longer change."""
    space = _space(heat, *channel, t, f)
    free = heat.discretization.free
    means = heat.discretization.means

    def answers() -> Answers:
        basis = space.basis()
        V, Z = basis.fields, basis.rotation
        b = Z.T @ (V.T @ means[channel[0]][free])
        c = Z.T @ (V.T @ means[channel[1]][free])
        of_K, of_M, of_b, of_c = project(tangents, channel, free, V)
        modal = ModalDerivative(basis.rate, b, c, Z.T @ of_K @ Z, Z.T @ of_M @ Z, of_b @ Z, of_c @ Z)
        step = None if t is None else modal.step_response(t)
        impedance = None if f is None else modal.impedance(f)
        return modal.resistance(), step, impedance

    for _ in range(FEWEST):
        space.grow()
    responses = answers()
    while len(space.sizes) <= ROUNDS:
        size = space.order
        space.grow()
        space.grow()
        before = responses
        responses = answers()
        if space.order == size or _settled(responses, before):
            break
    return responses


def _settled(responses: Answers, before: Answers) -> bool:
    """Whether step response and impedance changed by less than `SETTLED_DERIVATIVE` of each parameter's largest."""
    for now, last in zip(responses[1:], before[1:], strict=True):
        if now is None or last is None:
            continue
        largest = np.abs(now).max(axis=1, keepdims=True)
        if (np.abs(now - last) > SETTLED_DERIVATIVE * largest).any():
            return False
    return True


def _space(heat: HeatProblem, heated: str, read: str, t: Array | None, f: Array | None) -> Rounds:
    """Krylov space with shifts that cover the times t (s) and frequencies f (Hz)."""
    names = tuple(dict.fromkeys((heated, read)))
    factors = heat.discretization.factors
    free = heat.discretization.free
    means = heat.discretization.means

    def static(rhs: Array) -> Array:
        return factors.solve(0.0, 1.0, rhs)

    system = heat.discretization.state_space((heated,), (heated,))
    slow, _ = rates(system, static)
    B = np.column_stack([means[name][free] for name in names])
    system = replace(system, B=B, inputs=names)
    shifts = np.zeros(1)
    if t is not None or f is not None:
        fast = [10 * slow]
        if t is not None and (t > 0).any():
            fast.append(3 / t[t > 0].min())
        if f is not None:
            fast.append(2 * np.pi * np.abs(f).max())
        shifts = np.append(0.0, np.geomspace(5 * slow, max(fast), 5))
    solvers = [factors.keep(shift, 1.0) if shift else static for shift in shifts]
    return Rounds(system, shifts, solvers)


def dataset_of(
    parameters: Sequence[tuple[str, float, str]],
    responses: Answers,
    t: Array | None,
    f: Array | None,
) -> xr.Dataset:
    """Dataset of the derivatives of R_th, of the step response at ``t`` and of the impedance at ``f``, over parameters.

    ``parameters`` are names, values and SI units; what was not asked for is None.
    """
    names, values, units = zip(*parameters, strict=True)
    per = "K/W per unit of the parameter"
    kinds = {
        "thermal_resistance": ((), "R_th"),
        "step_response": (("time",), "the step response"),
        "impedance": (("frequency",), "the thermal impedance"),
    }
    variables = {}
    for (name, (over, of)), numbers in zip(kinds.items(), responses, strict=True):
        if numbers is not None:
            about = {"long_name": f"derivative of {of}", "units": per}
            variables[name] = (("parameter", *over), numbers, about)
    coords: dict[str, Any] = {
        "parameter": list(names),
        "value": ("parameter", list(values), {"long_name": "value of the parameter"}),
        "unit": ("parameter", list(units), {"long_name": "SI unit of the parameter"}),
    }
    for name, axis in (("time", t), ("frequency", f)):
        if axis is not None:
            coords[name] = (name, axis, describe(name))
    return xr.Dataset(variables, coords=coords)
