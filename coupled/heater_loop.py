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

from thermofem import Function, InputError
from thermofem.arrays import Array, ArrayLike
from thermofem.piecewise import interpolated

from .circuit.circuit import Circuit
from .circuit.network import ring_heat
from .heaters import AMBIENT, LongOn, Poles, channels, heating
from .inputs import Pieces, add, joint, largest, pieces
from .resistive_heaters import ResistiveHeater, at_rest, drive_in_time, read_heaters
from .states import final_state, starting_point
from .thermal import attributes

log = logging.getLogger("thermofem")

MOST_ITERATIONS = 100
MOST_PASSES = 12


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
        return {heater.name: _square(heater, self.duration) for heater in self.heaters}

    def powers(self, run: xr.Dataset | None = None) -> dict[str, Pieces]:
        """Powers of the driven heaters (W), with the heat of the light of a ``run``; InputError without a limit."""
        light = {} if run is None else self._absorbed(run)
        cold = Pieces.constant(0.0, self.duration, 0.0)
        watts = {heater.name: self._power(heater, cold) for heater in self.heaters}
        for _ in range(MOST_ITERATIONS):
            before = watts
            watts = before | self._warmed(before, light)
            # the change of a power in the last iteration, relative to its largest value
            if difference(watts, before) <= 0.1 * self.rtol:
                return watts
        names = ", ".join(heater.name for heater in self.fed_back)
        raise InputError(f"heaters {names}: their temperature does not settle", "give a smaller drive")

    def _warmed(self, watts: dict[str, Pieces], light: Mapping[str, Pieces]) -> dict[str, Pieces]:
        """The powers of the heaters with a tcr at the temperatures that given powers cause."""
        if not self.fed_back:
            return {}
        poles, _, before, _ = self.feedback
        drives = {**self.given, **light, **self._long_on(watts)}
        rises = heating(poles, drives, self.duration, self.rtol, before, len(self.fed_back)).rises
        return {heater.name: self._power(heater, rise) for heater, rise in zip(self.fed_back, rises, strict=True)}

    def _power(self, heater: ResistiveHeater, rise: Pieces) -> Pieces:
        """Power in W of a heater with a rise in K."""
        square = self.squares[heater.name]
        if square.steady and rise.steady:
            return Pieces.constant(0.0, self.duration, float(heater.power(square(0.0), rise(0.0))))
        return interpolated(
            lambda t: heater.power(square(t), rise(t)),
            lambda t: heater.power(square.before(t), rise.before(t)),
            joint(square, rise),
        )

    def _long_on(self, watts: Mapping[str, Pieces]) -> dict[str, Any]:
        """Powers as inputs of `heating` whose constant part was there before t = 0: a number where it is one."""
        inputs: dict[str, Any] = {}
        for name, power in watts.items():
            rest = self.feedback.rest.get(name, 0.0)
            inputs[name] = LongOn([rest, add([power, Pieces.constant(0.0, self.duration, -rest)])])
            if power.steady:
                inputs[name] = float(power(0.0))
        return inputs

    def _absorbed(self, run: xr.Dataset) -> dict[str, Pieces]:
        """The light (W) absorbed in a run by the input that it heats; the last value stays to the end."""
        before_end = run["time"].values < self.duration
        time = np.append(run["time"].values[before_end], self.duration)
        light = {}
        for name, absorbed in zip(self.feedback.lit, np.atleast_2d(run["absorbed"].values), strict=False):
            spline = PchipInterpolator(time, np.append(absorbed[before_end], absorbed[-1]))
            light[name] = pieces("absorbed", spline, 0.0, self.duration)
        return light

    def inputs(self, watts: Mapping[str, Pieces]) -> dict[str, Any]:
        """Powers of all heaters (W) as inputs of a run."""
        others = {name: power for name, power in self.given.items() if name != AMBIENT}
        return others | self._long_on(watts)

    def described(self, run: xr.Dataset) -> xr.Dataset:
        """The run with the variables heater_voltage (V) and heater_current (A); nan of heaters driven by a power."""
        names = run["heater"].values.tolist()
        sides = np.full((2, *run["heater_power"].shape), np.nan)
        for heater in self.heaters:
            k = names.index(heater.name)
            square = np.maximum(self.squares[heater.name](run["time"].values), 0)
            sides[:, k] = heater.terminals(run["heater_power"].values[k], square)
        over = ("heater", "time")
        voltage = (over, sides[0], {"units": "V", "long_name": "voltage across a heater"})
        current = (over, sides[1], {"units": "A", "long_name": "current through a heater"})
        return run.assign(heater_voltage=voltage, heater_current=current)

    def relaxed(
        self, run: Callable[..., xr.Dataset], times: ArrayLike | None = None
    ) -> tuple[dict[str, Pieces], xr.Dataset]:
        """Repeat a run with the heat of its light in the heaters until their powers stay within rtol.

        run: simulates with the given heaters and times.
        Returns the powers (W) of the last run, and that run with its passes and the largest relative change of a power
        that one more would make.
        """
        watts = self.powers()
        pass_times = None if self.fed_back else times
        for passes in range(1, MOST_PASSES + 1):
            trace = run(heaters=self.inputs(watts), times=pass_times)
            after = self.powers(trace)
            change = difference(after, watts)
            if change <= self.rtol or passes == MOST_PASSES:
                break
            watts = after
        if change > self.rtol:
            log.warning("after %d passes the powers of heaters change by %.1e (rtol %.1e)", passes, change, self.rtol)
        if pass_times is not times:
            trace = run(heaters=self.inputs(watts), times=times)
        return watts, self.described(trace).assign_attrs(heater_passes=passes, heater_change=change)


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
    for name in system.inputs:
        gains = [system.channel(name, heater.name).dynamics.gain for heater in heaters]
        poles[name] = Poles(1 / np.asarray(lit.tau), np.array(gains))
    # all inputs share the poles: the heat of the past counts as that of the light
    past = np.asarray(starting_point(initial, lit.order, attributes(small)).thermal)
    if past[lit.gain == 0].any():
        rule = "initial holds heat of the heaters of a layout, whose temperatures it does not say"
        raise InputError(rule, "start cold, or take a circuit of this ring: coupled.bus(ring)")
    part = lit.inputs[0]
    begin = np.divide(past, lit.gain, out=np.zeros(lit.order), where=lit.gain != 0)
    before = [begin if name == part else np.zeros(lit.order) for name in poles]
    return Feedback(poles, (part,), np.concatenate(before), {})


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


def difference(some: Mapping[str, Pieces], others: Mapping[str, Pieces]) -> float:
    """Largest difference of powers in the middles of their pieces, relative to the largest value of each."""
    changes = [0.0]
    for name, power in some.items():
        middles = (power.edges[1:] + power.edges[:-1]) / 2
        change = np.abs(power(middles) - others[name](middles)).max()
        changes.append(float(change) / largest(power))
    return max(changes)


def _square(heater: ResistiveHeater, duration: float) -> Pieces:
    """The square of a drive, V^2 or A^2, over [0, duration]."""
    drive = drive_in_time(heater.name, heater.drive, duration)
    if drive.steady:
        return Pieces.constant(0.0, duration, float(drive(0.0)) ** 2)
    return Function(lambda t: drive(t) ** 2, drive.edges[1:-1]).pieces(0.0, duration)
