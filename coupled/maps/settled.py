"""The settled cycles of a row of a map: every point from its neighbours' cycles where no fixed point is stable.

Where one is, the ring may rest there or pulse beside it; a transient from a cold ring decides which.
"""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray

from ..cycles.closing import Settled, refined
from ..cycles.orbit import FEW_SHOTS, ROUGH, ROUGHLY, TRACE_RTOL, CycleProblem, closer, problem
from ..cycles.parameters import under_laser
from ..cycles.scheme import scheme
from ..cycles.start import RestError, longest_of, pursued, rest_words
from ..equilibria.balance import absorbable, internal_ring
from ..equilibria.spectrum import stable_points
from ..kernel.tableaus import Method, tableau
from ..kernels.interrupts import uninterrupted
from ..runs.pulsing import DUTY_LEVEL, Regime
from .grid import Point

if TYPE_CHECKING:
    from ..kernels.orbit_row import Beside
    from ..kernels.orbit_start import Transient

Found = tuple[str, float, float, float, str]


def settled_row(model: Any, points: list[Point], watch: Array) -> list[Found]:
    """Return regime, period (s), duty, swing (K) and the reason at every point of a row."""
    out: list[Found] = []
    for (ring, power), group in groupby(points, key=lambda point: point[:2]):
        part = [detuning for _, _, detuning in group]
        try:
            row = _Row.of(ring, model, power, part)
        except _FAILURES as error:
            out += [_failed(error)] * len(part)
        else:
            out += row.cells(watch)
    return out


class _Row(NamedTuple):
    """Detunings under one power."""

    p: CycleProblem
    detunings: list[float]
    shifts: Array  # the same in rad/ns
    still: NDArray[np.bool_]  # where a fixed point is stable
    points: Array  # which, as of `stable_points`

    @classmethod
    def of(cls, ring: Any, model: Any, power: float, detunings: list[float]) -> _Row:
        """Prepare the row."""
        from ..kernels import equations as eq

        p = problem(ring, model, power, detunings[0])
        at = internal_ring(ring, model, absorbable(ring, power))
        shifts = np.array([eq.internal_detuning(nu) for nu in detunings])
        points = stable_points(p.at.pump, shifts, at)
        return cls(p, detunings, shifts, np.isfinite(points[:, 0, 0]), points)

    def cells(self, watch: Array) -> list[Found]:
        """Return regime, period, duty cycle, swing and reason at every detuning."""
        from ..kernels import orbit_row

        m, out = self.p.units.size, list[Found]()
        none = orbit_row.Beside(np.empty((0, m)), np.empty(0), np.empty((0, 0)))
        beside = none
        while len(out) < len(self.detunings):
            if watch[0] > 0:
                raise KeyboardInterrupt
            try:
                cells, beside, transient = self._along(len(out), beside, watch)
                out += cells
                if len(out) < len(self.detunings):
                    cell, found = self._point(len(out), transient)
                    if found is None or found.pulses > 1:
                        beside = none
                    else:
                        beside = orbit_row.after(beside, found.orbit.start, found.orbit.T, found.orbit.M)
                    out.append(cell)
            except _FAILURES as error:
                out.append(_failed(error))
                beside = none
        return out

    def _along(self, first: int, beside: Beside, watch: Array) -> tuple[list[Found], Beside, Transient]:
        """Return the points from ``first`` on, up to one where a transient does not end at rest."""
        from ..kernels import orbit_row

        options = orbit_row.Options(TRACE_RTOL, *ROUGH, FEW_SHOTS, ROUGHLY, DUTY_LEVEL, longest_of(self.p))
        rows, beside, transient = uninterrupted(
            orbit_row.along, self.shifts[first:], self.still[first:], self.points[first:], beside, self.p.at,
            self.p.floor, scheme(), tableau(Method.RODAS4), options, watch,
        )  # fmt: skip
        return [self._cell(first + k, row) for k, row in enumerate(rows.tolist())], beside, transient

    def _cell(self, k: int, row: list[float]) -> Found:
        """Convert a row of `orbit_row.along`."""
        if row[4] < 0:
            T, duty, swing, size = row[:4]
            return _pulsing(T, duty, swing, size)
        p = self.p._replace(detuning=self.detunings[k])
        return _resting(rest_words(p, row[3], self.points[k, int(row[4])]))

    def _point(self, k: int, transient: Transient) -> tuple[Found, Settled | None]:
        """Return one point from where a transient has come to."""
        from ..kernels import orbit_measure, orbit_row

        p = under_laser(self.p, self.p.power, self.detunings[k])
        try:
            found = pursued(p, transient, self.points[k])
        except RestError as rest:
            return _resting(str(rest)), None
        except checks.InputError as error:
            return (str(Regime.SLOW_TRANSIENT), np.nan, np.nan, np.nan, str(error)), None
        if found.pulses > 1:  # long, and sensitive: the mesh of a trace leaves 1e-5 of the period
            found = refined(p, found)
        elif found.size > orbit_row.SURE:
            found = found._replace(orbit=closer(p, found.orbit))
        orbit = found.orbit
        duty, swing, _, _ = orbit_measure.measured(orbit.start, orbit.Y, orbit.tau, p.at.thermal, scheme(), DUTY_LEVEL)
        return _pulsing(orbit.T, float(duty), float(swing), found.size, found.pulses), found


_FAILURES = (checks.InputError, RuntimeError, np.linalg.LinAlgError)


def _failed(error: Exception) -> Found:
    return ("failed", np.nan, np.nan, np.nan, str(error))


def _resting(words: str) -> Found:
    return (str(Regime.STABLE), np.nan, np.nan, 0.0, words)


def _pulsing(T: float, duty: float, swing: float, size: float, pulses: int = 1) -> Found:
    """A settled cycle of the period T in ns."""
    words = f"settled cycle; a deviation shrinks to {size:.3g} of itself in a period"
    if pulses > 1:
        words += f"; {pulses} pulses in a period"
    return (str(Regime.SELF_PULSING), T * 1e-9, duty, swing, words)
