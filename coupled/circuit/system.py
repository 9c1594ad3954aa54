"""A circuit, its heat and its drive, in SI and as the kernel takes them; the breakpoints that delays bring back."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

from ..arguments import detuning_in_time, power_in_time
from ..inputs import Input, Pieces, add, bounds, integral, joint, largest, pieces, table, values
from ..kernel import units as eq
from ..kernel.integrator import Drive, PoleHeat, Polynomials, Problem, Rings
from ..kernel.tableaus import Method
from .circuit import Circuit
from .network import Light, RingHeat, heater_offsets, light_of, network_of, ring_heat

SAME_TIME = 1e-13  # of a run: nearer breakpoints are one; sums of hundreds of delays differ by less
MOST_EDGES = 5_000_000  # 40 MB


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
    def corner(self) -> Array:
        """2 pi times the bandwidth of the detector of every observed wave in 1/ns; empty where none has one."""
        bandwidths, first = self.circuit.bandwidths, self.light.delay.size
        found = np.zeros(len(self.light.terminals) if any(bandwidths) else 0)
        found[first : first + len(bandwidths)] = 2 * np.pi * eq.NS * np.array(bandwidths)[: found.size]
        return found

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
        hair = 2 * SAME_TIME * self.powers[0].edges[-1] / eq.NS
        network = network_of(self.light, corner=corner, energies=energies, hair=hair)
        return Problem(self.rings, PoleHeat(gain, rate, own, cross), self.drive, method, network)

    def waves(self, fields: Array, times: Array) -> Array:
        """Observed waves in sqrt(W), (Q, m), of fields in sqrt(J), (N, m), at times in s, without delays."""
        power, phase = values(self.drive.power, times) * eq.UW, values(self.drive.phase, times)
        lasers = np.sqrt(np.maximum(power, 0)) * np.exp(1j * phase)
        return np.asarray(self.light.seen_ring @ fields + self.light.seen_laser @ lasers)

    def by_ring(self, field: Array, N: Array, rise: Array) -> dict[str, Array]:
        """Energy, carriers, rise and absorbed power in SI, (N, m), of fields and carriers in the kernel's units."""
        U, (absorbed, fca, tpa) = np.abs(field) ** 2, self.rings.modes[:, 0, 1:4].T[:, :, None]
        heating = 2 * (absorbed + fca * N + tpa * U) * U
        return {"energy": U * eq.FJ, "carriers": N * eq.DENSITY, "delta_T": rise, "absorbed": heating * eq.UW}


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
    light = light_of(circuit).at(constant + circuit.lasers[0].offset)
    watts, offsets, ends = heater_offsets(heat, heaters, duration, rtol, before)
    drive = drive_of(circuit, light, powers, detunings, offsets)
    rings = _rings(circuit, light, heat, drive.brightest)
    return System(circuit, light, heat, powers, detunings, watts, offsets, ends, drive, rings)


def _rings(circuit: Circuit, light: Light, heat: RingHeat, largest: Array) -> Rings:
    """The rings in the kernel's units, and the sizes below which their errors are not relative.

    largest: powers of the lasers in uW. A ring that none of them reaches gets its light from other rings or delays.
    """
    coupler = np.sqrt([2 * ring.bus_rate * eq.NS for ring in circuit.resonators])
    whole, reaching = np.sqrt(largest.sum()) * coupler, np.abs(light.from_laser) @ np.sqrt(largest * eq.NS)
    pumps = np.where(reaching < 1e-6 * whole, whole, reaching)
    each = [
        eq.internal_rings([ring], float(pump), float(R) * eq.UW)
        for ring, pump, R in zip(circuit.resonators, pumps, heat.thermal_resistance, strict=True)
    ]
    dispersion = np.tile([0.0, 1.0], (len(each), max(one.dispersion.shape[1] for one in each), 1))
    for row, one in zip(dispersion, each, strict=True):
        row[: one.dispersion.shape[1]] = one.dispersion[0]
    modes, carriers, floor = (np.concatenate([getattr(one, k) for one in each]) for k in ("modes", "carriers", "floor"))
    return Rings(modes, carriers, dispersion, floor, heat.curvature)


def powers_of(circuit: Circuit, power: Mapping[str, Any], duration: float) -> list[Pieces]:
    """Power of every laser in W as a piecewise cubic; 0 where none is given.

    Raises InputError: no mapping, a name that is no laser, or a power out of range.
    """
    checks.has("power", power, "items", hint="give powers by the lasers' names, {'in': 1e-3}")
    names = [laser.name for laser in circuit.lasers]
    for name in power:
        checks.choice("a name in power", name, names)
    values = {name: power_in_time(power.get(name, 0.0), duration) for name in names}
    return [pieces(f"power[{name!r}]", value, 0.0, duration) for name, value in values.items()]


