"""The settled cycles along a row of a map: continued from point to point where no fixed point is stable.

Where a fixed point is stable, the ring may rest there or pulse; a transient from a cold ring decides. A cycle is
accepted if this transient approaches it, and a trace that starts next to it does so, too.
"""

from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..cycles.cycle_problem import CycleProblem
from ..cycles.cycle_search import RestError, UnsettledError, settled
from ..cycles.return_map import FLAT, Measures, measures
from ..equilibria.steady_states import Fixed
from ..kernel.shooting import FINE, Closed, Turns
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning
from ..runs.pulsing import Regime
from .grid import Point


class Cell(NamedTuple):
    """Result at one point of a map: regime, period (s), duty cycle, swing (K), reason, and highest rise (K)."""

    regime: str
    period: float = np.nan  # s
    duty: float = np.nan
    swing: float = np.nan  # K
    reason: str = ""
    rise: float = 0.0  # K, the highest of its cycle or trace and its fixed points


LONG = 800  # steps of a cycle; one with more may be a burst, of which a stable return map alone proves little
ASIDE = 3e-4  # of the largest state of heat: the distance from a cycle at which a trace begins that tests it
AGAIN = 3  # periods of that trace, in which its distance must change as the return map says
PRECISE = 1e-9  # rtol, with Rodas5P, of the numbers of a cycle that is `LONG`
REACH = 4.0  # periods within which a trace must come back to the section where the carriers rise
AHEAD = ([1.0], [2.0, -1.0], [3.0, -3.0, 1.0])  # the polynomial through one to three neighbours at the next point


def settled_row(model: Any, points: list[Point], fixed: list[Fixed | str], watch: Array) -> list[Cell]:
    """Return a `Cell` for every point of a row; ``fixed`` are its fixed points, and ``watch[0]`` > 0 stops the work."""
    out: list[Cell | Closed] = []
    for (ring, power), group in groupby(zip(points, fixed, strict=True), key=lambda pair: pair[0][:2]):
        row = _Row(ring, model, power, watch)
        beside: list[Closed] = []
        for (_, _, detuning), at in group:
            row.look()
            try:
                if isinstance(at, str):
                    raise InputError(at)
                found = row.point(detuning, at, beside)
                cell: Cell | Closed = found if isinstance(found, Cell) else row.precisely(found)
            except (InputError, RuntimeError, np.linalg.LinAlgError) as error:
                cell = found = Cell("failed", reason=str(error))
            beside = [found, *beside[:2]] if isinstance(found, Closed) and found.pulses == 1 else []
            out.append(cell)
    seen = iter(measures([cell.rows for cell in out if isinstance(cell, Closed)]))  # all at once, which is faster
    cells = [_pulsing(cell, next(seen)) if isinstance(cell, Closed) else cell for cell in out]
    heat = [0.0 if isinstance(at, str) else float(at.every[:, 2].max()) for at in fixed]
    return [cell._replace(rise=max(cell.rise, rise)) for cell, rise in zip(cells, heat, strict=True)]


