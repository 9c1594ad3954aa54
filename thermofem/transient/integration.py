"""Full-order transients E dx/dt = A x + B P(t), with error control, exact breakpoints and an energy audit.

Between two breakpoints of the waveforms (a piece of length L) every step is L/4^k for some k, so there are few step
sizes, every factorization of E - gamma h A is used many times, and each breakpoint is met exactly. The error is
controlled on every output and, in the energy norm, on the whole field. Each error is relative to the largest value so
far; for an output that value is at least a tenth (`esdirk.FAR`) of the output of a steady field of the same norm. The
small early signal at distant probes therefore does not set the step size. From rest the first step ends at the first
wanted time of the piece: heat spreads with the square root of time, and shorter time scales are not observed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from .. import checks
from ..algebra.factor import Pencil
from ..arrays import Array, ArrayLike, Indices
from ..waveforms import Waveform, period_times
from .esdirk import EMBEDDED, WEIGHTS, Stepper
from .newton_stages import NewtonStepper
from .nonlinear import Ledger, NonlinearEquations

if TYPE_CHECKING:
    from ..models import StateSpace


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The result of a transient.

    times [shape (n,), s]
    outputs [shape (n, outputs), K]
    final [shape (states,), K]
    snapshots [shape (snapshots, states), K]
    heat_in, heat_stored, heat_out [J]: exact energy delivered, energy now in the field above the start, energy that
        left; nan without a ledger.
    steps, rejected, factorizations, solves: steps of the integrator, or straight pieces of the power in closed form.
    method: "stepping" (`transient.integration`) or "closed form" (`transient.modal`).
    """

    times: Array
    outputs: Array
    final: Array
    snapshots: Array
    heat_in: float
    heat_stored: float
    heat_out: float
    steps: int
    rejected: int
    factorizations: int
    solves: int
    method: str = "stepping"

    @property
    def imbalance(self) -> float:
        """`heat_imbalance` of the run."""
        return heat_imbalance(self.heat_in, self.heat_stored, self.heat_out)


def heat_imbalance(heat_in: float, stored: float, heat_out: float) -> float:
    """(in - stored - out) relative to the largest of the three; 0 where all are 0."""
    scale = max(abs(heat_in), abs(stored), abs(heat_out))
    return (heat_in - stored - heat_out) / scale if scale else 0.0


SAFETY = 0.1  # local error allowed, as a share of rtol; the accumulated error then stays below rtol (measured)
MOST_PASSES = 30  # of a period, before the periodic state is given up
FINEST = 40  # step levels below the length of a piece before a run is given up


