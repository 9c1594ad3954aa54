"""Light, carriers and heat of all rings of a circuit in time: what `simulate` does for a circuit."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks, dataset
from thermofem.arrays import Array

from ..arguments import check_duration, check_times
from ..heaters import heater_powers
from ..inputs import last_beat, last_change
from ..kernel import units as eq
from ..kernel.tableaus import Method
from ..resonator import parameters
from ..states import final_state
from ..thermal import dense_times, trusted
from .circuit import Circuit
from .network import RingHeat
from .system import System, beat_of, system_of, turns

SHORTEST = 1e-2  # of the shortest photon lifetime: no step is longer than a delay

NAMES = {
    "output": ("W", "power at the ports"),
    "detected": ("W", "power that the detectors show"),
    "mean_output": ("W", "power that the detectors show, averaged since the time before"),
    "phase": ("rad", "phase of the light at the ports, against the first laser's"),
    "input": ("W", "power of the lasers"),
    "lost": ("W", "power lost in waveguides and on the way from lasers"),
    "scattered": ("W", "power scattered by the rings"),
}


def run_circuit(
    circuit: Circuit,
    thermal: Any,
    *,
    power: Mapping[str, Any],
    detuning: Any,
    heaters: Mapping[str, Any] | None,
    duration: float,
    rtol: float,
    times: Any,
    average: bool,
    method: Method | None,
    initial: Any,
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Simulate a circuit; arguments and result are those of `simulate`."""
    duration = check_duration(duration)
    rtol = checks.between("rtol", rtol, 1e-13, 1e-1, hint="1e-6 gives traces to better than 1e-5")
    shortest = SHORTEST / max(ring.linear_rate for ring in circuit.resonators)
    for w in circuit.waveguides:
        hint = "no step would be longer; for one that is short against the photon lifetime of the rings give 0"
        checks.between(f"delay of the waveguide from {w.start!r}", w.delay or 1.0, shortest, 1.0, unit="s", hint=hint)
    before = None
    if initial is not None:
        kept = np.ravel(getattr(initial, "attrs", {}).get("heater_states", ()))
        before = checks.array("initial.attrs['heater_states']", kept, empty=True)
    system = system_of(
        circuit, thermal, power=power, heaters=heaters, detuning=detuning, duration=duration, rtol=rtol, before=before
    )
    light, corner = system.light, system.corner
    wanted = np.empty(0) if times is None else check_times(times, duration)
    asked, kept = dense_times(thermal, wanted, duration)
    alone = len(circuit.names) == 1 and not circuit.waveguides
    chosen = method or (Method.RODAS4 if rtol >= 1e-6 and alone else Method.RODAS5P)
    problem = system.problem(chosen, corner=corner, energies=average)
    longest = min([np.inf, *(light.delay / eq.NS)])
    beat = beat_of(light, circuit, system.powers, system.detunings) if problem.waves else 0.0
    if beat:  # the cubic through exp(i x t) at thirds of a step is off by (x h)^4/1944
        longest = min(longest, (1944.0 * rtol) ** 0.25 / beat)
    run = problem.integrate(
        _start(circuit, system.heat, initial), rtol=rtol, times=asked / eq.NS if asked.size else None, longest=longest,
        progress=(lambda t: progress(t * eq.NS)) if progress else None,
    )  # fmt: skip
    attributes = {
        "duration": duration, "rtol": float(rtol), "method": chosen.value, "steps": run.accepted,
        "rejected_steps": run.rejected, "final_state": run.y * eq.units(problem.order, problem.rings),
        "model_tau": np.ravel(1 / system.heat.rate), "driven_until": driven_until(system),
    }  # fmt: skip
    if system.heat.heaters:
        attributes["heater_states"] = system.heater_states
    rises = run.rows[:, 4 : 1 + 4 * problem.rings : 4]
    for i, offset in enumerate(system.offsets):
        if np.any(offset.coefficients):
            rises[:, i] += offset(run.rows[:, 0] * eq.NS)
    trusted(thermal, rises)
    rows = run.rows[kept[: len(run.rows)]] if wanted.size else run.rows
    return _dataset(system, rows, attributes, corner=corner, average=average)


