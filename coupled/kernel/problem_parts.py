"""What a problem of the kernel consists of, in its units (`units`): rings, heat, drive, and light between rings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, Complex, NDArray

SINGLE, BUS, LOOPS = range(3)  # how light passes the rings, as in equations.hpp


class Rings(NamedTuple):
    """Parameters of R rings with F optical fields (resonances) each, in the kernel's units."""

    modes: Array
    """Shape (R, F, 8); the last axis has the fields of `units.Mode`."""
    carriers: Array
    """Shape (R, 3): tau0 (ns), a and b (m^3/1e23) of the lifetime tau(N) = tau0 (1 + a N)/(1 + b N)."""
    dispersion: Array
    """Shape (R, terms, 2): c_k and p_k of the dispersion sum_k c_k N^p_k in rad/ns; an unused term is (0, 1)."""
    floor: Array
    """Shape (R, 3): sizes of field, N and dT below which errors are absolute (`units.floor_of`)."""
    bend: float = 0.0
    """Coefficient of the output map dT = z + bend z^2, 1/K."""


class PoleHeat(NamedTuple):
    """Linear thermal model of R rings with K poles each: dx_k/dt = gain_k P - rate_k x_k, z = sum_k read_k x_k."""

    gain: Array
    """Shape (R, K), K/fJ. ``rate`` (1/ns) and ``read`` (1 for a single ring, where it is None) have the same shape."""
    rate: Array
    read: Array | None = None
    cross: Array | None = None
    """Shape (R, R, K): the temperature of ring i gains sum_jk cross_ijk x_jk from the other rings j."""


class QuadraticHeat(NamedTuple):
    """Quadratic thermal model of one ring with n states: dx/dt = A x + H[x, x] + (G x + B) P, z = C x.

    H[x, x]_i = sum_jk H_ijk x_j x_k; P is the absorbed power in uW, z the temperature rise in K.
    weight [shape (n,)]: error of the temperature in K per unit error of each state, for the step-size control.
    """

    A: Array
    H: Array
    G: Array
    B: Array
    C: Array
    weight: Array


class Polynomials(NamedTuple):
    """Piecewise polynomials of the time in ns, as plain arrays, which are made faster than `Pieces`.

    coefficients [shape (pieces, functions, terms)]: as of `piecewise.Pieces`, constant term first.
    """

    edges: Array
    coefficients: Array

    def over(self, edges: Array, size: Callable[[Array], Array], least: float | Array) -> tuple[NDArray[Any], ...]:
        """Return, for each interval between ``edges``, the piece there, and whether the functions jump and vary.

        They jump where the ``size`` of one changes by more than ``least`` at the start of the interval.
        """
        c = self.coefficients
        varies = np.any(c[:, :, 1:], axis=(1, 2))
        jumped = np.zeros(len(edges) - 1, dtype=bool)
        if len(c) == 1:
            place = np.zeros(len(edges) - 1, dtype=int)
            return place, jumped, varies[place]
        middles = (edges[1:] + edges[:-1]) / 2
        place = np.searchsorted(self.edges[1:-1], middles, side="right")
        starts = c[:, :, 0]
        powers = np.diff(self.edges)[:, None, None] ** np.arange(c.shape[2])
        ends = (c * powers).sum(axis=2)
        change = np.abs(size(starts[1:]) - size(ends[:-1]))
        jumps = (change > least).any(axis=1)
        before = np.append(0, jumps.cumsum())  # number of jumps up to the start of each piece
        jumped[1:] = np.diff(before[place]) > 0
        return place, jumped, varies[place]


class Drive(NamedTuple):
    """Powers and phases of L lasers, and detunings of all R F fields, as piecewise polynomials of the time in ns."""

    edges: Array
    """Breakpoints of the drive, ns, increasing; a step ends at each."""
    power: Polynomials
    """Power of each laser, values of shape (times, L); |entry|^2 power is in fJ/ns^2."""
    phase: Polynomials
    """Phase of each laser in rad, values of shape (times, L)."""
    detuning: Polynomials
    """Detuning of each field in rad/ns, values of shape (times, R F)."""
    entry: Complex
    """Shape (R F, L): drive amplitude of each field per square root of the power of each laser."""
    brightest: Array
    """Shape (L,): largest power of each laser, above 0."""

    @classmethod
    def constant(cls, power: float, detuning: float, duration: float) -> Drive:
        """Return the drive of one ring under constant light: 2 gamma_e P (fJ/ns^2), detuning (rad/ns), length (ns)."""
        edges = np.array([0.0, duration])

        def steady(value: float) -> Polynomials:
            return Polynomials(edges, np.full((1, 1, 1), value))

        entry = np.ones((1, 1), dtype=complex)
        brightest = np.array([max(power, 1e-300)])
        return cls(edges, steady(power), steady(0.0), steady(detuning), entry, brightest)


class Network(NamedTuple):
    """Optical coupling of the R rings of a circuit to each other, to L lasers, D delays and Q observed waves.

        da_i/dt = ... + sum_j M_ij a_j + i sum_d late_id u_d(t),     u_d(t) = wave_d(t - delay_d)
        wave_q  = sum_j seen_ring_qj a_j + sum_l seen_laser_ql s_l + sum_d seen_late_qd u_d

    light: BUS where light passes the rings in one order and M_ij = taken_i sent_j [shape (R,) each], LOOPS elsewhere.
    own [shape (R,), 1/ns]: M_ii, the coupling of each ring to itself.
    sequence [shape (R,)]: ring numbers in the order in which light passes them.
    between [shape (R, R), 1/ns]: M_ij, the coupling from ring j to ring i.
    delay [shape (D,), ns]
    late [shape (R, D)]: coupling of the delayed waves u_d into each ring.
    seen_ring, seen_laser, seen_late [shapes (Q, R), (Q, L), (Q, D)]; the first D waves are the inputs of the delays.
    corner [shape (Q,), 1/ns]: 2 pi times the bandwidth of the detector of each wave, 0 for none; None if all have none.
    energies: whether the energy of each wave, the integral of its power since the start, is computed.
    time_tolerance [ns]: round-off of the arrival time of a wave front. If a front of delayed light arrives within it of
        an end of a step, the value on the side inside the step is used.
    """

    light: int
    own: Complex
    sequence: NDArray[np.int32]
    between: Complex
    taken: Complex | None
    sent: Complex | None
    delay: Array
    late: Complex
    seen_ring: Complex
    seen_laser: Complex
    seen_late: Complex
    corner: Array | None
    energies: bool
    time_tolerance: float
