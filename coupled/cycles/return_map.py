"""The return map of a ring or a circuit to a Poincare section, and periodic orbits as its fixed points: shooting.

    y_0 -> y(T):  the first (or n-th) time that N, or U, of one ring rises through its value at y_0
    M = V - f(y_T) (w . V)/(w . f(y_T)),     V = d(flow)/dy,   w = d(N or U)/dy,   f = dy/dt
    (1 - M) dy = y(T) - y_0,   w . dy = 0

The kernel differentiates the steps of an integration to get V. Newton's method on integrations of low accuracy (Rodas4)
approaches the orbit; chord iterations on accurate ones (Rodas5P), with the V of the former, converge to it. The
eigenvalues of V are the Floquet multipliers; the trivial one, of a shift in time, is 1: V f(y_0) = f(y_T).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 1.5 and 10.1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray

from ..kernel.integrator import CARRIERS, Crossing, Problem, Run
from ..runs.pulsing import DUTY_LEVEL

ROUGH, MIDDLE, NEAR, FINE = 1e-5, 1e-6, 1e-7, 1e-9  # rtol of traces: Rodas4, Rodas4, Rodas5P, Rodas5P
FINEST = 1e-11  # rtol where errors at FINE grow along the orbit, as they do while it follows a saddle
FOLLOWED = (NEAR, 1e-8, FINE)  # rtol of the trajectory that V is computed along: the first whose `DEFECT` is small
DEFECT = 3e-6  # relative, of V f(y_0) = f(y_T): errors of multipliers below 3e-7 on 95 % of 153 cycles, at most 2e-6
CLOSED = {ROUGH: 1e-2, MIDDLE: 3e-4, NEAR: 1e-3, FINE: 3e-10, FINEST: 1e-11}  # relative step, by rtol, that ends it
ERROR = 4e-10  # estimate for the period above which FINEST is used: leaves 4e-10 on 99 % of 340 cycles, at most 3e-9
LARGEST = 0.3  # relative step of Newton's method
CONTRACTION = 0.2  # a chord step that shrinks less than this asks for the derivative anew
TURNS = 30  # of Newton's method
PER_STEP = 4  # rows for each step of a precise trace
REACH = 30.0  # of the longest wait for a pulse, within which the next one comes
FLAT = 1e-5  # relative range of the section's quantity below which an orbit is a fixed point


class Trace(NamedTuple):
    """A trajectory from a state on the Poincare section through one or more returns to it; internal units."""

    start: Array
    end: Array
    T: float  # ns
    rows: Array  # t, then fields, N and dT of every ring
    parts: list[tuple[Array, Array]]  # start and steps of the turn from each crossing to the next


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic orbit, with the derivative V of the flow over its period and its number of pulses."""

    trace: Trace
    V: Array  # derivative of the flow over the period
    move: float  # relative size of the last step of Newton's method
    pulses: int = 1  # crossings of the section in a period

    @property
    def start(self) -> Array:
        """The state on the Poincare section, shape (n,), in internal units."""
        return self.trace.start

    @property
    def T(self) -> float:
        """Period of the orbit in ns."""
        return self.trace.T

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers, the eigenvalues of V, by decreasing modulus; shape (n,)."""
        found = np.linalg.eigvals(self.V).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found))])

    @property
    def others(self) -> NDArray[np.complex128]:
        """The Floquet multipliers without the trivial one (the one nearest to 1), shape (n - 1,)."""
        every = self.multipliers
        return np.delete(every, int(np.argmin(np.abs(every - 1))))

    @property
    def worst(self) -> complex:
        """The nontrivial multiplier of largest modulus, which determines the stability; 0 where there is none."""
        return complex(self.others[0]) if len(self.V) > 1 else 0j

    @property
    def size(self) -> float:
        """Modulus of `worst`: the factor by which a perturbation grows in one period, below 1 for a stable orbit."""
        return abs(self.worst)


@dataclass(frozen=True, eq=False)
class Flow:
    """The flow of a ring or circuit under constant light, and a Poincare section of it.

    rough, fine: the same equations, integrated with Rodas4 and with Rodas5P.
    quantity, ring: the section is a level of the CARRIERS or the ENERGY of the ring with this index.
    """

    rough: Problem
    fine: Problem
    quantity: int = CARRIERS
    ring: int = 0

    def value(self, y: Array) -> float:
        """The quantity q(y) of which the section is a level set: N or U of one ring, internal units."""
        a = self.ring * self.rough.block
        return float(y[a + 2] if self.quantity == CARRIERS else y[a] ** 2 + y[a + 1] ** 2)

    def normal(self, y: Array) -> Array:
        """Gradient dq/dy of the section's quantity, shape (n,)."""
        w = np.zeros(y.size)
        a = self.ring * self.rough.block
        if self.quantity == CARRIERS:
            w[a + 2] = 1.0
        else:
            w[a] = 2 * y[a]
            w[a + 1] = 2 * y[a + 1]
        return w

    def seen(self, rows: Array) -> Array:
        """The section's quantity q along the rows of a trajectory, shape (rows,)."""
        a = 1 + self.ring * (self.rough.block + 1)
        return np.asarray(rows[:, a + 2] if self.quantity == CARRIERS else rows[:, a] ** 2 + rows[:, a + 1] ** 2)

    def run(
        self, y: Array, duration: float, rtol: float = ROUGH, *, level: float | None = None, above: bool = False,
        first_step: float = 0.0, per_step: int = 1,
    ) -> Run:  # fmt: skip
        """Integrate for ``duration`` ns, or up to the crossing where the section's quantity rises through ``level``."""
        problem = self.rough if rtol >= MIDDLE else self.fine
        problem.edges[-1] = duration  # the drive is constant
        event = None if level is None else Crossing(self.quantity, level, True, self.ring, above)
        return problem.integrate(
            y, rtol=rtol, event=event, keep_steps=level is not None, first_step=first_step, per_step=per_step
        )  # fmt: skip

    @property
    def heat(self) -> int:
        """Index of the first thermal state in y."""
        return self.rough.rings * self.rough.block

    def part(self, y: Array, duration: float, first_step: float) -> tuple[Array, float, Array, Array]:
        """Integrate part of a transient; this and the next four methods are those of `cycle_search.Shooting`."""
        run = self.run(y, duration, first_step=first_step)
        return run.y, run.step, run.rows, self.seen(run.rows)

    def turn(self, y: Array, longest: float, level: float | None = None) -> Array | None:
        """The state where the quantity next rises through ``level`` (default q(y)); None within ``longest`` ns."""
        run = self.run(y, longest, level=self.value(y) if level is None else level, above=level is None)
        return run.y if run.crossings.size else None

    def cycle(self, y: Array, pulses: int, wait: float, precisely: bool) -> "Orbit | None":
        """The periodic orbit near a state; its period has a relative error of 1e-6 unless ``precisely`` is set."""
        return close(self, y, pulses, REACH * wait, rtol=FINE if precisely else MIDDLE)

    def confirmed(self, orbit: Orbit, wait: float) -> "Orbit | None":
        """The orbit recomputed at the tolerance `FINE`; None without convergence."""
        return close(self, orbit.start, orbit.pulses, REACH * wait, beside=orbit)

    def swing(self, orbit: Orbit) -> float:
        """Range of the section's quantity along a periodic orbit."""
        return float(np.ptp(self.seen(orbit.trace.rows)))

    def trace(self, y: Array, rtol: float, pulses: int, longest: float, per_step: int = 1) -> Trace | None:
        """Integrate from ``y`` through ``pulses`` returns to the section; None if one exceeds ``longest`` ns."""
        level, at, T = self.value(y), y, 0.0
        parts: list[tuple[Array, Array]] = []
        rows: list[Array] = []
        for _ in range(pulses):
            run = self.run(at, longest, rtol, level=level, above=True, per_step=per_step)
            if run.crossings.size == 0:
                return None
            run.rows[:, 0] += T
            rows.append(run.rows if not rows else run.rows[1:])
            parts.append((at, run.steps))
            at, T = run.y, T + run.t
        return Trace(y, at, T, np.concatenate(rows), parts)

    def derivative(self, trace: Trace, rtol: float) -> Array:
        """V = d(end)/d(start) along the steps of a trajectory, shape (n, n); ``rtol`` selects the method."""
        problem = self.rough if rtol >= MIDDLE else self.fine
        V = np.eye(trace.end.size)
        for start, steps in trace.parts:
            _, V = problem.follow(start, steps, V)
        return V

    def projected(self, columns: Array, end: Array) -> Array:
        """Project derivatives of the end state, shape (n, k), along dy/dt onto the section's tangent plane."""
        rate = self.rough.slopes(end)[0]
        w = self.normal(end)
        return np.asarray(columns - np.outer(rate, w @ columns) / (w @ rate))

    def scale(self, rows: Array) -> Array:
        """Scales of the states along an orbit, (n,): largest |a|, N of each ring; its largest dT for x."""
        problem = self.rough
        sizes = []
        heat = []
        for i in range(problem.rings):
            own = rows[:, 1 + i * (problem.block + 1) :][:, : problem.block + 1]
            field = max(float(np.hypot(own[:, 0], own[:, 1]).max()), 1e-12)  # of a dark ring
            sizes += [field, field, max(float(np.abs(own[:, 2]).max()), 1e-12)]
            heat += [max(float(np.abs(own[:, 3]).max()), 1e-12)] * problem.order
        return np.array(sizes + heat)


