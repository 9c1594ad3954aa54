"""Does a ring pulse under a constant laser? `simulate` and `pulsing` in one call, for maps of many points."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import checks

from ..equilibria.balance import InternalRing, absorbable, internal_ring
from ..kernel.tableaus import Method, tableau
from ..kernels.interrupts import new_watch
from ..resonator import RingResonator
from ..runs import window
from ..runs.pulsing import Pulsing, Regime, classify, lasting
from ..runs.resting import Rest, rest_of
from ..states import State

Array = NDArray[np.float64]


@lru_cache(maxsize=16)
def _prepared(ring: RingResonator, model: Any) -> tuple[Any, ...]:
    """Ring and model in internal units, once for all points of a map."""
    from ..kernels import equations as eq

    return (*eq.internal_rates(ring), eq.internal_thermal(model), model.thermal_resistance * eq.UW)


@lru_cache(maxsize=16)
def at_rest(ring: RingResonator, model: Any, power: float) -> InternalRing:
    """Rates and static heat of the fixed points, computed once for all detunings."""
    return internal_ring(ring, model, absorbable(ring, power))


def _rest(ring: RingResonator, model: Any, power: float, detuning: float) -> Rest | None:
    """All fixed points; None where a quadratic model has no steady state at the power."""
    try:
        return rest_of(ring, model, power, detuning, at=at_rest(ring, model, power))
    except checks.InputError:
        return None


def pulse(
    ring: RingResonator,
    model: Any,
    *,
    power: float,
    detuning: float,
    duration: float = 20e-6,
    rtol: float = 1e-5,
    initial: State,
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
    watch : array, optional
        flag by which another thread stops the integration, `interrupts.new_watch`.
    """
    from ..kernels import equations as eq
    from ..kernels import rosenbrock

    rates, fcd, thermal, resistance = _prepared(ring, model)
    pump = eq.internal_pump(ring, power)
    laser = window.constant_laser(0.0, duration, pump, eq.internal_detuning(detuning))
    unit = window.units(np.size(initial.thermal))
    method = tableau(Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
    rows, y, reached, _, _, counts = rosenbrock.integrate(
        initial.as_array() / unit, laser, rates, fcd, thermal, method, rtol,
        window.floor_of(rates, pump, resistance), np.empty(0), 1, 0.0, np.zeros(3), window.MAX_STEPS,
        new_watch() if watch is None else watch,
    )  # fmt: skip
    window.check_end(counts, reached, duration, rtol)
    t, ar, ai, N, dT = np.ascontiguousarray(rows.T)
    if t.size < 8:
        raise checks.InputError(f"the run took {t.size - 1} steps; at least 8 samples are needed to tell a cycle")
    t, energy = t * eq.NS, (ar * ar + ai * ai) * eq.FJ
    found = classify(t, N * eq.DENSITY, energy, dT, rtol=rtol, every_step=True)
    if found.regime == Regime.STABLE:
        found = lasting(found, t, energy, dT, _rest(ring, model, power, detuning))
    return found, State.from_array(y * unit)
