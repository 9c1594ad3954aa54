"""Fixed points of a ring and its thermal model as explicit functions of the energy U and the detuned D, on arrays.

    k = tau0 g U^2:       b N^2 + (1 - a k) N - k = 0,        dT = dT(P_abs(U, N)),     gamma = gamma(U, N)
    shift(U) = -thermal_shift dT - S(N) - kerr U             the resonance's own shift, with D = shift - detuning
    pump^2  = U (gamma^2 + D^2)

At one power the fixed points lie on one smooth curve, the tilted resonance, with the parameter t:

    U = top/cosh^2 t,     top gamma(top)^2 = pump^2,     D = +- sqrt(pump^2/U - gamma^2) with the sign of t

and detuning(t) = shift(U) - D goes from +infinity to -infinity; it varies on the scale of 1 in t at any power. Between
its extrema (the folds at that power) it is monotone: each interval has at most one root, so no fixed point is missed.

Thermal model: steady state and linear response about it,

    poles:      dx_i/dt = gain_i P - rate_i x_i,             dT = z + curvature z^2,  z = sum_i x_i
    quadratic:  dx/dt   = A x + H[x, x] + (G x + B) P,       dT = C x;      steady state x = P f(P)

f are Chebyshev series through the steady states of the model, over the powers that the ring can absorb. Internal units:
ns, fJ, uW, K and 1e23 carriers per m^3.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from thermofem import InputError
from thermofem.arrays import Array, ArrayLike, Complex, Indices
from thermofem.models import ThermalModel

from ..kernel.integrator import Problem
from ..kernel.problem_parts import PoleHeat, QuadraticHeat
from ..kernel.rates import absorbed_power, absorbed_slopes, dispersion, field_loss, steady_carriers
from ..kernel.tableaus import Method
from ..kernel.units import UW, Rates, internal_heat, internal_rates, single_ring
from ..resonator import RingResonator
from ..thermal import Compact, compact
from .zeros import Brackets, newton, zeros

TERMS = (16, 32, 64, 128, 256)


class Heat(NamedTuple):
    """Steady state and linear response of a thermal model with n states.

    of: a Foster network, or one before an output map, or a quadratic model.
    f [K/uW, shape (terms, n)]: Chebyshev coefficients over [0, top] of x/P, one term for a network; total: of their sum
    over the states, as the output weights them.
    """

    of: PoleHeat | QuadraticHeat
    curvature: float  # 1/K, of an output map
    f: Array
    total: Array
    top: float  # uW, the largest power of the series

    def rise(self, P: Array) -> tuple[Array, Array]:
        """Steady rise (K) under the absorbed power P (uW), and d(dT)/dP; extrapolated linearly above ``top``."""
        z, slope = self._at_rest(P, self.total)
        rise = z * (1 + self.curvature * z)
        read_out = 1 + 2 * self.curvature * z
        return rise, slope * read_out

    def states(self, P: Array) -> Array:
        """Steady states x under the absorbed power P (uW), on the branch from x = 0; shape (..., n)."""
        return self._at_rest(np.asarray(P)[..., None], self.f)[0]

    def _at_rest(self, P: Array, f: Array) -> tuple[Array, Array]:
        """P f(P) and its derivative for a series f, or several as columns."""
        if len(f) == 1:
            return P * f[0], f[0]
        inside = np.minimum(P, self.top)
        x = 2 * inside / self.top - 1
        share = chebyshev.chebval(x, f, tensor=False)
        derivative = chebyshev.chebder(f)
        share_slope = chebyshev.chebval(x, derivative, tensor=False)
        slope = share + inside * share_slope * 2 / self.top
        beyond = P - inside
        return inside * share + beyond * slope, slope

    def impedance(self, lam: Complex, P: Array) -> Complex:
        """d(dT)/dP (K/uW) at the complex rate lam (1/ns), about the steady state at P (uW); lam, P of one shape."""
        if isinstance(self.of, PoleHeat):
            gains = self.of.gain[0]
            rates = self.of.rate[0]
            poles = zip(gains, rates, strict=True)
            response = sum(gain / (lam + rate) for gain, rate in poles)
            read_out = 1 + 2 * self.curvature * self.total * P
            return response * read_out
        heat = self.of
        powers, which = np.unique(P, return_inverse=True)
        which = which.reshape(np.shape(P))
        x = self.states(powers)
        by_power = (heat.B + x @ heat.G.T).astype(complex)
        of_squares = 2 * np.einsum("ijk,mk->mij", heat.H, x)
        of_power = powers[:, None, None] * heat.G
        rates, modes = np.linalg.eig(heat.A + of_squares + of_power)
        inputs = np.linalg.solve(modes, by_power[..., None])[..., 0]
        gains = (heat.C @ modes) * inputs
        total = np.zeros(np.shape(P), dtype=complex)
        for k in range(heat.C.size):
            total += gains[which, k] / (lam - rates[which, k])
        return total


def heat_of(model: Compact, largest: float) -> Heat:
    """Return the steady state and linear response of a compact model in internal units.

    largest [W]: absorbed power up to which the steady states of a quadratic model are needed.
    Raises InputError: a quadratic model without a steady state at some power up to ``largest``, or too close to a fold.
    """
    heat, curvature = internal_heat(model)
    if isinstance(heat, PoleHeat):
        f = heat.gain / heat.rate
        return Heat(heat, curvature, f, f.sum(axis=1), np.inf)
    f = _series(model, largest) * UW
    return Heat(heat, curvature, f, f @ heat.C, largest / UW)


def _series(model: Any, largest: float) -> Array:
    """Chebyshev coefficients of f(P) = x/P (K/W) over P in [0, largest] W, x the steady states; shape (terms, n)."""
    for terms in TERMS:
        x = chebyshev.chebpts1(terms)
        powers = (1 + x) / 2 * largest
        states = np.array([model.steady_state(power) for power in powers])  # no warning: none need be reached
        f = np.asarray(chebyshev.chebfit(x, states / powers[:, None], terms - 1), dtype=float)
        # the last terms are below 1e-12 of f, the error of the steady states themselves
        if np.abs(f[-3:]).max() < 1e-12 * np.abs(f).max():
            return f
    raise InputError(
        f"model is quadratic and near the end of its steady states at {largest:g} W of heat; lower the power"
    )


SPACING = 0.02  # of t, in the search for turning points; pairs of them closer than this are found by their slope
PUMPS = 1000  # surveyed at one go: 1000 x 500 points of t are 4 MB an array


class InternalRing(NamedTuple):
    """A ring and its thermal model in internal units (ns, fJ, uW, K, 1e23/m^3).

    model: the thermal model in SI.
    fcd [shape (terms, 2)]: rows (c_k, p_k) of the free-carrier dispersion S(N), see `dispersion`.
    heat: steady states and linear response of the thermal model.
    problem: the equations of ring and thermal model for the C++ kernel.
    """

    model: Compact
    rates: Rates
    fcd: Array
    heat: Heat
    problem: Problem


class Balance(NamedTuple):
    """Quantities at fixed points of energy U, of its shape, that do not depend on the laser; ``*_slope`` are d/dU."""

    N: Array
    P_abs: Array
    dT: Array
    shift: Array
    shift_slope: Array
    gamma: Array
    gamma_slope: Array


def internal_ring(ring: RingResonator, model: ThermalModel, largest: float) -> InternalRing:
    """Convert ring and thermal model to internal units; ``largest`` [W] bounds the absorbed power of steady states."""
    small = compact(model)
    problem = single_ring(ring, small, 1e-3, 0.0, 1.0, Method.RODAS4)
    return InternalRing(small, *internal_rates(ring), heat_of(small, largest), problem)


def absorbable(ring: RingResonator, power: float) -> float:
    """Upper bound in W of the power that a ring absorbs at a bus power in W.

    With own = P_abs/2U and other = gamma_e + gamma_d + gamma_s, the loss rates by absorption and by all else,
    P_abs = 2 own U <= 4 gamma_e own P/(own + other)^2 <= gamma_e P/other.
    """
    return power * ring.bus_rate / (ring.linear_rate - ring.loss_rate)


def carriers(U: ArrayLike, rates: Rates) -> tuple[Array, Array]:
    """Return the steady density N at the energy U, and dN/dU."""
    U = np.asarray(U)
    N, per_made = steady_carriers(rates.g * U * U, rates)
    return N, per_made * (2 * rates.g * U)


def balance(U: ArrayLike, ring: InternalRing) -> Balance:
    """Return carriers, heat, loss and resonance shift at fixed points of energy ``U``, any shape, internal units."""
    U = np.asarray(U, dtype=float)
    rates = ring.rates
    N, N_slope = carriers(U, rates)
    P_abs = absorbed_power(U, N, rates)
    P_by_U, P_by_N = absorbed_slopes(U, N, rates)
    dT, by_P = ring.heat.rise(P_abs)
    dT_slope = by_P * (P_by_U + P_by_N * N_slope)
    S, S_slope = dispersion(N, ring.fcd)
    shift = -rates.thermal_shift * dT - S - rates.kerr * U
    shift_slope = -rates.thermal_shift * dT_slope - S_slope * N_slope - rates.kerr
    gamma, gamma_slope = loss_and_slope(U, N, N_slope, rates)
    return Balance(N, P_abs, dT, shift, shift_slope, gamma, gamma_slope)


def loss_and_slope(U: Array, N: Array, N_slope: Array, rates: Rates) -> tuple[Array, Array]:
    """Return gamma(U, N(U)) and d(gamma)/dU."""
    return field_loss(U, N, rates), rates.fca * N_slope + rates.tpa


def peak(pump: ArrayLike, ring: InternalRing) -> Array:
    """Return the energy on resonance (fJ), the root U of U gamma(U)^2 = pump^2, by Newton's method in log U."""
    rates = ring.rates
    target = 2 * np.log(np.asarray(pump))

    def equation(x: Array) -> tuple[Array, Array]:
        U = np.exp(x)
        N, N_slope = carriers(U, rates)
        gamma, gamma_slope = loss_and_slope(U, N, N_slope, rates)
        above_pump = x + 2 * np.log(gamma) - target
        slope = 1 + 2 * U * gamma_slope / gamma
        return above_pump, slope

    high = target - 2 * np.log(rates.loss)
    above, _ = equation(high)
    low = high - above
    below, _ = equation(low)
    return np.exp(newton(equation, low, high, below, above))


