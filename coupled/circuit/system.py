"""A circuit, its heat and its drive, in SI and as the kernel takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem.arrays import Array

from ..inputs import Input, Pieces, values
from ..kernel import units as eq
from ..kernel.integrator import Drive, PoleHeat, Problem, Rings
from ..kernel.tableaus import Method
from .circuit import Circuit
from .drive import HAIR, detunings_of, drive_of, powers_of
from .heat import RingHeat, heater_offsets, ring_heat
from .network import Light, light_of, network_of


@dataclass(frozen=True, eq=False)
class System:
    """A circuit under its drive.

    powers [W], detunings [Hz]: of the lasers.
    heaters [W]: powers of the heaters that are given.
    offsets [K]: what the heaters add to each ring.
    heater_states: of all heaters at the end of the run.
    """

    circuit: Circuit
    light: Light
    heat: RingHeat
    powers: list[Pieces]
    detunings: list[Pieces]
    heaters: dict[str, Pieces]
    offsets: list[Pieces]
    heater_states: Array
    drive: Drive
    rings: Rings

    @property
    def detuning(self) -> float | None:
        """Detuning of the first laser in Hz, None where it varies."""
        c = self.detunings[0].coefficients
        return None if np.any(c[:, 1:]) or np.ptp(c[:, 0]) else float(c[0, 0])

    @property
    def size(self) -> int:
        """Number of states."""
        return 3 * len(self.circuit.names) + int(self.heat.gain.size)

    def problem(self, method: Method, *, corner: Array | None = None, energies: bool = False) -> Problem:
        """The problem for the kernel; a ring alone, whose waves follow from its rows, is one of `simulate`."""
        corner, heat = np.empty(0) if corner is None else corner, self.heat
        n = len(self.circuit.names)
        own = np.ascontiguousarray(np.einsum("iik->ik", heat.read))
        gain, rate = heat.gain * (eq.UW * eq.NS), heat.rate * eq.NS
        alone = n == 1 and not (self.light.delay.size or corner.size or energies or self.light.between.any())
        if alone and np.all(own == 1):
            return Problem(self.rings, PoleHeat(gain, rate), self.drive, method)
        cross = None
        if heat.crossed:
            cross = heat.read.copy()
            cross[np.arange(n), np.arange(n)] = 0.0
        hair = 2 * HAIR * self.powers[0].edges[-1] / eq.NS
        network = network_of(self.light, corner=corner, energies=energies, hair=hair)
        return Problem(self.rings, PoleHeat(gain, rate, own, cross), self.drive, method, network)

    def scaled(self, share: float) -> System:
        """The same under a ``share`` of the light's power."""
        power = self.drive.power._replace(coefficients=share * self.drive.power.coefficients)
        return replace(self, drive=self.drive._replace(power=power))

    def waves(self, fields: Array, times: Array) -> Array:
        """Observed waves in sqrt(W), (Q, m), of fields in sqrt(J), (N, m), at times in s, without delays."""
        power, phase = values(self.drive.power, times) * eq.UW, values(self.drive.phase, times)
        lasers = np.sqrt(np.maximum(power, 0)) * np.exp(1j * phase)
        return np.asarray(self.light.seen_ring @ fields + self.light.seen_laser @ lasers)


def system_of(
    circuit: Circuit,
    thermal: Any,
    *,
    power: Mapping[str, Input],
    heaters: Mapping[str, Any] | None = None,
    detuning: Any = 0.0,
    duration: float,
    rtol: float = 1e-6,
    before: Array | None = None,
) -> System:
    """Convert a circuit and its drive; arguments and errors as of `simulate`.

    before: states of the heaters at the end of a run that this one goes on from.
    """
    heat = ring_heat(thermal, circuit.names)
    powers, detunings = powers_of(circuit, power, duration), detunings_of(circuit, detuning, duration)
    constant = float(detunings[0].coefficients[0, 0]) if len(detunings[0].coefficients) == 1 else 0.0
    light = light_of(circuit, constant + circuit.lasers[0].offset)
    watts, offsets, ends = heater_offsets(heat, heaters, duration, rtol, before)
    drive = drive_of(circuit, light, powers, detunings, offsets)
    rings = _rings(circuit, light, heat, drive.brightest)
    return System(circuit, light, heat, powers, detunings, watts, offsets, ends, drive, rings)


def _rings(circuit: Circuit, light: Light, heat: RingHeat, largest: Array) -> Rings:
    """The rings in the kernel's units, and the sizes below which their errors are not relative."""
    converted = [eq.internal_rates(ring) for ring in circuit.resonators]
    terms = max(len(fcd) for _, fcd in converted)
    fcd = np.zeros((len(converted), terms, 2))
    fcd[:, :, 1] = 1.0
    for i, (_, own) in enumerate(converted):
        fcd[i, : len(own)] = own
    whole = np.sqrt(largest.sum())
    floors = []
    for i, ((rates, _), ring) in enumerate(zip(converted, circuit.resonators, strict=True)):
        own_coupler = np.sqrt(2 * ring.bus_rate * eq.NS)
        reaching = float((np.abs(light.from_laser[i]) * np.sqrt(largest)).sum() * np.sqrt(eq.NS))
        if reaching < 1e-6 * whole * own_coupler:  # by other rings or delays only
            reaching = float(whole * own_coupler)
        floors.append(eq.floor_of(rates, reaching, heat.thermal_resistance[i] * eq.UW))
    modes = [[[r.loss, r.absorbed, r.fca, r.tpa, r.g, r.thermal_shift, 1.0, r.kerr]] for r, _ in converted]
    carriers = [[r.tau0, r.a, r.b] for r, _ in converted]
    return Rings(np.array(modes), np.array(carriers), fcd, np.array(floors), heat.curvature)
