"""A circuit, its heat and its drive, in SI and as the kernel takes them; the breakpoints that delays bring back."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, Complex

from ..arguments import detuning_in_time, power_in_time
from ..heaters import Heating, heating
from ..inputs import SAME_TIME, Input, Lights, Pieces, add, apart_in_time, lights, pieces
from ..kernel import units as eq
from ..kernel.integrator import Drive, PoleHeat, Problem, Rings
from ..kernel.tableaus import Method
from .circuit import Circuit
from .network import Light, RingHeat, light_of, network_of, ring_heat

MOST_EDGES = 5_000_000  # 40 MB


@dataclass(frozen=True, eq=False)
class System:
    """A circuit under its drive.

    detuning [Hz]: of the first laser.
    """

    circuit: Circuit
    light: Light
    heat: RingHeat
    detuning: Pieces
    lights: Lights
    heating: Heating
    rings: Rings

    @property
    def corner(self) -> Array:
        """2 pi times the bandwidth of the detector of every observed wave in 1/ns; 0 for none."""
        found, first = np.zeros(len(self.light.terminals)), self.light.delay.size
        found[first : first + len(self.circuit.ports)] = 2 * np.pi * eq.NS * np.array(self.circuit.bandwidths)
        return found

    def problem(self, method: Method, *, detected: bool = False, energies: bool = False) -> Problem:
        """The problem for the kernel, which keeps what detectors show where it is ``detected``, and the energies."""
        heat, n = self.heat, len(self.circuit.names)
        own, cross = np.einsum("iik->ik", heat.read), None
        if heat.crossed:
            cross = np.where(np.eye(n, dtype=bool)[:, :, None], 0.0, heat.read)
        network = network_of(
            self.light,
            corner=self.corner * detected,
            energies=energies,
            hair=2 * SAME_TIME * self.lights.drive.edges[-1],
        )
        poles = PoleHeat(heat.gain * (eq.UW * eq.NS), heat.rate * eq.NS, own, cross)
        return Problem(self.rings, poles, self.lights.drive, method, network)

    def waves(self, fields: Complex, times: Array) -> Complex:
        """Observed waves in sqrt(W), (Q, m), of fields in sqrt(J), (N, m), at times in s, without delays."""
        return np.asarray(self.light.seen_ring @ fields + self.light.seen_laser @ self.lights.amplitudes(times))


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
    powers, detunings = inputs_of(circuit, power, detuning, duration)
    constant = float(detunings[0].coefficients[0, 0]) if len(detunings[0].coefficients) == 1 else 0.0
    light = light_of(circuit).at(constant + circuit.lasers[0].offset)
    warm = heating(heat.heaters, heaters, duration, rtol, before, len(circuit.names))
    lights = lights_of(circuit, light, powers, detunings, warm.rises)
    rings = _rings(circuit, heat, lights.drive)
    return System(circuit, light, heat, detunings[0], lights, warm, rings)


def _rings(circuit: Circuit, heat: RingHeat, drive: Drive) -> Rings:
    """The rings in the kernel's units, and the sizes below which their errors are not relative.

    A ring that no laser reaches gets its light from other rings or delays.
    """
    coupler = np.sqrt([2 * ring.bus_rate * eq.NS for ring in circuit.resonators])
    whole, reaching = np.sqrt(drive.brightest.sum()) * coupler, np.abs(drive.entry) @ np.sqrt(drive.brightest)
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


def inputs_of(
    circuit: Circuit, power: Mapping[str, Any], detuning: Any, duration: float
) -> tuple[list[Pieces], list[Pieces]]:
    """Power in W and detuning in Hz of every laser as piecewise cubics; those that are not named are 0.

    detuning: for all lasers alike, or a mapping from their names.
    Raises InputError: no mapping, a name that is no laser, a value out of range, or a detuning that varies in a circuit
        with delays.
    """
    checks.has("power", power, "items", hint="give powers by the lasers' names, {'in': 1e-3}")
    names = [laser.name for laser in circuit.lasers]
    given = detuning if isinstance(detuning, Mapping) else dict.fromkeys(names, detuning)
    for what, some in (("power", power), ("detuning", given)):
        for name in some:
            checks.choice(f"a name in {what}", name, names)
    watts = {f"power[{name!r}]": power_in_time(power.get(name, 0.0), duration) for name in names}
    shifts = [detuning_in_time(given.get(name, 0.0), duration) for name in names]
    if not all(isinstance(one, float) for one in shifts) and any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("detuning varies, and the circuit has delays, whose phases belong to one frequency")
    powers = [pieces(what, value, 0.0, duration) for what, value in watts.items()]
    return powers, [pieces("detuning", value, 0.0, duration) for value in shifts]


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
        together = apart_in_time(np.concatenate([found, later[later < duration]]), found[[0, -1]])
        found, newest = together, np.setdiff1d(together, found)
        generation += 1
        hint = "shorten the run or lengthen the delays"
        checks.between("power: number of its edges and echoes", found.size, 0, MOST_EDGES, hint=hint)
    return found


def lights_of(
    circuit: Circuit, light: Light, powers: list[Pieces], detunings: list[Pieces], rises: list[Pieces]
) -> Lights:
    """Lasers in W, their detunings in Hz, and what the heaters add to each ring in K; fields turn with the first."""
    duration = powers[0].edges[-1]

    def moved(detuning: Pieces, by: float) -> Pieces:
        return add([detuning, Pieces.constant(0.0, duration, by)])

    reference = float(circuit.frequency or 0.0) + circuit.lasers[0].offset
    return lights(
        powers,
        [moved(own, laser.offset) for own, laser in zip(detunings, circuit.lasers, strict=True)],
        frame=[0] * len(powers),
        detunings=[
            add([moved(detunings[0], reference - ring.frequency).times(2 * np.pi), rise.times(ring.thermal_shift)])
            for ring, rise in zip(circuit.resonators, rises, strict=True)
        ],
        entry=light.from_laser,
        echoes=lambda edges: echoes(edges, light, duration),
    )


def beat_of(lights: Lights) -> float:
    """Fastest beat of the lit lasers with each other and with the light of rings and delays, rad/ns."""
    lit = [bool(np.any(power.coefficients)) for power in lights.powers]
    return float(np.ptp(np.append(lights.turning[lit], 0.0)))
