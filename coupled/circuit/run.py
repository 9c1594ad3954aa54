"""Time integration of a circuit: light, carriers and heat of all its rings, as `simulate` calls it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks, dataset
from thermofem.arrays import Array

from ..heaters import heater_powers
from ..kernel import units as eq
from ..kernel.tableaus import Method
from ..resonator import parameters
from ..states import final_state
from ..thermal import dense_times, trusted
from .circuit import Circuit
from .system import System, system_of

SHORTEST = 1e-2  # of the shortest photon lifetime: no step is longer than a delay


def run_circuit(
    circuit: Circuit,
    thermal: Any,
    *,
    power: Mapping[str, Any],
    detuning: Any,
    heaters: Mapping[str, Any] | None,
    duration: float,
    rtol: float,
    times: Array,
    average: bool,
    method: Method | None,
    initial: Any,
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Simulate a circuit: `simulate` calls it with its arguments, duration, rtol and times checked, for its result."""
    shortest = SHORTEST / max(ring.linear_rate for ring in circuit.resonators)
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
        lit = [power.coefficients.any() for power in system.lights.powers]
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
        progress=(lambda t: progress(t * eq.NS)) if progress else None,
    )  # fmt: skip
    rises = run.rows[:, 4 : 1 + 4 * problem.rings : 4]
    for i, offset in enumerate(system.heating.rises):
        if offset.coefficients.any():
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
    attrs |= system.heat.doubts
    if system.detuning.steady:
        attrs["detuning"] = float(system.detuning(0.0))
    else:
        overall["detuning"] = system.detuning(time)
    groups = {("ring",): by_ring, ("port",): by_port, ("laser",): {"input": input_power}, (): overall}
    variables = {
        name: ((*over, "time"), values, dataset.describe(name))
        for over, group in groups.items()
        for name, values in group.items()
    }
    coordinates = {
        "time": ("time", time, dataset.describe("time")),
        "ring": list(circuit.names),
        "port": list(circuit.ports),
        "laser": [laser.name for laser in circuit.lasers],
    }
    return xr.Dataset(variables | heater_powers(system.heating.powers, time), coordinates, attrs)
