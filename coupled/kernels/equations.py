"""Light, carriers and heat as compiled functions, and the only place where SI becomes internal units.

Internal units: ns, fJ, uW, K and 1e23 carriers per m^3 (1 uW is 1 fJ/ns), in which every state is of order one.
State: y = [Re a, Im a, N, x_1 .. x_n], with U = |a|^2.

    da/dt   = (i D - gamma) a + i pump
    dN/dt   = -N/tau(N) + g U^2
    dx_i/dt = gain_i P_abs - rate_i x_i,                  dT = z + curvature z^2,  z = sum_i x_i       (a network)
    dx/dt   = A x + H[x, x] + (G x + B) P_abs,            dT = C x                                     (quadratic)
    D       = -thermal_shift dT - S(N) - kerr U - detuning,      S(N) = sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2)
    gamma   = loss + fca N + tpa U
    P_abs   = 2 (absorbed + fca N + tpa U) U,             tau(N) = tau0 (1 + a N)/(1 + b N)

The heat of the coupling loss leaves through the buses and that of scattering with the light, so ``absorbed`` is the
absorbing loss alone. S(N) stands for N^p, whose slope at N = 0 is infinite for p < 1. Heat meets light only through dT
and P_abs: the Jacobian of a network is a 3 x 3 block, a diagonal, and two blocks of rank one.

Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5, with 2 gamma_e for both buses.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster, OutputMap

from . import kinds
from .compiling import compiled, forget_if_older, inlined
from .kinds import flow, read, rise_of, spread

if TYPE_CHECKING:
    from ..resonator import RingResonator
    from ..thermal import Compact
    from .kinds import Thermal

Array = NDArray[np.float64]
Row = tuple[float, float, float, float]
Rows = tuple[Row, Row, Row, Row]

NS, FJ, UW, DENSITY = 1e-9, 1e-15, 1e-6, 1e23  # the internal units in s, J, W, 1/m^3
EPSILON = 1e15 / DENSITY  # eps of S(N); 1e15 per m^3 is six orders below the densities that matter


class Rates(NamedTuple):
    """The ring in internal units; the names are those of the module's equations."""

    loss: float  # 1/ns
    absorbed: float  # 1/ns
    fca: float  # 1/ns per 1e23/m^3
    tpa: float  # 1/(ns fJ)
    g: float  # 1e23/m^3 per ns and fJ^2
    tau0: float  # ns
    a: float  # m^3/1e23
    b: float  # m^3/1e23
    thermal_shift: float  # rad/ns/K
    kerr: float  # rad/ns/fJ


def internal_rates(ring: RingResonator) -> tuple[Rates, Array]:
    """Return the ring in internal units and its free-carrier dispersion, rows (c_k in rad/ns, p_k)."""
    rates = Rates(
        loss=ring.linear_rate * NS,
        absorbed=ring.loss_rate * NS,
        fca=ring.eta_fca * DENSITY * NS,
        tpa=ring.eta_tpa * FJ * NS,
        g=ring.g_tpa * FJ**2 * NS / DENSITY,
        tau0=ring.carriers.tau0 / NS,
        a=ring.carriers.a * DENSITY,
        b=ring.carriers.b * DENSITY,
        thermal_shift=ring.thermal_shift * NS,
        kerr=ring.kerr_shift * FJ * NS,
    )
    fcd = np.array(ring.fcd, dtype=float).reshape(-1, 2)
    fcd[:, 0] *= ring.index_rate * NS * DENSITY ** fcd[:, 1]
    return rates, fcd


def internal_thermal(model: Compact) -> Thermal:
    """Return a Foster network, an output map over one, or a quadratic model in internal units."""
    if isinstance(model, OutputMap):
        return kinds.Poles(_poles(model.linear), float(model.coefficient))
    if isinstance(model, Foster):
        return kinds.Poles(_poles(model), 0.0)
    A, H, G, B, C = (np.array(getattr(model, name), dtype=float, order="C") for name in "AHGBC")
    static = np.linalg.solve(A, B)
    weight = np.where(C != 0, np.abs(C), np.abs(C @ static) / np.abs(static).max())
    return kinds.QuadraticHeat(A * NS, H * NS, G * FJ, B * FJ, C, weight)


def _poles(model: Foster) -> Array:
    """Return rows (gain_i in K/fJ, rate_i in 1/ns)."""
    R, tau = np.asarray(model.R, dtype=float), np.asarray(model.tau, dtype=float)
    return np.array([R * UW * NS / tau, NS / tau])


def internal_pump(ring: RingResonator, power: float) -> float:
    """Return the pump amplitude sqrt(2 gamma_e P) in sqrt(fJ)/ns for a bus power in W."""
    return math.sqrt(2 * ring.bus_rate * NS * power / UW)


