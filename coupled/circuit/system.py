"""The equations of a circuit with thermal model and drive, breakpoints from delays, and their integration in time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks, dataset
from thermofem.arrays import Array

from ..heaters import Heating, heater_powers, heating
from ..inputs import (
    SAME_TIME,
    Input,
    Lights,
    Pieces,
    add,
    apart_in_time,
    detuning_in_time,
    lights,
    pieces,
    power_in_time,
)
from ..kernel import units as eq
from ..kernel.integrator import Problem
from ..kernel.problem_parts import Drive, PoleHeat, Rings
from ..kernel.tableaus import Method
from ..resonator import parameters
from ..states import final_state
from ..thermal import Heaters, dense_times, trusted
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
    heaters: Heaters = None,
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
    constant = float(detunings[0].c[-1, 0]) if detunings[0].c.shape[1] == 1 else 0.0
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


def run_circuit(
    circuit: Circuit,
    thermal: Any,
    *,
    power: Mapping[str, Any],
    detuning: Any,
    heaters: Heaters,
    duration: float,
    rtol: float,
    times: Array,
    average: bool,
    method: Method | None,
    initial: Any,
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Simulate a circuit: `simulate` calls it with its arguments, duration, rtol and times checked, for its result."""
    # no step is longer than a delay, so none may be far below a photon lifetime
    shortest = 1e-2 / max(ring.linear_rate for ring in circuit.resonators)
    for w in circuit.waveguides:
        hint = "no step would be longer; for one that is short against the photon lifetime of the rings give 0"
        checks.between(f"delay of the waveguide from {w.start!r}", w.delay or 1.0, shortest, 1.0, unit="s", hint=hint)
    if initial is not None and any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("initial: the light on its way through the delays of a circuit is not kept; start cold")
    before = None
    if initial is not None:
        states = np.ravel(getattr(initial, "attrs", {}).get("heater_states", ()))
        before = checks.array("initial.attrs['heater_states']", states, empty=True)
    system = system_of(
        circuit, thermal, power=power, heaters=heaters, detuning=detuning, duration=duration, rtol=rtol, before=before
    )
    alone = len(circuit.names) == 1 and not circuit.waveguides
    chosen = method or (Method.RODAS4 if rtol >= 1e-6 and alone else Method.RODAS5P)
    problem = system.problem(chosen, detected=True, energies=average)
    longest = min([np.inf, *(system.light.delay / eq.NS)])
    if problem.waves:  # the cubic through exp(i x t) at thirds of a step is off by (x h)^4/1944
        lit = [power.c.any() for power in system.lights.powers]
        beat = np.ptp(np.append(system.lights.turning[lit], 0.0))  # rad/ns, of the lit lasers and the frame
        longest = min(longest, (1944.0 * rtol) ** 0.25 / max(beat, 1e-300))
    dense, asked = dense_times(thermal, times, duration)
    y = problem.zero()
    units = eq.units(problem.order, problem.rings)
    tau = 1 / system.heat.rate
    if initial is not None:
        y = final_state(initial, y.size, {"model_tau": tau}) / units
    run = problem.integrate(
        y, rtol=rtol, times=dense / eq.NS if dense.size else None, longest=longest,
        progress=eq.in_seconds(progress),
    )  # fmt: skip
    rises = run.rows[:, 4 : 1 + 4 * problem.rings : 4]
    for i, offset in enumerate(system.heating.rises):
        if offset.c.any():
            rises[:, i] += offset(run.rows[:, 0] * eq.NS)
    trusted(thermal, rises)
    rows = run.rows[asked] if times.size else run.rows
    result = as_dataset(system, rows, average)
    result.attrs |= {
        "duration": duration, "rtol": rtol, "method": chosen.value, "steps": run.accepted,
        "rejected_steps": run.rejected, "final_state": run.y * units, "model_tau": np.ravel(tau),
        "driven_until": max(system.lights.driven_until, system.heating.driven_until),
    }  # fmt: skip
    result.attrs |= system.heating.attributes
    if system.heat.heaters:
        result.attrs["heater_states"] = np.concatenate(system.heating.states(duration))
    return result


def as_dataset(system: System, rows: Array, average: bool = False) -> xr.Dataset:
    """Convert the rows of the kernel to a Dataset over time, ring, port and laser, in SI."""
    circuit = system.circuit
    light = system.light
    time = rows[:, 0] * eq.NS
    further = rows[:, 1 + 4 * len(circuit.names) :].T
    fields, N, rise, absorbed = eq.in_si(system.rings, rows)
    D = light.delay.size
    Q = len(light.terminals)
    if further.size:
        waves = (further[: 2 * Q : 2] + 1j * further[1 : 2 * Q : 2]) * eq.UW**0.5
    else:  # no delays
        waves = light.seen_ring @ fields + light.seen_laser @ system.lights.amplitudes(time)
    energy = np.abs(fields) ** 2
    power = np.abs(waves) ** 2
    ports = slice(D, D + len(circuit.ports))
    scattering = np.array([[2 * ring.scattering_rate] for ring in circuit.resonators])
    input_power = np.array([np.maximum(p(time), 0) for p in system.lights.powers])
    on_the_way = np.array([1 - abs(laser.transmission) ** 2 for laser in circuit.lasers])
    shown = power[ports]
    corner = light.corner[ports, None]
    by_port = {"output": shown, "phase": np.angle(waves[ports])}
    if further.size and corner.any():
        shown = np.where(corner > 0, further[-Q:][ports] * eq.UW, shown)
        by_port["detected"] = shown
    if average:
        lag = np.divide(1.0, corner, out=np.zeros_like(corner), where=corner > 0)  # dz/dt = (P - z)/lag
        energies = further[2 * Q : 3 * Q][ports] * eq.FJ - lag * shown
        length = np.diff(time, prepend=0.0)
        gathered = np.diff(energies, prepend=0.0, axis=1)
        by_port["mean_output"] = np.divide(gathered, length, out=shown.copy(), where=length > 0)
    by_ring = {"energy": energy, "carriers": N, "delta_T": rise, "absorbed": absorbed, "scattered": scattering * energy}
    overall = {"lost": light.lost @ power + on_the_way @ input_power}
    attrs = dataset.stamp("circuit") | {"circuit": circuit.name, "circuit_parameters": parameters(circuit)}
    attrs["frequency"] = circuit.frequency
    attrs |= system.heat.doubts
    if system.detuning.steady:
        attrs["detuning"] = float(system.detuning(0.0))
    else:
        overall["detuning"] = system.detuning(time)
    variables = dataset.variables("time", {"time": time, **overall})
    for over, group in {"ring": by_ring, "port": by_port, "laser": {"input": input_power}}.items():
        variables |= dataset.variables((over, "time"), group)
    coordinates = {
        "ring": list(circuit.names),
        "port": list(circuit.ports),
        "laser": [laser.name for laser in circuit.lasers],
    }
    return xr.Dataset(variables | heater_powers(system.heating.powers, time), coordinates, attrs)
