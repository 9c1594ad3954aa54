"""Heaters driven by a voltage or a current in time: their powers by iteration, and runs with the heat of their light.

    R_h = R_0 (1 + alpha dT_h),    P_h = V^2/R_h or I^2 R_h,    dT_h = sum_g Z_hg P_g + sum_c Z_hc P_c + T_a

The powers are iterated with the temperatures of the last iteration: under a voltage their difference shrinks by
alpha dT/(1 + alpha dT) each time. A run then gives the light P_c that every ring absorbs, and is repeated with its heat
until the powers stay the same.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from thermofem import Function, InputError, checks
from thermofem.arrays import Array
from thermofem.piecewise import interpolated

from .circuit.circuit import Circuit
from .circuit.network import ring_heat
from .heaters import AMBIENT, LongOn, Poles, channels, heating
from .inputs import Pieces, add, bounds, joint, pieces
from .resistive_heaters import LARGEST_DRIVE, ResistiveHeater, at_rest, read_heaters
from .states import final_state, starting_point
from .thermal import attributes

log = logging.getLogger("thermofem")

MOST_ITERATIONS = 100
MOST_PASSES = 12
PASS_ATTRIBUTES = ("heater_passes", "heater_change")  # attributes of a run


class Feedback(NamedTuple):
    """What the temperatures of heaters with a tcr follow."""

    poles: Mapping[str, Poles]
    """From every input of the thermal model to those heaters."""
    lit: tuple[str, ...]
    """The inputs that the light heats, one for each ring."""
    before: Array | None
    """States (J) of all poles at t = 0, see `heating`."""
    rest: Mapping[str, float]
    """Powers (W) that were there for long at t = 0."""


@dataclass(frozen=True, eq=False)
class HeaterLoop:
    """Heaters of a run that a voltage or a current drives.

    heaters: those. fed_back: of them, those with a tcr.
    given: power (W) of all other heaters, and the ambient (K).
    """

    heaters: list[ResistiveHeater]
    fed_back: list[ResistiveHeater]
    given: dict[str, Any]
    duration: float
    rtol: float
    feedback: Feedback

    @cached_property
    def squares(self) -> dict[str, Pieces]:
        """The square of every drive over [0, duration], V^2 or A^2."""
        return {one.name: _square(one, self.duration) for one in self.heaters}

    def powers(self, light: Mapping[str, Pieces] | None = None) -> dict[str, Any]:
        """Powers of all heaters (W) as inputs of `heating`, with the heat of the absorbed ``light`` (W)."""
        cold = Pieces.constant(0.0, self.duration, 0.0)
        watts = {one.name: _power(one, self.squares[one.name], cold) for one in self.heaters}
        for _ in range(MOST_ITERATIONS):
            before = watts
            watts = self._warmed(before, light or {})
            # the change of a power in the last iteration, relative to its largest value
            if difference(watts, before) <= 0.1 * self.rtol:
                others = {name: power for name, power in self.given.items() if name != AMBIENT}
                return others | {name: self._long_on(name, power) for name, power in watts.items()}
        names = ", ".join(one.name for one in self.fed_back)
        raise InputError(f"heaters {names}: their temperature does not settle", "give a smaller drive")

    def _warmed(self, watts: dict[str, Pieces], light: Mapping[str, Pieces]) -> dict[str, Pieces]:
        """The powers of all heaters at the temperatures that given powers cause."""
        if not self.fed_back:
            return watts
        drives = {name: self._long_on(name, power) for name, power in watts.items()}
        inputs = {**self.given, **light, **drives}
        poles, _, before, _ = self.feedback
        warm = heating(poles, inputs, self.duration, self.rtol, before, len(self.fed_back))
        after = watts.copy()
        for one, rise in zip(self.fed_back, warm.rises, strict=True):
            after[one.name] = _power(one, self.squares[one.name], rise)
        return after

    def _long_on(self, name: str, power: Pieces) -> Any:
        """A power as an input whose constant part was there before t = 0: a number where it is one."""
        if power.steady:
            return float(power(0.0))
        rest = self.feedback.rest.get(name, 0.0)
        return LongOn([rest, add([power, Pieces.constant(0.0, self.duration, -rest)])])

    def change(self, powers: Mapping[str, Any], run: xr.Dataset) -> tuple[dict[str, Any], float]:
        """Powers with the heat of the light of a run, and the largest relative change from those that it had."""
        if not self.fed_back:
            return dict(powers), 0.0
        time = run["time"].values
        light = {}
        for name, absorbed in zip(self.feedback.lit, np.atleast_2d(run["absorbed"].values), strict=True):
            # the last value stays to the end
            ends = [absorbed[-1]] if time[-1] < self.duration else []
            spline = PchipInterpolator(np.append(time, [self.duration] * len(ends)), np.append(absorbed, ends))
            light[name] = pieces("absorbed", spline, 0.0, self.duration)
        after = self.powers(light)
        return after, difference(self._pieces(after), self._pieces(powers))

    def _pieces(self, powers: Mapping[str, Any]) -> dict[str, Pieces]:
        return {one.name: pieces(one.name, powers[one.name], 0.0, self.duration) for one in self.fed_back}

    def described(self, run: xr.Dataset) -> xr.Dataset:
        """The run with the variables heater_voltage (V) and heater_current (A); nan of heaters driven by a power."""
        names = run["heater"].values.tolist()
        sides = np.full((2, *run["heater_power"].shape), np.nan)
        for one in self.heaters:
            k = names.index(one.name)
            square = np.maximum(self.squares[one.name](run["time"].values), 0)
            sides[:, k] = one.terminals(run["heater_power"].values[k], square)
        over = ("heater", "time")
        voltage = (over, sides[0], {"units": "V", "long_name": "voltage across a heater"})
        current = (over, sides[1], {"units": "A", "long_name": "current through a heater"})
        return run.assign(heater_voltage=voltage, heater_current=current)


def heater_loop(
    ring: Any,
    model: Any,
    heaters: list[ResistiveHeater],
    inputs: dict[str, Any],
    duration: float,
    rtol: float,
    heated: str | None = None,
    read: str | None = None,
    initial: Any = None,
) -> HeaterLoop:
    """The loop of a run; arguments as of `simulate`, ``inputs`` being its heaters and the ambient."""
    others = {name: power for name, power in inputs.items() if name not in {heater.name for heater in heaters}}
    fed_back = [heater for heater in heaters if heater.resistor.tcr]
    feedback = Feedback({}, (), None, {})
    if fed_back and isinstance(ring, Circuit):
        feedback = _of_circuit(ring, model, fed_back, inputs, initial)
    elif fed_back:
        feedback = _of_ring(ring, model, fed_back, inputs, heated, read, initial)
    return HeaterLoop(heaters, fed_back, others, duration, rtol, feedback)


def _of_ring(
    ring: Any, model: Any, heaters: list[ResistiveHeater], inputs: dict[str, Any], heated: Any, read: Any, initial: Any
) -> Feedback:
    """The feedback in a single ring, whose heaters are off before t = 0."""
    system = read_heaters(model, heaters)
    small: Any = channels(model, ring.read, inputs, heated, read).model
    lit = small.linear
    poles = {}
    begin = {}
    for name in system.inputs:
        gains = [system.channel(name, heater.name).dynamics.gain for heater in heaters]
        poles[name] = Poles(1 / np.asarray(lit.tau), np.array(gains))
        begin[name] = np.zeros(lit.order)
    # all inputs share the poles: the heat of the past counts as that of the light
    past = np.asarray(starting_point(initial, lit.order, attributes(small)).thermal)
    if past[lit.gain == 0].any():
        rule = "initial holds heat of the heaters of a layout, whose temperatures it does not say"
        raise InputError(rule, "start cold, or take a circuit of this ring: coupled.bus(ring)")
    part = lit.inputs[0]
    begin[part] = np.divide(past, lit.gain, out=np.zeros(lit.order), where=lit.gain != 0)
    return Feedback(poles, (part,), np.concatenate([*begin.values()]), {})


def _of_circuit(
    circuit: Circuit, model: Any, heaters: list[ResistiveHeater], inputs: dict[str, Any], initial: Any
) -> Feedback:
    """The feedback in a circuit, where a constant drive has been on for long."""
    read_heaters(model, heaters)
    heat = ring_heat(model, circuit.resonators, circuit.names)
    rows = [list(heat.sensors).index(heater.name) for heater in heaters]
    poles = {name: Poles(rate, gain[rows]) for name, (rate, gain) in heat.sensed.items()}
    if initial is None:
        waves = {name: getattr(drive, "wave", drive) for name, drive in inputs.items()}
        constant = {name: inputs[name] for name, wave in waves.items() if hasattr(wave, "__float__")}
        return Feedback(poles, circuit.names, None, at_rest(model, constant).powers)
    rings = len(circuit.names)
    x = final_state(initial, 3 * rings + heat.gain.size)[3 * rings :].reshape(heat.gain.shape)
    past = []
    for name, kelvin, gain in zip(circuit.names, x, heat.gain, strict=True):
        order = poles[name].rate.size
        past.append(kelvin[:order] / gain[:order])
    heater_states = np.ravel(getattr(initial, "attrs", {}).get("heater_states", ()))
    return Feedback(poles, circuit.names, np.concatenate([*past, heater_states]), {})


def relaxed(loop: HeaterLoop, run: Callable[[dict[str, Any]], xr.Dataset]) -> tuple[dict[str, Any], xr.Dataset]:
    """Repeat a run with the heat of its light in the heaters until their powers stay within rtol.

    run: simulates with the given powers.
    Returns the powers (W) of the last run, and that run with its passes and the largest relative change of a power that
    one more would make.
    """
    powers = loop.powers()
    for passes in range(1, MOST_PASSES + 1):
        trace = run(powers)
        after, change = loop.change(powers, trace)
        if change <= loop.rtol or passes == MOST_PASSES:
            break
        powers = after
    if change > loop.rtol:
        log.warning("after %d passes the powers of heaters change by %.1e (rtol %.1e)", passes, change, loop.rtol)
    return powers, trace.assign_attrs(heater_passes=passes, heater_change=change)


def difference(some: Mapping[str, Pieces], others: Mapping[str, Pieces]) -> float:
    """Largest difference of powers in the middles of their pieces, relative to the largest value of each."""
    largest = 0.0
    for name, power in some.items():
        inner = (power.edges[1:] + power.edges[:-1]) / 2
        scale = max(float(np.abs(power.coefficients[:, 0]).max()), float(np.abs(power.ends).max()))
        change = float(np.abs(power(inner) - others[name](inner)).max())
        largest = max(largest, change / (scale or 1.0))
    return largest


def _square(heater: ResistiveHeater, duration: float) -> Pieces:
    """The square of a drive, V^2 or A^2, over [0, duration]."""
    name = f"heaters[{heater.name!r}]"
    drive = pieces(name, heater.drive.wave, 0.0, duration)
    for value in bounds(drive):
        checks.between(name, value, -LARGEST_DRIVE, LARGEST_DRIVE, unit=heater.drive.unit)
    if drive.steady:
        return Pieces.constant(0.0, duration, float(drive(0.0)) ** 2)
    return Function(lambda t: drive(t) ** 2, drive.edges[1:-1]).pieces(0.0, duration)


def _power(heater: ResistiveHeater, square: Pieces, rise: Pieces) -> Pieces:
    """Power in W of a heater with a rise in K."""
    if square.steady and rise.steady:
        return Pieces.constant(square.edges[0], square.edges[-1], float(heater.power(square(0.0), rise(0.0))))

    def after(t: Array) -> Array:
        return heater.power(square(t), rise(t))

    def before(t: Array) -> Array:
        return heater.power(square.before(t), rise.before(t))

    return interpolated(after, before, joint(square, rise))
