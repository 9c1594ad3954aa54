"""ESDIRK4(3)6L[2]SA: an L-stable, stiffly accurate Runge-Kutta method of order 4 with an embedded error estimate.

Stage i solves (E - gamma h A) k_i = A (x + h sum_{j<i} a_ij k_j) + B P(t + c_i h); the last stage is the new state.

Source: C. A. Kennedy, M. H. Carpenter, NASA/TM-2016-219173, ESDIRK4(3)6L[2]SA.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix

from .. import checks
from ..algebra.factor import Pencil
from ..arrays import Array
from ..waveforms import Waveform

if TYPE_CHECKING:
    from ..models import StateSpace

_R2 = np.sqrt(2.0)
GAMMA = 0.25
FAR = 0.1  # of a probe's steady share of the field: the smallest scale to which the probe's error is relative
STAGE_TIMES = np.array([0, 1 / 2, (2 - _R2) / 4, 5 / 8, 26 / 25, 1])
STAGES = np.zeros((6, 6))  # strictly lower part; the diagonal is GAMMA
STAGES[1, 0] = 1 / 4
STAGES[2, :2] = (1 - _R2) / 8
STAGES[3, :3] = [(5 - 7 * _R2) / 64, (5 - 7 * _R2) / 64, 7 * (1 + _R2) / 32]
STAGES[4, :4] = [
    (-13796 - 54539 * _R2) / 125000,
    (-13796 - 54539 * _R2) / 125000,
    (506605 + 132109 * _R2) / 437500,
    166 * (-97 + 376 * _R2) / 109375,
]
STAGES[5, :5] = [
    (1181 - 987 * _R2) / 13782,
    (1181 - 987 * _R2) / 13782,
    47 * (-267 + 1783 * _R2) / 273343,
    -16 * (-22922 + 3525 * _R2) / 571953,
    -15625 * (97 + 376 * _R2) / 90749876,
]
WEIGHTS = np.append(STAGES[5, :5], GAMMA)
EMBEDDED = np.array(
    [
        -0.09651334216818033,
        -0.09651334216818033,
        0.5228199509962342,
        0.5205678646221885,
        -0.08255805440762122,
        0.23219692312555915,
    ]
)


def through(nodes: Array, x: float) -> Array:
    """Interpolation weights, shape (nodes,): weights @ values is the polynomial through the nodes at ``x``."""
    powers = np.arange(len(nodes))
    return np.linalg.solve(np.power.outer(nodes, powers).T, x**powers)


_THIRDS = np.array([0, 1 / 3, 2 / 3])
_EXTRAPOLATE = through(np.append(_THIRDS, 1), STAGE_TIMES[4])


class Stepper:
    """Steps of one linear system under its waveforms, with factorizations of E - shift A and counts of solves.

    factors: factorizations of E and -A that the caller keeps; None makes them.
    """

    def __init__(self, system: StateSpace, waves: Waveform | Sequence[Waveform], factors: Pencil | None = None) -> None:
        self.waves = tuple(waves) if isinstance(waves, Sequence) else (waves,)
        if len(self.waves) != len(system.inputs):
            raise checks.InputError(f"{len(self.waves)} waveforms for the inputs {system.inputs}; one each is needed")
        self.E = csr_matrix(system.E)
        self.A = csr_matrix(system.A)
        self.B = system.B
        self.C = system.C
        self.factors = Pencil(self.E, -self.A) if factors is None else factors
        self.steps = self.rejected = self.solves = 0
        self._factorized_before = self.factors.factorizations
        self._knots = np.empty(0)
        self.smooth_peak = 0.0
        self.least = 0.0  # W: errors of smaller rises than this power makes in the steady state are measured against it

    def solve(self, shift: float, rhs: Array) -> Array:
        """(E - shift A)^-1 rhs; shifts equal to 9 digits share a factorization."""
        self.solves += 1
        return self.factors.solve(1.0, shift, rhs)

    def static(self, rhs: Array) -> Array:
        """Steady field (-A)^-1 rhs."""
        self.solves += 1
        return self.factors.solve(0.0, 1.0, rhs)

    @property
    def factorizations(self) -> int:
        """Factorizations so far."""
        return self.factors.factorizations - self._factorized_before

    @cached_property
    def steady(self) -> Array:
        """Steady field with one watt in every input at small power, shape (n,)."""
        return self.static(self.B.sum(axis=1))

    @cached_property
    def far(self) -> Array:
        """`FAR` times the steady outputs over the norm of the steady field, shape (outputs,)."""
        outputs = np.abs(self.C @ self.steady)
        field = max(self.norm(self.steady), np.finfo(float).tiny)
        return FAR * outputs / field

    def edges(self, stop: float, rtol: float) -> Array:
        """Ends of the smooth pieces up to ``stop`` in s: 0, all breakpoints, ``stop``; prepares `resolves`."""
        tolerance = max(rtol, 1e-8)  # of a smooth power by a cubic, relative to its peak
        knots = [np.empty(0)]
        peaks = [0.0]
        breakpoints = [np.array([0.0, stop])]
        for wave in self.waves:
            breakpoints.append(wave.breakpoints(0.0, stop))
            if stop and not wave.piecewise_linear:
                fit = wave.pieces(0.0, stop, tolerance=tolerance)
                knots.append(fit.edges)
                peaks.append(float(np.abs(wave(fit.edges)).max()))
        self._knots = np.unique(np.concatenate(knots))
        self.smooth_peak = max(peaks)
        return np.unique(np.concatenate(breakpoints))

    def resolves(self, t: float, h: float) -> bool:
        """Whether no smooth power changes too fast for a step from ``t`` to ``t + h``.

        Between two knots a power equals one cubic within rtol. A step of at most twice the shortest interval that it
        touches samples the power on both sides of every fast change, so the error estimate includes it.
        """
        if not self._knots.size:
            return True
        after = np.searchsorted(self._knots, t + 1e-9 * h, side="right")
        last = np.searchsorted(self._knots, t + h * (1 - 1e-9), side="left")
        touched = self._knots[max(after - 1, 0) : last + 1]
        return h <= 2.001 * float(np.diff(touched).min(initial=np.inf))

    def sources(self, t: float, h: float, stop: float) -> Array:
        """B P in W at the six stages, shape (6, n).

        The fifth stage lies 4 % beyond the step; where that crosses the end of the smooth piece the cubic through four
        points of the step continues it, which keeps the order and is exact for straight pieces.
        """
        last = t + h >= stop * (1 - 1e-12)
        at = t + STAGE_TIMES * h
        powers = np.empty((len(self.waves), 6))
        for wave, power in zip(self.waves, powers, strict=True):
            power[:4] = wave(at[:4])
            if last:
                end = float(wave.before(stop))
                power[4:] = np.append(wave(t + h * _THIRDS), end) @ _EXTRAPOLATE, end
            else:
                power[4:] = wave(at[4:])
        return powers.T @ self.B.T

    def start_slope(self, x: Array, t: float, h: float, stop: float) -> Array:
        """dx/dt at the start of a smooth piece, shape (n,)."""
        power = self.sources(t, h, stop)[0]
        return self.solve(0.0, self.A @ x + power)

    def rate(self, x: Array, slope: Array) -> Array:
        """dx/dt at the state ``x`` from a slope of `step`: the slope itself, as the system is linear."""
        return slope

    def norm(self, x: Array) -> float:
        """Energy norm sqrt(x^T E x)."""
        return math.sqrt(max(x @ (self.E @ x), 0.0))

    def step(self, x: Array, slope: Array, h: float, sources: Array) -> tuple[Array, Array] | None:
        """One ESDIRK step: slopes and states of the six stages, each (6, n); the last state is the new x."""
        slopes = np.empty((6, x.size))
        states = np.empty((6, x.size))
        slopes[0] = slope
        states[0] = x
        shift = GAMMA * h
        for i in range(1, 6):
            before = x + h * (STAGES[i, :i] @ slopes[:i])
            slopes[i] = self.solve(shift, self.A @ before + sources[i])
            states[i] = before + shift * slopes[i]
        self.steps += 1
        return slopes, states
