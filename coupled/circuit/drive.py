"""Lasers, detunings and edges of a run of a circuit, as the compiled integration takes them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from thermofem import Symbols, checks
from thermofem.arrays import Array, NDArray

from ..arguments import detuning_in_time, power_in_time
from ..inputs import Pieces, joint, pieces
from .circuit import Circuit
from .network import Light

log = logging.getLogger("thermofem")

ECHO = 1e-7  # of the light: edges that come back weaker are left to the error control
HAIR = 1e-13  # of a run: edges that are nearer to each other are one; sums of hundreds of delays differ by less
MOST_EDGES = 5_000_000


def powers_of(circuit: Circuit, inputs: Mapping[str, Any], duration: float) -> list[Pieces]:
    """Power of every laser in W as a piecewise cubic; 0 where none is given.

    Raises InputError: no mapping, a name that is no laser, or a power out of range.
    """
    checks.has("inputs", inputs, "items", hint="give powers by the lasers' names, {'in': 1e-3}")
    names = [laser.name for laser in circuit.lasers]
    for name in inputs:
        checks.choice("a name in inputs", name, names)
    found = []
    for name in names:
        value = power_in_time(inputs.get(name, 0.0), duration)
        found.append(pieces(f"inputs[{name!r}]", value, 0.0, duration))
    return found


def warn_of_fast_streams(circuit: Circuit, inputs: Mapping[str, Any]) -> None:
    """Log a warning where a node of a stream is shorter than the photon lifetime 1/(2 gamma) of a ring."""
    lifetime, name = max((1 / (2 * ring.linear_rate), name) for name, ring in circuit.rings.items())
    for laser, power in inputs.items():
        for wave in power if isinstance(power, list | tuple) else [power]:
            if isinstance(wave, Symbols) and wave.rate * np.size(wave.mask) * lifetime > 1:
                node = 1 / (wave.rate * np.size(wave.mask))
                log.warning(
                    f"inputs[{laser!r}]: a node of the stream lasts {node:.2g} s, less than the photon lifetime of "
                    f"{name!r} ({lifetime:.2g} s), which averages over nodes; take a lower rate or a shorter mask"
                )


def corners(circuit: Circuit, light: Light) -> Array:
    """2 pi times the bandwidth of the detector of every observed wave in 1/ns; empty where none has one."""
    from ..kernels import equations as eq

    if not any(circuit.bandwidths):
        return np.empty(0)
    first = light.delay.size
    found = np.zeros(len(light.terminals))
    found[first : first + len(circuit.ports)] = 2 * np.pi * eq.NS * np.array(circuit.bandwidths)
    return found


def detuning_of(circuit: Circuit, detuning: Any, duration: float) -> tuple[Pieces, float]:
    """Detuning of the frame in Hz as a piecewise cubic, and its constant value, 0 where it varies."""
    value = detuning_in_time(detuning, duration)
    constant = value if isinstance(value, float) else 0.0
    if not isinstance(value, float) and any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("detuning varies, and the circuit has delays, whose phases belong to one frequency")
    return pieces("detuning", value, 0.0, duration), constant


def echoes(edges: Array, light: Light, duration: float) -> Array:
    """Edges of the lasers and those that come back through the delays while they are strong enough.

    Light behind a delay is at most as strong as before it times the largest gain from any delay to any other past the
    rings. A ring makes a kink of a jump: one passage through a ring is counted as a gain of 1, more are left out.
    """
    delays = np.unique(light.delay)
    if not delays.size:
        return edges
    passing = light.seen_delay[: light.delay.size]
    gain = float(np.abs(passing).sum(axis=1).max(initial=0.0))
    found = newest = edges
    generation = 0
    while newest.size and gain ** max(generation - 1, 0) > ECHO:
        later = np.add.outer(newest, delays).ravel()
        newest = _apart(later[later < duration], duration)
        newest = newest[_distance(found, newest) > HAIR * duration]
        found = np.sort(np.concatenate([found, newest]))
        generation += 1
        if found.size > MOST_EDGES:
            raise checks.InputError(
                f"inputs: their edges and echoes are more than {MOST_EDGES:g}; shorten the run or lengthen the delays"
            )
    return found


def _apart(times: Array, duration: float) -> Array:
    """Times in increasing order, without those that are nearer than `HAIR` to the one before."""
    every = np.sort(times)
    return every[np.diff(every, prepend=-np.inf) > HAIR * duration]


def _distance(known: Array, times: Array) -> Array:
    """Distance of each time from the nearest of ``known``, which increase."""
    at = np.searchsorted(known, times)
    near = np.stack([known[at - 1], known[np.minimum(at, known.size - 1)]])
    return np.asarray(np.abs(near - times).min(axis=0))


def internal_drive(
    circuit: Circuit, light: Light, powers: list[Pieces], frame: Pieces, offsets: list[Pieces], duration: float
) -> Any:
    """The run's `layout.LaserTable`.

    powers [W]
    frame [Hz]: laser minus the circuit's reference frequency.
    offsets [K]: what the heaters add to each ring.
    """
    from ..kernels import equations as eq
    from .layout import LaserTable

    scale = eq.NS ** np.arange(4)
    power_edges = joint(*powers)
    power = np.stack([p.on(power_edges).coefficients for p in powers], axis=1) / eq.UW * scale
    detuning_edges = joint(frame, *offsets)
    turning = []
    for ring, offset in zip(circuit.resonators, offsets, strict=True):
        first = float(circuit.frequency or 0.0) - ring.frequency + circuit.lasers[0].offset
        c = frame.on(detuning_edges).coefficients.copy()
        c[:, 0] += first
        c = c * (2 * np.pi * eq.NS) + offset.on(detuning_edges).coefficients * (ring.thermal_shift * eq.NS)
        turning.append(c * scale)
    edges = echoes(power_edges, light, duration)
    every = _apart(np.concatenate([edges, detuning_edges]), duration)
    every[-1] = duration
    middle = (every[:-1] + every[1:]) / 2
    lasers = [laser.offset for laser in circuit.lasers]
    turn, largest = 2 * np.pi * eq.NS * (np.array(lasers) - lasers[0]), np.abs(power[:, :, 0]).max(axis=0)
    return LaserTable(
        edges=every / eq.NS,
        power_piece=np.clip(np.searchsorted(power_edges, middle) - 1, 0, len(power) - 1),
        detuning_piece=np.clip(np.searchsorted(detuning_edges, middle) - 1, 0, len(detuning_edges) - 2),
        power_edges=power_edges / eq.NS,
        power=np.ascontiguousarray(power),
        detuning_edges=detuning_edges / eq.NS,
        detuning=np.ascontiguousarray(np.stack(turning, axis=1)),
        turn=turn,
        largest=np.maximum(largest, 1e-300),
        hair=2 * HAIR * duration / eq.NS,
        beat=_beat(light, turn, largest > 0),
    )


def _beat(light: Light, turn: Array, lit: NDArray[np.bool_]) -> float:
    """Fastest beat in an observed wave, rad/ns: of two lit lasers, or of one with light of rings or delays.

    Light of rings and delays is held in the common frame.
    """
    fastest = 0.0
    for q in range(len(light.terminals)):
        late, ringed = bool(light.seen_delay[q].any()), bool(light.seen_ring[q].any())
        seen = turn[lit & ((light.seen_laser[q] != 0) | late)]
        if seen.size:
            fastest = max(
                fastest, float(np.ptp(np.append(seen, 0.0) if late or ringed or q < light.delay.size else seen))
            )
    return fastest