def close(
    flow: Flow, y: Array, pulses: int, longest: float, *, rtol: float = FINE, beside: Orbit | None = None
) -> Orbit | None:
    """Return the periodic orbit with ``pulses`` crossings per period near the state ``y``; None without convergence.

    longest [ns]: limit of the time from one crossing to the next.
    rtol: tolerance of the last integrations. At MIDDLE the period has a relative error of 1e-6; at FINE the orbit is
        recomputed at FINEST where the estimated error of the period exceeds `ERROR`.
    beside: a nearby periodic orbit, whose V starts the chord iterations.
    """
    most = np.inf if beside is None else NEAR if rtol == FINE else rtol
    tolerances = [each for each in CLOSED if rtol <= each <= most]
    tolerance = tolerances.pop(0)
    before = np.inf
    V = np.empty((0, 0))
    A, row = V, 0
    if beside is not None:
        before = 1.0
        A, row = _bordered(flow.projected(beside.V, beside.trace.end), flow.normal(beside.start))
    for _ in range(TURNS):
        first = before == 1.0  # trace at this tolerance, which is hardly ever the last
        trace = flow.trace(y, tolerance, pulses, longest, 1 if first or tolerance > FINE else PER_STEP)
        if trace is None or np.ptp(flow.seen(trace.rows)) <= FLAT * np.abs(flow.seen(trace.rows)).max():
            return None
        fresh = tolerance >= MIDDLE or before == np.inf
        if fresh:
            V = flow.derivative(trace, tolerance)
            A, row = _bordered(flow.projected(V, trace.end), flow.normal(y))
        missed = trace.end - y
        missed[row] = 0.0
        dy = np.linalg.solve(A, missed)
        size = float(np.abs(dy / flow.scale(trace.rows)).max())
        if not np.isfinite(size):
            return None
        rounded = fresh and 0.5 * before < size < 1e-7  # round-off of the traces
        if (size < CLOSED[tolerance] or (rounded and tolerance <= FINE)) and not tolerances:
            if tolerance > FINE:
                return Orbit(trace, V, size, pulses)
            if first and (again := flow.trace(y, tolerance, pulses, longest, PER_STEP)):
                trace = again
            V, error = _followed(flow, trace, longest, A, row)
            orbit = Orbit(trace, V, size, pulses)
            if tolerance == FINE and error > ERROR:
                return close(flow, y, pulses, longest, rtol=FINEST, beside=orbit) or orbit
            return orbit
        if size < CLOSED[tolerance]:
            tolerance, before = tolerances.pop(0), 1.0
        elif tolerance <= FINE:
            before = np.inf if size > CONTRACTION * before and not fresh else size
        y = y + dy * min(1.0, LARGEST / size)
    return None


