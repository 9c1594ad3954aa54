"""Conversion of SI to the kernel's units: ns, fJ, uW, K and 1e23 carriers per m^3, in which states are of order one.

1 uW is 1 fJ/ns. The equations, with these names, are in `equations.hpp`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import Quadratic
from thermofem.arrays import Array, Complex
from thermofem.models import ThermalModel, two_kinds

from .integrator import Problem
from .problem_parts import Drive, PoleHeat, QuadraticHeat, Rings
from .rates import absorbed_power
from .tableaus import Method

if TYPE_CHECKING:
    from ..resonator import RingResonator

NS, FJ, UW, DENSITY = 1e-9, 1e-15, 1e-6, 1e23  # the internal units in s, J, W, 1/m^3


class Rates(NamedTuple):
    """Optical and carrier coefficients of one ring in the kernel's units (ns, fJ, uW, K, 1e23/m^3)."""

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


class Mode(NamedTuple):
    """Coefficients of one resonance in the kernel's units: last axis of `Rings.modes`, ``Mode`` of equations.hpp."""

    loss: Any
    absorbed: Any
    fca: Any
    tpa: Any
    generation: Any
    shift: Any
    turn: Any
    kerr: Any


class Carriers(NamedTuple):
    """Recombination in the kernel's units: last axis of `Rings.carriers`, ``Carriers`` of equations.hpp."""

    tau0: Any
    a: Any
    b: Any


@lru_cache(maxsize=1000)
def internal_rates(ring: RingResonator) -> tuple[Rates, Array]:
    """Return a ring in the kernel's units, and its free-carrier dispersion, shape (terms, 2): c_k in rad/ns, p_k."""
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
    fcd.setflags(write=False)
    return rates, fcd


def internal_pump(ring: RingResonator, power: float) -> float:
    """Return the pump amplitude sqrt(2 gamma_e P) in sqrt(fJ)/ns for a bus power in W."""
    return math.sqrt(2 * ring.bus_rate * NS * power / UW)


def internal_detuning(detuning: float) -> float:
    """Return 2 pi (laser - cold resonance) in rad/ns for a detuning in Hz."""
    return 2 * math.pi * detuning * NS


def floor_of(rates: Rates, pump: float, thermal_resistance: float) -> Array:
    """Return the sizes of field, N and dT, shape (3,), in the kernel's units, below which errors are absolute.

    A thousandth of the values on resonance with the loss of the cold ring, but at most 1e20 carriers per m^3 (the value
    where light generates none) and 0.01 K. These sizes are far below those that shift the resonance by its width.
    pump [sqrt(fJ)/ns], thermal_resistance [K/uW]
    """
    tiny = 1e-27  # with no light at all, keeps 0/0 away
    U = (pump / rates.loss) ** 2
    field = max(np.sqrt(U), tiny)
    lifetime = rates.tau0 * (rates.a / rates.b if rates.b > 0 else 1.0)  # at high density
    N = lifetime * rates.g * U**2 if rates.g > 0 else 1.0
    dT = thermal_resistance * 2 * rates.absorbed * U
    return 1e-3 * np.array([field, min(max(N, tiny), 1), min(max(dT, tiny), 10)])


def units(order: int, rings: int = 1) -> Array:
    """Return the SI value of one kernel unit of each state, shape (3 rings + order rings,): fields and N, then heat."""
    light_and_carriers = np.tile([FJ**0.5, FJ**0.5, DENSITY], rings)
    heat = np.ones(rings * order)
    return np.concatenate([light_and_carriers, heat])


def in_seconds(progress: Callable[[float], None] | None) -> Callable[[float], None] | None:
    """Return the same report of progress for a time in ns."""
    return progress and (lambda t: progress(t * NS))


def in_si(rings: Rings, rows: Array) -> tuple[Complex, Array, Array, Array]:
    """Convert m kernel rows of R rings with F fields each to SI.

    Returns fields in sqrt(J), shape (R F, m); then carriers in 1/m^3, rise in K and absorbed power in W, shape (R, m).
    """
    R, F = rings.modes.shape[:2]
    states = rows[:, 1 : 1 + R * (2 * F + 2)].reshape(-1, R, 2 * F + 2).T
    real = states[0 : 2 * F : 2]
    imaginary = states[1 : 2 * F : 2]
    fields = real + 1j * imaginary
    N = states[-2]
    rise = states[-1]
    U = np.abs(fields) ** 2
    felt = 2 * U.sum(axis=0) - U  # two-photon absorption is twice as strong between fields
    heating = absorbed_power(U, N, Mode(*rings.modes.T[..., None]), felt).sum(axis=0)
    of_each_ring = fields.swapaxes(0, 1).reshape(R * F, -1)
    return of_each_ring * FJ**0.5, N * DENSITY, rise, heating * UW


def internal_rings(resonances: Sequence[RingResonator], pump: float, thermal_resistance: float) -> Rings:
    """Return the `Rings` of one ring with one field for each of ``resonances``; the first one gives the carriers.

    pump: largest drive amplitude, sqrt(fJ)/ns; thermal_resistance [K/uW].
    """
    own = resonances[0]
    first, fcd = internal_rates(own)
    modes = []
    for one in resonances:
        r = internal_rates(one)[0]
        turn = one.index_rate / own.index_rate
        modes.append(Mode(r.loss, r.absorbed, r.fca, r.tpa, r.g, r.thermal_shift, turn, r.kerr))
    floor = floor_of(first, pump, thermal_resistance)
    law = Carriers(first.tau0, first.a, first.b)
    return Rings(np.array([modes]), np.array([law]), fcd[None], floor[None])


def internal_heat(model: ThermalModel) -> tuple[PoleHeat | QuadraticHeat, float]:
    """Return a thermal model in the kernel's units, and the coefficient of its output map in 1/K, 0 without one."""
    small = two_kinds(model)
    if not isinstance(small, Quadratic):
        R = np.asarray(small.linear.R, dtype=float)
        tau = np.asarray(small.linear.tau, dtype=float)
        return PoleHeat((R * UW * NS / tau)[None], (NS / tau)[None]), float(small.coefficient)
    C = small.C
    static = np.linalg.solve(small.A, small.B)
    weight = np.where(C != 0, np.abs(C), np.abs(C @ static) / np.abs(static).max())
    return QuadraticHeat(small.A * NS, small.H * NS, small.G * FJ, small.B * FJ, C, weight), 0.0


def single_ring(
    ring: RingResonator, model: ThermalModel, power: float, detuning: float, duration: float, method: Method
) -> Problem:
    """Return the `Problem` of one ring under constant light; power in W, detuning in Hz, duration in s."""
    pump = internal_pump(ring, power)
    heat, bend = internal_heat(model)
    rings = internal_rings([ring], pump, model.thermal_resistance * UW)._replace(bend=bend)
    return Problem(rings, heat, Drive.constant(pump**2, internal_detuning(detuning), duration / NS), method)