class _Row:
    """Settled cycles of one ring at one power, detuning after detuning; implements `cycles.cycle_search.Shooting`."""

    heat = 3  # index of the first of its states

    def __init__(self, ring: Any, model: Any, power: float, watch: Array) -> None:
        self.watch, self.problem = watch, CycleProblem(ring, model, power, 0.0)
        self.longest = self.problem.longest
        self.turns = Turns(self.problem.kernel(Method.RODAS4))

    @cached_property
    def precise(self) -> Turns:
        """The same return map by Rodas5P, which is faster at small tolerances."""
        return Turns(self.problem.kernel(Method.RODAS5P))

    def look(self) -> None:
        """Raise KeyboardInterrupt where another thread has set ``watch[0]`` above 0."""
        if self.watch[0] > 0:
            raise KeyboardInterrupt

    def point(self, detuning: float, fixed: Fixed, beside: list[Closed]) -> Cell | Closed:
        """Return the cycle at a detuning (Hz), or the cell without one.

        beside: one-pulse cycles of the previous points, last first.
        """
        self.problem = replace(self.problem, detuning=detuning)
        self.turns.problem.set_detuning(internal_detuning(detuning))
        self.turns.near(fixed.every)
        found = self._continued(beside) if beside and not len(fixed.stable) else None
        return found or self._from_cold(fixed.stable)

    def precisely(self, found: Closed) -> Closed:
        """Return a cycle of more than 800 steps solved again with a small tolerance, any other as it is."""
        if len(found.rows) <= LONG:
            return found
        self.precise.problem.set_detuning(internal_detuning(self.problem.detuning))
        return self.precise.closer(found, PRECISE) or found

    def _continued(self, beside: list[Closed]) -> Closed | None:
        """Return the stable cycle near the polynomial extrapolation of those at the points before; None without one."""
        ahead, last = AHEAD[len(beside) - 1], beside[0]
        y = np.sum([a * one.start for a, one in zip(ahead, beside, strict=True)], axis=0)
        T = sum(a * one.T for a, one in zip(ahead, beside, strict=True))
        if len(beside) > 1 and np.array_equal(last.slow, beside[1].slow):
            last = last._replace(M=2 * last.M - beside[1].M, dT=2 * last.dT - beside[1].dT)
        found = self.turns.close(y, T, beside=last)
        if found is None or found.size >= 1 or not self._moves(found):
            return None
        return found if len(found.rows) < LONG or self._attracts(found) else None

    def _from_cold(self, points: Array) -> Cell | Closed:
        """Return the cycle reached from a cold ring, or the cell without one; points: stable, rows (U, N, dT)."""
        try:
            found: Closed = settled(
                self, self.turns.problem.zero(), lambda: points, self.longest, where=self.problem.where,
                look=self.look,
            )  # fmt: skip
        except RestError as rest:
            return Cell(Regime.STABLE, swing=0.0, reason=str(rest))
        except UnsettledError as error:
            return Cell(Regime.SLOW_TRANSIENT, reason=str(error))
        return found

    def part(self, y: Array, duration: float, first_step: float) -> tuple[Array, float, Array, Array]:
        """Integrate for ``duration`` ns; return final state, next step, rows (t, Re a, Im a, N, dT), and their N."""
        end, rows = self.turns.run(y, duration, first_step=first_step), self.turns.rows
        return end.y, end.step, rows, rows[:, 3]

    def turn(self, y: Array, longest: float, level: float | None = None) -> Array | None:
        """Return the state where N next rises through ``level`` (default: N of ``y``), None after ``longest`` ns."""
        end = self.turns.run(y, longest, level=float(y[2]) if level is None else level, above=level is None)
        return end.y if end.met else None

    def cycle(self, y: Array, pulses: int, wait: float, precisely: bool) -> Closed | None:
        """Return the periodic orbit near ``y`` with ``pulses`` pulses of about ``wait`` ns each; None without one."""
        found = (self.precise if precisely else self.turns).close(y, pulses * wait, pulses)
        return found if found is not None and self._moves(found) else None

    def _moves(self, orbit: Closed) -> bool:
        """Whether the orbit is no fixed point: the range of N along it exceeds a small fraction of its maximum."""
        return self.swing(orbit) > FLAT * float(orbit.rows[:, 3].max())

    def confirmed(self, orbit: Closed, wait: float) -> Closed | None:
        """Return the orbit if a trace approaches it, or precise multipliers are below 1 in modulus; else None."""
        if self._attracts(orbit):
            return orbit
        found = self.problem.flow.cycle(orbit.start, orbit.pulses, wait, precisely=True)
        return orbit if found is not None and found.size < 1 else None

    def swing(self, orbit: Closed) -> float:
        """Return the range of the carrier density N along the orbit, in 1e23/m^3."""
        return float(np.ptp(orbit.rows[:, 3]))

    def _attracts(self, found: Closed) -> bool:
        """Whether a trace that starts off the cycle approaches it as the return map predicts, within 3 periods."""
        slow, M = found.slow, found.M[found.slow]
        aside = ASIDE * np.abs(found.start[3:]).max()
        y = found.start.copy()
        off = np.full(slow.size, aside)
        y[slow] += off
        for _ in range(AGAIN * found.pulses):
            run = self.turns.run(y, REACH * found.T, level=found.start[2], above=True, rtol=FINE)
            if not run.met:
                return False
            y = run.y
        expected = np.linalg.matrix_power(M, AGAIN) @ off
        return bool(np.abs(y[slow] - found.start[slow] - expected).max() < aside / 2)


def _pulsing(found: Closed, seen: Measures) -> Cell:
    """Return the cell of a cycle from its measures."""
    words = f"settled cycle; a deviation shrinks to {found.size:.3g} of itself in a period"
    if found.pulses > 1:
        words += f"; {found.pulses} pulses in a period"
    return Cell(Regime.SELF_PULSING, found.T * NS, seen.duty, seen.swing, words, seen.hottest)
