"""Small models of heat flow with k(T) and c_p(T): a quadratic Galerkin reduction, and a static output map.

The output map dT = z + coefficient z^2 of a linear model comes from steady solutions with k(T) or from data
(G. Kirchhoff, Vorlesungen ueber die Theorie der Waerme (Teubner, 1894): with k(T) the integral of k obeys a nearly
linear heat equation, and the temperature is a function of it).

Quadratic reduction.
The full system d/dt H(x) = -F(x) + b P of `thermofem.transient.nonlinear` is projected, x = V z, on the basis of the
certified linear reduction, the steady field x1 at the power asked for, and, where only k depends on temperature, a few
vectors of the reduction linearised about x1: what cools after a pulse is hot. With the laws of second order

    g_l(x) = x + a_l x^2,     c_l(x) = 1 / (1 - gamma_l x),

m[z] = sum_l gamma_l V^T M_l diag(V z) V, Q[z, z] = sum_l a_l V^T K_l (V z)^2 and the core's rise y = c^T V z,

    dz/dt = (1 - m[z]) (-L z + b P) - Q[z, z] + m[z1/2] Q[z, z] + w N z + w y p + w^2 q,      dT = y.

The first four terms are what the laws give up to second order; m[z1/2] Q[z, z] stands for the cubic m[z] Q[z, z]: it
takes a quarter off the largest error of a transient, and leaves 1e-3 in the steady states between, where there was
1e-5 (measured). The last three are of third and fourth order in the rise. They stay quadratic in the states, because w
is a state of its own that follows y^2/y1 as fast as the fastest mode ("lifting"):

    N  so that the heat flow has the slope of F at x1,      p, q  so that both x1 and the steady field at half the power
                                                            are steady states, exactly.

Sources: B. Kramer, K. Willcox, AIAA J. 57, 2297 (2019); E. Qian, B. Kramer, B. Peherstorfer, K. Willcox, Physica D 406,
132401 (2020) (lifting to quadratic form, Galerkin); R. Becker, R. Rannacher, Acta Numer. 10, 1 (2001) (adjoint
weights, of gamma).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import Foster, OutputMap, Quadratic, checks
from thermofem.algebra.factor import factorize
from thermofem.algebra.krylov import symmetric_part
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import Array
from thermofem.data.dataset import responses_of, warn_of
from thermofem.models import HasModel, NonlinearSystem, check_single
from thermofem.transient.nonlinear import cubic_form

from .reduce import Reduction, reduce


def output_map(system: NonlinearSystem, power: float, *, linear: Foster | None = None) -> OutputMap:
    """Linear dynamics with the static map dT = z + coefficient z^2 of two nonlinear steady solutions.

    Parameters
    ----------
    system : NonlinearSystem
        ``heat.model("core", "core")``; one input, one output.
    power : float, W
        the largest of interest; the map is the least-squares one for it and half of it.
    linear : Foster
        default the certified reduction at 1e-4.

    Returns
    -------
    OutputMap
        measured as in `reduce_quadratic`: worst error 0.8 to 1.2 % of the peak rise, mean over the drives 0.2 to 0.3 %,
        the most of one drive 0.4 %; at 167 K 1.4 % and 0.5 %.

    Raises
    ------
    InputError
        a system that is linear or has several channels, a power without a steady state.
    """
    power = check_nonlinear(system, power)
    if linear is None:
        linear = reduce(system.linear, 1e-4).model  # type: ignore[assignment]  # one channel: a Foster network
    powers = np.array([power / 2, power])
    z = system.thermal_resistance * powers
    (rise,) = np.transpose([system.steady_rise(p) for p in powers])
    return _mapped(linear, z, rise, "output map of k(T) steady states")  # type: ignore[arg-type]


def fit_output_map(linear: Foster, data: xr.Dataset | Sequence[xr.Dataset]) -> OutputMap:
    """The static map of the output, dT = z + coefficient z^2, that fits data best; the linear model is kept.

    Parameters
    ----------
    linear : Foster
        at small power, as of `reduce` or a fit to a weak drive.
    data : Dataset or list of them
        with rises large enough to show the nonlinearity.

    Raises
    ------
    InputError
        data without power or rise.
    """
    responses = responses_of(data)
    warn_of(responses)
    rate = 1 / np.asarray(linear.tau)
    phi = np.vstack([pole_responses(rate, d.wave, d.times, periodic=d.periodic) for d in responses])
    rise = np.concatenate([d.rise for d in responses])
    return _mapped(linear, phi @ linear.gain, rise, "output map of a linear model, fitted to data")


def _mapped(linear: Foster, z: Array, rise: Array, method: str) -> OutputMap:
    """The output map by least squares from the rises z of a linear model, with the provenance of that model."""
    square = z**2
    beyond = rise - z
    coefficient = float(beyond @ square / (square @ square))
    origin = dict(linear.origin or {})
    origin |= {"linear_method": origin.get("method"), "method": method}
    return OutputMap(linear, coefficient, float(rise.max()), origin)


def check_nonlinear(system: NonlinearSystem, power: float) -> float:
    """Return the power in W where a reduction with k(T) or c_p(T) is possible.

    Raises InputError: a system that is linear or has several channels, a power out of range.
    """
    hint = "heat.model(heated, read) of a geometry with laws of temperature is needed; others take surrogate.reduce"
    checks.instance("system", system, NonlinearSystem, hint=hint)
    check_single(system)
    return checks.power("power", power)


@dataclass(frozen=True, eq=False)
class QuadraticReduction(HasModel):
    """A quadratic reduced model, with the power and the error for which it holds.

    Attributes
    ----------
    model : Quadratic
        its last state follows the square of the rise, so that terms of third order are products of two states.
    linear : Reduction
        the certified reduction at small power.
    power : float, W
        largest that it is made for.
    static_error : float
        of its steady rise at three quarters of ``power``, relative, against the full order; at one half and at the
        whole of it there is none.
    basis : array, shape (states of the full system, order - 1)
        full state = basis @ states of the model but the last.
    """

    model: Quadratic
    linear: Reduction
    power: float
    static_error: float
    basis: Array

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        return {
            **(self.model.origin or {}),
            "method": "quadratic Galerkin reduction",
            "power_W": self.power,
            "static_error": self.static_error,
        }


def reduce_quadratic(system: NonlinearSystem, power: float, *, tolerance: float = 1e-4) -> QuadraticReduction:
    """Reduce heat flow with k(T) and c_p(T) to a small quadratic system.

    Parameters
    ----------
    system : NonlinearSystem
        ``heat.model("core", "core")`` of a geometry whose materials have laws of temperature; one input, one output.
    power : float, W
        largest constant power that the model is made for.
    tolerance : float
        of the linear reduction.

    Returns
    -------
    QuadraticReduction
        measured on the reference strip at 20 mW, 147 K: the largest error at any time over the peak rise, on a step of
        half the power, a 20 us pulse, a 3 us pulse of two thirds, a telegraph and a 1 us square wave. With k(T) alone
        (Si T^-1.3, oxide T^0.3) 1.8e-4, mean at most 4e-5 (at 167 K 2.3e-4 and 5e-5); with c_p(T) (oxide T^0.5) 9e-4
        and 3e-4; with the library's Si(T) and SiO2(T), whose laws are far from parabolas, 2.0e-3 and 9e-4. The linear
        model is off by 7e-2.

    Raises
    ------
    InputError
        a system that is linear or has several channels, a power without a steady state.
    """
    power = check_nonlinear(system, power)
    full = system.steady_state(power)
    half = system.steady_state(power / 2)
    rom = reduce(system.linear, tolerance)
    fields = [rom.basis, full]
    if not system.content.laws:  # the reduction linearised about the steady field, the Jacobian symmetrised
        slope = symmetric_part(system.flow.jacobian(full))
        # 0.1: tolerance of that reduction: 4 to 6 vectors more
        hot = reduce(replace(system.linear, A=-slope), 0.1)
        fields.append(hot.basis)
    rate, V = _modes(system, np.column_stack(fields))
    model = _quadratic_form(system, rate, V, [(full, power), (half, power / 2)])
    between = 0.75 * power
    (exact,) = system.steady_rise(between)
    error = abs(float(model.steady_rise(between) / exact) - 1)
    return QuadraticReduction(replace(model, origin=system.linear.origin), rom, power, error, V).recorded()


def _modes(system: NonlinearSystem, fields: Array) -> tuple[Array, Array]:
    """Rates in 1/s and M-orthonormal modes, shape (n, k), of the heat flow at small power in the span of ``fields``."""
    E = system.linear.E
    squares = np.einsum("ij,ij->j", fields, E @ fields)
    fields = fields / np.sqrt(squares)
    size, turn = np.linalg.eigh(fields.T @ (E @ fields))
    new = size > 1e-8 * size[-1]  # 1e-8 of the largest: below, a direction of the basis is in the span of the others
    directions = turn[:, new] / np.sqrt(size[new])
    V = fields @ directions
    stiffness = -V.T @ (system.linear.A @ V)
    rate, Z = np.linalg.eigh(symmetric_part(stiffness))
    return rate, V @ Z


def _quadratic_form(system: NonlinearSystem, rate: Array, V: Array, steady: list[tuple[Array, float]]) -> Quadratic:
    """The model of the module's docstring from modes and steady fields, the one at full power first."""
    n = rate.size
    linear = system.linear
    full, _ = steady[0]
    b = V.T @ linear.B[:, 0]
    c = V.T @ linear.C[0]
    z = V.T @ (linear.E @ full)
    y = float(linear.C[0] @ full)
    Q = _flow_terms(system, V, full)
    m = _content_terms(system, V, full)
    slope = V.T @ (system.flow.jacobian(full) @ V)
    N = (np.diag(rate) + 2 * Q @ z - slope) / y
    inflow = m * rate
    A = np.diag(np.append(-rate, -rate[-1]))
    B = np.append(b, 0)
    C = np.append(c, 0)
    H = np.zeros((n + 1, n + 1, n + 1))
    G = np.zeros((n + 1, n + 1))
    symmetric = (inflow + inflow.transpose(0, 2, 1)) / 2
    cubic = np.einsum("ijk,j,klm->ilm", m, z / 2, Q, optimize=True)
    H[:n, :n, :n] = symmetric - Q + cubic
    G[:n, :n] = -(m @ b)
    H[n, :n, :n] = np.outer(c, c) * (rate[-1] / y)
    missing = []
    terms = []
    for x, power in steady:
        rise = float(linear.C[0] @ x)
        w = rise**2 / y
        modes = V.T @ (linear.E @ x)
        state = np.append(modes, w)
        driven = A @ state + (H @ state) @ state + power * (G @ state + B)
        missing.append(-driven[:n] - w * (N @ modes))
        terms.append([w * rise, w**2])
    p, q = np.linalg.solve(terms, missing)
    H[:n, :n, n] = (N + np.outer(p, c)) / 2
    H[:n, n, :n] = H[:n, :n, n]
    H[:n, n, n] = q
    return Quadratic(A, H, G, B, C, system.inputs, system.outputs, largest_rise=y)


