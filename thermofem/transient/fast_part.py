"""The part of a field that follows the power in closed form: dz/dt = -rate z + heating P over one window.

Between two grid times (wanted times and the breakpoints of the waves) P is one cubic, and z is exact at the grid:

    z(t + h) = exp(-rate h) z(t) + sum_m c_m h phi_m(rate h),    phi_m(y) = integral_0^1 exp(-y (1 - u)) u^m du.

Between grid times z is the cubic through its values and slopes; behind a jump of the power the grid is graded, since a
fast pole does not move like a cubic there.

With k(T) and c_p(T) the amplitudes follow what these do to the fields (`nonlinear.curvature`): w = z + e(z) and

    dw/dt = -rate w + heating P + g(z),    g(z) = rate e(z) - f(z)

by iteration with g of the last z as one more cubic; what is left of an error falls by k's relative change each time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from .. import checks
from ..algebra.krylov import Basis
from ..algebra.pole_responses import phi
from ..arrays import Array, ArrayLike
from ..waveforms import Waveform
from .esdirk import STAGE_TIMES
from .nonlinear import Curvature

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)  # on [-1, 1]
NODES = (NODES + 1) / 2
WEIGHTS = WEIGHTS / 2
_POWERS = np.linalg.inv(NODES[:, None] ** np.arange(4)).T  # values at the nodes @ _POWERS = coefficients of u^m
_GRADING = 2.0 ** -np.arange(1, 25)


def _legendre(u: ArrayLike) -> Array:
    """Polynomials of degree 0 to 3, orthonormal on [0, 1], shape (..., 4)."""
    x = 2 * np.asarray(u, dtype=float) - 1
    norms = np.sqrt([1.0, 3.0, 5.0, 7.0])
    return np.polynomial.legendre.legvander(x, 3) * norms


_AT_STAGES = _legendre(STAGE_TIMES)


@dataclass(frozen=True, eq=False)
class Piece:
    """Powers P and amplitudes z along one step, as their best cubic.

    stages [shape (6, inputs + k)]: the cubic at the stages of `esdirk`.
    leftover [shape (inputs,), W]: largest difference between power and cubic.
    energy [shape (inputs,), J]
    """

    stages: Array
    leftover: Array
    energy: Array


class FastPart:
    """Amplitudes z over one window.

    start, z [float, array of shape (k,)]: time and z at the beginning.
    waves [one Waveform for each input]
    times [s]: wanted times, the last is the end of the window.
    allowed [shape (k,)]: tolerance of each amplitude in the iteration with k(T) and c_p(T).
    """

    def __init__(
        self,
        basis: Basis,
        start: float,
        z: Array,
        waves: Sequence[Waveform],
        times: Array,
        curved: Curvature | None = None,
        allowed: Array | float = 0.0,
    ) -> None:
        self.waves, self.rate = waves, basis.rate
        self.grid = _grid(waves, start, times)
        h = np.diff(self.grid)[:, None]
        self.nodes = self.grid[:-1, None] + h * NODES
        self.weights = h * WEIGHTS  # of Gauss's rule on every interval, s
        powers = self.powers(self.nodes).transpose(0, 2, 1) @ _POWERS  # coefficients, (intervals, inputs, 4)
        gains = h * phi(h * self.rate)
        forcing = np.einsum("tim,mtk,ki->tk", powers, gains, basis.heating)
        decay = np.exp(-h * self.rate)
        ends = np.stack([powers[..., 0], powers.sum(axis=-1)])  # not from the waves: round-off may hit their edges
        heat = ends @ basis.heating.T
        self.values = _followed(z, decay, forcing)
        self.slopes = heat - self.rate * _ends(self.values)
        if curved is not None:
            self._bend(curved, (h, gains, decay, forcing, heat), allowed)

    def _bend(self, curved: Curvature, linear: tuple[Array, ...], allowed: Array | float) -> None:
        """Iterate values and slopes of z with k(T) and c_p(T), from those of the ``linear`` solution."""
        h, gains, decay, forcing, heat = linear
        _, held_at_start = curved(self.values[:1])
        w0 = self.values[0] + held_at_start[0]
        # 40 iterations, under k(T) and c_p(T)
        for _ in range(40):
            z = self.values
            flow, held = curved(z)
            g = self.rate * held - flow
            flow_slopes, held_slopes = _along(curved, _ends(z), self.slopes)
            g_slopes = h * (self.rate * held_slopes - flow_slopes)
            cubics = _coefficients(g, g_slopes[0], g_slopes[1])
            w = _followed(w0, decay, forcing + (cubics * gains).sum(axis=0))
            self.values = w - held
            self.values[0] = z[0]
            self.slopes = heat + _ends(g) - self.rate * _ends(w) - held_slopes
            change = np.abs(self.values - z).max(axis=0, initial=0)
            if (change <= allowed).all():
                return
        raise checks.InputError("the amplitudes of the fields under k(T) do not settle; is the power far too large?")

    def powers(self, t: Array) -> Array:
        """P of every input, shape (*t.shape, inputs)."""
        return np.stack([wave(t) for wave in self.waves], axis=-1)

    @cached_property
    def z(self) -> PPoly:
        """Amplitudes z at any times t of the window, shape (*t.shape, k)."""
        h = np.diff(self.grid)[:, None]
        first, last = h * self.slopes
        coefficients = _coefficients(self.values, first, last)
        powers = h ** np.arange(4)[:, None, None]
        return PPoly((coefficients / powers)[::-1], self.grid)

    def mean(self) -> Array:
        """Mean of z over the window, shape (k,)."""
        return np.tensordot(self.weights, self.z(self.nodes)) / self.weights.sum()

    def mean_products(self) -> Array:
        """Mean of z_j z_k over the window, shape (k, k)."""
        z = self.z(self.nodes)
        weighted = self.weights[..., None] * z
        return np.tensordot(z, weighted, ((0, 1), (0, 1))) / self.weights.sum()

    def energy(self) -> Array:
        """Energy in J that each input delivers in the window."""
        return np.tensordot(self.weights, self.powers(self.nodes))

    def piece(self, t: float, h: float) -> Piece:
        """The `Piece` of the step from ``t`` to ``t + h``."""
        u, weight = self._nodes(t, h)
        times = t + h * u
        power = self.powers(times)
        values = np.concatenate([power, self.z(times)], axis=1)
        shapes = _legendre(u)
        moments = shapes.T @ (weight[:, None] * values)
        leftover = power - shapes @ moments[:, : power.shape[1]]
        energy = h * (weight @ power)
        return Piece(_AT_STAGES @ moments, np.abs(leftover).max(axis=0), energy)

    def products(self, t: float, h: float) -> Array:
        """All z_j z_k at the stages of the step from ``t`` to ``t + h``, as their best cubics, shape (6, k, k)."""
        u, weight = self._nodes(t, h)
        z = self.z(t + h * u)
        products = (z[:, :, None] * z[:, None, :]).reshape(u.size, -1)
        shapes = weight[:, None] * _legendre(u)
        moments = shapes.T @ products
        k = z.shape[1]
        at_stages = _AT_STAGES @ moments
        return at_stages.reshape(len(at_stages), k, k)

    def _nodes(self, t: float, h: float) -> tuple[Array, Array]:
        """Gauss points of all grid intervals in a step, as fractions of the step, and their weights."""
        after_start = self.grid > t + 1e-9 * h
        before_end = self.grid < t + h * (1 - 1e-9)
        inside = self.grid[after_start & before_end]
        times = np.concatenate([[t], inside, [t + h]])
        edges = (times - t) / h
        width = np.diff(edges)[:, None]
        points = edges[:-1, None] + width * NODES
        return points.ravel(), (width * WEIGHTS).ravel()


def _along(curved: Curvature, values: Array, slopes: Array) -> tuple[Array, Array]:
    """Time derivatives of f(z) and e(z) at start and end of every interval, shape (2, intervals, k) each."""
    each = [curved.along(z, slope) for z, slope in zip(values, slopes, strict=True)]
    flow, held = zip(*each, strict=True)
    return np.stack(flow), np.stack(held)


def _followed(z: Array, decay: Array, forcing: Array) -> Array:
    """Solution of z_(k+1) = decay_k z_k + forcing_k from z_0 = z, shape (intervals + 1, k)."""
    values = np.empty((len(decay) + 1, z.size))
    values[0] = z
    for k in range(len(decay)):
        values[k + 1] = decay[k] * values[k] + forcing[k]
    return values


def _coefficients(values: Array, d0: Array, d1: Array) -> Array:
    """Coefficients of u^m, shape (4, intervals, k), of cubics through values with slopes d0, d1 times the interval."""
    rise = np.diff(values, axis=0)
    quadratic = 3 * rise - 2 * d0 - d1
    cubic = d0 + d1 - 2 * rise
    return np.stack([values[:-1], d0, quadratic, cubic])


def _ends(values: Array) -> Array:
    """Values at start and end of every interval, shape (2, intervals, ...)."""
    return np.stack([values[:-1], values[1:]])


def _grid(waves: Sequence[Waveform], start: float, times: Array) -> Array:
    """Grid times in s: wanted times, breakpoints, and graded times behind the start and each jump of the power."""
    stop = float(times[-1])
    parts = [np.array([start]), times]
    for wave in waves:
        edges = wave.breakpoints(start, stop)
        jumps = np.append(start, edges[wave(edges) != wave.before(edges)])
        if not wave.piecewise_linear:  # between two knots the power is one cubic, within 1e-6 of its peak
            knots = wave.pieces(start, stop, tolerance=1e-6).edges
            parts.append(knots)
        graded = jumps[:, None] + (stop - start) * _GRADING
        parts += [edges, graded.ravel()]
    grid = np.unique(np.concatenate(parts))
    grid = grid[(grid >= start) & (grid <= stop)]
    return grid[np.append(True, np.diff(grid) > 1e-13 * stop)]


# coefficients of the cubic of `Inside` from its four numbers
_DEGREES = np.arange(4)
CUBIC = np.linalg.inv(np.stack([_DEGREES == 0, STAGE_TIMES[3] ** _DEGREES, np.ones(4), _DEGREES]))


@dataclass(frozen=True, eq=False)
class FieldState:
    """A field x = V z + r at one time, and the data from which the next step starts.

    time [s]
    z, r [shape (k,) and (n,)]
    slope [shape (n,)]: the time derivative in the equation of the module at the end of the last step: E^-1 times it
        where the system is linear, in W where it is not.
    source [shape (inputs + k,)]: the P and z that this slope was computed with.
    step [s]: length of the last step; 0 before the first.
    heat_in, heat_out [J]: since the start.
    correction [shape (n,), W]: what `NonlinearRemainder.step` has added to the slope.
    """

    time: float
    z: Array
    r: Array
    slope: Array
    source: Array
    step: float = 0.0
    heat_in: float = 0.0
    heat_out: float = 0.0
    correction: Array | float = 0.0


class Inside(NamedTuple):
    """Cubic of the remainder r or its outputs in a step: through both ends and the third stage, with the end slope.

    The slope at the beginning is not used: it contains fast modes and the difference of two cubics of the power, which
    both decay within a small part of the step.
    """

    first: Array
    middle: Array
    last: Array
    rate: Array
    """h dr/dt at the end."""

    def __call__(self, u: ArrayLike) -> Array:
        """Value at the fractions u of the step, shape (*u.shape, components)."""
        powers = np.asarray(u)[..., None] ** _DEGREES
        return np.asarray(powers @ CUBIC @ np.stack(self))


class Advanced(NamedTuple):
    """Record of an advanced window, from which `FieldIntegrator.revised` solves it again."""

    begin: FieldState
    fast: FastPart
    steps: list[tuple[float, float, Inside]]
    """Start and length in s, and the outputs of the remainder."""
    end: FieldState
    fields: Array
