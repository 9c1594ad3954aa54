"""Linearised collocation of a closed orbit, interval by interval, with heat eliminated.

On an interval of h ns, stages j at the nodes c_j of Radau IIA:

    o_j = o_0 + h sum_l A_jl f(o_l, z_l),           z_j = sum_i X_ij
    X_i = (1 + h rate_i A)^-1 (x_i + h gain_i A P)     (one pole of a network)

The eigenvalues m of A turn the inverse into 1/(1 + h rate_i m), so that a pole costs a few products and the linear
system of an interval has 3 s unknowns, whatever the number of poles. A quadratic model is solved with all its states.
Every interval then gives its end as a linear function of its beginning, of the period and of parameters; the product
of these is the derivative of the return map.

Source: Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems (1995), Section 5.7 (condensation).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import algebra, equations, kinds
from .algebra import eliminate, follows
from .compiling import compiled, forget_if_older, inner, overload
from .equations import Array, Rates, dispersion, optics, optics_jacobian
from .kinds import rise_of

Complex = NDArray[np.complex128]


class Scheme(NamedTuple):
    """A collocation method, and its coefficients by the eigenvalues of A, one of each conjugate pair."""

    c: Array  # nodes, shape (s,)
    A: Array  # shape (s, s)
    eigenvalue: Complex  # shape (m,)
    back: Complex  # from eigenvectors to stages, shape (s, m), twice those of a pair: only the real part counts
    forth: Complex  # from stages to eigenvectors, shape (m, s)
    one: Complex  # the stages (1, .. 1) in eigenvectors, shape (m,)
    top: Array  # weights of the values at 0, c_1 .. c_s in the leading coefficient, shape (s + 1,)


class Ring(NamedTuple):
    """Ring, laser and heat in internal units, as `equations` takes them."""

    pump: float
    detuning: float
    rates: Rates
    fcd: Array
    thermal: Any


class Intervals(NamedTuple):
    """What the intervals do to a change of their beginning, for the substitution back."""

    light: Array  # changes of all unknowns of the stages by the inputs of an interval and by the extra columns
    warmth: Array  # dz at the stages by dx: shape (N, s, n); empty for a quadratic model
    gain: Array  # dx at the end by dP at the stages: shape (N, n, s)
    power: Array  # dP at the stages by dRe a, dIm a, dN: shape (N, s, 3)
    direct: Array  # dx at the end by the extra columns alone: shape (N, n, E)


def linearize(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array) -> Any:
    """Linearise the collocation equations at a trial orbit.

    Parameters
    ----------
    start : array, shape (m,)
        the state at the beginning, [Re a, Im a, N, x_1 .. x_n].
    Y : array, shape (N, s, m)
        the states at the stages; those of a network's heat between the ends are computed here.
    tau : array, shape (N + 1,)
        the mesh, as fractions of the period.
    T : float, ns
    ring, scheme : Ring, Scheme
    forcing : array, shape (N, s, m, q)
        derivatives of dy/dt by q parameters at the stages.

    Returns
    -------
    M : array, shape (m, m + 2 + q)
        derivative of the last state by the first; then what the residuals, the period and the parameters do to it.
    intervals : Intervals
    size : float
        largest residual, of the stages in units of the states.
    """
    one_pass = full_pass if isinstance(ring.thermal, kinds.QuadraticHeat) else network_pass
    return one_pass(start, Y, tau, T, ring, scheme, forcing)


@compiled
def network_pass(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array) -> Any:
    """`linearize` for a network with an output map."""
    intervals, s, m = Y.shape
    n, extra, modes = m - 3, 2 + forcing.shape[3], scheme.eigenvalue.size
    poles, A, c_back, forth, lam, one = (
        ring.thermal.poles, scheme.A, scheme.back, scheme.forth, scheme.eigenvalue, scheme.one,
    )  # fmt: skip
    wide = 3 + s + extra
    light, warmth = np.empty((intervals, 3 * s, wide)), np.empty((intervals, s, n))
    gain, power, direct = np.empty((intervals, n, s)), np.empty((intervals, s, 3)), np.zeros((intervals, n, extra))
    prop = np.zeros((m, m + extra))
    for i in range(m):
        prop[i, i] = 1.0
    K = np.empty((3 * s, 3 * s + wide))
    f, J, u, P = np.empty((s, 3)), np.empty((s, 3, 3)), np.empty((s, 2)), np.empty(s)
    W, pull, slide = np.empty((s, s)), np.empty((s, s, 2)), np.zeros((s, extra))
    P_hat = np.empty(modes, np.complex128)
    xs, gs, slope_hat = np.empty(modes, np.complex128), np.empty(modes, np.complex128), np.empty(modes, np.complex128)
    from_power, zeta, dP = np.empty((s, wide)), np.empty((s, m + extra)), np.empty((s, m + extra))
    light_out = np.empty((3, m + extra))
    end_of_power = np.empty((s, modes), np.complex128)
    size = 0.0
    for k in range(intervals):
        h = T * (tau[k + 1] - tau[k])
        begin = start if k == 0 else Y[k - 1, s - 1]
        for j in range(s):
            U = Y[k, j, 0] * Y[k, j, 0] + Y[k, j, 1] * Y[k, j, 1]
            P[j] = equations.absorbed_power(U, Y[k, j, 2], ring.rates)
        # heat: the stages of every pole, and what they answer to their beginning and to the power
        for q in range(modes):
            P_hat[q], xs[q], gs[q], slope_hat[q] = 0.0, 0.0, 0.0, 0.0
            for j in range(s):
                P_hat[q] += forth[q, j] * P[j]
                end_of_power[j, q] = 0.0
        for i in range(n):
            g, r, x = poles[0, i], poles[1, i], begin[3 + i]
            for j in range(s):
                warmth[k, j, i], gain[k, i, j] = 0.0, 0.0
                if j < s - 1:
                    Y[k, j, 3 + i] = 0.0
            end, change = 0.0, 0.0
            for q in range(modes):
                by = 1.0 / (1.0 + h * r * lam[q])
                X = by * (one[q] * x + h * g * lam[q] * P_hat[q])
                drift = by * lam[q] * (g * P_hat[q] - r * X)
                xs[q] += by * x
                gs[q] += by * g
                slope_hat[q] += drift
                weight = h * g * lam[q] * by * c_back[s - 1, q]
                for j in range(s):
                    warmth[k, j, i] += (c_back[j, q] * one[q] * by).real
                    gain[k, i, j] += (weight * forth[q, j]).real
                    if j < s - 1:
                        Y[k, j, 3 + i] += (c_back[j, q] * X).real
                end += (c_back[s - 1, q] * X).real
                change += (c_back[s - 1, q] * drift).real
            direct[k, i, 0] = end - Y[k, s - 1, 3 + i]
            direct[k, i, 1] = h / T * change
            size = max(size, abs(direct[k, i, 0]))
        for j in range(s):
            for p in range(s):
                W[j, p] = 0.0
                for q in range(modes):
                    W[j, p] += h * (c_back[j, q] * lam[q] * gs[q] * forth[q, p]).real
        for j in range(s):
            for e in range(extra):
                slide[j, e] = 0.0
            for q in range(modes):
                slide[j, 1] += h / T * (c_back[j, q] * slope_hat[q]).real
        for e in range(2, extra):  # (1 + h rate A)^-1 A h F of every pole
            for i in range(n):
                r = poles[1, i]
                for q in range(modes):
                    F_hat = 0.0 * lam[q]
                    for j in range(s):
                        F_hat += forth[q, j] * forcing[k, j, 3 + i, e - 2]
                    F_hat *= h * lam[q] / (1.0 + h * r * lam[q])
                    for j in range(s):
                        slide[j, e] += (c_back[j, q] * F_hat).real
                    direct[k, i, e] += (c_back[s - 1, q] * F_hat).real
        # light and carriers: the linear system of the stages
        for j in range(s):
            z = 0.0
            for q in range(modes):
                z += (c_back[j, q] * (one[q] * xs[q] + h * lam[q] * gs[q] * P_hat[q])).real
            dT, dT_slope = rise_of(z, ring.thermal)
            ar, ai, N = Y[k, j, 0], Y[k, j, 1], Y[k, j, 2]
            shift, slope = dispersion(N, ring.fcd)
            f[j, 0], f[j, 1], f[j, 2], _ = optics(ar, ai, N, dT, shift, ring.pump, ring.detuning, ring.rates)
            real, imaginary, carriers, heat = optics_jacobian(ar, ai, N, dT, shift, slope, ring.detuning, ring.rates)
            J[j, 0, 0], J[j, 0, 1], J[j, 0, 2] = real[0], real[1], real[2]
            J[j, 1, 0], J[j, 1, 1], J[j, 1, 2] = imaginary[0], imaginary[1], imaginary[2]
            J[j, 2, 0], J[j, 2, 1], J[j, 2, 2] = carriers[0], carriers[1], carriers[2]
            power[k, j, 0], power[k, j, 1], power[k, j, 2] = heat[0], heat[1], heat[2]
            u[j, 0], u[j, 1] = real[3] * dT_slope, imaginary[3] * dT_slope
        for j in range(s):
            for p in range(s):
                pull[j, p, 0], pull[j, p, 1] = 0.0, 0.0
                for i in range(s):
                    pull[j, p, 0] += h * A[j, i] * u[i, 0] * W[i, p]
                    pull[j, p, 1] += h * A[j, i] * u[i, 1] * W[i, p]
        S = K[:, 3 * s :]
        for j in range(s):
            for a in range(3):
                for col in range(wide):
                    S[3 * j + a, col] = 0.0
                row, residual, turn = 3 * j + a, begin[a] - Y[k, j, a], 0.0
                for p in range(s):
                    residual += h * A[j, p] * f[p, a]
                    turn += h / T * A[j, p] * f[p, a]
                    for b in range(3):
                        K[row, 3 * p + b] = -h * A[j, p] * J[p, a, b]
                        if a < 2:
                            K[row, 3 * p + b] -= pull[j, p, a] * power[k, p, b]
                    if a < 2:
                        S[row, 3 + p] = h * A[j, p] * u[p, a]
                    for e in range(2, extra):
                        S[row, 3 + s + e] += h * A[j, p] * forcing[k, p, a, e - 2]
                K[row, row] += 1.0
                S[row, a] = 1.0
                S[row, 3 + s], S[row, 4 + s] = residual, turn
                size = max(size, abs(residual))
                if a < 2:
                    for e in range(1, extra):
                        for p in range(s):
                            S[row, 3 + s + e] += h * A[j, p] * u[p, a] * slide[p, e]
        eliminate(K)
        for row in range(3 * s):
            for col in range(wide):
                light[k, row, col] = S[row, col]
        # the derivative of the return map so far
        for j in range(s):
            for col in range(wide):
                from_power[j, col] = (
                    power[k, j, 0] * S[3 * j, col]
                    + power[k, j, 1] * S[3 * j + 1, col]
                    + power[k, j, 2] * S[3 * j + 2, col]
                )
        for j in range(s):
            for col in range(m + extra):
                zeta[j, col] = 0.0
            for i in range(n):
                w = warmth[k, j, i]
                for col in range(m + extra):
                    zeta[j, col] += w * prop[3 + i, col]
        last = 3 * (s - 1)
        for a in range(3):
            for col in range(m + extra):
                light_out[a, col] = 0.0
            for b in range(3 + s):
                w = S[last + a, b]
                for col in range(m + extra):
                    light_out[a, col] += w * (prop[b, col] if b < 3 else zeta[b - 3, col])
            for e in range(extra):
                light_out[a, m + e] += S[last + a, 3 + s + e]
        for j in range(s):
            for col in range(m + extra):
                dP[j, col] = 0.0
            for b in range(3 + s):
                w = from_power[j, b]
                for col in range(m + extra):
                    dP[j, col] += w * (prop[b, col] if b < 3 else zeta[b - 3, col])
            for e in range(extra):
                dP[j, m + e] += from_power[j, 3 + s + e]
        for i in range(n):
            w = warmth[k, s - 1, i]
            for col in range(m + extra):
                prop[3 + i, col] *= w
            for j in range(s):
                w = gain[k, i, j]
                for col in range(m + extra):
                    prop[3 + i, col] += w * dP[j, col]
            for e in range(extra):
                prop[3 + i, m + e] += direct[k, i, e]
        for a in range(3):
            for col in range(m + extra):
                prop[a, col] = light_out[a, col]
    return prop, Intervals(light, warmth, gain, power, direct), size


@compiled
def full_pass(start: Array, Y: Array, tau: Array, T: float, ring: Ring, scheme: Scheme, forcing: Array) -> Any:
    """`linearize` with all states as unknowns of an interval: for every kind of heat, at a cost like (s m)^3.

    The derivative is nan where heat grows faster than an interval follows (`algebra.follows`).
    """
    intervals, s, m = Y.shape
    extra, A = 2 + forcing.shape[3], scheme.A
    light, none = np.empty((intervals, s * m, m + extra)), np.empty((0, 0, 0))
    prop = np.zeros((m, m + extra))
    for i in range(m):
        prop[i, i] = 1.0
    K, f, J = np.empty((s * m, s * m)), np.empty((s, m)), np.empty((s, m, m))
    heat, one, order, own, size = np.empty((m - 3, m - 3)), np.eye(m - 3), np.empty(m - 3, np.int64), 0.0, 0.0
    for value in scheme.eigenvalue:
        own = value.real if abs(value.imag) < 1e-9 else own  # the real one
    for k in range(intervals):
        h = T * (tau[k + 1] - tau[k])
        begin = start if k == 0 else Y[k - 1, s - 1]
        right = np.zeros((s * m, m + extra))
        for j in range(s):
            f[j] = equations.right_hand_side(Y[k, j], ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
            J[j] = equations.jacobian(Y[k, j], ring.detuning, ring.rates, ring.fcd, ring.thermal)
            heat[:] = one - h * own * J[j, 3:, 3:]
            if not follows(heat, order):
                prop[:] = np.nan  # no step of Newton's method
                return prop, Intervals(light, none, none, none, none), size
        for j in range(s):
            for a in range(m):
                row, residual, turn = m * j + a, begin[a] - Y[k, j, a], 0.0
                for p in range(s):
                    residual += h * A[j, p] * f[p, a]
                    turn += h / T * A[j, p] * f[p, a]
                    for b in range(m):
                        K[row, m * p + b] = -h * A[j, p] * J[p, a, b]
                    for e in range(2, extra):
                        right[row, m + e] += h * A[j, p] * forcing[k, p, a, e - 2]
                K[row, row] += 1.0
                right[row, a] = 1.0
                right[row, m], right[row, m + 1] = residual, turn
                size = max(size, abs(residual))
        solved, last = np.linalg.solve(K, right), m * (s - 1)
        for row in range(s * m):
            for col in range(m + extra):
                light[k, row, col] = solved[row, col]
        following = np.zeros((m, m + extra))
        for a in range(m):
            for b in range(m):
                for col in range(m + extra):
                    following[a, col] += solved[last + a, b] * prop[b, col]
            for col in range(m, m + extra):
                following[a, col] += solved[last + a, col]
        prop = following
    return prop, Intervals(light, none, none, none, none), size


@inner
def substitute(first: Array, extras: Array, intervals: Intervals, Y: Array, change: Array) -> None:
    """Write the change of all stages to ``change``, shape of Y, from that of the beginning and the extra columns.

    ``extras``, shape (2 + q,), multiplies the columns of residuals (1 in a step of Newton's method), period and
    parameters. Heat between the ends of a network's intervals is left out: `linearize` computes it anew.
    """
    number, s, m = Y.shape
    n, dense = m - 3, intervals.warmth.size == 0 and m > 3
    begin = np.empty(m)
    for i in range(m):
        begin[i] = first[i]
    if dense:
        for k in range(number):
            S = intervals.light[k]
            for row in range(s * m):
                total = 0.0
                for b in range(m):
                    total += S[row, b] * begin[b]
                for e in range(extras.size):
                    total += S[row, m + e] * extras[e]
                change[k, row // m, row % m] = total
            for i in range(m):
                begin[i] = change[k, s - 1, i]
        return
    zeta, dP = np.empty(s), np.empty(s)
    for k in range(number):
        S = intervals.light[k]
        for j in range(s):
            zeta[j] = 0.0
            for i in range(n):
                zeta[j] += intervals.warmth[k, j, i] * begin[3 + i]
        for j in range(s):
            for a in range(3):
                row = 3 * j + a
                total = S[row, 0] * begin[0] + S[row, 1] * begin[1] + S[row, 2] * begin[2]
                for p in range(s):
                    total += S[row, 3 + p] * zeta[p]
                for e in range(extras.size):
                    total += S[row, 3 + s + e] * extras[e]
                change[k, j, a] = total
            for i in range(n):
                change[k, j, 3 + i] = 0.0
            w = intervals.power[k, j]
            dP[j] = w[0] * change[k, j, 0] + w[1] * change[k, j, 1] + w[2] * change[k, j, 2]
        for i in range(n):
            total = intervals.warmth[k, s - 1, i] * begin[3 + i]
            for j in range(s):
                total += intervals.gain[k, i, j] * dP[j]
            for e in range(extras.size):
                total += intervals.direct[k, i, e] * extras[e]
            change[k, s - 1, 3 + i] = total
        for i in range(m):
            begin[i] = change[k, s - 1, i]


@overload(linearize, inline="always", strict=False)
def _linearize_of(start, Y, tau, T, ring, scheme, forcing):  # type: ignore[no-untyped-def]
    def network(start, Y, tau, T, ring, scheme, forcing):  # type: ignore[no-untyped-def]
        return network_pass(start, Y, tau, T, ring, scheme, forcing)

    def full(start, Y, tau, T, ring, scheme, forcing):  # type: ignore[no-untyped-def]
        return full_pass(start, Y, tau, T, ring, scheme, forcing)

    heat = ring.types[ring.fields.index("thermal")]
    return kinds.chosen(heat, network, full)


for module in (algebra, equations, kinds):
    forget_if_older(network_pass, str(module.__file__))
