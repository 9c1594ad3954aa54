"""Conversion of a circuit, its heat and its drive to the arguments of the compiled code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem.arrays import Array, NDArray

from ..inputs import Input, Pieces
from ..runs.window import floor_of
from .circuit import Circuit
from .drive import detuning_of, internal_drive, powers_of
from .heat import RingHeat, heater_offsets, ring_heat
from .network import NOTHING, Light, light_of, order_of_rings


@dataclass(frozen=True, eq=False)
class System:
    """A circuit under its drive: light, heat and powers in SI, and the same in internal units (the types of `layout`).

    powers [W]: of the lasers.
    heaters [W]: powers of the heaters that are given.
    offsets [K]: what the heaters add to each ring.
    heater_states: of all heaters at the end of the run.
    detuning [Hz]: 0 where it varies.
    frame [Hz]: the detuning over time.
    drive, rings, states, net [layout.LaserTable, Rings, Heat and LightNetwork]
    """

    light: Light
    heat: RingHeat
    powers: list[Pieces]
    heaters: dict[str, Pieces]
    offsets: list[Pieces]
    heater_states: Array
    detuning: float
    frame: Pieces
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
    rtol: float = 1e-6,
    before: Array | None = None,
) -> System:
    """Convert a circuit and its drive; arguments and errors as of `simulate_circuit`.

    before: states of the heaters at the end of a run that this one goes on from.
    """
    heat = ring_heat(thermal, circuit.names)
    powers = powers_of(circuit, inputs, duration)
    frame, constant = detuning_of(circuit, detuning, duration)
    light = light_of(circuit, constant + circuit.lasers[0].offset)
    watts, offsets, ends = heater_offsets(heat, heaters, duration, rtol, before)
    drive = internal_drive(circuit, light, powers, frame, offsets, duration)
    rings = _rings(circuit, light, heat, drive.largest)
    return System(
        light, heat, powers, watts, offsets, ends, constant, frame, drive, rings, _states(heat), _network(light)
    )


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
    rates = np.array([tuple(rates) for rates, _ in converted], dtype=float)
    whole = np.sqrt(largest.sum())
    floors = []
    for i, ((own_rates, _), ring) in enumerate(zip(converted, circuit.resonators, strict=True)):
        reaching = float((np.abs(light.from_laser[i]) * np.sqrt(largest)).sum() * np.sqrt(eq.NS))
        if reaching < 1e-6 * whole * np.sqrt(2 * ring.bus_rate * eq.NS):  # by other rings or delays only
            reaching = float(whole * np.sqrt(2 * ring.bus_rate * eq.NS))
        floors.append(floor_of(own_rates, reaching, heat.thermal_resistance[i] * eq.UW))
    return Rings(rates, fcd, np.array(floors))


def _states(heat: RingHeat) -> Any:
    """The thermal states in internal units."""
    from ..kernels import equations as eq
    from .layout import Heat

    gain, rate = heat.gain * (eq.UW * eq.NS), heat.rate * eq.NS
    read = np.ascontiguousarray(heat.read)
    share = gain * np.einsum("iik->ik", read)
    _, first, kind = np.unique(np.hstack([rate, share]), axis=0, return_index=True, return_inverse=True)
    cross = read.copy() if heat.crossed else np.zeros((len(read), len(read), 0))
    cross[np.arange(len(read)), np.arange(len(read))] = 0.0
    return Heat(
        gain, rate, read, heat.curvature, heat.crossed, cross.reshape(len(read), -1), kind.ravel().astype(np.int64),
        np.ascontiguousarray(rate[first]), np.ascontiguousarray(share[first]),
    )  # fmt: skip


def _network(light: Light) -> Any:
    """The waveguides in internal units, without what round-off left of M."""
    from ..kernels import equations as eq
    from .layout import LightNetwork

    M = light.between
    kept = np.abs(M) > NOTHING * np.abs(M).max(initial=0.0)
    feeds = kept & ~np.eye(len(M), dtype=bool)
    root, order = np.sqrt(eq.NS), order_of_rings(M)
    taken, sent = _one_waveguide(np.where(feeds, M * eq.NS, 0), order)
    return LightNetwork(
        real=np.ascontiguousarray(np.where(feeds, M, 0).T.real * eq.NS),
        imaginary=np.ascontiguousarray(np.where(feeds, M, 0).T.imag * eq.NS),
        own=np.diag(M) * eq.NS,
        taken=taken,
        sent=sent,
        fed=_ranges(feeds.T),
        order=order,
        from_laser=np.ascontiguousarray(light.from_laser * root),
        from_delay=np.ascontiguousarray(light.from_delay * root),
        seen_ring=np.ascontiguousarray(light.seen_ring * root),
        seen_from=_ranges(light.seen_ring != 0),
        seen_laser=np.ascontiguousarray(light.seen_laser),
        seen_delay=np.ascontiguousarray(light.seen_delay),
        delay=light.delay / eq.NS,
    )


def _one_waveguide(M: NDArray[np.complex128], order: NDArray[np.int64]) -> tuple[Any, Any]:
    """Factors of an M that is taken_i sent_j below its diagonal, as along one bus; else empty."""
    none = np.zeros(0, dtype=complex)
    if len(M) < 3 or order.size == 0 or not M[order[-1], order[0]]:
        return none, none
    ordered = M[np.ix_(order, order)]
    taken, sent = np.zeros(len(M), dtype=complex), np.zeros(len(M), dtype=complex)
    taken[1:] = ordered[1:, 0]
    sent[:-1] = ordered[-1, :-1] / taken[-1]
    if np.abs(np.tril(np.outer(taken, sent), -1) - ordered).max() > NOTHING * np.abs(ordered).max():
        return none, none
    back = np.argsort(order)
    return taken[back], sent[back]


def _ranges(used: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First and one behind the last of the marked columns of every row."""
    numbers = np.arange(used.shape[1])
    stop = np.where(used, numbers + 1, 0).max(axis=1, initial=0)
    start = np.where(used, numbers, used.shape[1]).min(axis=1, initial=used.shape[1])
    return np.column_stack([np.minimum(start, stop), stop]).astype(np.int64)
