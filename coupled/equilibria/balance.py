"""Fixed points of ring and heat as compiled functions: all follows from the energy U and the detuned D in closed form.

    k = tau0 g U^2:       b N^2 + (1 - a k) N - k = 0,        dT = dT(P_abs(U, N)),     gamma = gamma(U, N)
    shift(U) = -thermal_shift dT - S(N) - kerr U             the resonance's own shift, with D = shift - detuning
    pump^2  = U (gamma^2 + D^2)

At one power the fixed points lie on one smooth curve, the tilted resonance, with the parameter s:

    D = gamma sinh s,     U gamma(U)^2 = pump^2 / cosh^2 s,      detuning(s) = shift(U) - gamma sinh s

The left side of the second rises with U, so every s has one U; detuning(s) runs from +infinity to -infinity and bends
on the scale of 1 in s at any power. Cut at its turning points (the folds of that power), every piece holds a detuning
at most once: no fixed point is missed.

Internal units as in `equations`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..kernels import equations, kinds
from ..kernels.compiling import compiled, forget_if_older, inlined, inner
from ..kernels.equations import Array, Rates, absorbed_power, dispersion
from ..kernels.kinds import rise

SPACING = 0.02  # of s, in the search for turning points; pairs of them closer than this are found by their slope
CLOSE = 4e-16  # relative width at which a bracket has no floating-point number left inside


class Balance(NamedTuple):
    """Everything at a fixed point of energy U that does not depend on the laser; primes are d/dU."""

    N: float
    N_slope: float
    dT: float
    shift: float
    shift_slope: float
    gamma: float
    gamma_slope: float


@inlined
def balance(U: float, rates: Rates, fcd: Array, heat: Any) -> Balance:
    """Return the fixed point of energy ``U``."""
    k = rates.tau0 * rates.g * U * U
    p = 1.0 - rates.a * k
    root = math.sqrt(p * p + 4.0 * rates.b * k)
    N = 2.0 * k / (p + root) if p > 0.0 else (root - p) / (2.0 * rates.b)  # neither form subtracts
    N_slope = 2.0 * rates.tau0 * rates.g * U * (1.0 + rates.a * N) / root
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    gamma_slope = rates.fca * N_slope + rates.tpa
    dT, by_heat = rise(absorbed_power(U, N, rates), heat)
    dT_slope = by_heat * 2.0 * (rates.absorbed + rates.fca * (N + N_slope * U) + 2.0 * rates.tpa * U)
    S, S_slope = dispersion(N, fcd)
    shift = -rates.thermal_shift * dT - S - rates.kerr * U
    shift_slope = -rates.thermal_shift * dT_slope - S_slope * N_slope - rates.kerr
    return Balance(N, N_slope, dT, shift, shift_slope, gamma, gamma_slope)


@compiled
def balances(U: Array, rates: Rates, fcd: Array, heat: Any) -> Array:
    """Return the fields of `Balance` as rows, shape (7, n), for the energies ``U``, shape (n,)."""
    out = np.empty((7, U.size))
    for j in range(U.size):
        out[:, j] = balance(U[j], rates, fcd, heat)
    return out


@compiled
def energy(s: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> float:
    """Return U with U gamma(U)^2 = pump^2/cosh^2 s: Newton in log U, kept within a bracket."""
    target = 2.0 * (math.log(pump) - math.log(math.cosh(s)))
    high = target - 2.0 * math.log(rates.loss)  # gamma >= loss
    gamma = balance(math.exp(high), rates, fcd, heat).gamma
    low = target - 2.0 * math.log(gamma)
    x = high
    for _ in range(200):
        at = balance(math.exp(x), rates, fcd, heat)
        f = x + 2.0 * math.log(at.gamma) - target
        if f >= 0.0:
            high = x
        if f <= 0.0:
            low = x
        before = x
        x -= f / (1.0 + 2.0 * math.exp(x) * at.gamma_slope / at.gamma)
        if not low <= x <= high:
            x = 0.5 * (low + high)
        if abs(x - before) < 1e-15 * (1.0 + abs(x)):
            break
    return math.exp(x)


@compiled
def tilted(s: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> tuple[float, float, float, float]:
    """Return U, D, detuning and d(detuning)/ds of the tilted resonance at ``s``."""
    U = energy(s, pump, rates, fcd, heat)
    at = balance(U, rates, fcd, heat)
    D = at.gamma * math.sinh(s)
    U_slope = -2.0 * U * math.tanh(s) / (1.0 + 2.0 * U * at.gamma_slope / at.gamma)
    slope = (at.shift_slope - at.gamma_slope * math.sinh(s)) * U_slope - at.gamma * math.cosh(s)
    return U, D, at.shift - D, slope


@compiled
def reach(detuning: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> float:
    """Return an s beyond which, on either side, the tilted resonance is farther off than ``detuning`` (rad/ns)."""
    U = energy(0.0, pump, rates, fcd, heat)
    top = balance(U, rates, fcd, heat)
    largest = abs(rates.thermal_shift * top.dT) + abs(dispersion(top.N, fcd)[0]) + abs(rates.kerr * U)
    return math.asinh((abs(detuning) + largest) / rates.loss + 1.0)


@inner
def _slope_zero(left: float, right: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> float:
    """Return the s between two of opposite slope where the slope vanishes, by bisection."""
    sign = tilted(left, pump, rates, fcd, heat)[3] > 0.0
    while right - left > CLOSE * (1.0 + abs(left)):
        middle = 0.5 * (left + right)
        if middle <= left or middle >= right:
            break
        if (tilted(middle, pump, rates, fcd, heat)[3] > 0.0) == sign:
            left = middle
        else:
            right = middle
    return 0.5 * (left + right)


@inner
def _flattest(left: float, right: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> float:
    """Return the s between ``left`` and ``right`` of the smallest |slope|, by golden section.

    It stops early at an s where the slope has changed its sign.
    """
    golden = 0.6180339887498949
    sign = tilted(left, pump, rates, fcd, heat)[3] > 0.0
    a, b = right - golden * (right - left), left + golden * (right - left)
    fa, fb = tilted(a, pump, rates, fcd, heat)[3], tilted(b, pump, rates, fcd, heat)[3]
    for _ in range(40):
        if (fa > 0.0) != sign:
            return a
        if (fb > 0.0) != sign:
            return b
        if abs(fa) < abs(fb):
            right, b, fb = b, a, fa
            a = right - golden * (right - left)
            fa = tilted(a, pump, rates, fcd, heat)[3]
        else:
            left, a, fa = a, b, fb
            b = left + golden * (right - left)
            fb = tilted(b, pump, rates, fcd, heat)[3]
    return 0.5 * (left + right)


@compiled
def turning_points(s_end: float, pump: float, rates: Rates, fcd: Array, heat: Any) -> Array:
    """Return -s_end, every s between where detuning(s) turns, and s_end, in increasing order."""
    n = math.ceil(2.0 * s_end / SPACING) + 1
    s = np.linspace(-s_end, s_end, n)
    slope = np.empty(n)
    for k in range(n):
        slope[k] = tilted(s[k], pump, rates, fcd, heat)[3]
    out = np.empty(n + 2)
    out[0], count = -s_end, 1
    for k in range(n - 1):
        if (slope[k] > 0.0) != (slope[k + 1] > 0.0):
            out[count] = _slope_zero(s[k], s[k + 1], pump, rates, fcd, heat)
            count += 1
        elif k > 0 and (slope[k - 1] > 0.0) == (slope[k] > 0.0) and abs(slope[k]) < abs(slope[k - 1]) and (
            abs(slope[k]) <= abs(slope[k + 1])
        ):  # fmt: skip
            flat = _flattest(s[k - 1], s[k + 1], pump, rates, fcd, heat)
            if (tilted(flat, pump, rates, fcd, heat)[3] > 0.0) != (slope[k] > 0.0):
                out[count] = _slope_zero(s[k - 1], flat, pump, rates, fcd, heat)
                out[count + 1] = _slope_zero(flat, s[k + 1], pump, rates, fcd, heat)
                count += 2
    out[count] = s_end
    return out[: count + 1]


@inner
def crossing(
    left: float, right: float, detuning: float, pump: float, rates: Rates, fcd: Array, heat: Any
) -> tuple[float, float]:
    """Return U and D where a monotone piece of the tilted resonance meets ``detuning``; Newton kept in the bracket."""
    falling = tilted(left, pump, rates, fcd, heat)[2] > detuning
    s = 0.5 * (left + right)
    U, D = 0.0, 0.0
    for _ in range(200):
        U, D, at, slope = tilted(s, pump, rates, fcd, heat)
        f = at - detuning
        if (f > 0.0) == falling:
            left = s
        else:
            right = s
        before = s
        s = s - f / slope if slope != 0.0 else left
        if not left < s < right:
            s = 0.5 * (left + right)
        if f == 0.0 or abs(s - before) <= CLOSE * (1.0 + abs(s)):
            break
    return U, D


@compiled
def fixed_points(detuning: float, pump: float, rates: Rates, fcd: Array, heat: Any, pieces: Array) -> Array:
    """Return every fixed point as columns (U, D), shape (2, m), in the order of s; ``pieces`` by `turning_points`."""
    out, count = np.empty((2, pieces.size - 1)), 0
    above = tilted(pieces[0], pump, rates, fcd, heat)[2] > detuning
    for k in range(pieces.size - 1):
        after = tilted(pieces[k + 1], pump, rates, fcd, heat)[2] > detuning
        if above != after:
            out[0, count], out[1, count] = crossing(pieces[k], pieces[k + 1], detuning, pump, rates, fcd, heat)
            count += 1
        above = after
    return out[:, :count]


for module in (equations, kinds):
    forget_if_older(fixed_points, str(module.__file__))
