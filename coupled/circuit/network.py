"""Coupling of the rings of a circuit: light through waveguides, which are eliminated, and heat from ring to ring.

With K the amplitude rates sqrt(2 gamma) of the couplers, S the direct transmission of rings and splitters, C the
waveguides without delay, D those with delay, E the lasers, all in the frame of one frequency,

    s_out = S s_in + i K a,    s_in = C s_out + D u + E l,    u(t) = s_out(t - delay)
    s_in  = G (C i K a + D u + E l),    G = (1 - C S)^-1
    da/dt = ... + M a + i K^T G (E l + D u),    M = i K^T G C i K

The thermal model is one for all rings, or one with an input and an output for each ring. A mode of an N x N model that
several rings heat is replaced by one state per heating ring; as the model is linear, their sum is the state of that
mode. A model of `surrogate.reduce_array` has no such modes and keeps its states.

Source: W. Suh, Z. Wang and S. Fan, IEEE J. Quantum Electron. 40, 1511 (2004).
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np

from thermofem import InputError, StateSpace, checks
from thermofem.arrays import Array, Complex, NDArray
from thermofem.geometry.section_parts import AMBIENT, LIGHT
from thermofem.models.contract import bare
from thermofem.models.state_space import eigenmodes, has_ports

from ..heaters import Poles, channels
from ..kernel import units as eq
from ..kernel.problem_parts import BUS, LOOPS, Network
from ..resonator import RingResonator
from ..thermal import check_ports, check_resistance, poles
from .circuit import Circuit

log = logging.getLogger("thermofem")

NO_COUPLING = 1e-14  # of the largest entry of M
PILED = 1e-8  # smallest singular value of 1 - C S: light in a loop is 1e8 times that which enters it
NOTHING = 1e-15  # of a ring's R_th, what a state adds to any ring


@dataclass(frozen=True, eq=False)
class Light:
    """The matrices of a circuit of N rings, L lasers, D delays and Q observed waves in SI (sqrt(W), fields in sqrt(J)).

    between [shape (N, N), 1/s]: M.
    from_laser, from_delay [shape (N, L) and (N, D), 1/sqrt(s)]: K^T G E and K^T G D.
    seen_ring, seen_laser, seen_delay [shape (Q, N), (Q, L) and (Q, D)]: coefficients of the waves at ``terminals``.
    terminals: starts of the delayed waveguides, then the detectors, then the starts of the waveguides that lose light.
    delay [shape (D,), s]
    lost [shape (Q,)]: fraction of the power at each terminal that its waveguide loses.
    corner [shape (Q,), 1/s]: 2 pi times the bandwidth of the detector at each terminal; 0 for none.
    """

    between: Complex
    from_laser: Complex
    from_delay: Complex
    seen_ring: Complex
    seen_laser: Complex
    seen_delay: Complex
    terminals: tuple[str, ...]
    delay: Array
    lost: Array
    corner: Array

    def at(self, offset: float) -> "Light":
        """The matrices in a frame whose frequency is higher by ``offset`` (Hz): only the phases of delays change."""
        turn = np.exp(-2j * np.pi * offset * self.delay)
        return replace(self, from_delay=self.from_delay * turn, seen_delay=self.seen_delay * turn)


def light_of(circuit: Circuit, offset: float | None = None) -> Light:
    """Eliminate the waveguides of a circuit, in the frame of its reference frequency.

    offset [Hz]: of steady light above that frequency, for which a delay is a phase; None keeps the delays.
    Raises InputError: a resonant loop of waveguides without loss, for which 1 - C S is singular.
    """
    entry = {name: k for k, name in enumerate(circuit.entries)}
    exit = {name: k for k, name in enumerate(circuit.exits)}
    n = len(circuit.names)
    size = len(entry)
    late = [w for w in circuit.waveguides if w.delay > 0 and offset is None]
    lossy = [w for w in circuit.waveguides if w.loss > 0]
    sources: list[Any] = [*circuit.lasers, *late]
    K = np.zeros((size, n), dtype=complex)
    C = np.zeros((size, size), dtype=complex)
    ED = np.zeros((size, len(sources)), dtype=complex)
    S = np.eye(size, dtype=complex)
    for i, ring in enumerate(circuit.resonators):
        K[2 * i, i] = np.sqrt(2 * ring.bus_rate)
        K[2 * i + 1, i] = np.sqrt(2 * ring.drop_bus_rate)
    for k, splitter in enumerate(circuit.splitters, n):
        straight = np.sqrt(1 - splitter.cross)
        cross = 1j * np.sqrt(splitter.cross)
        ports = slice(2 * k, 2 * k + 2)
        S[ports, ports] = [[straight, cross], [cross, straight]]
    for w in circuit.waveguides:
        if w not in late:
            C[entry[w.stop], exit[w.start]] = w.transmission * np.exp(-2j * np.pi * (offset or 0.0) * w.delay)
    for k, source in enumerate(sources):
        ED[entry[source.stop], k] = source.transmission
    around = np.eye(size) - C @ S
    if np.linalg.norm(around, -2) < PILED:
        raise InputError(
            "the waveguides form a loop without loss in which light piles up; give one of them a loss, a delay or "
            "another phase"
        )
    inside = np.linalg.solve(around, np.hstack([C @ (1j * K), ED]))
    from_ring, from_laser, from_delay = np.split(inside, [n, n + len(circuit.lasers)], axis=1)
    observed = [(w.start, 0.0, 0.0) for w in late]
    for terminal, bandwidth in zip(circuit.outputs.values(), circuit.bandwidths, strict=True):
        observed.append((terminal, 0.0, 2 * np.pi * bandwidth))
    observed += [(w.start, 1 - abs(w.transmission) ** 2, 0.0) for w in lossy]
    terminals, lost, corner = zip(*observed, strict=True)
    rows = [exit[name] for name in terminals]
    return Light(
        between=1j * K.T @ from_ring,
        from_laser=K.T @ from_laser,
        from_delay=K.T @ from_delay,
        seen_ring=(S @ from_ring + 1j * K)[rows],
        seen_laser=(S @ from_laser)[rows],
        seen_delay=(S @ from_delay)[rows],
        terminals=terminals,
        delay=np.array([w.delay for w in late]),
        lost=np.array(lost),
        corner=np.array(corner),
    )


def network_of(light: Light, *, detected: bool, energies: bool, time_tolerance: float) -> Network:
    """Convert the matrices of a circuit to the kernel's units; entries of M at round-off become 0.

    detected: whether to integrate the low passes of the detectors.
    energies: whether to integrate the output powers. time_tolerance [ns]: round-off error of times.
    """
    M = light.between * eq.NS
    root = np.sqrt(eq.NS)
    corner = light.corner * eq.NS * detected
    large = np.abs(M) > NO_COUPLING * np.abs(M).max()
    feeds = large & ~np.eye(len(M), dtype=bool)
    between = np.where(feeds, M, 0)
    feeders = {i: np.flatnonzero(row).tolist() for i, row in enumerate(feeds)}
    try:
        order = np.fromiter(TopologicalSorter(feeders).static_order(), np.int32)
    except CycleError:  # the rings form a loop
        order = np.empty(0, np.int32)
    taken, sent = _one_waveguide(between, order)
    one_bus = taken is not None
    any_order = np.arange(len(M), dtype=np.int32)
    filtered = bool(corner.any())
    needed = light.delay.size > 0 or filtered or energies
    waves = slice(None) if needed else slice(0)  # others follow from the rows
    return Network(
        light=BUS if one_bus else LOOPS,
        own=np.diag(M),
        sequence=order if order.size else any_order,
        between=between,
        taken=taken,
        sent=sent,
        delay=light.delay / eq.NS,
        late=light.from_delay * root,
        seen_ring=light.seen_ring[waves] * root,
        seen_laser=light.seen_laser[waves],
        seen_late=light.seen_delay[waves],
        corner=corner if filtered else None,
        energies=energies,
        time_tolerance=time_tolerance,
    )


def _one_waveguide(M: Complex, order: NDArray[np.int32]) -> tuple[Complex | None, Complex | None]:
    """Vectors t and s with M_ij = t_i s_j below the diagonal (rings on one bus); (None, None) if M has another form."""
    if order.size:
        first, last = order[[0, -1]]
        ordered = np.ix_(order, order)
        taken = M[:, first]
        sent = M[last] / (M[last, first] or 1.0)
        miss = np.tril(np.outer(taken, sent)[ordered], -1) - M[ordered]
        if np.abs(miss).max() <= NO_COUPLING * np.abs(M).max():
            return taken, sent
    return None, None


@dataclass(frozen=True, eq=False)
class RingHeat:
    """Thermal model of N rings in SI with K states for each ring; unused states have gain 0.

        dx_jk/dt = gain_jk P_j - rate_jk x_jk,    dT_i = sum_jk read_ijk x_jk

    gain, rate [shape (N, K); K/J and 1/s]
    read [shape (N, N, K)]
    curvature [1/K]: of an output map, if each ring has its own model.
    crossed: whether rings heat each other. heaters: `Poles` by heater.
    sensed: `Poles` from every input, rings first, to the temperatures ``sensors``, which the model reads, too.
    doubts: attribute of a result, where a ring reads another temperature than the model gives, or has another volume.
    """

    gain: Array
    rate: Array
    read: Array
    curvature: float
    crossed: bool
    heaters: Mapping[str, Poles]
    doubts: Mapping[str, str]
    sensors: Sequence[str] = ()
    sensed: Mapping[str, Poles] = field(default_factory=dict)

    @property
    def thermal_resistance(self) -> Array:
        """R_th of each ring under its own absorbed power, shape (N,), K/W."""
        own = np.einsum("iik->ik", self.read)
        return (own * self.gain / self.rate).sum(axis=1)


def ring_heat(thermal: Any, rings: Sequence[RingResonator], names: Sequence[str]) -> RingHeat:
    """The thermal states of the ``rings`` called ``names`` under a thermal model.

    thermal [Foster, StateSpace, OutputMap, or what holds one as ``.model``]: a model with one input and output applies
        to every ring separately; a StateSpace with one output per ring has the rings as its first inputs, then heaters.
        Its rings are matched by name if the names agree, else by order. Of one with more outputs, a layout, the rings
        are those of the names, and the other inputs heaters.
    Raises InputError: another number of rings, a model that is not symmetric, not passive, quadratic, or too large.
    """
    model = bare(thermal)
    parts = getattr(model, "heated", model.inputs)
    several = has_ports(model) and (len(parts), len(model.outputs)) != (1, 1)
    if several and not (len(parts) == 1 and {*model.outputs} <= {*parts, LIGHT}):
        return _of_array(model, rings, names)
    drives = {AMBIENT: 0.0} if AMBIENT in model.inputs else {}
    picked = [channels(thermal, ring.read, drives, parts[0]) for ring in rings]
    models = [channel.model for channel in picked]
    maps = [poles(small, "heat a circuit") for small in models]
    networks = [small.linear for small in maps]
    order = networks[0].order
    read = np.eye(len(rings))[:, :, None] * np.ones(order)
    gain = np.array([network.gain for network in networks])
    rate = np.array([1 / np.asarray(network.tau) for network in networks])
    heaters = {}
    if drives:
        ambient = [channel.transfers[AMBIENT] for channel in picked]
        gains = np.array([transfer.gain for transfer in ambient])
        heaters[AMBIENT] = Poles(1 / np.asarray(ambient[0].tau), gains)
    ports = [(small.inputs[0], small.outputs[0]) for small in models]
    doubts = _doubts(rings, thermal, ports)
    curvature = float(maps[0].coefficient)
    return RingHeat(gain, rate, read, curvature, False, heaters, doubts)


def _doubts(rings: Sequence[RingResonator], thermal: Any, ports: Sequence[tuple[str, str]]) -> dict[str, str]:
    """The warnings of `thermal.check_ports` on all rings with their (input, output), each once, as an attribute."""
    pairs = dict.fromkeys(zip(rings, ports, strict=True))
    words = [check_ports(ring, thermal, *port).get("warning", "") for ring, port in pairs]
    warnings = dict.fromkeys(filter(None, words))
    return {"warning": "; ".join(warnings)} if warnings else {}


def _of_array(system: StateSpace, resonators: Sequence[RingResonator], names: Sequence[str]) -> RingHeat:
    rings = len(names)
    model = system.of_rings(names)
    sensors = [name for name in system.outputs if name not in model.outputs]
    if len(model.outputs) != rings or len(model.inputs) < rings:
        raise InputError(
            f"thermal has {len(model.inputs)} inputs and {len(model.outputs)} outputs, the circuit {rings} rings; one "
            "of each for every ring is needed (surrogate.reduce_array), or one model for all rings"
        )
    rate, B, C = _modes(model, system.C[[system.outputs.index(name) for name in sensors]])
    places = model.outputs
    if places not in (tuple(names), tuple(f"ring {k + 1}" for k in range(rings))):
        log.warning("thermal is of %s: they stand for the rings %s, in this order", ", ".join(places), ", ".join(names))
    scale = np.abs(model.gain).max()
    heated = []  # states that each input heats
    for b in B.T:
        rises = np.abs(C * b / rate)
        check_resistance(float(rises.sum(axis=1).max()))
        heated.append(np.flatnonzero(rises.max(axis=0) > NOTHING * scale))
    most = max(k.size for k in heated[:rings])
    # from 8 states on a multiple of 4, the numbers that a processor adds at once
    most = most if most < 8 else -(-most // 4) * 4
    gain = np.zeros((rings, most))
    rates = np.full((rings, most), rate.max())
    read = np.zeros((rings, rings, most))
    for j, k in enumerate(heated[:rings]):
        gain[j, : k.size] = B[k, j]
        rates[j, : k.size] = rate[k]
        read[:, j, : k.size] = C[:rings, k]
    heaters = {}
    sensed = {}
    for name, b, k in zip((*names, *model.inputs[rings:]), B.T, heated, strict=True):
        sensed[name] = Poles(rate[k], C[rings:, k] * b[k])
        if name not in names:
            heaters[name] = Poles(rate[k], C[:rings, k] * b[k])
    ports = list(zip(model.inputs[:rings], places, strict=True))
    doubts = _doubts(resonators, model, ports)
    heat = RingHeat(gain, rates, read, 0.0, rings > 1, heaters, doubts, sensors, sensed)
    checks.positive("thermal: R_th of every ring", heat.thermal_resistance.min(), unit="K/W")
    return heat


def _modes(model: StateSpace, sensors: Array) -> tuple[Array, Array, Array]:
    """Decay rates (1/s), input matrix B and output matrix C in the eigenmodes of a small symmetric system.

    sensors: further rows of C.
    """
    # the matrices of more states, which are dense, would not fit
    checks.integer("states of thermal", model.order, 1, 20_000, hint="reduce it first (surrogate.reduce_array)")
    E = model.E.toarray() if hasattr(model.E, "toarray") else np.asarray(model.E, dtype=float)
    A = model.A.toarray() if hasattr(model.A, "toarray") else np.asarray(model.A, dtype=float)
    B = np.asarray(model.B, dtype=float)
    C = np.vstack([model.C, sensors])
    rates = -np.diag(A)
    modal = np.array_equal(E, np.eye(len(E))) and np.array_equal(A, np.diag(-rates))
    if modal and rates.min() > 0:
        return rates, B, C
    rates, modes = eigenmodes(model)
    return rates, modes.T @ B, C @ modes