def _followed(flow: Flow, trace: Trace, longest: float, A: Array, row: int) -> tuple[Array, float]:
    """V of an accurate trajectory, from the least accurate integration that suffices, and the period's relative error.

    A rank-one correction makes V f(y_0) = f(y_T) exact, so that the trivial multiplier is 1. The error of the period at
    FINE is the difference of the periods at two tolerances, both orbits closed (``A``, ``row``: `_bordered`), scaled.
    """
    scale = flow.scale(trace.rows)
    begin = flow.fine.slopes(trace.start)[0]
    end = flow.fine.slopes(trace.end)[0]
    others: list[Trace] = []
    for rtol in FOLLOWED:
        others.append(flow.trace(trace.start, rtol, len(trace.parts), longest) or trace)
        V = flow.derivative(others[-1], rtol)
        defect = end - V @ begin
        if np.linalg.norm(defect / scale) <= DEFECT * np.linalg.norm(begin / scale):
            break
    w = flow.normal(trace.start)
    missed = others[0].end - trace.end
    missed[row] = 0.0
    change = others[0].T - trace.T - w @ V @ np.linalg.solve(A, missed) / (w @ end)
    along = begin / scale**2
    return V + np.outer(defect, along) / (along @ begin), float(abs(change)) / trace.T * FINE / FOLLOWED[0]


