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

from ..cycles.cycle_problem import CycleProblem, RestError, UnsettledError, settled
from ..cycles.orbit_measures import Measures, measures
from ..cycles.return_map import FLAT
from ..equilibria.steady_states import Fixed
from ..kernel.shooting import FINE, PeriodicOrbit, ReturnMap
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning
from ..runs.pulsing import Regime
from .stability_map import Point


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
REACH = 4.0  # periods within which a trace must come back to the section where the carriers rise
AHEAD = ([1.0], [2.0, -1.0], [3.0, -3.0, 1.0])  # the polynomial through one to three neighbours at the next point


def settled_row(model: Any, points: list[Point], fixed: list[Fixed | str], watch: Array) -> list[Cell]:
    """Return a `Cell` for every point of a row; ``fixed`` are its fixed points, and ``watch[0]`` > 0 stops the work."""
    out: list[Cell | PeriodicOrbit] = []
    for (ring, power), group in groupby(zip(points, fixed, strict=True), key=lambda pair: pair[0][:2]):
        row = _Row(ring, model, power, watch)
        beside: list[PeriodicOrbit] = []
        for (_, _, detuning), fixed_points in group:
            row.check_interrupt()
            try:
                if isinstance(fixed_points, str):
                    raise InputError(fixed_points)
                orbit = row.point(detuning, fixed_points, beside)
                cell = row.refined(orbit)
            except (InputError, RuntimeError, np.linalg.LinAlgError) as error:
                orbit = cell = Cell("failed", reason=str(error))
            continues = isinstance(orbit, PeriodicOrbit) and orbit.pulses == 1
            beside = [orbit, *beside[:2]] if continues else []  # type: ignore[list-item]
            out.append(cell)
    orbits = [cell.rows for cell in out if isinstance(cell, PeriodicOrbit)]
    each_measures = iter(measures(orbits))  # all at once, which is faster
    cells = [_pulsing(cell, next(each_measures)) if isinstance(cell, PeriodicOrbit) else cell for cell in out]
    rises = [0.0 if isinstance(each, str) else float(each.every[:, 2].max()) for each in fixed]
    return [cell._replace(rise=max(cell.rise, rise)) for cell, rise in zip(cells, rises, strict=True)]