def detunings_of(circuit: Circuit, detuning: Any, duration: float) -> list[Pieces]:
    """Detuning of every laser in Hz over a run, as a piecewise cubic of time; in the order of the lasers.

    detuning: a number, waveform or list for all lasers alike, or a mapping from their names, where 0 Hz is the default.
    duration [s]: of the run.
    Raises InputError: a name that is no laser, or one that varies in a circuit with delays.
    """
    names = [laser.name for laser in circuit.lasers]
    given = detuning if isinstance(detuning, Mapping) else dict.fromkeys(names, detuning)
    for name in given:
        checks.choice("a name in detuning", name, names)
    values = [detuning_in_time(given.get(name, 0.0), duration) for name in names]
    if not all(isinstance(v, float) for v in values) and any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("detuning varies, and the circuit has delays, whose phases belong to one frequency")
    return [pieces("detuning", value, 0.0, duration) for value in values]


def echoes(edges: Array, light: Light, duration: float) -> Array:
    """Times at which a jump of a laser is felt: at once, and after each further sum of delays, until it is too weak.

    gain: largest factor of the amplitude from one delay to the next by ways past the rings. An echo after n delays is
    kept while gain^(n - 1) > 1e-7: light through a ring changes without a jump, and one passage is allowed for.
    Returns times in s, increasing, below ``duration``. Raises InputError: more than `MOST_EDGES` of them.
    """
    delays = np.unique(light.delay)
    gain = float(np.abs(light.seen_delay[: light.delay.size]).sum(axis=1).max(initial=0.0))
    found = newest = edges
    generation = 0
    # breakpoints that come back with less than 1e-7 of the light are left to the error control
    while delays.size and newest.size and gain ** max(generation - 1, 0) > 1e-7:
        later = np.add.outer(newest, delays).ravel()
        together = _apart(np.concatenate([found, later[later < duration]]), duration)
        found, newest = together, np.setdiff1d(together, found)
        generation += 1
        hint = "shorten the run or lengthen the delays"
        checks.between("power: number of its edges and echoes", found.size, 0, MOST_EDGES, hint=hint)
    return found


def _apart(times: Array, duration: float) -> Array:
    """Times in increasing order, without those that are nearer than `SAME_TIME` to the one before."""
    every = np.sort(times)
    return every[np.diff(every, prepend=-np.inf) > SAME_TIME * duration]


def drive_of(
    circuit: Circuit, light: Light, powers: list[Pieces], detunings: list[Pieces], offsets: list[Pieces]
) -> Drive:
    """Lasers in W, their detunings in Hz, and what the heaters add to each ring in K, as the kernel takes them.

    Fields turn with the first laser; the phase of another is the integral of the difference.
    """
    first, duration = detunings[0], powers[0].edges[-1]
    edges, scale = joint(first, *offsets), eq.NS ** np.arange(4)
    turning = np.repeat(first.on(edges).coefficients[:, None] * (2 * np.pi * eq.NS), len(offsets), axis=1)
    cold = np.array([ring.frequency for ring in circuit.resonators])
    turning[:, :, 0] += 2 * np.pi * (float(circuit.frequency or 0.0) - cold + circuit.lasers[0].offset) * eq.NS
    for i, (ring, offset) in enumerate(zip(circuit.resonators, offsets, strict=True)):
        if np.any(offset.coefficients):
            turning[:, i] += offset.on(edges).coefficients * (ring.thermal_shift * eq.NS)
    power, detuning = table([one.times(1 / eq.UW) for one in powers]), Polynomials(edges / eq.NS, turning * scale)
    apart = table([one.times(2 * np.pi * eq.NS) for one in turns(circuit, detunings)])
    edges = echoes(joint(*powers), light, duration)
    every = _apart(np.concatenate([edges, detuning.edges * eq.NS, apart.edges * eq.NS]), duration)
    every[-1] = duration
    return Drive(
        every / eq.NS, power, integral(apart), detuning, light.from_laser * np.sqrt(eq.NS),
        np.array([largest(one) / eq.UW for one in powers]),
    )  # fmt: skip


def turns(circuit: Circuit, detunings: list[Pieces]) -> list[Pieces]:
    """Frequency of every laser minus that of the first in Hz."""
    back, duration = detunings[0].times(-1.0), detunings[0].edges[-1]
    apart = [Pieces.constant(0.0, duration, float(laser.offset - circuit.lasers[0].offset)) for laser in circuit.lasers]
    return [add([own, back, away]) for own, away in zip(detunings, apart, strict=True)]


def beat_of(light: Light, circuit: Circuit, powers: list[Pieces], detunings: list[Pieces]) -> float:
    """Fastest beat in an observed wave, rad/ns: of two lit lasers, or of one with light of rings or delays.

    Light of rings and delays is held in the common frame.
    """
    lit = np.array([bool(np.any(power.coefficients)) for power in powers])
    turn = 2 * np.pi * eq.NS * np.array([max(bounds(one), key=abs) for one in turns(circuit, detunings)])
    late = np.asarray(light.seen_delay.any(axis=1))
    common = late | np.asarray(light.seen_ring.any(axis=1)) | (np.arange(late.size) < light.delay.size)
    seen = [turn[lit & here] for here in (light.seen_laser != 0) | late[:, None]]
    beats = [np.ptp(np.append(own, 0.0) if held else own) for own, held in zip(seen, common, strict=True) if own.size]
    return float(max(beats, default=0.0))
