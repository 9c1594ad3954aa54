"""Heaters driven by a voltage or a current in time: their powers by iteration, and runs with the heat of their light.

    R_h = R_0 (1 + alpha dT_h),    P_h = V^2/R_h or I^2 R_h,    dT_h = sum_g Z_hg P_g + Z_hc P_abs + T_a

The powers are iterated with the temperatures of the last iteration: under a voltage their difference shrinks by
alpha dT/(1 + alpha dT) each time. A run then gives the light that the ring absorbs, and is repeated with its heat until
the powers stay the same.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from thermofem import Function, checks
from thermofem.arrays import Array
from thermofem.piecewise import interpolated

from .heaters import AMBIENT, Poles, channels, heating
from .inputs import Pieces, bounds, joint, pieces
from .resistive_heaters import LARGEST_DRIVE, ResistiveHeater, read_heaters
from .states import starting_point
from .thermal import attributes

log = logging.getLogger("thermofem")

MOST_ITERATIONS = 100
MOST_PASSES = 12
SETTLED = 0.1  # of rtol: change of a power in the last iteration, relative to its largest value

Powers = dict[str, Any]


@dataclass(frozen=True, eq=False)
class HeaterLoop:
    """Heaters of a run that a voltage or a current drives.

    heaters: those.
    given: power (W) of all other heaters, and the ambient (K).
    poles: from every input of the thermal model to the heaters with a tcr, in the order of ``heaters``.
    lit: the input that the light heats.
    before [J]: states of all poles at t = 0, see `heating`.
    """

    heaters: list[ResistiveHeater]
    given: Powers
    duration: float
    rtol: float
    poles: Mapping[str, Poles] = field(default_factory=dict)
    lit: str = ""
    before: Array | None = None

    @cached_property
    def squares(self) -> dict[str, Pieces]:
        """The square of every drive over [0, duration], V^2 or A^2."""
        return {one.name: _square(one, self.duration) for one in self.heaters}

    @property
    def fed_back(self) -> list[ResistiveHeater]:
        """The heaters whose resistance follows their temperature."""
        return [one for one in self.heaters if one.resistor.tcr]

    def powers(self, light: Pieces | None = None) -> Powers:
        """Powers of all heaters (W) as piecewise cubics or numbers, with the heat of the absorbed ``light`` (W)."""
        cold = Pieces.constant(0.0, self.duration, 0.0)
        watts: Powers = {one.name: _power(one, self.squares[one.name], cold) for one in self.heaters}
        others = {name: power for name, power in self.given.items() if name != AMBIENT}
        if not self.fed_back:
            numbers = {name: float(power(0.0)) if power.steady else power for name, power in watts.items()}
            return others | numbers
        inputs = self.given if light is None else {**self.given, self.lit: light}
        for _ in range(MOST_ITERATIONS):
            driven = {**inputs, **watts}
            rises = heating(self.poles, driven, self.duration, self.rtol, self.before, len(self.fed_back)).rises
            settled = True
            for one, rise in zip(self.fed_back, rises, strict=True):
                power = _power(one, self.squares[one.name], rise)
                settled &= difference(power, watts[one.name]) <= SETTLED * self.rtol
                watts[one.name] = power
            if settled:
                return others | watts
        names = ", ".join(one.name for one in self.fed_back)
        raise checks.InputError(f"heaters {names}: their temperature does not settle", "give a smaller drive")

    def described(self, run: xr.Dataset) -> xr.Dataset:
        """The run with the variables heater_voltage (V) and heater_current (A); nan of heaters driven by a power."""
        time = run["time"].values
        shape = run["heater_power"].shape
        volts = np.full(shape, np.nan)
        amperes = np.full(shape, np.nan)
        for one in self.heaters:
            k = run["heater"].values.tolist().index(one.name)
            square = np.maximum(self.squares[one.name](time), 0)
            volts[k], amperes[k] = one.terminals(run["heater_power"].values[k], square)
        over = ("heater", "time")
        about_volts = {"units": "V", "long_name": "voltage across a heater"}
        about_amperes = {"units": "A", "long_name": "current through a heater"}
        return run.assign(heater_voltage=(over, volts, about_volts), heater_current=(over, amperes, about_amperes))


def heater_loop(
    ring: Any,
    model: Any,
    heaters: list[ResistiveHeater],
    inputs: Powers,
    duration: float,
    rtol: float,
    heated: str | None = None,
    read: str | None = None,
    initial: Any = None,
) -> HeaterLoop:
    """The loop of a run; arguments as of `simulate`, ``inputs`` being its heaters and the ambient."""
    others = {name: power for name, power in inputs.items() if name not in {heater.name for heater in heaters}}
    fed_back = [heater for heater in heaters if heater.resistor.tcr]
    if not fed_back:
        return HeaterLoop(heaters, others, duration, rtol)
    system = read_heaters(model, fed_back)
    lit: Any = channels(model, ring.read, inputs, heated, read).model
    part = lit.inputs[0]
    poles = {}
    begin = {}
    for name in system.inputs:
        to_heaters = [system.channel(name, heater.name).dynamics for heater in fed_back]
        poles[name] = Poles(1 / np.asarray(lit.tau), np.array([each.gain for each in to_heaters]))
        begin[name] = np.zeros(lit.order)
    # all inputs share the poles: the heat of the past counts as that of the light
    past = np.asarray(starting_point(initial, lit.order, attributes(lit)).thermal)
    begin[part] = np.divide(past, lit.gain, out=np.zeros(lit.order), where=lit.gain != 0)
    before = np.concatenate([*begin.values()])
    return HeaterLoop(heaters, others, duration, rtol, poles, part, before)


def relaxed(loop: HeaterLoop, run: Callable[[Powers], xr.Dataset]) -> tuple[Powers, xr.Dataset]:
    """Repeat a run with the heat of its light in the heaters until their powers stay within rtol.

    run: simulates with the given powers.
    Returns the powers (W) of the last run, and that run with its passes and the largest relative change of a power that
    one more would make.
    """
    powers = loop.powers()
    trace = run(powers)
    passes = 1
    change = 0.0
    while loop.fed_back:
        after = loop.powers(absorbed(trace, loop.duration))
        change = max(difference(after[heater.name], powers[heater.name]) for heater in loop.fed_back)
        if change <= loop.rtol or passes == MOST_PASSES:
            break
        powers = after
        trace = run(powers)
        passes += 1
    if change > loop.rtol:
        log.warning("after %d passes the powers of heaters change by %.1e (rtol %.1e)", passes, change, loop.rtol)
    return powers, trace.assign_attrs(heater_passes=passes, heater_change=change)


def passes_of(run: xr.Dataset) -> dict[str, Any]:
    """The attributes of a run that `relaxed` adds."""
    return {name: run.attrs[name] for name in ("heater_passes", "heater_change")}


def absorbed(run: xr.Dataset, duration: float) -> Pieces:
    """The absorbed light of a run (W) as a piecewise cubic over [0, duration]; the last value stays to the end."""
    time = run["time"].values
    power = run["absorbed"].values
    if time[-1] < duration:
        time = np.append(time, duration)
        power = np.append(power, power[-1])
    return pieces("absorbed", PchipInterpolator(time, power), 0.0, duration)


def difference(one: Pieces, other: Pieces) -> float:
    """Largest difference of two powers at the breakpoints of the first, relative to its largest value."""
    scale = max(float(np.abs(one.coefficients[:, 0]).max()), float(np.abs(one.ends).max()))
    inner = (one.edges[1:] + one.edges[:-1]) / 2
    return float(np.abs(one(inner) - other(inner)).max()) / scale if scale else 0.0


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
    return interpolated(lambda t, side: heater.power(square(t, side), rise(t, side)), joint(square, rise))
