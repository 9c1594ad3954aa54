"""Lasers, detunings and edges of a run of a circuit, as the compiled integration takes them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from thermofem import Symbols, checks
from thermofem.arrays import Array

from ..arguments import detuning_in_time, power_in_time
from ..inputs import Pieces, add, bounds, integral, joint, largest, pieces, table
from ..kernel import units as eq
from ..kernel.integrator import Drive, Polynomials
from .circuit import Circuit
from .network import Light

log = logging.getLogger("thermofem")

ECHO = 1e-7  # of the light: edges that come back weaker are left to the error control
HAIR = 1e-13  # of a run: edges that are nearer to each other are one; sums of hundreds of delays differ by less
MOST_EDGES = 5_000_000


def powers_of(circuit: Circuit, power: Mapping[str, Any], duration: float) -> list[Pieces]:
    """Power of every laser in W as a piecewise cubic; 0 where none is given.

    Raises InputError: no mapping, a name that is no laser, or a power out of range.
    """
    checks.has("power", power, "items", hint="give powers by the lasers' names, {'in': 1e-3}")
    names = [laser.name for laser in circuit.lasers]
    for name in power:
        checks.choice("a name in power", name, names)
    values = [power_in_time(power.get(name, 0.0), duration) for name in names]
    return [pieces(f"power[{name!r}]", value, 0.0, duration) for name, value in zip(names, values, strict=True)]


def warn_of_fast_streams(circuit: Circuit, power: Mapping[str, Any]) -> None:
    """Log a warning where a node of a stream is shorter than the photon lifetime 1/(2 gamma) of a ring."""
    lifetime, name = max((1 / (2 * ring.linear_rate), name) for name, ring in circuit.rings.items())
    for laser, own in power.items():
        for wave in own if isinstance(own, list | tuple) else [own]:
            if isinstance(wave, Symbols) and wave.rate * np.size(wave.mask) * lifetime > 1:
                node = 1 / (wave.rate * np.size(wave.mask))
                log.warning(
                    f"power[{laser!r}]: a node of the stream lasts {node:.2g} s, less than the photon lifetime of "
                    f"{name!r} ({lifetime:.2g} s), which averages over nodes; take a lower rate or a shorter mask"
                )


def corners(circuit: Circuit, light: Light) -> Array:
    """2 pi times the bandwidth of the detector of every observed wave in 1/ns; empty where none has one."""
    if not any(circuit.bandwidths):
        return np.empty(0)
    first = light.delay.size
    found = np.zeros(len(light.terminals))
    found[first : first + len(circuit.ports)] = 2 * np.pi * eq.NS * np.array(circuit.bandwidths)
    return found


def detunings_of(circuit: Circuit, detuning: Any, duration: float) -> list[Pieces]:
    """Detuning of every laser in Hz as a piecewise cubic: all together, or by the lasers' names.

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
                f"power: its edges and echoes are more than {MOST_EDGES:g}; shorten the run or lengthen the delays"
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


def drive_of(
    circuit: Circuit, light: Light, powers: list[Pieces], detunings: list[Pieces], offsets: list[Pieces]
) -> Drive:
    """Lasers in W, their detunings in Hz, and what the heaters add to each ring in K, as the kernel takes them.

    Fields turn with the first laser; the phase of another is the integral of the difference.
    """
    first, duration = detunings[0], powers[0].edges[-1]
    edges, scale = joint(first, *offsets), eq.NS ** np.arange(4)
    turning = np.repeat(first.on(edges).coefficients[:, None] * (2 * np.pi * eq.NS), len(offsets), axis=1)
    for i, (ring, offset) in enumerate(zip(circuit.resonators, offsets, strict=True)):
        turning[:, i, 0] += eq.internal_detuning(
            float(circuit.frequency or 0.0) - ring.frequency + circuit.lasers[0].offset
        )
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
    duration = detunings[0].edges[-1]
    apart = [laser.offset - circuit.lasers[0].offset for laser in circuit.lasers]
    return [
        add([own, detunings[0].times(-1.0), pieces("offset", float(away), 0.0, duration)])
        for own, away in zip(detunings, apart, strict=True)
    ]


def beat_of(light: Light, circuit: Circuit, powers: list[Pieces], detunings: list[Pieces]) -> float:
    """Fastest beat in an observed wave, rad/ns: of two lit lasers, or of one with light of rings or delays.

    Light of rings and delays is held in the common frame.
    """
    lit = np.array([bool(np.any(power.coefficients)) for power in powers])
    turn = 2 * np.pi * eq.NS * np.array([max(bounds(one), key=abs) for one in turns(circuit, detunings)])
    fastest = 0.0
    for q in range(len(light.terminals)):
        late, ringed = bool(light.seen_delay[q].any()), bool(light.seen_ring[q].any())
        seen = turn[lit & ((light.seen_laser[q] != 0) | late)]
        if seen.size:
            fastest = max(
                fastest, float(np.ptp(np.append(seen, 0.0) if late or ringed or q < light.delay.size else seen))
            )
    return fastest