def _start(circuit: Circuit, heat: RingHeat, initial: xr.Dataset | None) -> Array:
    """The state that a run begins with, in the kernel's units."""
    n, K = heat.gain.shape
    if initial is None:
        return np.zeros(n * (3 + K))
    if any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("initial: the light on its way through the delays of a circuit is not kept; start cold")
    return np.asarray(final_state(initial, n * (3 + K), {"model_tau": 1 / heat.rate}) / eq.units(K, n))


def _dataset(system: System, rows: Array, attributes: dict[str, Any], *, corner: Array, average: bool) -> xr.Dataset:
    """The rows of the kernel as a Dataset, in SI."""
    circuit, light = system.circuit, system.light
    n, D, ports, Q = len(circuit.names), light.delay.size, len(circuit.ports), len(light.terminals)
    time, states = rows[:, 0] * eq.NS, rows[:, 1 : 1 + 4 * n].reshape(-1, n, 4).T
    field, further, seen = states[0] + 1j * states[1], rows[:, 1 + 4 * n :].T, slice(D, D + ports)
    if further.size:
        waves = (further[: 2 * Q : 2] + 1j * further[1 : 2 * Q : 2]) * eq.UW**0.5
    else:
        waves = system.waves(field * eq.FJ**0.5, time)
    power = np.abs(waves) ** 2
    of_rings = system.by_ring(field, states[2], states[3])
    scattering = np.array([[2 * ring.scattering_rate] for ring in circuit.resonators])
    given = np.array([np.maximum(p(time), 0) for p in system.powers])
    on_the_way = np.array([1 - abs(laser.transmission) ** 2 for laser in circuit.lasers])
    shown = power[seen]
    by_port = {"output": shown, "phase": np.angle(waves[seen])}
    if corner.size:
        late = corner[seen] > 0
        shown = np.where(late[:, None], further[(3 if average else 2) * Q :][seen] * eq.UW, shown)
        by_port["detected"] = shown
    if average:
        energies = further[2 * Q : 3 * Q][seen] * eq.FJ
        if corner.size:  # dz/dt = corner (P - z)
            energies = energies - np.where(late, eq.NS / np.where(late, corner[seen], 1.0), 0.0)[:, None] * shown
        length = np.diff(time, prepend=0.0)
        gathered = np.diff(energies, prepend=0.0, axis=1)
        by_port["mean_output"] = np.where(length > 0, gathered / np.where(length > 0, length, 1.0), shown)
    every: dict[str, Any] = {
        "ring": of_rings | {"scattered": scattering * of_rings["energy"]}, "port": by_port, "laser": {"input": given}
    }  # fmt: skip
    variables: dict[str, Any] = {
        name: ((over, "time"), v, described(name)) for over, group in every.items() for name, v in group.items()
    }
    variables["lost"] = ("time", light.lost @ power + on_the_way @ given, described("lost"))
    if system.detuning is None:
        variables["detuning"] = ("time", system.detunings[0](time), described("detuning"))
    else:
        attributes = attributes | {"detuning": system.detuning}
    coordinates = {
        "time": ("time", time, dataset.describe("time")),
        "ring": list(circuit.names),
        "port": list(circuit.ports),
        "laser": [laser.name for laser in circuit.lasers],
    }
    origin = dataset.stamp("circuit") | {"circuit": circuit.name, "circuit_parameters": parameters(circuit)}
    return xr.Dataset(variables | heater_powers(system.heaters, time), coords=coordinates, attrs=origin | attributes)


def described(name: str) -> dict[str, str]:
    """Unit and long name of a variable."""
    return dict(zip(("units", "long_name"), NAMES[name], strict=True)) if name in NAMES else dataset.describe(name)


def driven_until(system: System) -> float:
    """When a laser or heater last changes, or lasers last beat, s."""
    inputs = *system.powers, *system.detunings, *system.heaters.values()
    return max(last_beat(system.powers, turns(system.circuit, system.detunings)), *map(last_change, inputs))