def internal_detuning(detuning: float) -> float:
    """Return 2 pi (laser - cold resonance) in rad/ns for a detuning in Hz."""
    return 2 * math.pi * detuning * NS


@inlined
def dispersion(N: float, fcd: Array) -> tuple[float, float]:
    """Return S(N) in rad/ns and dS/dN."""
    shift, slope = 0.0, 0.0
    for k in range(fcd.shape[0]):
        c, p = fcd[k, 0], fcd[k, 1]
        if p == 1.0:
            shift += c * N
            slope += c
        else:
            square = N * N + EPSILON * EPSILON
            factor = c * np.exp(0.5 * (p - 1.0) * np.log(square))  # half the time of a power
            shift += factor * N
            slope += factor * (1.0 + (p - 1.0) * N * N / square)
    return shift, slope


@inlined
def absorbed_power(U: float, N: float, rates: Rates) -> float:
    """Return P_abs in uW."""
    return 2.0 * (rates.absorbed + rates.fca * N + rates.tpa * U) * U


@inlined
def optics(ar: float, ai: float, N: float, dT: float, shift: float, pump: float, detuning: float, rates: Rates) -> Row:
    """Return d(Re a)/dt, d(Im a)/dt, dN/dt and P_abs; ``shift`` is S(N)."""
    U = ar * ar + ai * ai
    D = -rates.thermal_shift * dT - shift - rates.kerr * U - detuning
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    recombination = N * (1.0 + rates.b * N) / (rates.tau0 * (1.0 + rates.a * N))
    heat = absorbed_power(U, N, rates)
    return -gamma * ar - D * ai, -gamma * ai + D * ar + pump, rates.g * U * U - recombination, heat


@inlined
def optics_jacobian(
    ar: float, ai: float, N: float, dT: float, shift: float, slope: float, detuning: float, rates: Rates
) -> Rows:
    """Return the derivatives of what `optics` returns (rows) by Re a, Im a, N and dT (columns)."""
    U = ar * ar + ai * ai
    D = -rates.thermal_shift * dT - shift - rates.kerr * U - detuning
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    saturation = 1.0 + rates.a * N
    relaxation = (1.0 + rates.b * N * (2.0 + rates.a * N)) / (rates.tau0 * saturation * saturation)
    cross, turn = 2.0 * rates.tpa * ar * ai, 2.0 * rates.kerr * ar * ai
    by_U = 2.0 * (rates.absorbed + rates.fca * N + 2.0 * rates.tpa * U)
    return (
        (
            -gamma - 2.0 * rates.tpa * ar * ar + turn,
            -D - cross + 2.0 * rates.kerr * ai * ai,
            -rates.fca * ar + slope * ai,
            rates.thermal_shift * ai,
        ),
        (
            D - cross - 2.0 * rates.kerr * ar * ar,
            -gamma - 2.0 * rates.tpa * ai * ai - turn,
            -rates.fca * ai - slope * ar,
            -rates.thermal_shift * ar,
        ),
        (4.0 * rates.g * U * ar, 4.0 * rates.g * U * ai, -relaxation, 0.0),
        (2.0 * by_U * ar, 2.0 * by_U * ai, 2.0 * rates.fca * U, 0.0),
    )


@compiled
def right_hand_side(y: Array, pump: float, detuning: float, rates: Rates, fcd: Array, thermal: Any) -> Array:
    """Return dy/dt, shape (3 + n,); ``thermal`` is one of the `kinds`."""
    out, shift = np.empty_like(y), dispersion(y[2], fcd)[0]
    dT = rise_of(read(y, thermal), thermal)[0]
    out[0], out[1], out[2], heat = optics(y[0], y[1], y[2], dT, shift, pump, detuning, rates)
    flow(y, heat, thermal, out)
    return out


@compiled
def jacobian(y: Array, detuning: float, rates: Rates, fcd: Array, thermal: Any) -> Array:
    """Return d(dy/dt)/dy, shape (3 + n, 3 + n), for the same kinds."""
    shift, slope = dispersion(y[2], fcd)
    dT = rise_of(read(y, thermal), thermal)[0]
    J = optics_jacobian(y[0], y[1], y[2], dT, shift, slope, detuning, rates)
    out = np.zeros((y.size, y.size))
    out[0, 0], out[0, 1], out[0, 2] = J[0][0], J[0][1], J[0][2]
    out[1, 0], out[1, 1], out[1, 2] = J[1][0], J[1][1], J[1][2]
    out[2, 0], out[2, 1], out[2, 2] = J[2][0], J[2][1], J[2][2]
    heat = absorbed_power(y[0] * y[0] + y[1] * y[1], y[2], rates)
    spread(y, heat, J[3], (J[0][3], J[1][3], J[2][3]), thermal, out)
    return out


forget_if_older(jacobian, kinds.__file__)
