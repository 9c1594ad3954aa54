"""Right-hand side and Jacobian of a circuit, compiled; state and equations as in `kernel`."""

from __future__ import annotations

import numpy as np

from ..kernels import control, equations, kinds, spectrum
from ..kernels.compiling import compiled, forget_if_older, inlined, inlined_lean
from ..kernels.control import fastest_growth
from ..kernels.equations import Array, Rates, absorbed_power, dispersion, optics, optics_jacobian
from ..kernels.kinds import Poles
from . import layout, waves
from .layout import Complex, Heat, LightNetwork, Rings, rates_of
from .waves import inputs_of

LARGEST_SPECTRUM = 90  # rows of the Jacobian of the whole circuit whose eigenvalues are computed


@inlined_lean
def neighbours(y: Array, heat: Heat, out: Array) -> None:
    """Write what the other rings add to the temperature of each, in K."""
    n, cross = heat.gain.shape[0], heat.cross
    for i in range(n):
        total = 0.0
        for k in range(cross.shape[1]):
            total += cross[i, k] * y[3 * n + k]
        out[i] = total


@inlined
def _at(y: Array, rings: Rings, heat: Heat, i: int) -> tuple[Rates, float, float, float, float]:
    """Return the rates of ring ``i``, S(N) and dS/dN, and the rise by its own heat and its slope by the states' sum."""
    n, K = heat.gain.shape
    z = 0.0
    for k in range(K):
        z += heat.read[i, i, k] * y[3 * n + i * K + k]
    shift, slope = dispersion(y[3 * i + 2], rings.fcd[i])
    return rates_of(rings, i), shift, slope, z + heat.curvature * z * z, 1.0 + 2.0 * heat.curvature * z


@compiled
def right_hand_side(
    y: Array, laser: Complex, delayed: Complex, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork
) -> Array:
    """Return dy/dt in internal units, shape (3 N + N K,), at the waves of lasers and delayed waveguides."""
    n, K = heat.gain.shape
    out, other, b = np.empty_like(y), np.empty(n), np.empty(n, np.complex128)
    neighbours(y, heat, other)
    inputs_of(net, laser, delayed, b)
    for i in range(n):
        rates, shift, _, dT, _ = _at(y, rings, heat, i)
        turned = detuning[i] + rates.thermal_shift * other[i]
        f0, f1, f2, power = optics(y[3 * i], y[3 * i + 1], y[3 * i + 2], dT, shift, 0.0, turned, rates)
        light = 1j * b[i] + net.own[i] * complex(y[3 * i], y[3 * i + 1])
        for j in range(n):
            light += complex(net.real[j, i], net.imaginary[j, i]) * complex(y[3 * j], y[3 * j + 1])
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = f0 + light.real, f1 + light.imag, f2
        for k in range(K):
            at = 3 * n + i * K + k
            out[at] = heat.gain[i, k] * power - heat.rate[i, k] * y[at]
    return out


@compiled
def jacobian(y: Array, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork) -> Array:
    """Return d(dy/dt)/dy of the circuit, with the light of delayed waveguides held."""
    n, K = heat.gain.shape
    out, other = np.zeros((y.size, y.size)), np.empty(n)
    neighbours(y, heat, other)
    for i in range(n):
        rates, shift, slope, dT, bend = _at(y, rings, heat, i)
        turned = detuning[i] + rates.thermal_shift * other[i]
        J = optics_jacobian(y[3 * i], y[3 * i + 1], y[3 * i + 2], dT, shift, slope, turned, rates)
        for p in range(3):
            for q in range(3):
                out[3 * i + p, 3 * i + q] = J[p][q]
            for j in range(n):
                for k in range(K):
                    factor = bend if j == i else 1.0
                    out[3 * i + p, 3 * n + j * K + k] = J[p][3] * factor * heat.read[i, j, k]
        for j in range(n):
            m = net.own[i] if j == i else complex(net.real[j, i], net.imaginary[j, i])
            out[3 * i, 3 * j] += m.real
            out[3 * i, 3 * j + 1] -= m.imag
            out[3 * i + 1, 3 * j] += m.imag
            out[3 * i + 1, 3 * j + 1] += m.real
        for k in range(K):
            at = 3 * n + i * K + k
            out[at, at] = -heat.rate[i, k]
            for q in range(3):
                out[at, 3 * i + q] = heat.gain[i, k] * J[3][q]
    return out


@compiled
def growing(y: Array, detuning: Array, rings: Rings, heat: Heat, net: LightNetwork) -> float:
    """Return the modulus of the fastest mode that grows, in 1/ns, or 0 where all decay.

    A small circuit is treated as a whole. In a large one each ring is treated alone with its own heat.
    """
    n, K = heat.gain.shape
    if y.size <= LARGEST_SPECTRUM:
        return fastest_growth(jacobian(y, detuning, rings, heat, net))
    fastest, other = 0.0, np.empty(n)
    neighbours(y, heat, other)
    state, poles = np.empty(3 + K), np.empty((2, K))
    for i in range(n):
        for p in range(3):
            state[p] = y[3 * i + p]
        for k in range(K):
            own = heat.read[i, i, k]
            poles[0, k], poles[1, k] = own * heat.gain[i, k], heat.rate[i, k]
            state[3 + k] = own * y[3 * n + i * K + k]
        alone = Poles(poles, heat.curvature)
        turned = detuning[i] + rings.rates[i, 8] * other[i]
        fastest = max(
            fastest, fastest_growth(equations.jacobian(state, turned, rates_of(rings, i), rings.fcd[i], alone))
        )
    return fastest


@compiled
def heating(rows: Array, rings: Rings, i: int) -> Array:
    """Return the absorbed power in uW of ring ``i`` from its rows Re a, Im a, N."""
    rates, out = rates_of(rings, i), np.empty(rows.shape[0])
    for m in range(rows.shape[0]):
        out[m] = absorbed_power(rows[m, 0] * rows[m, 0] + rows[m, 1] * rows[m, 1], rows[m, 2], rates)
    return out


for module in (equations, control, kinds, layout, spectrum, waves):
    forget_if_older(heating, str(module.__file__))
