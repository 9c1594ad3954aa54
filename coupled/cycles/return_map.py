"""The return map of a ring or a circuit to a Poincare section, and periodic orbits as its fixed points: shooting.

    y_0 -> y(T):  the first (or n-th) time that N, or U, of one ring rises through its value at y_0
    M = V - f(y_T) (w . V)/(w . f(y_T)),     V = d(flow)/dy,   w = d(N or U)/dy,   f = dy/dt
    (1 - M) dy = y(T) - y_0,   w . dy = 0

The kernel differentiates the steps of an integration to get V. Newton's method on integrations of low accuracy (Rodas4)
approaches the orbit; chord iterations on accurate ones (Rodas5P), with the V of the former, converge to it. The
eigenvalues of V are the Floquet multipliers; the trivial one, of a shift in time, is 1: V f(y_0) = f(y_T).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 1.5 and 10.1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, Complex

from ..kernel.integrator import CARRIERS, Crossing, Problem, Run

ROUGH, MIDDLE, NEAR, FINE = 1e-5, 1e-6, 1e-7, 1e-9  # rtol of traces: Rodas4, Rodas4, Rodas5P, Rodas5P
FINEST = 1e-11  # rtol where errors at FINE grow along the orbit, as they do while it follows a saddle
FOLLOWED = (NEAR, 1e-8, FINE)  # rtol of the trajectory that V is computed along: the first whose `DEFECT` is small
DEFECT = 3e-6  # relative, of V f(y_0) = f(y_T): errors of multipliers below 3e-7 on 95 % of 153 cycles, at most 2e-6
CLOSED = {ROUGH: 1e-2, MIDDLE: 3e-4, NEAR: 1e-3, FINE: 3e-10, FINEST: 1e-11}  # relative step, by rtol, that ends it
ERROR = 4e-10  # estimate for the period above which FINEST is used: leaves 4e-10 on 99 % of 340 cycles, at most 3e-9
LARGEST_STEP = 0.3  # relative, of Newton's method
TURNS = 30  # of Newton's method
PER_STEP = 4  # rows for each step of a precise trace
REACH = 30.0  # of the longest wait for a pulse, within which the next one comes
BOOLE = np.array([7, 32, 12, 32, 7]) / 90  # weights of five rows of a step, of its length
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
    def multipliers(self) -> Complex:
        """Floquet multipliers, the eigenvalues of V, by decreasing modulus; shape (n,)."""
        multipliers = np.linalg.eigvals(self.V).astype(complex)
        order = np.argsort(-np.abs(multipliers))
        return multipliers[order]

    @property
    def others(self) -> Complex:
        """The Floquet multipliers without the trivial one (the one nearest to 1), shape (n - 1,)."""
        trivial = int(np.argmin(np.abs(self.multipliers - 1)))
        return np.delete(self.multipliers, trivial)

    @property
    def leading(self) -> complex:
        """The nontrivial multiplier of largest modulus, which determines the stability; 0 where there is none."""
        return complex(self.others[0]) if len(self.V) > 1 else 0j

    @property
    def size(self) -> float:
        """Modulus of `leading`: the factor by which a perturbation grows in one period, below 1 for a stable orbit."""
        return abs(self.leading)


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
            w[a : a + 2] = 2 * y[a : a + 2]
        return w

    def seen(self, rows: Array) -> Array:
        """The section's quantity q along the rows of a trajectory, shape (rows,)."""
        a = 1 + self.ring * (self.rough.block + 1)
        if self.quantity == CARRIERS:
            return rows[:, a + 2]
        return rows[:, a] ** 2 + rows[:, a + 1] ** 2

    def at(self, rtol: float) -> Problem:
        """The equations with the faster method at a tolerance."""
        return self.rough if rtol >= MIDDLE else self.fine

    def run(
        self, y: Array, duration: float, rtol: float = ROUGH, *, level: float | None = None, above: bool = False,
        first_step: float = 0.0, per_step: int = 1,
    ) -> Run:  # fmt: skip
        """Integrate for ``duration`` ns, or up to the crossing where the section's quantity rises through ``level``."""
        problem = self.at(rtol)
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
        """Integrate part of a transient: the end, the next step, the rows, and the section's quantity along them."""
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
        level = self.value(y)
        state = y
        T = 0.0
        parts: list[tuple[Array, Array]] = []
        rows: list[Array] = []
        for _ in range(pulses):
            run = self.run(state, longest, rtol, level=level, above=True, per_step=per_step)
            if run.crossings.size == 0:
                return None
            run.rows[:, 0] += T
            rows.append(run.rows if not rows else run.rows[1:])
            parts.append((state, run.steps))
            state = run.y
            T = T + run.t
        return Trace(y, state, T, np.concatenate(rows), parts)

    def derivative(self, trace: Trace, rtol: float) -> Array:
        """V = d(end)/d(start) along the steps of a trajectory, shape (n, n); ``rtol`` selects the method."""
        problem = self.at(rtol)
        V = np.eye(trace.end.size)
        for start, steps in trace.parts:
            _, V = problem.follow(start, steps, V)
        return V

    def projected(self, columns: Array, end: Array) -> Array:
        """Project derivatives of the end state, shape (n, k), along dy/dt onto the section's tangent plane."""
        rate, _ = self.rough.slopes(end)
        w = self.normal(end)
        return columns - np.outer(rate, w @ columns) / (w @ rate)

    def rests(self, trace: Trace) -> bool:
        """Whether a trajectory is a fixed point rather than an orbit."""
        quantity = self.seen(trace.rows)
        return bool(np.ptp(quantity) <= FLAT * np.abs(quantity).max())

    def scale(self, rows: Array) -> Array:
        """Scales of the states along an orbit, (n,): largest |a|, N of each ring; its largest dT for x."""
        problem = self.rough
        sizes = []
        heat = []
        for i in range(problem.rings):
            first = 1 + i * (problem.block + 1)
            re, im, N, dT = rows[:, first : first + 4].T
            field = _largest(np.hypot(re, im))
            sizes += [field, field, _largest(N)]
            heat += [_largest(dT)] * problem.order
        return np.array(sizes + heat)