def tilted(t: Array, pump: float | Array, top: float | Array, ring: InternalRing) -> tuple[Array, Array, Array, Array]:
    """Return U, D, detuning and d(detuning)/dt of the tilted resonance at ``t``, elementwise with ``pump``.

    top: the energy on resonance, `peak` of the pump.
    """
    share = np.tanh(t)
    U = np.asarray(top / np.cosh(t) ** 2)
    at = balance(U, ring)
    square = pump**2 / U
    per_U = 2 * U * at.gamma * at.gamma_slope
    below_peak = share**2
    far = below_peak > 1e-8  # nearer to the peak a difference of gammas is less exact than their slope
    change = pump**2 / top - at.gamma**2
    difference = change / np.where(far, below_peak, 1.0)
    steepness = np.where(far, difference, per_U)
    ratio = np.sqrt(square + steepness)
    by_shift = -2 * U * share * at.shift_slope
    slope = by_shift - (square + per_U) / ratio
    D = share * ratio
    return U, D, at.shift - D, slope


def farthest(detuning: float, top: float, ring: InternalRing) -> float:
    """Return a bound of |t|, above which the detuning of the tilted resonance exceeds ``detuning`` (rad/ns) in size."""
    rates = ring.rates
    at = balance(top, ring)
    S, _ = dispersion(at.N, ring.fcd)
    largest = abs(rates.thermal_shift * at.dT) + abs(S) + abs(rates.kerr * top)
    widths = (abs(detuning) + largest) / rates.loss
    return float(np.arcsinh(widths + 1))


