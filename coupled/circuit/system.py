"""A circuit, its heat and its drive converted to what the compiled code takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..inputs import Input, Pieces
from ..window import floor_of
from .circuit import Circuit
from .drive import detuning_of, internal_drive, powers_of
from .heat import RingHeat, heater_offsets, ring_heat
from .network import Light, light_of, order_of_rings

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class System:
    """A circuit under its drive: in SI (light, heat, powers, offsets) and in internal units (the types of `layout`).

    Attributes
    ----------
    light : Light
    heat : RingHeat
    powers : list of Pieces, W
        of the lasers.
    offsets : list of Pieces, K
        what the heaters add to each ring.
    detuning : float, Hz
        0 where it varies.
    drive, rings, states, net : layout.LaserTable, Rings, Heat and LightNetwork
    """

    light: Light
    heat: RingHeat
    powers: list[Pieces]
    offsets: list[Pieces]
    detuning: float
    drive: Any
    rings: Any
    states: Any
    net: Any


def system_of(
    circuit: Circuit,
    thermal: Any,
    *,
    inputs: Mapping[str, Input],
    heaters: Mapping[str, Any] | None = None,
    detuning: Input = 0.0,
    duration: float,
) -> System:
    """Convert a circuit and its drive; arguments and errors as of `simulate_circuit`."""
    heat = ring_heat(thermal, len(circuit.names))
    powers = powers_of(circuit, inputs, duration)
    frame, constant = detuning_of(circuit, detuning, duration)
    light = light_of(circuit, constant + circuit.lasers[0].offset)
    offsets = heater_offsets(heat, heaters, duration)
    drive = internal_drive(circuit, light, powers, frame, offsets, duration)
    rings = _rings(circuit, light, heat, drive.largest)
    return System(light, heat, powers, offsets, constant, drive, rings, _states(heat), _network(light))


def units_of(rings: int, states: int) -> Array:
    """SI value of one internal unit of every state, shape (3 N + N K,)."""
    from ..kernels import equations as eq

    return np.concatenate([np.tile([eq.FJ**0.5, eq.FJ**0.5, eq.DENSITY], rings), np.ones(rings * states)])


def _rings(circuit: Circuit, light: Light, heat: RingHeat, largest: Array) -> Any:
    """The rings in internal units, and the sizes below which their errors are not relative."""
    from ..kernels import equations as eq
    from .layout import Rings

    converted = [eq.internal_rates(ring) for ring in circuit.resonators]
    terms = max(len(fcd) for _, fcd in converted)
    fcd = np.zeros((len(converted), terms, 2))
    fcd[:, :, 1] = 1.0
    for i, (_, own) in enumerate(converted):
        fcd[i, : len(own)] = own
    whole = np.sqrt(largest.sum())
    floors = []
    for i, ((rates, _), ring) in enumerate(zip(converted, circuit.resonators, strict=True)):
        reaching = float((np.abs(light.from_laser[i]) * np.sqrt(largest)).sum() * np.sqrt(eq.NS))
        if reaching < 1e-6 * whole * np.sqrt(2 * ring.bus_rate * eq.NS):  # by other rings or delays only
            reaching = float(whole * np.sqrt(2 * ring.bus_rate * eq.NS))
        floors.append(floor_of(rates, reaching, heat.thermal_resistance[i] * eq.UW))
    return Rings(np.array([tuple(rates) for rates, _ in converted], dtype=float), fcd, np.array(floors))


def _states(heat: RingHeat) -> Any:
    """The thermal states in internal units."""
    from ..kernels import equations as eq
    from .layout import Heat

    gain, rate = heat.gain * (eq.UW * eq.NS), heat.rate * eq.NS
    return Heat(gain, rate, np.ascontiguousarray(heat.read), heat.curvature, heat.crossed)


def _network(light: Light) -> Any:
    """The waveguides in internal units: entries of M by row, without what round-off left."""
    from ..kernels import equations as eq
    from .layout import LightNetwork
    from .network import NOTHING

    M = light.between
    kept = np.abs(M) > NOTHING * np.abs(M).max(initial=0.0)
    root = np.sqrt(eq.NS)
    return LightNetwork(
        start=np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(np.int64),
        column=np.nonzero(kept)[1].astype(np.int64),
        entry=np.ascontiguousarray(M[kept] * eq.NS),
        order=order_of_rings(M),
        from_laser=np.ascontiguousarray(light.from_laser * root),
        from_delay=np.ascontiguousarray(light.from_delay * root),
        seen_ring=np.ascontiguousarray(light.seen_ring * root),
        seen_laser=np.ascontiguousarray(light.seen_laser),
        seen_delay=np.ascontiguousarray(light.seen_delay),
        delay=light.delay / eq.NS,
    )
