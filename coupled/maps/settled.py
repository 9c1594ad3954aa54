"""The settled cycles of a row of a map: every point from its neighbours' cycles where no fixed point is stable.

Where one is, the ring may rest there or pulse beside it; a transient from a cold ring decides which. A cycle that a
transient leads to is accepted if the transient comes nearer to it, and a trace from beside it, too.
"""

from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..cycles import settling
from ..cycles.cycle_problem import CycleProblem
from ..cycles.return_map import measure
from ..cycles.settling import FLAT, MOST_PULSES, Part, RestError, rest_words
from ..kernel.shooting import FINE, Closed, Turns
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning
from ..runs.pulsing import Regime
from .grid import Fixed, Point


class Cell(NamedTuple):
    """What a ring does at a point of a map."""

    regime: str
    period: float = np.nan  # s
    duty: float = np.nan
    swing: float = np.nan  # K
    reason: str = ""
    rise: float = 0.0  # K, the highest of its cycle or trace and its fixed points


TRIES = 4  # of closing a cycle near a transient
LONG = 2400  # steps of a cycle; one with more may be a burst, of which a stable return map alone proves little
ASIDE = 3e-4  # of the largest state of heat: the distance from a cycle at which a trace begins that tests it
AGAIN = 3  # periods of that trace, in which its distance must change as the return map says
PRECISE = 1e-9  # rtol, with Rodas5P, of the numbers of a cycle that is `LONG`
REACH = 4.0  # periods within which a trace must come back to the section where the carriers rise
AHEAD = ([1.0], [2.0, -1.0], [3.0, -3.0, 1.0])  # the polynomial through one to three neighbours at the next point


def settled_row(model: Any, points: list[Point], fixed: list[Fixed | str], watch: Array) -> list[Cell]:
    """Return regime, period (s), duty, swing (K) and the reason at every point of a row."""
    out: list[Cell] = []
    for (ring, power), group in groupby(zip(points, fixed, strict=True), key=lambda pair: pair[0][:2]):
        row = _Row(ring, model, power, watch)
        beside: list[Closed] = []
        for (_, _, detuning), at in group:
            row.look()
            try:
                if isinstance(at, str):
                    raise InputError(at)
                cell, found = row.point(detuning, at, beside)
                cell = cell._replace(rise=max(cell.rise, float(at.every[:, 2].max())))
            except (InputError, RuntimeError, np.linalg.LinAlgError) as error:
                cell, found = Cell("failed", reason=str(error)), None
            beside = [found, *beside[:2]] if found and found.pulses == 1 else []
            out.append(cell)
    return out


