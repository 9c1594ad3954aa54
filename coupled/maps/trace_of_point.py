"""Does a ring pulse under a constant laser? `simulate` and `pulsing` in one call, for maps of many points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

from ..equilibria.balance import absorbable, balance, internal_ring
from ..equilibria.spectrum import survey
from ..kernel.tableaus import Method
from ..kernel.units import DENSITY, FJ, NS, internal_detuning, internal_pump, single_ring, units
from ..resonator import RingResonator
from ..runs.pulsing import Pulsing, Regime, classify, lasting
from ..runs.resting import Rest
from ..states import State
from ..thermal import Compact
from .grid import Point


def rests(model: Compact, points: Sequence[Point]) -> list[Rest | None]:
    """All fixed points of every point of a row; None where a quadratic model has no steady state at the power."""
    out: list[Rest | None] = [None] * len(points)
    for ring in dict.fromkeys(ring for ring, _, _ in points):
        cells = [k for k, point in enumerate(points) if point[0] == ring]
        try:
            at = internal_ring(ring, model, max(absorbable(ring, points[k][1]) for k in cells))
        except checks.InputError:
            continue
        pump = np.array([internal_pump(ring, points[k][1]) for k in cells])
        found = survey(pump, np.array([internal_detuning(points[k][2]) for k in cells]), at)
        dT = balance(found.U, at).dT
        for n, k in enumerate(cells):
            own = found.cell == n
            out[k] = Rest(found.U[own] * FJ, dT[own], found.growth[own] / NS)
    return out


def pulse(
    ring: RingResonator,
    model: Compact,
    *,
    power: float,
    detuning: float,
    duration: float = 20e-6,
    rtol: float = 1e-5,
    initial: State,
    rest: Rest | None = None,
    watch: Array | None = None,
) -> tuple[Pulsing, State]:
    """Return the result of ``pulsing(simulate(...))`` at constant power (W) and detuning (Hz), and the final state.

    The numbers are the same; without the Dataset a point takes two thirds of the time. The arguments are not checked.

    Parameters
    ----------
    ring, model : RingResonator, and a model as `thermal.compact` returns it
    power, detuning, duration, rtol : float
        as in `simulate`.
    initial : State
        ``State.cold(n)`` for a map from a cold ring.
    rest : Rest, optional
        the fixed points, as of `rests`.
    watch : array, optional
        whose first entry is above 0 where another thread asks the integration to stop.

    Raises KeyboardInterrupt: ``watch`` asks for it.
    """
    problem = single_ring(ring, model, power, detuning, duration, Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
    unit = units(problem.order)

    def look(_: float) -> None:
        if watch is not None and watch[0] > 0:
            raise KeyboardInterrupt

    run = problem.integrate(initial.as_array() / unit, rtol=rtol, progress=look)
    t, ar, ai, N, dT = np.ascontiguousarray(run.rows.T)
    if t.size < 8:
        raise checks.InputError(f"the run took {t.size - 1} steps; at least 8 samples are needed to tell a cycle")
    t, energy = t * NS, (ar * ar + ai * ai) * FJ
    found = classify(t, N * DENSITY, energy, dT, rtol=rtol, every_step=True)
    if found.regime == Regime.STABLE:
        known = rest if rest is not None else rests(model, [(ring, power, detuning)])[0]
        found = lasting(found, t, energy, dT, known)
    return found, State.from_array(run.y * unit)