def _largest(x: Array) -> float:
    """The largest modulus, which is not 0 even for a dark ring."""
    return max(float(np.abs(x).max()), 1e-12)


class Chord(NamedTuple):
    """The matrix of a Newton step towards an orbit: 1 - M, whose row ``row`` is replaced by the w of the section."""

    A: Array
    row: int

    def improved(self, flow: Flow, trace: Trace) -> tuple[Array, float] | None:
        """The state after a step dy from the start of a trajectory, and the size of dy relative to the orbit's scales.

        (1 - M) dy = y(T) - y_0, w . dy = 0; dy is shortened to `LARGEST_STEP`. None where it is not finite.
        """
        missed = trace.end - trace.start
        missed[self.row] = 0.0
        dy = np.linalg.solve(self.A, missed)
        size = float(np.abs(dy / flow.scale(trace.rows)).max())
        if not np.isfinite(size):
            return None
        shortened = LARGEST_STEP / max(size, LARGEST_STEP)
        return trace.start + shortened * dy, size


def chord(flow: Flow, trace: Trace, V: Array) -> Chord:
    """The `Chord` of a trajectory from the section with the derivative V of its flow.

    w replaces the row of its largest entry.
    """
    M = flow.projected(V, trace.end)
    w = flow.normal(trace.start)
    row = int(np.abs(w).argmax())
    A = np.eye(len(M)) - M
    A[row] = w
    return Chord(A, row)


def close(
    flow: Flow, y: Array, pulses: int, longest: float, *, rtol: float = FINE, beside: Orbit | None = None
) -> Orbit | None:
    """Return the periodic orbit with ``pulses`` crossings per period near the state ``y``; None without convergence.

    longest [ns]: limit of the time from one crossing to the next.
    rtol: tolerance of the last integrations. At MIDDLE the period has a relative error of 1e-6; at FINE the orbit is
        recomputed at FINEST where the estimated error of the period exceeds `ERROR`.
    beside: a nearby periodic orbit, whose V starts the chord iterations.
    """
    search = Search(flow, pulses, longest, iter(range(TURNS)))
    if beside is not None:
        return search.by_chords(y, rtol, chord(flow, beside.trace, beside.V))
    rough = search.by_newton(y, ROUGH)
    if rough is None:
        return None
    middle = search.by_newton(rough.improved, MIDDLE)
    if middle is None or rtol == MIDDLE:
        return middle and middle.orbit
    start = chord(flow, middle.orbit.trace, middle.orbit.V)
    return search.by_chords(middle.improved, rtol, start)


class Approach(NamedTuple):
    """An orbit found at a low accuracy, and the state on the section after its last Newton step."""

    orbit: Orbit
    improved: Array


