"""Light and carriers of a ring as numbers of order one: ns, fJ, 1e23 carriers per m^3, fields in sqrt(fJ) and sqrt(W).

    da/dt = (i D - gamma) a + i (pump s_in + add s_add),     |a|^2 = U
    D     = -thermal_shift dT - sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2) - kerr U - 2 pi detuning
    gamma = loss + fca N + tpa U
    dN/dt = -N (1 + b N)/(tau0 (1 + a N)) + g U^2
    P_abs = 2e-6 (absorbed + fca N + tpa U) U in W
    s_through = s_in + i through a,    s_drop = s_add + i drop a

N (N^2 + eps^2)^((p - 1)/2) stands for N^p, whose slope is infinite at N = 0 for p < 1.

Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5, as `coupled.RingResonator` reads them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from thermofem import checks

NS, FJ, DENSITY = 1e-9, 1e-15, 1e23  # the units in s, J, 1/m^3
EPSILON = 1e-8  # eps in 1e23/m^3: 1e15 per m^3 is six orders below the densities that matter
STEPS_A_PERIOD = 400  # ngspice is within 3e-4 of the period with it, within 1e-3 with half as many
STEPS_A_LIFETIME = 20  # where the period is not known; a pulse lasts some carrier lifetimes


@dataclass(frozen=True)
class RingRates:
    """Coefficients of the equations of this module; ``dispersion`` holds the pairs (c_k, p_k), c_k in rad/ns."""

    pump: float
    add: float
    through: float
    drop: float
    loss: float
    absorbed: float
    fca: float
    tpa: float
    g: float
    tau0: float
    a: float
    b: float
    thermal_shift: float
    kerr: float
    dispersion: tuple[tuple[float, float], ...]

    @property
    def output_port(self) -> str:
        """The port that a demonstration reads: drop, or through for a ring on one bus."""
        return "drop" if self.drop else "through"


def ring_rates(ring: Any) -> RingRates:
    """Coefficients of a ring from its fields and derived rates in SI, such as those of `coupled.RingResonator`.

    Raises InputError: something that has no such rates.
    """
    hint = "coupled.borghi2021() is one, coupled.Circuit holds several"
    checks.has("ring", ring, "bus_rate", "linear_rate", "thermal_shift", "carriers", hint=hint)
    bus, drop, carriers = ring.bus_rate, ring.drop_bus_rate, ring.carriers
    return RingRates(
        pump=math.sqrt(2 * bus / FJ) * NS,
        add=math.sqrt(2 * drop / FJ) * NS,
        through=math.sqrt(2 * bus * FJ),
        drop=math.sqrt(2 * drop * FJ),
        loss=ring.linear_rate * NS,
        absorbed=ring.loss_rate * NS,
        fca=ring.eta_fca * DENSITY * NS,
        tpa=ring.eta_tpa * FJ * NS,
        g=ring.g_tpa * FJ**2 * NS / DENSITY,
        tau0=carriers.tau0 / NS,
        a=carriers.a * DENSITY,
        b=carriers.b * DENSITY,
        thermal_shift=ring.thermal_shift * NS,
        kerr=ring.kerr_shift * FJ * NS,
        dispersion=tuple((ring.index_rate * c * DENSITY**p * NS, float(p)) for c, p in ring.fcd),
    )


@dataclass(frozen=True)
class Demonstration:
    """Laser of a demonstration run from cold, which is written beside an export.

    power [W], detuning [Hz]: of the laser, on from t = 0.
    period [s]: of the settled pulsation, or None where it is not known or the ring does not pulse.
    """

    power: float
    detuning: float
    period: float | None

    def largest_step(self, rates: RingRates) -> float:
        """Largest step in s that the simulator may take."""
        return self.period / STEPS_A_PERIOD if self.period else rates.tau0 * NS / STEPS_A_LIFETIME

    def row(self) -> float:
        """Interval of the rows of the output table in s: a 100th of the period in whole ns, 1 to 4; else 4 ns."""
        return min(4.0, max(1.0, self.period / 100 // NS)) * NS if self.period else 4 * NS

    def reason(self) -> str:
        """Text that says how the largest step was chosen."""
        if self.period:
            return f"settled period {self.period:.9g} s / {STEPS_A_PERIOD}"
        return f"carrier lifetime / {STEPS_A_LIFETIME}; the period is not known"


def demonstration(power: Any, detuning: float, period: float | None) -> Demonstration:
    """Check the laser power (W, or a mapping from the laser's name), detuning (Hz) and period (s) of a run.

    Raises InputError: a power or detuning out of range, or powers of several lasers.
    """
    if isinstance(power, Mapping):
        checks.integer("number of lasers", len(power), 1, 1)
        (power,) = power.values()
    power = checks.power("power", power, zero=True)
    detuning = checks.between("detuning", detuning, -5e12, 5e12, unit="Hz", hint="did you mean 10e9?")
    if period is not None:
        period = checks.between("period", period, 1e-12, 1, unit="s")
    return Demonstration(power, detuning, period)
