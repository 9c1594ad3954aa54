"""Integration of a ring over one time window from a given state; `simulate` and the co-simulation use it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.data.display import shown
from thermofem.piecewise import Pieces, bounds

from ..arguments import ROUND_OFF
from ..inputs import add, joint, pieces
from ..kernels.tableaus import Method, tableau
from ..resonator import RingResonator
from ..states import State
from ..thermal import Compact

if TYPE_CHECKING:
    from ..kernels.equations import Rates

MAX_STEPS = 20_000_000  # ten seconds of work and 800 MB of accepted steps
LONG = 1e-4  # s; shorter runs are done in well under a second, at the sharpest rtol
MANY = 50_000  # steps that the light takes at least, or edges, from which a shorter run takes a second, too
QUANTITIES = ("energy", "carriers", "delta_T")
NO_TIMES = np.empty(0)


@shown
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
    adiabatic: bool = False,
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
    first_step [s]: 0 for a cautious one.
    adiabatic: as in `simulate`; without events, and with no meaning of absorbed_slope.
    progress: as in `simulate`.
    Raises InputError: a power below 0, inputs that do not cover the window, or too many steps.

    Measured on the self-pulsing ring at (8 dBm, 0 GHz) with Rodas4 at rtol 1e-6 against 1e-11: the spline through
    (absorbed, absorbed_slope) of one row a step is as near as the steps themselves.
    """
    from ..kernels import equations as eq
    from ..kernels import rosenbrock
    from ..kernels.interrupts import new_watch, uninterrupted, watched
    from ..kernels.laser import largest_power

    laser = laser_of(ring, start, stop, power, detuning, offset)
    rates, fcd = eq.internal_rates(ring)
    thermal = eq.internal_thermal(model)
    floor = floor_of(rates, float(np.sqrt(largest_power(laser.edges, laser.power))), model.thermal_resistance * eq.UW)
    unit = units(np.size(state.thermal))
    at, begin = np.asarray(times, dtype=float) / eq.NS, state.as_array() / unit
    call = uninterrupted
    if stop - start > LONG or laser.edges.size > MANY:
        call = partial(watched, progress=(lambda t: progress(t * eq.NS)) if progress else None)
    if adiabatic:
        from ..kernels.adiabatic import integrate

        rows, y, reached, counts = call(
            integrate, begin, laser, rates, fcd, thermal, rtol, floor, at, MAX_STEPS, new_watch()
        )
        step, crossings = 0.0, NO_TIMES
    else:
        chosen = method or (Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
        rows, y, reached, step, crossings, counts = call(
            rosenbrock.integrate, begin, laser, rates, fcd, thermal, tableau(chosen), rtol, floor, at, per_step,
            first_step / eq.NS, _event(event), MAX_STEPS, new_watch(),
        )  # fmt: skip
    check_end(counts, reached, stop - start, rtol)
    if progress:
        progress(float(reached * eq.NS))
    t, ar, ai, N, dT = rows.T
    return Window(
        time=t * eq.NS,
        field=(ar + 1j * ai) * np.sqrt(eq.FJ),
        carriers=N * eq.DENSITY,
        delta_T=dT + (offset if isinstance(offset, float) else pieces("offset", offset, start, stop)(t * eq.NS)),
        absorbed=eq.absorbed_power(ar**2 + ai**2, N, rates) * eq.UW,
        absorbed_slope=_absorbed_slope(rows, laser, rates),
        final=State.from_array(y * unit),
        reached=reached * eq.NS,
        step=step * eq.NS,
        crossings=crossings * eq.NS,
        counts=counts[:2],
    )


def _event(event: Event | None) -> Array:
    """Number of the watched quantity (0 for none), its level in internal units, and whether to stop at the level."""
    from ..kernels import equations as eq

    if event is None:
        return np.zeros(3)
    if not isinstance(event, Event):
        raise checks.InputError(f"event = {event!r} is no coupled.Event, such as coupled.Event('delta_T', 5.0)")
    level = checks.finite("event.level", event.level)
    kind = QUANTITIES.index(checks.choice("event", event.quantity, QUANTITIES))
    stop = checks.flag("event.stop", event.stop)
    return np.array([1 + kind, level / (eq.FJ, eq.DENSITY, 1.0)[kind], stop])


def laser_of(ring: RingResonator, start: float, stop: float, power: Any, detuning: Any, offset: Any = 0.0) -> Any:
    """Power, detuning and temperature offset as the compiled integration takes them, `rosenbrock.LaserPieces`.

    An offset shifts the resonance as a detuning of thermal_shift x offset does, so it becomes one.
    """
    from ..kernels import equations as eq
    from ..kernels.rosenbrock import LaserPieces

    if isinstance(power, float) and isinstance(detuning, float) and isinstance(offset, float) and power >= 0:
        turned = eq.internal_detuning(detuning) + ring.thermal_shift * eq.NS * offset
        return constant_laser(start, stop, eq.internal_pump(ring, power), turned)
    P, nu, dT = (
        pieces(name, value, start, stop)
        for name, value in (("power", power), ("detuning", detuning), ("offset", offset))
    )
    low, high = bounds(P)
    if low < -ROUND_OFF * max(high, 1e-30):
        raise checks.InputError(f"power falls to {low:g} W; it must not be negative (powers are in W)")
    edges = joint(P, nu, dT)
    turning = add([nu.times(2 * np.pi * eq.NS), dT.times(ring.thermal_shift * eq.NS)]).on(edges)
    scale = eq.NS ** np.arange(4)
    squared = P.on(edges).coefficients * (2 * ring.bus_rate * eq.NS / eq.UW)
    return LaserPieces(
        edges / eq.NS, np.ascontiguousarray(squared * scale), np.ascontiguousarray(turning.coefficients * scale)
    )


def constant_laser(start: float, stop: float, pump: float, detuning: float) -> Any:
    """A laser that does not change; times in s, pump and detuning in internal units."""
    from ..kernels import equations as eq
    from ..kernels.rosenbrock import LaserPieces

    zero = [0.0, 0.0, 0.0]
    edges = np.array([start / eq.NS, stop / eq.NS])
    return LaserPieces(edges, np.array([[pump * pump, *zero]]), np.array([[detuning, *zero]]))


def check_end(counts: NDArray[np.int64], reached: float, duration: float, rtol: float) -> None:
    """Raise if an integration did not reach its end; ``reached`` in ns, ``duration`` in s."""
    from ..kernels import control

    if counts[2] == control.TOO_MANY_ROWS:
        raise checks.InputError(
            f"the accepted steps up to t = {reached * 1e-9:g} s fill the memory; give the wanted times, times=..."
        )
    if counts[2] == control.TOO_MANY_STEPS:
        raise checks.InputError(
            f"duration = {duration:g} s takes more than {MAX_STEPS} steps at rtol = {rtol:g} "
            f"(they reach {reached * 1e-9:g} s); shorten it or loosen rtol"
        )
    if counts[2] == control.STOPPED:
        raise KeyboardInterrupt
    if counts[2] == control.STEP_TOO_SMALL:
        raise checks.InputError(
            f"the integration found no step small enough at t = {reached * 1e-9:g} s: light and heat run away, or the "
            "rise is at the top of an output map; look at the model's largest numbers"
        )


def floor_of(rates: Rates, pump: float, thermal_resistance: float) -> Array:
    """Sizes of field, carriers and temperature, in internal units, below which errors are not relative to them.

    A thousandth of the values on resonance with the loss of the cold ring, but at most a thousandth of 1e23 carriers
    per m^3, which is that of a ring whose light makes none, and of 10 K. These values are far below those that shift
    the resonance by its width.
    """
    U = (pump / rates.loss) ** 2
    N = rates.tau0 * (rates.a / rates.b if rates.b > 0 else 1.0) * rates.g * U**2 if rates.g > 0 else 1.0
    dT = thermal_resistance * 2 * rates.absorbed * U
    tiny = 1e-27  # with no light at all, keeps 0/0 away
    return 1e-3 * np.array([max(np.sqrt(U), tiny), min(max(N, tiny), 1), min(max(dT, tiny), 10)])


def units(order: int) -> Array:
    """SI value of one internal unit of every state."""
    from ..kernels import equations as eq

    return np.concatenate([np.array([eq.FJ**0.5, eq.FJ**0.5, eq.DENSITY]), np.ones(order)])


def _absorbed_slope(rows: Array, laser: Any, rates: Rates) -> Array:
    """dP_abs/dt in W/s at the rows, from the equations themselves: dU/dt = 2 (pump Im a - gamma U)."""
    from ..kernels import equations as eq

    t, ar, ai, N, _ = rows.T
    pump = np.sqrt(np.maximum(Pieces(laser.edges, laser.power)(t), 0))
    U = ar**2 + ai**2
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    U_slope = 2 * (pump * ai - gamma * U)
    recombination = N * (1 + rates.b * N) / (rates.tau0 * (1 + rates.a * N))
    N_slope = rates.g * U**2 - recombination
    slope = 2 * (rates.absorbed + rates.fca * N + 2 * rates.tpa * U) * U_slope + 2 * rates.fca * U * N_slope
    return slope * eq.UW / eq.NS
