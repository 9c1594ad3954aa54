"""Light, carriers and heat as compiled functions, and the only place where SI becomes internal units.

Internal units: ns, fJ, uW, K and 1e23 carriers per m^3 (1 uW is 1 fJ/ns), in which every state is of order one.
State: y = [Re a, Im a, N, x_1 .. x_n], with U = |a|^2 and dT = sum_i x_i.

    da/dt   = (i D - gamma) a + i drive
    dN/dt   = -N/tau(N) + g U^2
    dx_i/dt = gain_i P_abs - rate_i x_i
    D       = -thermal_shift dT - S(N) - detuning,        S(N) = sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2)
    gamma   = loss + fca N + tpa U
    P_abs   = 2 (absorbed + fca N + tpa U) U,             tau(N) = tau0 (1 + a N)/(1 + b N)

The heat of the coupling loss leaves through the buses, so ``absorbed`` is gamma_i alone. S(N) stands for N^p, whose
slope at N = 0 is infinite for p < 1. Heat meets light only through dT and P_abs: the Jacobian is a 3 x 3 block, a
diagonal, and two blocks of rank one.

Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5, with 2 gamma_e in drive and drop.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from thermofem.model import Foster

    from .resonator import RingResonator

Array = NDArray[np.float64]

NS, FJ, UW, DENSITY = 1e-9, 1e-15, 1e-6, 1e23  # the internal units in s, J, W, 1/m^3
EPSILON = 1e15 / DENSITY  # eps of S(N); 1e15 per m^3 is six orders below the densities that matter


class Rates(NamedTuple):
    """The ring in internal units, as the compiled functions take it; the names are those of the module's equations."""

    loss: float  # 1/ns
    absorbed: float  # 1/ns
    fca: float  # 1/ns per 1e23/m^3
    tpa: float  # 1/(ns fJ)
    generation: float  # 1e23/m^3 per ns and fJ^2, g
    tau0: float  # ns
    a: float  # m^3/1e23
    b: float  # m^3/1e23
    thermal_shift: float  # rad/ns/K
    coupling: float  # 1/ns, 2 gamma_e
    fcd: Array  # rad/ns, coefficients c_k
    exponents: Array  # p_k


class Poles(NamedTuple):
    """A Foster network in internal units."""

    gain: Array  # K/fJ
    rate: Array  # 1/ns


def internal_rates(ring: RingResonator) -> Rates:
    """Return the ring in internal units."""
    coefficients, exponents = (np.array(column, dtype=float) for column in zip(*ring.fcd, strict=True))
    return Rates(
        loss=ring.linear_rate * NS,
        absorbed=ring.loss_rate * NS,
        fca=ring.eta_fca * DENSITY * NS,
        tpa=ring.eta_tpa * FJ * NS,
        generation=ring.g_tpa * FJ**2 * NS / DENSITY,
        tau0=ring.carriers.tau0 / NS,
        a=ring.carriers.a * DENSITY,
        b=ring.carriers.b * DENSITY,
        thermal_shift=ring.thermal_shift * NS,
        coupling=2 * ring.bus_rate * NS,
        fcd=ring.index_rate * NS * coefficients * DENSITY**exponents,
        exponents=exponents,
    )


def internal_poles(model: Foster) -> Poles:
    """Return the Foster network in internal units."""
    R, tau = np.asarray(model.R, dtype=float), np.asarray(model.tau, dtype=float)
    return Poles(gain=R * UW / (tau / NS), rate=NS / tau)


def internal_drive(ring: RingResonator, power: float) -> float:
    """Return sqrt(2 gamma_e P) in sqrt(fJ)/ns for a bus power in W."""
    return math.sqrt(2 * ring.bus_rate * NS * power / UW)


def internal_detuning(detuning: float) -> float:
    """Return 2 pi (laser - cold resonance) in rad/ns for a detuning in Hz."""
    return 2 * math.pi * detuning * NS


