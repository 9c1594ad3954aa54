"""Integration of a ring under its lasers over one time window from a given state; `simulate` and `cosimulate` use it.

Every resonance that a laser is on has a field of its own. All share carriers and heat, and two-photon absorption and
the Kerr effect of another resonance count twice. Lasers on one resonance beat.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from thermofem import checks, dataset
from thermofem.arrays import Array, Complex, NDArray

from ..inputs import Input, Lights, add, lights, pieces, values
from ..kernel import units as eq
from ..kernel.integrator import Crossing, Problem
from ..kernel.problem_parts import Drive
from ..kernel.rates import absorbed_slopes, field_loss, recombination
from ..kernel.tableaus import Method
from ..resonator import RingResonator, origin
from ..states import State
from ..thermal import Compact

QUANTITIES = ("energy", "carriers", "delta_T")
NO_TIMES = np.empty(0)


class Event(NamedTuple):
    """A quantity ("energy" in J, "carriers" in 1/m^3 or "delta_T" in K) that rises through a level.

    ``stop`` says whether the run ends there.
    """

    quantity: str
    level: float
    stop: bool = True


@dataclass(frozen=True)
class Laser:
    """A further laser on a ring.

    Parameters
    ----------
    power : float, Waveform, or a list of both; W
        in the bus waveguide.
    detuning : float, Waveform, or a list of both; Hz
        laser minus the cold resonance that it is near.
    resonance : RingResonator, optional
        the ring as light at that resonance sees it, such as ``replace(ring, frequency=194.4e12)``. By default the
        resonance of the first laser, with whose field this one beats.
    phase : float, rad
        at t = 0, relative to the first laser of its resonance.

    >>> Laser(power=1e-6, detuning=-2e9).phase
    0.0
    """

    power: Input
    detuning: Input = 0.0
    resonance: RingResonator | None = None
    phase: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.finite("phase", self.phase, unit="rad")
        if self.resonance is not None:
            hint = "give a ring, such as replace(ring, frequency=194e12)"
            checks.instance("resonance", self.resonance, RingResonator, hint=hint)


class Window(NamedTuple):
    """Result of `advance` in SI, at the accepted steps or at the output times."""

    time: Array
    fields: Complex
    """sqrt(J), shape (resonances, times)."""
    carriers: Array
    delta_T: Array
    absorbed: Array
    absorbed_slope: Array
    """dP_abs/dt in W/s; with ``absorbed`` it gives a cubic Hermite spline as accurate as the steps."""
    final: State
    further: Array
    """Re and Im of the final fields of all resonances but the first, sqrt(J)."""
    reached: float
    step: float
    """Length of the step that would follow, s: the ``first_step`` of the next window."""
    crossings: Array
    counts: NDArray[np.int64]
    """Accepted and rejected steps."""
    method: Method
    lights: Lights
    resonances: list[RingResonator]


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
    lasers: Sequence[Laser] = (),
    fields: Mapping[float, Array] | None = None,
    rtol: float = 1e-6,
    method: Method | None = None,
    times: Array = NO_TIMES,
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
        them, which add. A step ends at every breakpoint. The returned delta_T contains the offset.
    lasers: further lasers.
    fields: Re and Im in sqrt(J) of the light on other resonances at ``start``, by their frequency in Hz.
    rtol, method: as in `simulate`.
    times [s]: wanted times; empty for the accepted steps.
    slopes: whether absorbed_slope is computed, of a ring with one laser; it is empty otherwise.
    first_step [s]: first trial step; 0 for a cautious one.
    progress: as in `simulate`.
    Raises InputError: inputs that do not cover the window, or too many steps.

    Measured on the self-pulsing ring at (8 dBm, 0 GHz) with Rodas4 at rtol 1e-6 against 1e-11: the spline through
    (absorbed, absorbed_slope) with one row per step is as accurate as the steps themselves.
    """
    resonances = resonances_of(ring, lasers)
    modes = len(resonances)
    light = lights_of(ring, [Laser(power, detuning), *lasers], start, stop, offset)
    drive = light.drive
    chosen = method or (Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
    heat, bend = eq.internal_heat(model)
    pumps = np.abs(drive.entry) * np.sqrt(drive.brightest)
    pump = float(pumps.max())
    rings = eq.internal_rings(resonances, pump, model.thermal_resistance * eq.UW)
    problem = Problem(rings._replace(bend=bend), heat, drive, chosen)
    unit = eq.units(problem.order)
    first_state = state.as_array() / unit
    begin = np.insert(first_state, 2, _further_fields(resonances, fields or {}))
    beating = len(lasers) >= modes
    run = problem.integrate(
        begin,
        rtol=rtol,
        times=times / eq.NS if times.size else None,
        longest=_longest_step(light) if beating else math.inf,
        first_step=first_step / eq.NS,
        event=_event(event),
        progress=eq.in_seconds(progress),
    )
    time = run.rows[:, 0] * eq.NS
    amplitudes, (N,), (dT,), (absorbed,) = eq.in_si(rings, run.rows)
    rise = offset if isinstance(offset, float) else pieces("offset", offset, start, stop)(time)
    first_ring = np.concatenate([run.y[:2], run.y[2 * modes :]])
    absorbed_slope = NO_TIMES
    if slopes:
        rates, _ = eq.internal_rates(ring)
        absorbed_slope = _absorbed_slope(run.rows, drive, rates)
    return Window(
        time=time,
        fields=amplitudes,
        carriers=N,
        delta_T=dT + rise,
        absorbed=absorbed,
        absorbed_slope=absorbed_slope,
        final=State.from_array(first_ring * unit),
        further=run.y[2 : 2 * modes] * eq.FJ**0.5,
        reached=run.t * eq.NS,
        step=run.step * eq.NS,
        crossings=run.crossings * eq.NS,
        counts=np.array([run.accepted, run.rejected]),
        method=chosen,
        lights=light,
        resonances=resonances,
    )


def _further_fields(resonances: list[RingResonator], fields: Mapping[float, Array]) -> Array:
    """Return Re and Im of the fields of all resonances but the first, in the kernel's unit; dark by default."""
    further = [fields.get(resonance.frequency, np.zeros(2)) for resonance in resonances[1:]]
    return np.ravel(further) / eq.FJ**0.5


def _longest_step(light: Lights) -> float:
    """Return the longest step in ns that resolves the beat between lasers of one resonance."""
    beat = float(np.abs(light.turning).max())
    # a step may last a tenth of a beat
    return 0.1 * 2 * math.pi / beat if beat else math.inf


def _event(event: Event | None) -> Crossing | None:
    """Return the event in the kernel's units."""
    if event is None:
        return None
    checks.instance("event", event, Event, hint="give coupled.Event('delta_T', 5.0) or another")
    level = checks.finite("event.level", event.level)
    stop = checks.flag("event.stop", event.stop)
    kind = QUANTITIES.index(checks.choice("event", event.quantity, QUANTITIES))
    return Crossing(1 + kind, level / (eq.FJ, eq.DENSITY, 1.0)[kind], stop)


def resonances_of(ring: RingResonator, lasers: Sequence[Laser]) -> list[RingResonator]:
    """Return the resonances that the lasers drive, each once, that of the ring itself first."""
    driven = [laser.resonance or ring for laser in lasers]
    return list(dict.fromkeys([ring, *driven]))


def lights_of(ring: RingResonator, lasers: Sequence[Laser], start: float, stop: float, offset: Any = 0.0) -> Lights:
    """Convert lasers to the kernel's drive between two times in s.

    The first laser drives the ring's own resonance. offset [K]: a temperature rise by other sources, a number or a
    function of time; it is added to the detuning as thermal_shift x offset.
    """
    resonances = resonances_of(ring, lasers)
    driven = [resonances.index(laser.resonance or ring) for laser in lasers]
    first = [driven.index(mode) for mode in range(len(resonances))]
    frame = [first[mode] for mode in driven]
    powers = [pieces("power", laser.power, start, stop) for laser in lasers]
    frequencies = [pieces("detuning", laser.detuning, start, stop) for laser in lasers]
    rise = pieces("offset", offset, start, stop)
    detunings = []
    for k, resonance in zip(first, resonances, strict=True):
        shift = rise.times(resonance.thermal_shift)
        detunings.append(add([frequencies[k].times(2 * np.pi), shift]))
    coupling = np.array([(2 * resonance.bus_rate) ** 0.5 for resonance in resonances])
    entry = coupling[:, None] * np.equal.outer(range(len(resonances)), driven)
    phases = [laser.phase - lasers[k].phase for laser, k in zip(lasers, frame, strict=True)]
    return lights(powers, frequencies, frame=frame, detunings=detunings, entry=entry, phases=phases)


def _absorbed_slope(rows: Array, drive: Drive, rates: eq.Rates) -> Array:
    """Return dP_abs/dt in W/s at the rows, shape (rows,), with dU/dt = 2 (pump Im a - gamma U) and dN/dt."""
    t, ar, ai, N, _ = rows.T
    power = np.maximum(values(drive.power, t * eq.NS)[0], 0)
    pump = float(drive.entry[0, 0].real) * np.sqrt(power)
    U = ar**2 + ai**2
    U_slope = 2 * (pump * ai - field_loss(U, N, rates) * U)
    lost, _ = recombination(N, rates)
    N_slope = rates.g * U**2 - lost
    by_U, by_N = absorbed_slopes(U, N, rates)
    slope = by_U * U_slope + by_N * N_slope
    return slope * eq.UW / eq.NS


def provenance(ring: RingResonator, light: dict[str, Any], duration: float) -> dict[str, Any]:
    """Return the attributes of a run: the ring, constant power and detuning, and the duration in s."""
    constant = {name: value for name, value in light.items() if isinstance(value, float)}
    return origin("coupled", ring) | constant | {"duration": float(duration)}


def traces(run: Window, light: dict[str, Any]) -> dict[str, Any]:
    """Return the variables of a run's Dataset in SI: of the first resonance, and as probe_* of all others.

    light: power and detuning of the first laser, floats or functions of time.
    """
    U = np.abs(run.fields) ** 2
    resonances = run.resonances
    incoming = run.lights.incoming(run.time)
    rates = [[mode.bus_rate, mode.drop_bus_rate, mode.scattering_rate] for mode in resonances]
    bus, drop, scattering = 2 * np.transpose(rates)[:, :, None]
    signals: dict[str, Array] = {
        "energy": U,
        "carriers": run.carriers,
        "delta_T": run.delta_T,
        "drop": drop * U,
        "through": np.abs(incoming + 1j * np.sqrt(bus) * run.fields) ** 2,
        "absorbed": run.absorbed,
    }
    if scattering.any():
        signals["scattered"] = scattering * U
    powers = [np.maximum(power(run.time), 0) for power in run.lights.powers]
    beats = len(powers) > len(resonances)
    signals["input_power"] = np.abs(incoming) ** 2 if beats else np.array(powers)
    if not isinstance(light["detuning"], float):
        signals["detuning"] = light["detuning"](run.time)
    variables: dict[str, Any] = {}
    for name, rows in signals.items():
        about = dataset.describe(name)
        first = rows if rows.ndim == 1 else rows[0]
        constant = name == "input_power" and isinstance(light[name], float) and np.all(first == first[:1])
        if not constant:
            variables[name] = ("time", first, about)
        if rows.ndim == 2 and len(resonances) > 1:
            words = f"{about['long_name']}, other resonances"
            variables[f"probe_{name}"] = (("probe", "time"), rows[1:], about | {"long_name": words})
    if len(resonances) > 1:
        where = {"units": "Hz", "long_name": "cold resonance"}
        frequencies = np.array([resonance.frequency for resonance in resonances[1:]])
        variables["resonance"] = ("probe", frequencies, where)
    return variables
