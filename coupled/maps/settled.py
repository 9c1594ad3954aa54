"""The settled cycles of a row of a map: every point from its neighbours' cycles where no fixed point is stable.

Where one is, the ring may rest there or pulse beside it; a transient from a cold ring decides which.
"""

from __future__ import annotations

from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thermofem import checks

from ..cycles.orbit import FEW_SHOTS, ROUGH, TRACE_RTOL, CycleProblem, Orbit, closer, problem
from ..cycles.parameters import under_laser
from ..cycles.scheme import scheme
from ..cycles.start import RestError, Settled, settled, stable_points
from ..equilibria.steady import absorbable, internal
from ..kernels.interrupts import uninterrupted
from ..kernels.tableaus import Method, tableau
from ..runs.pulsing import DUTY_LEVEL, Regime
from .grid import Point

Array = NDArray[np.float64]

LONGEST = 3e5  # ns, a transient from a cold ring

Found = tuple[str, float, float, float, str]
Beside = tuple[Array, Array, Array]  # starts, periods and the last return map of up to three neighbours


def settled_row(model: Any, points: list[Point], watch: Array) -> list[Found]:
    """Return regime, period (s), duty, swing (K) and the reason at every point of a row."""
    out: list[Found] = []
    beside: Beside | None = None
    for (ring, power), group in groupby(points, key=lambda point: point[:2]):
        part = [detuning for _, _, detuning in group]
        try:
            row = _Row.of(ring, model, power, part)
        except _FAILURES as error:
            out += [_failed(error)] * len(part)
            beside = None
            continue
        done = 0
        while done < len(part):
            if watch[0] > 0:
                raise KeyboardInterrupt
            try:
                if beside is not None:
                    cells, beside = row.along(done, beside, watch)
                    out += cells
                    done += len(cells)
                    if done == len(part):
                        break
                cell, found = row.point(done)
            except _FAILURES as error:
                cell, found = _failed(error), None
            out.append(cell)
            beside = None if found is None or found.pulses > 1 else _after(beside, found.orbit)
            done += 1
    return out


class _Row(NamedTuple):
    """Detunings under one power."""

    p: CycleProblem
    at: Any  # as `equilibria.steady.internal` returns it
    detunings: list[float]
    shifts: Array  # the same in rad/ns
    still: NDArray[np.bool_]  # where a fixed point is stable
    pieces: Array  # turning points of the fixed points

    @classmethod
    def of(cls, ring: Any, model: Any, power: float, detunings: list[float]) -> _Row:
        """Prepare the row."""
        from ..equilibria import balance, spectrum
        from ..kernels import equations as eq

        p = problem(ring, model, power, detunings[0])
        at = internal(ring, model, absorbable(ring, power))
        shifts = np.array([eq.internal_detuning(nu) for nu in detunings])
        seen = spectrum.survey(shifts, p.at.pump, at.rates, at.fcd, at.thermal.without_idle_poles(), at.static)
        rest = (p.at.pump, at.rates, at.fcd, at.static)
        pieces = balance.turning_points(balance.reach(float(np.abs(shifts).max()), *rest), *rest)
        return cls(p, at, detunings, shifts, np.asarray(seen[1] > 0), pieces)

    def along(self, first: int, beside: Beside, watch: Array) -> tuple[list[Found], Beside]:
        """The points from ``first`` on, as far as no fixed point is stable and a cycle lies beside the last one's."""
        from ..kernels import orbit_row

        ends = np.flatnonzero(self.still[first:])
        shifts = self.shifts[first : first + int(ends[0]) if ends.size else None]
        if shifts.size == 0:
            return [], beside
        rows, *beside_ = uninterrupted(
            orbit_row.along, shifts, *beside, self.p.at, self.p.floor, scheme(), tableau(Method.RODAS4), TRACE_RTOL,
            *ROUGH, FEW_SHOTS, DUTY_LEVEL, watch,
        )  # fmt: skip
        return [_pulsing(*row) for row in rows.tolist()], (beside_[0], beside_[1], beside_[2])

    def point(self, k: int) -> tuple[Found, Settled | None]:
        """One point by a transient from a cold ring."""
        from ..kernels import orbit_measure, orbit_row

        p = under_laser(self.p, self.p.power, self.detunings[k])
        still = stable_points(p, self.at, self.pieces) if self.still[k] else np.empty((0, 3))
        try:
            found = settled(p, np.zeros(p.units.size), points=still, rough=True, longest=LONGEST)
        except RestError as rest:
            return (str(Regime.STABLE), np.nan, np.nan, 0.0, str(rest)), None
        except checks.InputError as error:
            return (str(Regime.SLOW_TRANSIENT), np.nan, np.nan, np.nan, str(error)), None
        if found.size > orbit_row.SURE:
            found = found._replace(orbit=closer(p, found.orbit))
        orbit = found.orbit
        duty, swing, _, _ = orbit_measure.measured(orbit.start, orbit.Y, orbit.tau, p.at.thermal, scheme(), DUTY_LEVEL)
        return _pulsing(orbit.T, float(duty), float(swing), found.size, found.pulses), found


_FAILURES = (checks.InputError, RuntimeError, np.linalg.LinAlgError)


def _failed(error: Exception) -> Found:
    return ("failed", np.nan, np.nan, np.nan, str(error))


def _pulsing(T: float, duty: float, swing: float, size: float, pulses: int = 1) -> Found:
    """A settled cycle of the period T in ns."""
    words = f"settled cycle; a deviation shrinks to {size:.3g} of itself in a period"
    if pulses > 1:
        words += f"; {pulses} pulses in a period"
    return (str(Regime.SELF_PULSING), T * 1e-9, duty, swing, words)


def _after(beside: Beside | None, orbit: Orbit) -> Beside:
    """The neighbours of the next point."""
    starts, periods = orbit.start[None], np.array([orbit.T])
    if beside is not None:
        starts, periods = np.concatenate([starts, beside[0][:2]]), np.append(periods, beside[1][:2])
    return starts, periods, np.ascontiguousarray(orbit.M)
