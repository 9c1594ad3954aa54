"""Measures of a periodic orbit of one ring, from its rows: duty cycle, swing, extinction, extrema and their times."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, Mask

from ..runs.pulsing import DUTY_LEVEL

FACTORS = np.arange(1.0, 5.0)[:, None]  # of a derivative of powers


class Measures(NamedTuple):
    """Measures of a periodic orbit of one ring: duty cycle, swing, extinction, extrema and their times in ns."""

    duty: float
    swing: float  # K
    extinction: float  # dB
    lowest: float  # of U, fJ
    highest: float
    hottest: float  # K
    crossings: Array  # of the level of the duty cycle
    rising: Mask
    extremes: Array  # where U is lowest and highest, where dT is


class Cycle(NamedTuple):
    """Energy U (fJ) and temperature dT (K) of a ring over a closed period, at increasing times t (ns)."""

    t: Array
    U: Array
    dT: Array


class Guess(NamedTuple):
    """A row of the curve x(t) near which x or its slope vanishes."""

    t: Array
    x: Array
    row: int


class Extremes(NamedTuple):
    """Times and values of four extrema: U lowest, U highest, dT lowest, dT highest."""

    times: Array
    values: Array


class Crossings(NamedTuple):
    """Times at which U crosses a level, which of them rise, and whether U begins above the level."""

    times: Array
    rising: Mask
    begins_above: bool


def measure(rows: Array) -> Measures:
    """Measure an orbit of one ring from its rows (t, Re a, Im a, N, dT), shape (rows, 5), over one closed period."""
    return measures([rows])[0]


def measures(orbits: Sequence[Array]) -> list[Measures]:
    """Measure orbits of one ring, each given by its rows as in `measure`, all at once, which is faster for many.

    Extrema and crossings come from polynomials through five rows; splines through the rows of an accurate integration
    agree to 3e-10.
    """
    cycles = [_cycle(rows) for rows in orbits]
    extremes = _extremes(cycles)
    levels = [_duty_level(each) for each in extremes]
    crossings = _crossings(cycles, levels)
    return [_measured(*each) for each in zip(cycles, extremes, crossings, strict=True)]


def _cycle(rows: Array) -> Cycle:
    """The `Cycle` of the rows of an orbit, without rows at equal times."""
    advances = np.diff(rows[:, 0]) > 1e-13 * rows[-1, 0]
    t, re, im, _, dT = rows[np.append(True, advances)].T
    return Cycle(t, re * re + im * im, dT)


def _extremes(cycles: list[Cycle]) -> list[Extremes]:
    guesses = []
    for t, U, dT in cycles:
        for x in (U, dT):
            guesses.append(Guess(t, x, int(x.argmin())))
            guesses.append(Guess(t, x, int(x.argmax())))
    times, values = _roots(guesses, 1)
    return [Extremes(*each) for each in zip(times.reshape(-1, 4), values.reshape(-1, 4), strict=True)]


def _duty_level(extremes: Extremes) -> float:
    """The energy above which the ring counts as on, fJ."""
    low, high, _, _ = extremes.values
    return float(low + DUTY_LEVEL * (high - low))


def _crossings(cycles: list[Cycle], levels: list[float]) -> list[Crossings]:
    guesses: list[Guess] = []
    crossed = []
    for (t, U, _), level in zip(cycles, levels, strict=True):
        off = U - level
        above = off > 0
        rows = np.flatnonzero(above[1:] != above[:-1])
        guesses += [Guess(t, off, int(row)) for row in rows]
        crossed.append((above[rows + 1], bool(above[0])))
    times = _roots(guesses, 0)[0]
    ends = np.cumsum([rising.size for rising, _ in crossed])
    return [Crossings(part, *rest) for part, rest in zip(np.split(times, ends), crossed, strict=False)]


def _measured(cycle: Cycle, extremes: Extremes, crossings: Crossings) -> Measures:
    low, high, coldest, hottest = extremes.values.tolist()
    signed = np.where(crossings.rising, -crossings.times, crossings.times)
    duty = float(signed.sum() / cycle.t[-1]) + float(crossings.begins_above)
    dB = 10 * math.log10(high / low) if low > 0 else math.inf
    return Measures(
        duty, hottest - coldest, dB, low, high, hottest, crossings.times, crossings.rising, extremes.times
    )  # fmt: skip


class LocalPolynomials(NamedTuple):
    """Polynomials through five rows around each of m guesses, in powers of the time from ``begin``."""

    c: Array
    """(5, m): coefficients, constant terms first."""
    begin: Array
    """(m,): time of the row, ns."""
    low: Array
    """(m,): time of the row before, ns."""
    high: Array
    """(m,): time of the row after, ns."""


def _interpolated(guesses: list[Guess]) -> LocalPolynomials:
    """Divided differences of five rows around each guess, then powers of the time from its row."""
    fives = []
    neighbours = []
    for t, x, row in guesses:
        first = min(max(row - 2, 0), t.size - 5)
        five = slice(first, first + 5)
        fives.append((t[five], x[five]))
        neighbours.append((t[row], t[max(row - 1, 0)], t[min(row + 1, t.size - 1)]))
    at, c = np.array(fives).reshape(-1, 2, 5).transpose(1, 2, 0)
    begin, low, high = np.array(neighbours).reshape(-1, 3).T
    for distance in range(1, 5):
        c[distance:] = (c[distance:] - c[distance - 1 : -1]) / (at[distance:] - at[:-distance])
    for passed in range(4):
        for j in range(3, passed - 1, -1):
            c[j] += (begin - at[j - passed]) * c[j + 1]
    return LocalPolynomials(c, begin, low, high)


def _roots(guesses: list[Guess], order: int) -> Array:
    """Times at which x(t) (order 0) or dx/dt (order 1) vanishes, and x there; shape (2, guesses).

    Newton's method on the polynomials through five rows, within one row on either side of the one given.
    """
    c, begin, low, high = _interpolated(guesses)
    residual = c[1:] * FACTORS if order else c
    slope = residual[1:] * FACTORS[: len(residual) - 1]
    u = np.zeros(begin.size)
    # more steps of Newton's method from the nearest row change nothing
    for _ in range(4):
        rate = _horner(slope, u)
        step = np.divide(_horner(residual, u), rate, out=np.zeros(u.size), where=rate != 0)
        u = np.minimum(np.maximum(u - step, low - begin), high - begin)
    return np.array([begin + u, _horner(c, u)])


def _horner(c: Array, u: Array) -> Array:
    """Values at u, shape (m,), of polynomials with the coefficients c, shape (terms, m), constant terms first."""
    total = c[-1]
    for coefficient in c[-2::-1]:
        total = total * u + coefficient
    return total