class _Row:
    """Settled cycles of one ring at one power, detuning after detuning; `cycle_problem.settled` takes it as a flow."""

    heat = 3  # index of the first of its states

    def __init__(self, ring: Any, model: Any, power: float, watch: Array) -> None:
        self.watch = watch
        self.problem = CycleProblem(ring, model, power, 0.0)
        self.longest = self.problem.longest
        self.returns = ReturnMap(self.problem.kernel(Method.RODAS4))

    @cached_property
    def precise(self) -> ReturnMap:
        """The same return map by Rodas5P, which is faster at small tolerances."""
        return ReturnMap(self.problem.kernel(Method.RODAS5P))

    def check_interrupt(self) -> None:
        """Raise KeyboardInterrupt where another thread has set ``watch[0]`` above 0."""
        if self.watch[0] > 0:
            raise KeyboardInterrupt

    def point(self, detuning: float, fixed: Fixed, beside: list[PeriodicOrbit]) -> Cell | PeriodicOrbit:
        """Return the cycle at a detuning (Hz), or the cell without one.

        beside: one-pulse cycles of the previous points, last first.
        """
        self.problem = replace(self.problem, detuning=detuning)
        self.returns.problem.set_detuning(internal_detuning(detuning))
        self.returns.set_fixed_points(fixed.every)
        continued = self._continued(beside) if beside and not len(fixed.stable) else None
        return continued or self._from_cold(fixed.stable)

    def refined(self, orbit: Cell | PeriodicOrbit) -> Cell | PeriodicOrbit:
        """Return a cycle of more than 800 steps solved again with a small tolerance, anything else as it is."""
        if isinstance(orbit, Cell) or len(orbit.rows) <= LONG:
            return orbit
        self.precise.problem.set_detuning(internal_detuning(self.problem.detuning))
        return self.precise.refined(orbit, 1e-9) or orbit

    def _continued(self, beside: list[PeriodicOrbit]) -> PeriodicOrbit | None:
        """Return the stable cycle near the polynomial extrapolation of those at the points before; None without one."""
        weights = AHEAD[len(beside) - 1]
        y = np.sum([weight * orbit.start for weight, orbit in zip(weights, beside, strict=True)], axis=0)
        T = sum(weight * orbit.T for weight, orbit in zip(weights, beside, strict=True))
        last = beside[0]
        if len(beside) > 1 and np.array_equal(last.slow, beside[1].slow):
            M = 2 * last.M - beside[1].M
            dT = 2 * last.dT - beside[1].dT
            last = last._replace(M=M, dT=dT)
        orbit = self.returns.close(y, T, beside=last)
        if orbit is None or orbit.size >= 1 or not self._moves(orbit):
            return None
        return orbit if len(orbit.rows) < LONG or self._attracts(orbit) else None

    def _from_cold(self, points: Array) -> Cell | PeriodicOrbit:
        """Return the cycle reached from a cold ring, or the cell without one; points: stable, rows (U, N, dT)."""
        try:
            orbit: PeriodicOrbit = settled(
                self, self.returns.problem.zero(), lambda: points, self.longest, where=self.problem.where,
                look=self.check_interrupt,
            )  # fmt: skip
        except RestError as rest:
            return Cell(Regime.STABLE, swing=0.0, reason=str(rest))
        except UnsettledError as error:
            return Cell(Regime.SLOW_TRANSIENT, reason=str(error))
        return orbit

    def part(self, y: Array, duration: float, first_step: float) -> tuple[Array, float, Array, Array]:
        """Integrate for ``duration`` ns; return final state, next step, rows (t, Re a, Im a, N, dT), and their N."""
        end = self.returns.run(y, duration, first_step=first_step)
        rows = self.returns.rows
        return end.y, end.step, rows, rows[:, 3]

    def turn(self, y: Array, longest: float, level: float | None = None) -> Array | None:
        """Return the state where N next rises through ``level`` (default: N of ``y``), None after ``longest`` ns."""
        starts_on_level = level is None
        section = float(y[2]) if level is None else level
        end = self.returns.run(y, longest, level=section, above=starts_on_level)
        return end.y if end.met else None

    def cycle(self, y: Array, pulses: int, wait: float, precisely: bool) -> PeriodicOrbit | None:
        """Return the periodic orbit near ``y`` with ``pulses`` pulses of about ``wait`` ns each; None without one."""
        returns = self.precise if precisely else self.returns
        orbit = returns.close(y, pulses * wait, pulses)
        return orbit if orbit is not None and self._moves(orbit) else None

    def _moves(self, orbit: PeriodicOrbit) -> bool:
        """Whether the orbit is no fixed point: the range of N along it exceeds a small fraction of its maximum."""
        return self.swing(orbit) > FLAT * float(orbit.rows[:, 3].max())

    def confirmed(self, orbit: PeriodicOrbit, wait: float) -> PeriodicOrbit | None:
        """Return the orbit if a trace approaches it, or precise multipliers are below 1 in modulus; else None."""
        if self._attracts(orbit):
            return orbit
        precise = self.problem.flow.cycle(orbit.start, orbit.pulses, wait, precisely=True)
        return orbit if precise is not None and precise.size < 1 else None

    def swing(self, orbit: PeriodicOrbit) -> float:
        """Return the range of the carrier density N along the orbit, in 1e23/m^3."""
        return float(np.ptp(orbit.rows[:, 3]))

    def _attracts(self, orbit: PeriodicOrbit) -> bool:
        """Whether a trace that starts off the cycle approaches it as the return map predicts, within 3 periods."""
        slow = orbit.slow
        aside = ASIDE * np.abs(orbit.start[3:]).max()
        off = np.full(slow.size, aside)
        y = orbit.start.copy()
        y[slow] += off
        for _ in range(AGAIN * orbit.pulses):
            run = self.returns.run(y, REACH * orbit.T, level=orbit.start[2], above=True, rtol=FINE)
            if not run.met:
                return False
            y = run.y
        expected = np.linalg.matrix_power(orbit.M[slow], AGAIN) @ off
        unexpected = y[slow] - orbit.start[slow] - expected
        return bool(np.abs(unexpected).max() < aside / 2)


def _pulsing(orbit: PeriodicOrbit, of_cycle: Measures) -> Cell:
    """Return the cell of a cycle from its measures."""
    words = f"settled cycle; a deviation shrinks to {orbit.size:.3g} of itself in a period"
    if orbit.pulses > 1:
        words += f"; {orbit.pulses} pulses in a period"
    return Cell(Regime.SELF_PULSING, orbit.T * NS, of_cycle.duty, of_cycle.swing, words, of_cycle.hottest)