def _bordered(M: Array, w: Array) -> tuple[Array, int]:
    """The matrix 1 - M with one row, that of the largest entry of w, replaced by w; and the index of that row."""
    A = np.eye(len(M)) - M
    row = int(np.abs(w).argmax())
    A[row] = w
    return A, row


BOOLE = np.array([7, 32, 12, 32, 7]) / 90  # weights of five rows of a step, of its length
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
    rising: NDArray[np.bool_]
    extremes: Array  # where U is lowest and highest, where dT is


def measure(rows: Array) -> Measures:
    """Measure an orbit of one ring from its rows (t, Re a, Im a, N, dT), shape (rows, 5), over one closed period."""
    return measures([rows])[0]


def measures(orbits: Sequence[Array]) -> list[Measures]:
    """Measure orbits of one ring, each given by its rows as in `measure`, all at once, which is faster for many.

    Extrema and crossings come from polynomials through five rows; splines through the rows of an accurate integration
    agree to 3e-10.
    """
    every = [rows[np.append(True, np.diff(rows[:, 0]) > 1e-13 * rows[-1, 0])].T for rows in orbits]
    traces = [(t, re * re + im * im, dT) for t, re, im, _, dT in every]
    both = [(t, x) for t, *several in traces for x in several]
    places, values = _roots([(t, x, k) for t, x in both for k in (x.argmin(), x.argmax())], 1).reshape(2, -1, 4)
    levels = values[:, 0] + DUTY_LEVEL * (values[:, 1] - values[:, 0])
    offs = [U - level for (_, U, _), level in zip(traces, levels, strict=True)]
    before = [np.flatnonzero((off[1:] > 0) != (off[:-1] > 0)) for off in offs]
    near = [(t, off, k) for (t, *_), off, at in zip(traces, offs, before, strict=True) for k in at]
    times = np.split(_roots(near, 0)[0], np.cumsum([at.size for at in before]))[:-1]
    out = []
    columns = (traces, offs, before, times, places, values)
    for (t, *_), off, at, crossings, extremes, found in zip(*columns, strict=True):
        low, high, coldest, hottest = found.tolist()
        rising = off[at + 1] > 0
        duty = float(np.where(rising, -crossings, crossings).sum() / t[-1]) + float(off[0] > 0)
        dB = 10 * math.log10(high / low) if low > 0 else math.inf
        out.append(Measures(duty, hottest - coldest, dB, low, high, hottest, crossings, rising, extremes))
    return out


def _roots(near: list[tuple[Array, Array, Any]], order: int) -> Array:
    """Times at which x(t) (order 0) or dx/dt (order 1) vanishes, and x there; shape (2, m), for m places (t, x, row).

    Newton's method on the polynomials through five rows, within one row on either side of the one given.
    """
    first = [(t, x, min(max(k - 2, 0), t.size - 5)) for t, x, k in near]
    at, c = np.array([(t[i : i + 5], x[i : i + 5]) for t, x, i in first]).reshape(-1, 2, 5).transpose(1, 2, 0)
    beside = [(t[k], t[max(k - 1, 0)], t[min(k + 1, t.size - 1)]) for t, _, k in near]
    begin, low, high = np.array(beside).reshape(-1, 3).T
    for distance in range(1, 5):  # divided differences, then powers of the time from ``begin``
        c[distance:] = (c[distance:] - c[distance - 1 : -1]) / (at[distance:] - at[:-distance])
    for passed in range(4):
        for j in range(3, passed - 1, -1):
            c[j] += (begin - at[j - passed]) * c[j + 1]
    wanted = c[1:] * FACTORS if order else c
    slope = wanted[1:] * FACTORS[: len(wanted) - 1]
    u = np.zeros(begin.size)
    for _ in range(4):
        by = _horner(slope, u)
        step = np.divide(_horner(wanted, u), by, out=np.zeros(u.size), where=by != 0)
        u = np.minimum(np.maximum(u - step, low - begin), high - begin)
    return np.array([begin + u, _horner(c, u)])


def _horner(c: Array, u: Array) -> Array:
    """Values at u, shape (m,), of polynomials with the coefficients c, shape (terms, m), constant terms first."""
    total = c[-1]
    for one in c[-2::-1]:
        total = total * u + one
    return total


def time_weights(orbit: Orbit) -> Array:
    """Quadrature weights of the rows for an integral over the period, ns, shape (rows,): Boole's rule on each step."""
    out = np.zeros(len(orbit.trace.rows))
    steps = np.concatenate([steps for _, steps in orbit.trace.parts])
    for k, weight in enumerate(BOOLE):
        out[k : k + PER_STEP * (steps.size - 1) + 1 : PER_STEP] += weight * steps
    return out
