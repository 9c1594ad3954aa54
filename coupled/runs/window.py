"""Integration of a ring over one time window from a given state, and its traces; `simulate` and `cosimulate` use it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.piecewise import Pieces, bounds

from ..arguments import ROUND_OFF
from ..inputs import add, joint, largest, pieces, table
from ..kernel import units as eq
from ..kernel.integrator import Crossing, Drive, Polynomials, Problem
from ..kernel.tableaus import Method
from ..kernel.units import floor_of as floor_of
from ..kernel.units import units as units
from ..resonator import RingResonator, origin
from ..states import State
from ..thermal import Compact

MAX_STEPS = 20_000_000  # ten seconds of work and 800 MB of accepted steps
QUANTITIES = ("energy", "carriers", "delta_T")
NO_TIMES = np.empty(0)


class Event(NamedTuple):
    """A quantity ("energy" in J, "carriers" in 1/m^3 or "delta_T" in K) that rises through a level.

    ``stop`` says whether the run ends there.
    """

    quantity: str
    level: float
    stop: bool = True


class Window(NamedTuple):
    """Result of `advance` in SI; rows are the accepted steps or the wanted times."""

    time: Array
    field: NDArray[np.complex128]
    carriers: Array
    delta_T: Array
    absorbed: Array
    absorbed_slope: Array
    """dP_abs/dt in W/s: with ``absorbed`` a cubic Hermite spline as good as the steps."""
    final: State
    reached: float
    step: float
    """The step that the integration would take next, s; give it as ``first_step`` of the window that follows."""
    crossings: Array
    counts: NDArray[np.int64]
    """Accepted and rejected steps."""


def advance(
    ring: RingResonator,
    model: Compact,
    state: State,
    start: float,
    stop: float,
    *,
    power: Any,
    detuning: Any = 0.0,
    offset: Any = 0.0,
    rtol: float = 1e-6,
    method: Method | None = None,
    times: Array = NO_TIMES,
    per_step: int = 1,
    first_step: float = 0.0,
    event: Event | None = None,
    slopes: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Window:
    """Integrate ring and thermal model from ``state`` at ``start`` to ``stop``.

        dT = dT_model + offset(t)

    ring, model, state: the model as `thermal.compact` returns it.
    start, stop [s]
    power, detuning, offset [W, Hz, K]: a number, a Waveform, `Pieces`, a SciPy PPoly of degree 3 or less, or a list of
        them, which add. The integration lands on every edge. The returned delta_T contains the offset.
    rtol, method: as in `simulate`.
    times [s]: wanted times; empty for the accepted steps.
    per_step: rows for every accepted step.
    slopes: whether absorbed_slope is computed; it is empty otherwise.
    first_step [s]: 0 for a cautious one.
    progress: as in `simulate`.
    Raises InputError: a power below 0, inputs that do not cover the window, or too many steps.

    Measured on the self-pulsing ring at (8 dBm, 0 GHz) with Rodas4 at rtol 1e-6 against 1e-11: the spline through
    (absorbed, absorbed_slope) of one row a step is as near as the steps themselves.
    """
    drive, (heat, bend) = drive_of(ring, start, stop, power, detuning, offset), eq.internal_heat(model)
    rings = eq.internal_rings([ring], math.sqrt(drive.brightest[0]), model.thermal_resistance * eq.UW)
    unit, (rates, _) = eq.units(np.size(state.thermal)), eq.internal_rates(ring)
    chosen = method or (Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
    run = Problem(rings._replace(bend=bend), heat, drive, chosen).integrate(
        state.as_array() / unit, rtol=rtol, times=np.asarray(times) / eq.NS if np.size(times) else None,
        per_step=per_step, first_step=first_step / eq.NS, event=_event(event),
        progress=(lambda t: progress(t * eq.NS)) if progress else None,
    )  # fmt: skip
    t, ar, ai, N, dT = run.rows.T
    return Window(
        time=t * eq.NS,
        field=(ar + 1j * ai) * np.sqrt(eq.FJ),
        carriers=N * eq.DENSITY,
        delta_T=dT + (offset if isinstance(offset, float) else pieces("offset", offset, start, stop)(t * eq.NS)),
        absorbed=eq.absorbed_power(ar**2 + ai**2, N, rates) * eq.UW,
        absorbed_slope=_absorbed_slope(run.rows, drive, rates) if slopes else NO_TIMES,
        final=State.from_array(run.y * unit),
        reached=run.t * eq.NS,
        step=run.step * eq.NS,
        crossings=run.crossings * eq.NS,
        counts=np.array([run.accepted, run.rejected]),
    )


def _event(event: Event | None) -> Crossing | None:
    """The event in internal units."""
    if event is None:
        return None
    if not isinstance(event, Event):
        raise checks.InputError(f"event = {event!r} is no coupled.Event, such as coupled.Event('delta_T', 5.0)")
    level = checks.finite("event.level", event.level)
    kind = QUANTITIES.index(checks.choice("event", event.quantity, QUANTITIES))
    stop = checks.flag("event.stop", event.stop)
    return Crossing(1 + kind, level / (eq.FJ, eq.DENSITY, 1.0)[kind], stop)


def drive_of(ring: RingResonator, start: float, stop: float, power: Any, detuning: Any, offset: Any = 0.0) -> Drive:
    """Power, detuning and temperature offset as the kernel takes them.

    An offset shifts the resonance as a detuning of thermal_shift x offset does, so it becomes one.
    """
    if isinstance(power, float) and isinstance(detuning, float) and isinstance(offset, float) and power >= 0:
        turned = eq.internal_detuning(detuning) + ring.thermal_shift * eq.NS * offset
        constant = Drive.constant(eq.internal_pump(ring, power) ** 2, turned, 0.0)
        edges = np.array([start / eq.NS, stop / eq.NS])
        tables = {name: getattr(constant, name)._replace(edges=edges) for name in ("power", "phase", "detuning")}
        return constant._replace(edges=edges, **tables)
    P, nu, dT = (
        pieces(name, value, start, stop)
        for name, value in (("power", power), ("detuning", detuning), ("offset", offset))
    )
    low, high = bounds(P)
    if low < -ROUND_OFF * max(high, 1e-30):
        raise checks.InputError(f"power falls to {low:g} W; it must not be negative (powers are in W)")
    edges = joint(P, nu, dT)
    turning = add([nu.times(2 * np.pi * eq.NS), dT.times(ring.thermal_shift * eq.NS)])
    squared = P.times(2 * ring.bus_rate * eq.NS / eq.UW)
    none = Polynomials(np.array([start, stop]) / eq.NS, np.zeros((1, 1, 1)))
    return Drive(
        edges / eq.NS,
        table([squared]),
        none,
        table([turning]),
        np.ones((1, 1), dtype=complex),
        np.array([largest(squared)]),
    )


def _absorbed_slope(rows: Array, drive: Drive, rates: eq.Rates) -> Array:
    """dP_abs/dt in W/s at the rows, from the equations themselves: dU/dt = 2 (pump Im a - gamma U)."""
    t, ar, ai, N, _ = rows.T
    pump = np.sqrt(np.maximum(Pieces(drive.power.edges, drive.power.coefficients[:, 0])(t), 0))
    U = ar**2 + ai**2
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    U_slope = 2 * (pump * ai - gamma * U)
    recombination = N * (1 + rates.b * N) / (rates.tau0 * (1 + rates.a * N))
    N_slope = rates.g * U**2 - recombination
    slope = 2 * (rates.absorbed + rates.fca * N + 2 * rates.tpa * U) * U_slope + 2 * rates.fca * U * N_slope
    return slope * eq.UW / eq.NS


def provenance(ring: RingResonator, light: dict[str, Any], duration: float) -> dict[str, Any]:
    """Attributes of every run: ring and laser."""
    return {
        **origin("coupled", ring),
        **{name: value for name, value in light.items() if isinstance(value, float)},
        "duration": float(duration),
    }


def traces(ring: RingResonator, run: Window, light: dict[str, Any]) -> dict[str, Array]:
    """All time traces of a run, in SI."""
    U = np.abs(run.field) ** 2
    stop = max(float(run.reached), float(run.time.max(initial=0.0)))
    at = {
        name: np.full(run.time.size, value) if isinstance(value, float) else pieces(name, value, 0.0, stop)(run.time)
        for name, value in light.items()
    }
    traces = {
        "energy": U,
        "carriers": run.carriers,
        "delta_T": run.delta_T,
        "drop": 2 * ring.drop_bus_rate * U,
        "through": np.abs(np.sqrt(np.maximum(at["input_power"], 0)) + 1j * math.sqrt(2 * ring.bus_rate) * run.field)
        ** 2,
        "absorbed": run.absorbed,
    }
    if ring.scattering_rate > 0:
        traces["scattered"] = 2 * ring.scattering_rate * U
    return traces | {name: at[name] for name, value in light.items() if not isinstance(value, float)}
