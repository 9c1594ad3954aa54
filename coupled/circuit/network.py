"""Elimination of the waveguides: light that each ring receives from other rings, lasers and delayed waveguides.

With K the amplitude rates sqrt(2 gamma) of the couplers, S what passes rings and splitters, C the waveguides without
delay, D those with delay, E the lasers, all at the frequency of the common frame,

    s_out = S s_in + i K a,    s_in = C s_out + D u + E l,    u(t) = s_out(t - delay)
    s_in  = G (C i K a + D u + E l),    G = (1 - C S)^-1
    da/dt = ... + M a + i K^T G (E l + D u),    M = i K^T G C i K

Source: W. Suh, Z. Wang and S. Fan, IEEE J. Quantum Electron. 40, 1511 (2004).
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, Complex, NDArray

from ..kernel import units as eq
from ..kernel.integrator import LOOPS, ORDERED, Network
from .circuit import Circuit, Waveguide

NOTHING = 1e-14  # of the largest entry of M: round-off


@dataclass(frozen=True, eq=False)
class Light:
    """The matrices of a circuit in SI: rates in 1/s, waves in sqrt(W), fields in sqrt(J).

    between [shape (N, N), 1/s]: M.
    from_laser, from_delay [shape (N, L) and (N, D), 1/sqrt(s)]: K^T G E and K^T G D.
    seen_ring, seen_laser, seen_delay [shape (Q, N), (Q, L) and (Q, D)]: the waves at ``terminals``.
    terminals: starts of the delayed waveguides, then the detectors, then the starts of the waveguides that lose light.
    delay [shape (D,), s]
    lost [shape (Q,)]: share of the power at each terminal that its waveguide loses.
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


def light_of(circuit: Circuit, offset: float = 0.0) -> Light:
    """Eliminate the waveguides of a circuit whose frame turns at its reference frequency plus ``offset`` in Hz.

    Raises InputError: a loop of waveguides without delay and without loss, in which light would pile up.
    """
    from scipy.sparse import csc_array, eye_array, lil_array
    from scipy.sparse.linalg import splu

    entry = {name: k for k, name in enumerate(circuit.entries)}
    exit = {name: k for k, name in enumerate(circuit.exits)}
    n, size = len(circuit.names), len(entry)
    K = np.zeros((size, n), dtype=complex)
    for i, ring in enumerate(circuit.resonators):
        K[2 * i, i], K[2 * i + 1, i] = np.sqrt(2 * ring.bus_rate), np.sqrt(2 * ring.drop_bus_rate)
    S = lil_array(eye_array(size, dtype=complex))
    for k, splitter in enumerate(circuit.splitters):
        straight, cross = np.sqrt(1 - splitter.cross), 1j * np.sqrt(splitter.cross)
        at = 2 * (n + k)
        S[at : at + 2, at : at + 2] = [[straight, cross], [cross, straight]]
    late = [w for w in circuit.waveguides if w.delay > 0]
    C, D = lil_array((size, size), dtype=complex), np.zeros((size, len(late)), dtype=complex)
    for w in circuit.waveguides:
        if w.delay == 0:
            C[entry[w.stop], exit[w.start]] = w.transmission
    for d, w in enumerate(late):
        D[entry[w.stop], d] = w.transmission * cmath.exp(-2j * np.pi * offset * w.delay)
    E = np.zeros((size, len(circuit.lasers)), dtype=complex)
    for k, laser in enumerate(circuit.lasers):
        E[entry[laser.stop], k] = laser.transmission
    S, C = S.tocsr(), C.tocsr()
    try:
        factors = splu(csc_array(eye_array(size) - C @ S))  # nearly every entry is zero
        pivots = np.abs(factors.U.diagonal())
    except RuntimeError:  # exactly singular
        pivots = np.zeros(1)
    # pivots of 1 - C S below 1e-8 of the largest: a loop without delay and without loss
    if pivots.min() < 1e-8 * pivots.max() or not pivots.max():
        raise checks.InputError(
            "the waveguides form a loop without delay and without loss in which light piles up; "
            "give one of them a delay, a loss or another phase"
        )
    from_ring, from_laser, from_delay = (
        factors.solve(waves) if waves.size else waves for waves in (C @ (1j * K), E, D)
    )
    lossy = [w for w in circuit.waveguides if w.loss > 0]
    terminals = (*(w.start for w in late), *circuit.outputs.values(), *(w.start for w in lossy))
    rows = [exit[name] for name in terminals]
    lost = np.zeros(len(terminals))
    lost[len(terminals) - len(lossy) :] = [1 - abs(w.transmission) ** 2 for w in lossy]
    return Light(
        between=1j * K.T @ from_ring,
        from_laser=K.T @ from_laser,
        from_delay=K.T @ from_delay,
        seen_ring=(S @ from_ring + 1j * K)[rows],
        seen_laser=(S @ from_laser)[rows],
        seen_delay=(S @ from_delay)[rows],
        terminals=terminals,
        delay=np.array([w.delay for w in late]),
        lost=lost,
    )


