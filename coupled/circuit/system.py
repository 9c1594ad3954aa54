"""The equations of a circuit with thermal model and drive, in SI and in the kernel's units; breakpoints from delays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

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
    """A circuit with its thermal model, lasers and heaters over one time window.

    light: the matrices of the circuit, in the frame of the first laser at constant detuning.
    detuning [Hz]: of the first laser. rings: in the kernel's units.
    """

    circuit: Circuit
    light: Light
    heat: RingHeat
    detuning: Pieces
    lights: Lights
    heating: Heating
    rings: Rings

    def problem(self, method: Method, *, detected: bool = False, energies: bool = False) -> Problem:
        """The equations for the kernel; ``detected`` adds detector low passes, ``energies`` the integrated powers."""
        heat = self.heat
        own = np.einsum("iik->ik", heat.read)
        diagonal = np.eye(len(own), dtype=bool)[:, :, None]
        cross = np.where(diagonal, 0.0, heat.read) if heat.crossed else None
        time_tolerance = 2 * SAME_TIME * self.lights.drive.edges[-1]
        network = network_of(self.light, detected=detected, energies=energies, time_tolerance=time_tolerance)
        poles = PoleHeat(heat.gain * (eq.UW * eq.NS), heat.rate * eq.NS, own, cross)
        return Problem(self.rings, poles, self.lights.drive, method, network)


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
    """Convert a circuit, its thermal model and its drive to a `System`; arguments and errors as of `simulate`.

    before: states of the heaters at the end of the run that is continued.
    """
    heat = ring_heat(thermal, circuit.resonators, circuit.names)
    powers, detunings = inputs_of(circuit, power, detuning, duration)
    constant = float(detunings[0].coefficients[0, 0]) if len(detunings[0].coefficients) == 1 else 0.0
    light = light_of(circuit).at(constant + circuit.lasers[0].offset)
    warm = heating(heat.heaters, heaters, duration, rtol, before, len(circuit.names))
    lights = lights_of(circuit, light, powers, detunings, warm.rises)
    rings = _rings(circuit, heat, lights.drive)
    return System(circuit, light, heat, detunings[0], lights, warm, rings)


def _rings(circuit: Circuit, heat: RingHeat, drive: Drive) -> Rings:
    """Convert the rings to the kernel's units, with the absolute tolerances (floors) of their states.

    The floor of a ring that no laser reaches directly is computed from the total laser power.
    """
    coupler = np.sqrt([2 * ring.bus_rate * eq.NS for ring in circuit.resonators])
    whole = np.sqrt(drive.brightest.sum()) * coupler
    reaching = np.abs(drive.entry) @ np.sqrt(drive.brightest)
    pumps = np.where(reaching < 1e-6 * whole, whole, reaching)
    rings = [
        eq.internal_rings([ring], float(pump), float(R) * eq.UW)
        for ring, pump, R in zip(circuit.resonators, pumps, heat.thermal_resistance, strict=True)
    ]
    terms = [ring.dispersion.shape[1] for ring in rings]
    dispersion = np.tile([0.0, 1.0], (len(rings), max(terms), 1))
    for row, ring, count in zip(dispersion, rings, terms, strict=True):
        row[:count] = ring.dispersion[0]
    modes = np.concatenate([ring.modes for ring in rings])
    carriers = np.concatenate([ring.carriers for ring in rings])
    floor = np.concatenate([ring.floor for ring in rings])
    return Rings(modes, carriers, dispersion, floor, heat.curvature)


def inputs_of(
    circuit: Circuit, power: Mapping[str, Any], detuning: Any, duration: float
) -> tuple[list[Pieces], list[Pieces]]:
    """Power in W and detuning in Hz of every laser as piecewise cubics; 0 for lasers that are not named.

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
    watts = [power_in_time(power.get(name, 0.0), duration) for name in names]
    shifts = [detuning_in_time(given.get(name, 0.0), duration) for name in names]
    varies = not all(isinstance(shift, float) for shift in shifts)
    if varies and any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("detuning varies, and the circuit has delays, whose phases belong to one frequency")
    powers = [pieces("power", value, 0.0, duration) for value in watts]
    detunings = [pieces("", value, 0.0, duration) for value in shifts]
    return powers, detunings


def echoes(edges: Array, light: Light, duration: float) -> Array:
    """Times at which a discontinuity of a laser arrives: ``edges``, and these plus all sums of delays (breakpoints).

    With gain the largest amplitude factor from one delay to the next without passing through a ring, those after n
    delays are kept while gain^(n - 1) > 1e-7: a ring smooths a discontinuity, and one passage is allowed for.
    Returns times in s, increasing, below ``duration``. Raises InputError: more than `MOST_EDGES` of them.
    """
    delays = np.unique(light.delay)
    gain = float(np.abs(light.seen_delay[: light.delay.size]).sum(axis=1).max(initial=0.0))
    arrivals = newest = edges
    generation = 0
    # breakpoints that come back with less than 1e-7 of the light are left to the error control
    while delays.size and newest.size and gain ** max(generation - 1, 0) > 1e-7:
        later = np.add.outer(newest, delays).ravel()
        together = np.concatenate([arrivals, later[later < duration]])
        together = apart_in_time(together, arrivals[[0, -1]])
        newest = np.setdiff1d(together, arrivals)
        arrivals = together
        generation += 1
        hint = "shorten the run or lengthen the delays"
        checks.between("power: number of its edges and echoes", arrivals.size, 0, MOST_EDGES, hint=hint)
    return arrivals


def lights_of(
    circuit: Circuit, light: Light, powers: list[Pieces], detunings: list[Pieces], rises: list[Pieces]
) -> Lights:
    """Combine laser powers (W), detunings (Hz) and temperature rises by heaters (K) in the frame of the first laser."""
    duration = powers[0].edges[-1]

    def moved(detuning: Pieces, by: float) -> Pieces:
        return add([detuning, Pieces.constant(0.0, duration, by)])

    reference = float(circuit.frequency or 0.0) + circuit.lasers[0].offset
    frequencies = [moved(own, laser.offset) for own, laser in zip(detunings, circuit.lasers, strict=True)]
    of_rings = []
    for ring, rise in zip(circuit.resonators, rises, strict=True):
        cold = moved(detunings[0], reference - ring.frequency).times(2 * np.pi)
        of_rings.append(add([cold, rise.times(ring.thermal_shift)]))
    return lights(
        powers,
        frequencies,
        frame=[0] * len(powers),
        detunings=of_rings,
        entry=light.from_laser,
        echoes=lambda edges: echoes(edges, light, duration),
    )