def fixed_points(pump: ArrayLike, detuning: ArrayLike, ring: InternalRing) -> tuple[Array, Array, Indices]:
    """Return every fixed point at m laser settings: U and D, and the index of the setting, three arrays of one shape.

    pump, detuning [shape (m,)]: in sqrt(fJ)/ns and rad/ns.
    Sorted by setting, then by energy.
    """
    pump, detuning = np.broadcast_arrays(np.atleast_1d(pump), np.atleast_1d(detuning))
    pumps, which = np.unique(pump, return_inverse=True)
    roots = []
    for k in range(0, pumps.size, PUMPS):
        block = pumps[k : k + PUMPS]
        part = np.flatnonzero(which // PUMPS == k // PUMPS)
        U, D, cell = _on_pieces(block, which[part] - k, detuning[part], ring)
        roots.append((U, D, part[cell]))
    columns = zip(*roots, strict=True)
    U, D, cell = map(np.concatenate, columns)
    order = np.lexsort([U, cell])
    return U[order], D[order], cell[order]


def _on_pieces(pumps: Array, which: Indices, detuning: Array, ring: InternalRing) -> tuple[Array, Array, Indices]:
    """Fixed points U, D and index of the setting (pumps[which], detuning), by a root on each monotone piece."""
    tops = peak(pumps, ring)
    *ends, setting = _brackets(pumps, tops, which, detuning, ring)
    pump = pumps[which[setting]]
    top = tops[which[setting]]
    target = detuning[setting]

    def equation(t: Array) -> tuple[Array, Array]:
        _, _, of_resonance, slope = tilted(t, pump, top, ring)
        return of_resonance - target, slope

    U, *_ = tilted(newton(equation, *ends), pump, top, ring)
    return U, balance(U, ring).shift - target, setting


def _brackets(pumps: Array, tops: Array, which: Indices, detuning: Array, ring: InternalRing) -> Brackets:
    """Every monotone piece of a tilted resonance, in t, on which a detuning of its settings lies."""
    largest = float(np.abs(detuning).max())
    end = farthest(largest, tops[-1], ring)
    intervals = int(np.ceil(2 * end / SPACING))
    grid = np.linspace(-end, end, intervals + 1)
    _, _, on_grid, slopes = tilted(grid, pumps[:, None], tops[:, None], ring)

    def slope(t: Array, k: Indices) -> Array:
        return tilted(t, pumps[k], tops[k], ring)[3]

    turning, pump_of = zeros(slope, grid, pumps.size, slopes)
    _, _, at_turning, _ = tilted(turning, pumps[pump_of], tops[pump_of], ring)
    parts = []
    for k in range(pumps.size):
        settings = np.flatnonzero(which == k)
        on_this = pump_of == k
        ends = np.concatenate([grid, turning[on_this]])
        t, order = np.unique(ends, return_index=True)
        at_ends = np.concatenate([on_grid[k], at_turning[on_this]])
        of_resonance = at_ends[order]
        off = of_resonance - detuning[settings, None]
        above = off > 0
        row, piece = np.nonzero(above[:, 1:] != above[:, :-1])
        parts.append((t[piece], t[piece + 1], off[row, piece], off[row, piece + 1], settings[row]))
    return Brackets.joined(parts)
