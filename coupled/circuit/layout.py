"""Rings, heat, light and drive of a circuit as the compiled code takes them, in the units of `kernels.equations`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.compiling import inlined
from ..kernels.equations import Array, Rates

Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]


class Rings(NamedTuple):
    """N rings in internal units."""

    rates: Array  # shape (N, 10), the fields of `equations.Rates`
    fcd: Array  # shape (N, terms, 2); a term that a ring lacks is (0, 1)
    floor: Array  # shape (N, 3), sizes below which errors are not relative


class Heat(NamedTuple):
    """Thermal states of every ring: dx/dt = gain P - rate x, dT_i = sum_jk read_ijk x_jk (+ curvature of its own)."""

    gain: Array  # shape (N, K), K/fJ
    rate: Array  # shape (N, K), 1/ns
    read: Array  # shape (N, N, K)
    curvature: float  # 1/K
    crossed: bool  # whether heat goes from ring to ring
    cross: Array  # read, without that of the own ring; shape (N, N K), or (N, 0) where no heat is crossed
    kind: Integers  # which of the G kinds each ring is, shape (N,)
    kind_rate: Array  # rates of each kind, shape (G, K)
    kind_share: Array  # gain times own read of each kind, shape (G, K)


class LightNetwork(NamedTuple):
    """Light between rings, with L lasers, D delayed waveguides and Q observed waves."""

    real: Array  # Re M off its diagonal, transposed: [j, i] is what ring j sends into ring i; shape (N, N), 1/ns
    imaginary: Array  # Im M likewise
    own: Complex  # diagonal of M, shape (N,)
    taken: Complex  # where M is taken_i sent_j for j before i in ``order``; else empty; shape (N,)
    sent: Complex
    fed: Integers  # rings that ring j feeds: no other than those from fed[j, 0] to fed[j, 1] - 1; shape (N, 2)
    order: Integers  # in which light reaches the rings, shape (N,), or empty: it runs in loops
    from_laser: Complex  # shape (N, L), 1/sqrt(ns)
    from_delay: Complex  # shape (N, D)
    seen_ring: Complex  # observed waves, the starts of the delayed waveguides first; shape (Q, N)
    seen_from: Integers  # rings in a wave: no other than those from seen_from[q, 0] to [q, 1] - 1; shape (Q, 2)
    seen_laser: Complex  # shape (Q, L)
    seen_delay: Complex  # shape (Q, D)
    delay: Array  # shape (D,), ns


class LaserTable(NamedTuple):
    """Lasers and detunings: cubics in the time since the edge of their piece."""

    edges: Array  # ns, where steps end, shape (m + 1,)
    power_piece: Integers  # shape (m,)
    detuning_piece: Integers
    power_edges: Array
    power: Array  # uW, shape (pieces, L, 4)
    detuning_edges: Array
    detuning: Array  # rad/ns, shape (pieces, N, 4)
    turn: Array  # rad/ns, of each laser against the common frame, shape (L,)
    largest: Array  # uW, shape (L,)
    hair: float  # ns, by which times of fronts may be off
    beat: float  # rad/ns, fastest turn of light that reaches an observed wave past the rings


@inlined
def rates_of(rings: Rings, i: int) -> Rates:
    """Return the rates of one ring by name."""
    r = rings.rates[i]
    return Rates(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9])