class Search(NamedTuple):
    """The search for an orbit with crossings of the section at most ``longest`` ns apart; ``turns``: steps left."""

    flow: Flow
    pulses: int
    longest: float
    turns: Iterator[int]

    def trace(self, y: Array, rtol: float, per_step: int = 1) -> Trace | None:
        """The trajectory from a state through all crossings; None without one, or if it rests."""
        trace = self.flow.trace(y, rtol, self.pulses, self.longest, per_step)
        return None if trace is None or self.flow.rests(trace) else trace

    def by_newton(self, y: Array, rtol: float) -> Approach | None:
        """Newton's method with the derivative of every trajectory, until its step is below CLOSED[rtol]."""
        for _ in self.turns:
            trace = self.trace(y, rtol)
            if trace is None:
                return None
            V = self.flow.derivative(trace, rtol)
            step = chord(self.flow, trace, V).improved(self.flow, trace)
            if step is None:
                return None
            y, size = step
            if size < CLOSED[rtol]:
                return Approach(Orbit(trace, V, self.pulses), y)
        return None

    def by_chords(self, y: Array, rtol: float, start: Chord) -> Orbit | None:
        """Chord iterations: at NEAR with the chord ``start``, then at ``rtol`` with a new one where they are slow."""
        if rtol == FINE:
            nearer = self._nearer(y, start)
            if nearer is None:
                return None
            y = nearer
        before = 1.0
        renew = False
        for _ in self.turns:
            trace = self.trace(y, rtol, PER_STEP)
            if trace is None:
                return None
            if renew:
                start = chord(self.flow, trace, self.flow.derivative(trace, rtol))
            step = start.improved(self.flow, trace)
            if step is None:
                return None
            following, size = step
            if size < CLOSED[rtol]:
                return self._concluded(trace, rtol, start)
            # a chord step that does not shrink to a fifth asks for the derivative anew
            renew = not renew and size > 0.2 * before
            before = size
            y = following
        return None

    def _nearer(self, y: Array, start: Chord) -> Array | None:
        """Chord iterations at NEAR, with the chord kept; the state on the section after the last step."""
        for _ in self.turns:
            trace = self.trace(y, NEAR)
            step = trace and start.improved(self.flow, trace)
            if step is None:
                return None
            y, size = step
            if size < CLOSED[NEAR]:
                return y
        return None

    def _concluded(self, trace: Trace, rtol: float, last: Chord) -> Orbit | None:
        """The orbit of a closed trajectory, recomputed at FINEST where the error of its period at FINE is too large."""
        V, error = self._followed(trace, last)
        orbit = Orbit(trace, V, self.pulses)
        if rtol == FINE and error > ERROR:
            return close(self.flow, trace.start, self.pulses, self.longest, rtol=FINEST, beside=orbit) or orbit
        return orbit

    def _followed(self, trace: Trace, last: Chord) -> tuple[Array, float]:
        """V of an accurate trajectory, and the relative error of its period.

        V comes from the least accurate integration that suffices. A rank-one correction makes V f(y_0) = f(y_T) exact,
        so that the trivial multiplier is 1. The error of the period at FINE is the difference of the periods at two
        tolerances, both orbits closed (by the chord ``last``), scaled.
        """
        flow = self.flow
        scale = flow.scale(trace.rows)
        begin, _ = flow.fine.slopes(trace.start)
        end, _ = flow.fine.slopes(trace.end)
        others: list[Trace] = []
        for rtol in FOLLOWED:
            other = flow.trace(trace.start, rtol, self.pulses, self.longest) or trace
            others.append(other)
            V = flow.derivative(other, rtol)
            defect = end - V @ begin
            largest_defect = DEFECT * np.linalg.norm(begin / scale)
            if np.linalg.norm(defect / scale) <= largest_defect:
                break
        along = begin / scale**2
        corrected = V + np.outer(defect, along) / (along @ begin)
        rough = others[0]
        missed = rough.end - trace.end
        missed[last.row] = 0.0
        dy = np.linalg.solve(last.A, missed)
        w = flow.normal(trace.start)
        return_delay = w @ V @ dy / (w @ end)
        change = rough.T - trace.T - return_delay
        error = float(abs(change)) / trace.T * FINE / FOLLOWED[0]
        return corrected, error


def time_weights(orbit: Orbit) -> Array:
    """Quadrature weights of the rows for an integral over the period, ns, shape (rows,): Boole's rule on each step."""
    out = np.zeros(len(orbit.trace.rows))
    steps = np.concatenate([steps for _, steps in orbit.trace.parts])
    for k, weight in enumerate(BOOLE):
        out[k : k + PER_STEP * (steps.size - 1) + 1 : PER_STEP] += weight * steps
    return out