def order_of_rings(between: Complex) -> NDArray[np.int64]:
    """Topological order of the rings along the light between them; empty where that runs in loops."""
    n = len(between)
    size = np.abs(between).max(initial=0.0)
    feeds = (np.abs(between) > NOTHING * size) & ~np.eye(n, dtype=bool)
    order: list[int] = []
    left = set(range(n))
    while left:
        ready = sorted(i for i in left if not any(feeds[i, j] for j in left))
        if not ready:
            return np.empty(0, dtype=np.int64)
        order += ready
        left -= set(ready)
    return np.array(order, dtype=np.int64)


def check_delays(circuit: Circuit) -> None:
    """Raise InputError for a delay far below the photon lifetime, which would limit the step size."""
    fastest = max(ring.linear_rate for ring in circuit.resonators)
    for w in circuit.waveguides:
        if 0 < w.delay < SHORTEST / fastest:
            raise checks.InputError(
                f"{_way(w)}: delay = {w.delay:g} s is shorter than {SHORTEST:g} of the rings' photon lifetime "
                f"({1 / fastest:.2g} s), and no step may be longer; set it to 0 and keep the phase"
            )


SHORTEST = 1e-2


def _way(w: Waveguide) -> str:
    return f"waveguide from {w.start!r} to {w.stop!r}"


def network_of(light: Light, *, corner: Array, energies: bool, hair: float) -> Network:
    """The waveguides in the kernel's units; entries of M that are round-off become 0.

    corner [shape (Q,) or empty, 1/ns]: 2 pi times the bandwidths of the detectors; hair [ns].
    """
    M, root = light.between * eq.NS, np.sqrt(eq.NS)
    feeds = (np.abs(M) > NOTHING * np.abs(M).max(initial=0.0)) & ~np.eye(len(M), dtype=bool)
    order, between = order_of_rings(M), np.where(feeds, M, 0)
    taken, sent = _one_waveguide(between, order)
    needed = bool(light.delay.size) or bool(corner.size) or energies
    waves = slice(None) if needed else slice(0)  # others follow from the rows
    return Network(
        light=ORDERED if order.size else LOOPS,
        own=np.diag(M),
        sequence=(order if order.size else np.arange(len(M))).astype(np.int32),
        between=None if taken is not None else between,
        taken=taken,
        sent=sent,
        delay=light.delay / eq.NS,
        late=light.from_delay * root,
        seen_ring=light.seen_ring[waves] * root,
        seen_laser=light.seen_laser[waves],
        seen_late=light.seen_delay[waves],
        corner=corner if corner.size else None,
        energies=energies,
        hair=hair,
    )


def _one_waveguide(M: Complex, order: NDArray[np.int64]) -> tuple[Complex | None, Complex | None]:
    """The vectors of M_ij = taken_i sent_j below its diagonal, as along one bus, or None where M has no such form."""
    if len(M) < 2 or order.size == 0 or not M[order[-1], order[0]]:
        return None, None
    ordered = M[np.ix_(order, order)]
    taken, sent = np.zeros(len(M), dtype=complex), np.zeros(len(M), dtype=complex)
    taken[1:] = ordered[1:, 0]
    sent[:-1] = ordered[-1, :-1] / taken[-1]
    if np.abs(np.tril(np.outer(taken, sent), -1) - ordered).max() > NOTHING * np.abs(ordered).max():
        return None, None
    back = np.argsort(order)
    return taken[back], sent[back]