class _Row:
    """Points of one ring under one power."""

    def __init__(self, ring: Any, model: Any, power: float, watch: Array) -> None:
        self.watch, self.problem = watch, CycleProblem(ring, model, power, 0.0)
        self.turns = Turns(self.problem.kernel(Method.RODAS4))

    @cached_property
    def precise(self) -> Turns:
        """The same by the method that is better at small tolerances."""
        return Turns(self.problem.kernel(Method.RODAS5P))

    def look(self) -> None:
        """Raise KeyboardInterrupt where another thread asks for it."""
        if self.watch[0] > 0:
            raise KeyboardInterrupt

    def point(self, detuning: float, fixed: Fixed, beside: list[Closed]) -> tuple[Cell, Closed | None]:
        """What the ring does, and its cycle; ``beside`` are those just before, of one pulse, the last first."""
        p = replace(self.problem, detuning=detuning)
        self.turns.problem.set_detuning(internal_detuning(detuning))
        self.turns.near(fixed.every)
        found = self._continued(beside) if beside and not len(fixed.stable) else None
        return self._from_cold(p, fixed.stable) if found is None else (self._words(p, found), found)

    def _words(self, p: CycleProblem, found: Closed) -> Cell:
        """A cycle as a map tells it; one of many steps is closed precisely, as their errors add up."""
        closer = None
        if len(found.rows) > LONG:
            self.precise.problem.set_detuning(internal_detuning(p.detuning))
            closer = self.precise.closer(found, PRECISE)
        told = closer or found
        return _pulsing(told.T, told.size, told.pulses, told.rows)

    def _continued(self, beside: list[Closed]) -> Closed | None:
        """The stable cycle that continues those ``beside``."""
        ahead, last = AHEAD[len(beside) - 1], beside[0]
        y = np.sum([a * one.y for a, one in zip(ahead, beside, strict=True)], axis=0)
        T = sum(a * one.T for a, one in zip(ahead, beside, strict=True))
        if len(beside) > 1 and np.array_equal(last.slow, beside[1].slow):
            last = last._replace(M=2 * last.M - beside[1].M, dT=2 * last.dT - beside[1].dT)
        found = self.turns.close(y, T, beside=last)
        return found if _is_stable(found) and (len(found.rows) < LONG or self._attracts(found)) else None

    def _run(self, y: Array, duration: float, first_step: float) -> tuple[Array, float, Array, Array]:
        """A part of a transient."""
        end, rows = self.turns.run(y, duration, first_step=first_step), self.turns.rows
        return end.y, end.step, rows, rows[:, 3]

    def _from_cold(self, p: CycleProblem, points: Array) -> tuple[Cell, Closed | None]:
        """What a cold ring comes to; ``points`` are the stable fixed points."""
        passed, tries = 0.0, 0
        parts = settling.transient(
            self._run, self.turns.problem.zero(), lambda: points, self.problem.longest, self.look
        )
        for y, seen, at, passed in parts:
            if seen.pulses(lambda: points):
                found, tries = self._pursued(y, seen, len(points) > 0), tries + 1
                if found is not None:
                    return self._words(p, found), found
            if at is not None:
                return Cell(Regime.STABLE, swing=0.0, reason=rest_words(p.where, passed, at)), None
            if tries == TRIES:
                return self._carefully(p, y), None
        words = f"no settled cycle{p.where}: {passed / 1e3:.4g} us from a cold ring do not lead to one"
        return Cell(Regime.SLOW_TRANSIENT, reason=words), None

    def _pursued(self, y: Array, seen: Part, still: bool) -> Closed | None:
        """The stable cycle that a transient in ``y`` comes to; where a cycle has doubled, that of twice the pulses."""
        level, reach, pulses = (seen.low + seen.high) / 2, REACH * seen.longest, 1
        while pulses <= MOST_PULSES:
            met = self.turns.run(y, reach, level=level)
            found = self.turns.close(met.y, pulses * seen.longest, pulses) if met.met else None
            if _is_stable(found):
                change = abs(np.ptp(found.rows[:, 3]) - (seen.high - seen.low))
                alike = not still or change <= settling.AGREE * (seen.high - seen.low)
                return found if alike and self._comes_nearer(met.y, found) and self._attracts(found) else None
            if found is None or found.worst.real > -1 or found.worst.imag != 0:
                return None
            pulses *= 2  # pulses that differ more make a better start
            y = self.turns.run(met.y, settling.DIFFER * seen.longest).y
        return None

    def _comes_nearer(self, y: Array, found: Closed) -> bool:
        """Whether the trace from ``y`` is nearer to the cycle after as many turns as halve a small deviation."""
        turns = int(np.clip(np.ceil(np.log(0.5) / np.log(max(found.size, 1e-3))), 2, settling.PATIENT))
        warmest, first, last = np.abs(found.y[3:]).max(), np.inf, np.inf
        for turn in range((turns + 1) * found.pulses):
            off = np.abs(y[3:] - found.y[3:]).max() / warmest
            if turn < found.pulses:
                first = min(first, off)
            if first < settling.REPEATS:
                return True
            if turn >= turns * found.pulses:
                last = min(last, off)
            run = self.turns.run(y, REACH * found.T, level=found.y[2], above=True)
            if not run.met:
                return False
            y = run.y
        return bool(last < max((1 + found.size**turns) / 2 * first, settling.REPEATS))

    def _attracts(self, found: Closed) -> bool:
        """Whether a trace from beside the cycle comes nearer as the return map says: among bursts it may err."""
        slow, M = found.slow, found.M[found.slow]
        aside = ASIDE * np.abs(found.y[3:]).max()
        y, off = found.y.copy(), np.full(slow.size, aside)
        y[slow] += off
        for _ in range(AGAIN * found.pulses):
            run = self.turns.run(y, REACH * found.T, level=found.y[2], above=True, rtol=FINE)
            if not run.met:
                return False
            y = run.y
        expected = np.linalg.matrix_power(M, AGAIN) @ off
        return bool(np.abs(y[slow] - found.y[slow] - expected).max() < aside / 2)

    def _carefully(self, p: CycleProblem, y: Array) -> Cell:
        """What a transient in ``y`` comes to, by `settling.settled`."""
        try:
            orbit = p.settled(y, look=self.look)
        except RestError as rest:
            return Cell(Regime.STABLE, swing=0.0, reason=str(rest))
        except InputError as error:
            return Cell(Regime.SLOW_TRANSIENT, reason=str(error))
        return _pulsing(orbit.T, orbit.size, orbit.pulses, orbit.trace.rows)


def _is_stable(found: Closed | None) -> TypeGuard[Closed]:
    """Whether there is a cycle, and its multipliers say that it is stable."""
    if found is None or not found.size < 1:
        return False
    N = found.rows[:, 3]
    return bool(np.ptp(N) > FLAT * N.max())


def _pulsing(T: float, size: float, pulses: int, rows: Array) -> Cell:
    """A settled cycle of the period T in ns, with ``rows`` as of the kernel."""
    words = f"settled cycle; a deviation shrinks to {size:.3g} of itself in a period"
    if pulses > 1:
        words += f"; {pulses} pulses in a period"
    seen = measure(rows)
    return Cell(Regime.SELF_PULSING, T * NS, seen.duty, seen.swing, words, seen.hottest)