@njit(cache=True, nogil=True, error_model="numpy")
def dispersion(N: float, rates: Rates) -> tuple[float, float]:
    """Return S(N) in rad/ns and dS/dN."""
    shift, slope = 0.0, 0.0
    for k in range(rates.fcd.size):
        c, p = rates.fcd[k], rates.exponents[k]
        if p == 1.0:
            shift += c * N
            slope += c
        else:
            square = N * N + EPSILON * EPSILON
            factor = c * square ** (0.5 * (p - 1.0))
            shift += factor * N
            slope += factor * (1.0 + (p - 1.0) * N * N / square)
    return shift, slope


@njit(cache=True, nogil=True, error_model="numpy")
def absorbed_power(U: float, N: float, rates: Rates) -> float:
    """Return P_abs in uW."""
    return 2.0 * (rates.absorbed + rates.fca * N + rates.tpa * U) * U


@njit(cache=True, nogil=True, error_model="numpy")
def optics(
    ar: float, ai: float, N: float, dT: float, drive: float, detuning: float, rates: Rates
) -> tuple[float, float, float, float]:
    """Return d(Re a)/dt, d(Im a)/dt, dN/dt and P_abs."""
    U = ar * ar + ai * ai
    shift = dispersion(N, rates)[0]
    D = -rates.thermal_shift * dT - shift - detuning
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    recombination = N * (1.0 + rates.b * N) / (rates.tau0 * (1.0 + rates.a * N))
    return (
        -gamma * ar - D * ai,
        -gamma * ai + D * ar + drive,
        rates.generation * U * U - recombination,
        absorbed_power(U, N, rates),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def optics_jacobian(ar: float, ai: float, N: float, dT: float, detuning: float, rates: Rates, J: Array) -> None:
    """Fill J, shape (4, 4): the derivatives of what `optics` returns by (Re a, Im a, N, dT)."""
    U = ar * ar + ai * ai
    shift, slope = dispersion(N, rates)
    D = -rates.thermal_shift * dT - shift - detuning
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    saturation = 1.0 + rates.a * N
    J[0, 0] = -gamma - 2.0 * rates.tpa * ar * ar
    J[0, 1] = -D - 2.0 * rates.tpa * ar * ai
    J[0, 2] = -rates.fca * ar + slope * ai
    J[0, 3] = rates.thermal_shift * ai
    J[1, 0] = D - 2.0 * rates.tpa * ar * ai
    J[1, 1] = -gamma - 2.0 * rates.tpa * ai * ai
    J[1, 2] = -rates.fca * ai - slope * ar
    J[1, 3] = -rates.thermal_shift * ar
    J[2, 0] = 4.0 * rates.generation * U * ar
    J[2, 1] = 4.0 * rates.generation * U * ai
    J[2, 2] = -(1.0 + rates.b * N * (2.0 + rates.a * N)) / (rates.tau0 * saturation * saturation)
    J[2, 3] = 0.0
    by_U = 2.0 * (rates.absorbed + rates.fca * N + 2.0 * rates.tpa * U)
    J[3, 0] = 2.0 * by_U * ar
    J[3, 1] = 2.0 * by_U * ai
    J[3, 2] = 2.0 * rates.fca * U
    J[3, 3] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def right_hand_side(y: Array, drive: float, detuning: float, rates: Rates, poles: Poles, out: Array) -> None:
    """Fill ``out`` with dy/dt, both of shape (3 + n,)."""
    out[0], out[1], out[2], heat = optics(y[0], y[1], y[2], y[3:].sum(), drive, detuning, rates)
    for i in range(poles.rate.size):
        out[3 + i] = poles.gain[i] * heat - poles.rate[i] * y[3 + i]


@njit(cache=True, nogil=True, error_model="numpy")
def jacobian(y: Array, detuning: float, rates: Rates, poles: Poles, out: Array) -> None:
    """Fill ``out``, shape (3 + n, 3 + n), with d(dy/dt)/dy: the blocks of `optics_jacobian` spread over the poles."""
    block = np.empty((4, 4))
    optics_jacobian(y[0], y[1], y[2], y[3:].sum(), detuning, rates, block)
    out[:] = 0.0
    out[:3, :3] = block[:3, :3]
    for i in range(poles.rate.size):
        out[:3, 3 + i] = block[:3, 3]
        out[3 + i, :3] = poles.gain[i] * block[3, :3]
        out[3 + i, 3 + i] = -poles.rate[i]
