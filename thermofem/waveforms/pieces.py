"""A waveform as straight lines or cubics between times: what closed forms and compiled integrators take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from .adaptive import cubic, fitted
from .contract import Array, Waveform, check_cycles, check_wave, inside

MANY = 8  # periods of a smooth wave, beyond which one is fitted and repeated
MOST_SAMPLES = 10_000_000  # of a periodic state; more would not fit into memory
TOLERANCE = 1e-8  # of a cubic fit, relative to the largest value: far below the rtol of every model's default
COARSE = 1e-4  # the same, where only the sign of a power is asked
UNDERSHOOT = 1e-6  # of the largest power: what a cubic fit may fall below zero where the power is zero
_QUARTERS = np.array([[0.25], [0.75]])


class Pieces(NamedTuple):
    """A piecewise cubic: sum_j coefficients[k, j] (t - edges[k])^j between edges[k] and edges[k + 1].

    ``edges`` has shape (n + 1,), in s, increasing; ``coefficients`` has shape (n, 4).
    """

    edges: Array
    coefficients: Array

    def __call__(self, t: ArrayLike) -> Array:
        """The value at ``t``, continuous from the right; the first and last piece go on outside."""
        times = np.asarray(t, dtype=float)
        if len(self.coefficients) == 1 and not self.coefficients[0, 1:].any():
            return np.full(times.shape, self.coefficients[0, 0])
        k = np.clip(np.searchsorted(self.edges, times, side="right") - 1, 0, len(self.coefficients) - 1)
        return cubic(self.coefficients[k], times - self.edges[k])

    def on(self, edges: Array) -> Pieces:
        """The function on finer edges; edges of this one within their range must be among them."""
        k = np.clip(np.searchsorted(self.edges, (edges[:-1] + edges[1:]) / 2) - 1, 0, len(self.coefficients) - 1)
        u, (a, b, c, d) = edges[:-1] - self.edges[k], self.coefficients[k].T
        moved = [a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), c + 3 * u * d, d]
        return Pieces(edges, np.stack(moved, axis=1))

    def repeated(self, start: float, stop: float) -> Pieces:
        """The function as one period from 0, over all periods that touch [start, stop]."""
        check_cycles(start, stop, self.edges[-1], self.edges.size)
        length, first = self.edges[-1], np.floor(start / self.edges[-1])
        cycles = np.arange(first, max(np.ceil(stop / length), first + 1))
        edges = np.append((self.edges[:-1] + length * cycles[:, None]).ravel(), length * (cycles[-1] + 1))
        return Pieces(edges, np.tile(self.coefficients, (cycles.size, 1)))

    def times(self, factor: float) -> Pieces:
        """The function multiplied by a number."""
        return Pieces(self.edges, self.coefficients * factor)

    @property
    def straight(self) -> bool:
        """Whether every piece is a straight line."""
        return not self.coefficients[:, 2:].any()

    @property
    def ends(self) -> Array:
        """The value at the end of every piece, shape (n,)."""
        return cubic(self.coefficients, np.diff(self.edges))

    def integral(self) -> float:
        """Integral over all pieces."""
        a, b, c, d = self.coefficients.T
        u = np.diff(self.edges)
        return float(np.sum(u * (a + u * (b / 2 + u * (c / 3 + u * d / 4)))))


def hermite(times: Array, values: Array, first: Array, last: Array) -> Pieces:
    """Cubics through values, shape (n + 1,), with slopes at the start and the end of each piece, shape (n,)."""
    h = np.diff(times)
    mean = np.diff(values) / h
    square, cube = (3 * mean - 2 * first - last) / h, (first + last - 2 * mean) / h**2
    return Pieces(times, np.stack([values[:-1], first, square, cube], axis=1))


def bounds(function: Pieces) -> tuple[float, float]:
    """Lowest and highest value of a piecewise cubic."""
    length, (_, b, c, d) = np.diff(function.edges), function.coefficients.T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -(c + np.copysign(np.sqrt(np.maximum(c * c - 3 * b * d, 0)), c))  # no difference of equal numbers
        turns = [far / (3 * d), b / far]  # of b + 2 c u + 3 d u^2, also where b or d is 0
    inside = [np.where((u > 0) & (u < length), u, 0.0) for u in turns]
    values = [cubic(function.coefficients, u) for u in (0 * length, length, *inside)]
    return float(np.min(values)), float(np.max(values))


def linear_pieces(wave: Waveform, start: float, stop: float) -> tuple[Array, Array, Array]:
    """Split a piecewise-linear waveform into straight pieces.

    Returns edges, after, before [arrays of shape (n + 1,), (n,), (n,)]: piece k runs from ``edges[k]`` at power
        ``after[k]`` to ``edges[k + 1]`` at power ``before[k]``.
    """
    check_wave("wave", wave)
    if not wave.piecewise_linear:
        raise checks.InputError(f"{type(wave).__name__} is not piecewise linear; sample it with th.Sampled first")
    if hasattr(wave, "pieces"):  # the waveform knows them without being sampled
        return wave.pieces(start, stop)
    known = wave.breakpoints(start, stop)
    edges = np.empty(known.size + 2)
    edges[0], edges[1:-1], edges[-1] = start, known, stop
    left, length = edges[:-1], edges[1:] - edges[:-1]
    early, late = wave(left + _QUARTERS * length)  # well inside, where round-off hits no edge
    half = (late - early) / 2
    return edges, early - half, late + half


def cubic_pieces(wave: Waveform, start: float, stop: float, *, tolerance: float = TOLERANCE) -> Pieces:
    """Any waveform as a piecewise cubic over [start, stop].

    Exact for straight lines and for `Cubic`; others are fitted with error control (`adaptive.fitted`).

    start, stop [s]
    tolerance: largest error of a fit, relative to the largest value.
    Raises InputError: a value that is not finite, a function that changes too fast to be resolved.
    """
    check_wave("wave", wave)
    start, stop = (checks.finite(name, t, unit="s") for name, t in (("start", start), ("stop", stop)))
    if getattr(wave, "piecewise_linear", False):
        edges, after, before = linear_pieces(wave, start, stop)
        slope = (before - after) / np.diff(edges)
        return Pieces(edges, np.stack([after, slope, 0 * slope, 0 * slope], axis=1))
    if hasattr(wave, "cubics"):
        return Pieces(*wave.cubics(start, stop))
    period = getattr(wave, "period", None)
    if period is not None and stop - start > MANY * period:  # one of them is fitted, in a thousandth of the time
        whole = Pieces(*fitted(wave, 0.0, period, tolerance)).repeated(start, stop)
        return whole.on(np.concatenate([[start], inside(whole.edges, start, stop), [stop]]))
    return Pieces(*fitted(wave, start, stop, tolerance))


def heating_pieces(wave: Waveform, start: float, stop: float, *, tolerance: float = TOLERANCE) -> Pieces:
    """`cubic_pieces` of an absorbed power.

    Raises InputError: as `cubic_pieces`; a smooth power that is negative or above 10 W somewhere (other waveforms
        checked that when they were made).
    """
    found = cubic_pieces(wave, start, stop, tolerance=tolerance)
    if not getattr(wave, "piecewise_linear", False):
        low, high = bounds(found)
        if low < -UNDERSHOOT * max(abs(low), abs(high), getattr(wave, "peak", 0.0)):
            if tolerance <= TOLERANCE:
                raise checks.InputError(
                    f"the power of the {type(wave).__name__} falls to {low:g} W; absorbed power heats"
                )
            heating_pieces(wave, start, stop)  # tells a negative power from the error of a coarse fit
        checks.power("power", max(high, 0.0), zero=True)
    return found


def check_heating(wave: Waveform, stop: float | None) -> None:
    """Raise InputError for a smooth power that no light has somewhere before ``stop`` in s, as `heating_pieces`.

    What is no waveform is left to the function that needs one.
    """
    if stop and hasattr(wave, "breakpoints") and not getattr(wave, "piecewise_linear", False):
        heating_pieces(wave, 0.0, stop, tolerance=COARSE)


def knots(wave: Waveform, start: float, stop: float, *, tolerance: float) -> Array:
    """Times from ``start`` to ``stop`` between which the power is one cubic within ``tolerance`` of its peak.

    An integrator whose steps are at most twice as long as the distance of the knots misses no feature of a smooth wave.
    """
    return cubic_pieces(wave, start, stop, tolerance=tolerance).edges


def period_times(wave: Waveform, samples: int) -> Array:
    """``samples`` times over one period, both ends included, the nearest ones moved onto the waveform's edges.

    Raises InputError: the waveform has no period, or ``samples`` is too small to hold its edges.
    """
    check_wave("wave", wave)
    period = getattr(wave, "period", None)
    if period is None:
        raise checks.InputError(f"{type(wave).__name__} has no period; a periodic state needs a periodic waveform")
    edges = wave.breakpoints(0.0, period)
    samples = checks.integer("samples", samples, 3, MOST_SAMPLES)
    if samples < 3 + 2 * edges.size:
        raise checks.InputError(f"samples = {samples} is too few for a period with {edges.size} edges inside")
    times = np.arange(samples, dtype=float) * (period / (samples - 1))
    times[-1] = period
    nearest = {min(max(round(e / period * (samples - 1)), 1), samples - 2): e for e in edges.tolist()}
    if len(nearest) < edges.size:
        raise checks.InputError(f"samples = {samples} does not resolve the waveform's edges; take more")
    for k, edge in nearest.items():
        times[k] = edge
    return times
