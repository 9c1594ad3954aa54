"""The Dataset of a run of a circuit: rings, ports and lasers with their names, in SI."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.arrays import Array
from thermofem.data import dataset

from ..runs.record import heater_powers
from .circuit import Circuit
from .heat import RingHeat
from .network import Light
from .system import System

if TYPE_CHECKING:
    import xarray as xr

NAMES = {
    "output": ("W", "power at the ports"),
    "detected": ("W", "power that the detectors show"),
    "mean_output": ("W", "power that the detectors show, averaged since the time before"),
    "phase": ("rad", "phase of the light at the ports, against the first laser's"),
    "input": ("W", "power of the lasers"),
    "lost": ("W", "power lost in waveguides and on the way from lasers"),
    "scattered": ("W", "power scattered by the rings"),
}


def dataset_of(
    circuit: Circuit,
    system: System,
    rows: Array,
    attributes: dict[str, Any],
    *,
    corner: Array,
    average: bool,
) -> xr.Dataset:
    """The rows of `integrate` as a Dataset."""
    import xarray as xr

    from ..kernels import equations as eq
    from .equations import heating

    light, rings = system.light, system.rings
    n, D, ports = len(circuit.names), light.delay.size, len(circuit.ports)
    time = rows[:, 0] * eq.NS
    states = rows[:, 1 : 1 + 4 * n].reshape(-1, n, 4)
    Q = len(light.terminals)
    real, imaginary = (rows[:, 1 + 4 * n + k : 1 + 4 * n + 2 * Q : 2].T for k in (0, 1))
    power = (real**2 + imaginary**2) * eq.UW  # of every observed wave
    energy = (states[:, :, 0] ** 2 + states[:, :, 1] ** 2).T * eq.FJ
    absorbed = [heating(np.ascontiguousarray(states[:, i, :3]), rings, i) * eq.UW for i in range(n)]
    of_rings = {
        "energy": energy,
        "carriers": states[:, :, 2].T * eq.DENSITY,
        "delta_T": states[:, :, 3].T,
        "absorbed": np.array(absorbed),
        "scattered": 2 * np.array([ring.scattering_rate for ring in circuit.resonators])[:, None] * energy,
    }
    shown, seen = power[D : D + ports], slice(D, D + ports)
    variables: dict[str, Any] = {name: (("ring", "time"), values, described(name)) for name, values in of_rings.items()}
    variables["output"] = (("port", "time"), shown, described("output"))
    variables["phase"] = (("port", "time"), np.arctan2(imaginary[seen], real[seen]), described("phase"))
    given = np.array([np.maximum(p(time), 0) for p in system.powers])
    variables["input"] = (("laser", "time"), given, described("input"))
    on_the_way = np.array([1 - abs(laser.transmission) ** 2 for laser in circuit.lasers])
    variables["lost"] = (("time",), light.lost @ power + on_the_way @ given, described("lost"))
    if corner.size:
        late = corner[D : D + ports] > 0
        shown = np.where(late[:, None], rows[:, -Q + D : rows.shape[1] - Q + D + ports].T * eq.UW, shown)
        variables["detected"] = (("port", "time"), shown, described("detected"))
    if average:
        energies = rows[:, 1 + 4 * n + 2 * Q + D : 1 + 4 * n + 2 * Q + D + ports].T * eq.FJ
        if corner.size:  # dz/dt = corner (P - z)
            energies -= np.where(late, eq.NS / np.where(late, corner[D : D + ports], 1.0), 0.0)[:, None] * shown
        before = np.hstack([np.zeros((ports, 1)), energies[:, :-1]])
        length = np.diff(time, prepend=0.0)
        mean = np.where(length > 0, (energies - before) / np.where(length > 0, length, 1.0), shown)
        variables["mean_output"] = (("port", "time"), mean, described("mean_output"))
    turned = system.frame(time)
    if np.any(turned != system.detuning):
        variables["detuning"] = (("time",), turned, described("detuning"))
    else:
        attributes = attributes | {"detuning": system.detuning}
    coordinates = {
        "time": ("time", time, dataset.describe("time")),
        "ring": list(circuit.names),
        "port": list(circuit.ports),
        "laser": [laser.name for laser in circuit.lasers],
    }
    variables |= heater_powers(system.heaters, time)
    return xr.Dataset(variables, coords=coordinates, attrs=_origin(circuit) | attributes)


def first_row(light: Light, drive: Any, begin: Array, heat: RingHeat, *, gathered: int) -> Array:
    """The row of `integrate` at t = 0, without what heaters add."""
    from ..kernels import equations as eq
    from .waves import lasers_at

    n, K = heat.gain.shape
    fields = begin[0 : 3 * n : 3] + 1j * begin[1 : 3 * n : 3]
    laser, slope = (np.zeros(len(drive.turn), dtype=complex) for _ in range(2))
    lasers_at(drive, 0, 0.0, laser, slope)
    waves = light.seen_ring @ fields * np.sqrt(eq.NS) + light.seen_laser @ laser
    x = begin[3 * n :].reshape(n, K)
    own = np.einsum("iik,ik->i", heat.read, x)
    rises = np.einsum("ijk,jk->i", heat.read, x) + heat.curvature * own**2
    states = np.column_stack([fields.real, fields.imag, begin[2 : 3 * n : 3], rises]).ravel()
    seen = np.column_stack([waves.real, waves.imag]).ravel()
    return np.concatenate([[0.0], states, seen, np.zeros(gathered)])


def described(name: str) -> dict[str, str]:
    """Unit and long name of a variable."""
    if name in NAMES:
        unit, words = NAMES[name]
        return {"units": unit, "long_name": words}
    return dataset.describe(name)


def _origin(circuit: Circuit) -> dict[str, Any]:
    """Attributes that describe the circuit."""
    return dataset.stamp("circuit") | {"circuit": circuit.name, "circuit_parameters": json.dumps(asdict(circuit))}