def integrate(
    system: StateSpace | NonlinearEquations,
    waves: Waveform | Sequence[Waveform],
    times: ArrayLike,
    *,
    rtol: float = 1e-4,
    initial: Array | None = None,
    snapshots: ArrayLike = (),
    ledger: Ledger | None = None,
    factors: Pencil | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Integrate E dx/dt = A x + B P(t) from t = 0 and read C x at ``times``.

    waves [Waveform, or one for each input]
    times [s]: increasing, not negative.
    rtol: accumulated error of every output, relative to the largest value it has had (under a smooth power, at least to
        1e-6 of the static rise at its peak; with laws of the temperature, at least to 1e-9 K/rtol, round-off at 300 K);
        of a probe that the heat has not reached yet, relative to a tenth of what the field so far would mean there in
        the steady state.
    initial [shape (states,), K]: rise at t = 0; default none.
    snapshots [s]: times whose whole state is kept.
    ledger: closes the energy balance, see `Trajectory.imbalance`.
    factors: of E and -A, where the caller keeps them for further runs.
    progress: called after each step with the time in s that has been reached.
    Raises InputError: times not increasing or negative, rtol outside 1e-10..0.1, or steps that shrink without end.
    """
    times, kept = check_run(times, snapshots, rtol)
    stepper = _stepper(system, waves, rtol, factors)
    x = np.zeros(len(stepper.B)) if initial is None else np.array(initial, dtype=float)
    record = _Record(stepper, times, kept, ledger, x, progress)
    stop = max(times[-1], *kept[-1:], 0.0)
    edges = stepper.edges(stop, rtol)
    x, _ = _crossed(_Control(stepper, rtol, x), record, x, edges)
    return record.trajectory(x)


def check_run(times: ArrayLike, snapshots: ArrayLike, rtol: float) -> tuple[Array, Array]:
    """Times and snapshots of a run from t = 0 as arrays; InputError as of `integrate`."""
    times = checks.array("times", times, increasing=True)
    kept = checks.array("snapshots", snapshots, increasing=True, empty=True)
    checks.between("rtol", rtol, 1e-10, 0.1)
    earliest = min([times[0], *kept[:1]])
    checks.between("times", earliest, 0, np.inf, unit="s", hint="a run starts at t = 0")
    return times, kept


def integrate_periodic(
    system: StateSpace | NonlinearEquations,
    wave: Waveform,
    samples: int,
    *,
    rtol: float = 1e-4,
    initial: Array | None = None,
    ledger: Ledger | None = None,
    factors: Pencil | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """One period of the periodic state, at `waveforms.period_times`.

    The map over one period is x(T) = Phi x(0) + c with Phi close to (1 + T M^-1 K)^-1, so each pass corrects x(0) by

        (x(T) - x(0)) + K^-1 M (x(T) - x(0)) / T,

    which leaves at most 13 % of the error (z -> (1 - e^-z)(1 + z)/z lies in 1..1.3). The first pass, from ``initial``
    or the static state of the mean power, fixes the steps for all. ``progress`` is called after each step with the time
    in s that all passes together have covered.

    Raises InputError: as `integrate`; a waveform without a period.
    """
    times = period_times(wave, samples)
    rtol = checks.between("rtol", rtol, 1e-10, 0.1)
    period = float(times[-1])
    stepper = _stepper(system, wave, rtol, factors)
    if initial is None:
        initial = stepper.static(stepper.B.sum(axis=1) * wave.mean(0.0, period))
    x = np.array(initial, dtype=float)
    edges = stepper.edges(period, rtol)
    control = _Control(stepper, rtol, x)
    first_pass = _Record(stepper, times, np.empty(0), None, x, progress)
    end, plan = _crossed(control, first_pass, x, edges)
    for k in range(1, MOST_PASSES + 1):
        defect = end - x
        steady_part = stepper.static(stepper.E @ defect) / period
        # 1.149: the middle of the interval 1..1.298 of the corrected period map
        correction = (defect + steady_part) / 1.149
        x = x + correction
        record = _Record(stepper, times, np.empty(0), ledger, x, progress, k * period)
        end = _march(plan, x, record)
        if control.error(correction, x) <= 1:
            return record.trajectory(end)
    raise checks.InputError(
        f"the periodic state did not settle in {MOST_PASSES} passes; is the matrix A symmetric and definite?"
    )


def _stepper(
    system: StateSpace | NonlinearEquations, waves: Waveform | Sequence[Waveform], rtol: float, factors: Pencil | None
) -> Stepper:
    if isinstance(system, NonlinearEquations):
        return NewtonStepper(system, waves, SAFETY * rtol, factors)
    return Stepper(system, waves, factors)


# of one smooth piece: start, stop, and the level k of every step, which is (stop - start)/4^k long
Plan = tuple[float, float, list[int]]


def _crossed(control: _Control, record: _Record, x: Array, edges: Array) -> tuple[Array, list[Plan]]:
    """Integrate over all smooth pieces with error control; returns the state at the end and the steps taken."""
    plan = []
    for start, stop in pairwise(edges.tolist()):
        x, levels = _cross(control, record, x, start, stop)
        plan.append((start, stop, levels))
    return x, plan


def _cross(control: _Control, record: _Record, x: Array, start: float, stop: float) -> tuple[Array, list[int]]:
    """Integrate over one smooth piece with error control; returns the state at its end and the level of each step."""
    stepper = control.stepper
    length = stop - start
    level = control.first_level(length, record.first_wanted(start, stop))
    slope = stepper.start_slope(x, start, length, stop)
    done = 0
    taken: list[int] = []
    while done < 4**level:
        h = length / 4**level
        while not stepper.resolves(start + done * h, h):
            done = 4 * done
            level = level + 1
            h = length / 4**level
        t = start + done * h
        solution = stepper.step(x, slope, h, stepper.sources(t, h, stop))
        error = np.inf
        if solution is not None:
            slopes, states = solution
            estimate = h * ((WEIGHTS - EMBEDDED) @ slopes)
            error = control.error(estimate, states[-1])
        if error > 1:
            if level > FINEST:
                raise checks.InputError(
                    f"the step at t = {t:g} s shrinks without end; is rtol = {control.rtol:g} too small?"
                )
            stepper.rejected += 1
            down = 1
            if not taken and np.isfinite(error):
                # the error of a first step falls by 4^1.5 from level to level: the rise there is t - a t^1.5 (measured)
                factors = np.log(error) / np.log(4**1.5)
                down = int(np.ceil(factors))
            done = 4**down * done
            level = level + down
            continue
        record.add(t, h, slopes, states)
        x = states[-1]
        slope = slopes[-1]
        taken.append(level)
        done += 1
        if error * 4**4 < 1 and done % 4 == 0 and level > 0:
            done = done // 4
            level = level - 1
    control.first_step = length / 4 ** taken[0]
    record.deliver(start, stop)
    return x, taken


def _march(plan: Sequence[Plan], x: Array, record: _Record) -> Array:
    """Integrate from another state with the steps of ``plan``; returns the state at the end."""
    stepper = record.stepper
    for start, stop, levels in plan:
        t = start
        slope = stepper.start_slope(x, start, stop - start, stop)
        for level in levels:
            h = (stop - start) / 4**level
            solution = stepper.step(x, slope, h, stepper.sources(t, h, stop))
            if solution is None:
                raise checks.InputError(f"the step at t = {t:g} s does not converge; take a smaller rtol")
            slopes, states = solution
            record.add(t, h, slopes, states)
            x = states[-1]
            slope = slopes[-1]
            t = t + h
        record.deliver(start, stop)
    return x


class _Control:
    """Error control: error of a step over the tolerance; length of the first step after a breakpoint of the power."""

    def __init__(self, stepper: Stepper, rtol: float, x: Array) -> None:
        self.stepper, self.rtol = stepper, rtol
        # 1e-6 of the static rise at the peak of a smooth power: errors in its early tail are measured against it
        floor = max(1e-6 * stepper.smooth_peak, stepper.least)
        steady_outputs = np.abs(stepper.C @ stepper.steady)
        self.outputs = np.maximum(np.abs(stepper.C @ x), floor * steady_outputs)
        self.field = max(stepper.norm(x), floor * stepper.norm(stepper.steady))
        self.first_step = np.inf
        self.shortest_rise = _shortest_rise(stepper)

    def error(self, estimate: Array, x: Array) -> float:
        """Worst ratio of error to tolerance over the outputs and the field; both scales grow with every state tried."""
        self.outputs = np.maximum(self.outputs, np.abs(self.stepper.C @ x))
        self.field = max(self.field, self.stepper.norm(x))
        scale = np.maximum(self.outputs, self.field * self.stepper.far)
        tiny = np.finfo(float).tiny
        ratios = np.abs(self.stepper.C @ estimate) / np.maximum(scale, tiny)
        field = self.stepper.norm(estimate) / max(self.field, tiny)
        worst = max(field, ratios.max(initial=0.0))
        return float(worst / (SAFETY * self.rtol))

    def first_level(self, length: float, wanted: float) -> int:
        """Level k of the first step, whose length is length/4^k.

        At most the first wanted time, 16 times the first step of the last piece, and the shortest rise time. An
        L-stable step across a whole transient is accurate at its end only; its interior and its estimate are not.
        """
        first = min(wanted, 16 * self.first_step, self.shortest_rise)
        levels = np.log(length / first) / np.log(4)
        return max(0, int(np.ceil(levels - 1e-9)))


def _shortest_rise(stepper: Stepper) -> float:
    """Shortest time in s in which an output or the field would reach its steady value with its initial slope."""
    static = stepper.steady
    slope = stepper.solve(0.0, stepper.B.sum(axis=1))
    rises = np.append(np.abs(stepper.C @ static), stepper.norm(static))
    slopes = np.append(np.abs(stepper.C @ slope), stepper.norm(slope))
    moving = (slopes > 0) & (rises > 0)
    return float(np.min(rises[moving] / slopes[moving], initial=np.inf))


class _Record:
    """Records outputs at the wanted times by cubic Hermite interpolation, snapshots, and the energy balance."""

    def __init__(
        self,
        stepper: Stepper,
        times: Array,
        kept: Array,
        ledger: Ledger | None,
        x: Array,
        progress: Callable[[float], None] | None = None,
        before: float = 0.0,
    ) -> None:
        self.stepper, self.times, self.kept, self.ledger = stepper, times, kept, ledger
        self.progress, self.before = progress, before  # time covered by earlier passes, s
        self.outputs = np.tile(stepper.C @ x, (times.size, 1))  # right where times are 0, overwritten elsewhere
        self.snapshots = np.tile(x, (kept.size, 1))
        self.start = x
        self.heat_in = self.heat_out = 0.0 if ledger else np.nan

    def first_wanted(self, start: float, stop: float) -> float:
        """Time in s from ``start`` to the first wanted output or snapshot of the piece, or to the end of the piece."""
        times = np.concatenate([self.times, self.kept])
        inside = times[(times > start * (1 + 1e-12)) & (times <= stop)]
        first = float(inside.min(initial=stop))
        shortest = 1e-9 * (stop - start)
        return max(first - start, shortest)

    def add(self, t: float, h: float, slopes: Array, states: Array) -> None:
        """Record one step of length h from t: outputs, snapshots and heat that left."""
        C = self.stepper.C
        read = between(self.times, t, t + h)
        kept = between(self.kept, t, t + h)
        if read.size or kept.size:
            ends = states[[0, -1]]
            rates = np.stack([self.stepper.rate(states[k], slopes[k]) for k in (0, -1)])
            outputs = CubicHermiteSpline([0.0, h], ends @ C.T, rates @ C.T)
            self.outputs[read] = outputs(self.times[read] - t)
            if kept.size:
                self.snapshots[kept] = CubicHermiteSpline([0.0, h], ends, rates)(self.kept[kept] - t)
        if self.ledger:
            self.heat_out += self.ledger.outflow(h, WEIGHTS, states)
        if self.progress:
            self.progress(self.before + t + h)

    def deliver(self, start: float, stop: float) -> None:
        """Add the exact energy that the powers deliver in one piece."""
        if self.ledger:
            means = [wave.mean(start, stop) for wave in self.stepper.waves]
            energy = (stop - start) * sum(means)
            self.heat_in += energy
            self.heat_out += energy * self.ledger.direct

    def trajectory(self, x: Array) -> Trajectory:
        """Return the trajectory with its energy balance."""
        s = self.stepper
        stored = np.nan
        if self.ledger:
            stored = self.ledger.content(x) - self.ledger.content(self.start)
        return Trajectory(
            times=self.times,
            outputs=self.outputs,
            final=x,
            snapshots=self.snapshots,
            heat_in=self.heat_in,
            heat_stored=stored,
            heat_out=self.heat_out,
            steps=s.steps,
            rejected=s.rejected,
            factorizations=s.factorizations,
            solves=s.solves,
        )


def between(times: Array, start: float, stop: float) -> Indices:
    """Indices of the sorted ``times`` in (start, stop], with a tolerance for round-off at both ends."""
    slack = 1e-9 * (stop - start)
    first, end = np.searchsorted(times, [start + slack, stop + slack], side="right")
    return np.arange(first, end)