def _flow_terms(system: NonlinearSystem, V: Array, steady: Array) -> Array:
    """Q, shape (k, k, k): every law by the x^2 term of the cubic through it at its largest rise and at half of that."""
    k = V.shape[1]
    T0 = system.flow.ambient
    shares = np.array([0.5, 1.0])
    Q = np.zeros((k, k, k))
    for law, at, block in system.flow.parts():
        hottest = np.abs(steady[at]).max()
        integral = law.integral(T0, hottest * shares) / law.factor(T0)
        half, whole = integral / hottest - shares
        a = (8 * half - whole) / hottest
        Q += a * cubic_form(block.T @ V, V[at])
    return Q


def _content_terms(system: NonlinearSystem, V: Array, steady: Array) -> Array:
    """m, shape (k, k, k): every law by its chord at the steady field, weighted with the adjoint of the read-out."""
    k = V.shape[1]
    T0 = system.content.ambient
    m = np.zeros((k, k, k))
    adjoint = factorize(-system.linear.A.tocsc())(system.linear.C[0])
    for law, at, block in system.content.parts():
        x = steady[at]
        weight = block.T @ adjoint
        chord = 1 - law.factor(T0) / law.factor(T0 + x)
        gamma = weight @ (chord * x) / (weight @ (x * x))
        m += gamma * cubic_form(block.T @ V, V[at])
    return m
