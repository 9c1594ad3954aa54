"""Slow sweeps of a laser as measured: ports, units with decibels, noise, and the baseline that a chip adds to each.

    linear units  drop:     y = (1 + b xi) T + a             a: dark level,  b: tilt of the gratings over the sweep
                  through:  y = (1 + b xi) T + a             in W and "1"
                            y = (1 + a + b xi) T             in an arbitrary unit: the level off resonance is the scale
    decibels      drop:     y = 10 lg T + b xi
                  through:  y = 10 lg T + a + b xi

with T the output of the ring, and xi from -1 to 1 along the sweep of the wavelength. A sweep of the power at one
wavelength has no baseline. Of a through port in an arbitrary unit a dark level cannot be told from the extinction.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.constants import c, pi

from thermofem import InputError, checks
from thermofem.arrays import Array, noise_of
from thermofem.data import quantity
from thermofem.data.variables import in_si

from ..equilibria.transmission import PortCurve
from ..inputs import check_power
from ..resonator import RingResonator

DECIBELS = {"db": "dB", "dbm": "dBm"}
DBM_OF_WATT = 30.0  # 1 W in dBm
ABSOLUTE = ("W", "1")
TOP = 0.95  # quantile of a through port that stands for its level off resonance
# assumed deviations of the terms of a baseline: of the range or the level of a sweep, of its tilt, and both in dB
OFFSET, TILT, LEVEL_DB, TILT_DB = 0.3, 0.5, 3.0, 3.0


class Sweep(NamedTuple):
    """Samples of one sweep, in the units in which they are compared.

    x [shape (n,)]: ln P, or the laser's frequency less that of the initial ring, Hz.
    y [shape (n,)]: W, power over the bus power, dB, or the arbitrary ``unit``; of a through port whose level is free,
        relative to that level.
    power [W], detuning [Hz]: the one that is constant; None for the one that is swept.
    step, noise: half a step of x, and the standard deviation of y.
    level: the level off resonance by which y was divided, or which was subtracted in decibels.
    """

    x: Array
    y: Array
    port: str
    unit: str
    power: float | None
    detuning: float | None
    step: float
    noise: float
    level: float

    @property
    def decibels(self) -> bool:
        """Whether y is in dB."""
        return self.unit in DECIBELS.values()

    @property
    def free_level(self) -> bool:
        """Whether the level off resonance is a term of the baseline: a through port over wavelength, not in W or 1."""
        return self.port == "through" and self.power is not None and self.unit not in ABSOLUTE

    @property
    def scale(self) -> tuple[str, str] | None:
        """Port and unit whose common scale is an unknown of the fit; None where there is none."""
        return None if self.free_level or self.unit in ABSOLUTE else (self.port, self.unit)

    def output(self, curve: PortCurve) -> Array:
        """The output of a curve of fixed points in the unit of y, but for scale and baseline; over its points."""
        watts = curve.drop if self.port == "drop" else curve.through
        relative = self.free_level or self.unit in ("1", "dB")
        T = watts / curve.power if relative else watts
        if not self.decibels:
            return T
        # the bottom of a curve in decibels is at 1e-12 of its top
        decibels = 10 * np.log10(np.maximum(T, 1e-12 * T.max()))
        return decibels if relative else decibels + DBM_OF_WATT

    @property
    def baseline_scales(self) -> Array:
        """Assumed deviations of the terms of the baseline, those of a and b in units of y; (terms,)."""
        if self.power is None:
            return np.empty(0)
        if self.decibels:
            return np.array([LEVEL_DB, TILT_DB] if self.free_level else [TILT_DB])
        level = 1.0 if self.free_level else float(np.ptp(self.y))
        return np.array([OFFSET * level, TILT])

    def baseline_terms(self, x: Array, output: Array) -> Array:
        """Terms of the baseline at points (x, output) of a curve, each times its assumed deviation; (terms, points)."""
        scales = self.baseline_scales
        middle = (self.x.max() + self.x.min()) / 2
        half = max(float(np.ptp(self.x)) / 2, self.step)
        tilt = (x - middle) / half
        level = np.ones(x.size)
        if not self.decibels:
            tilt = tilt * output
            level = output if self.free_level else level
        terms = np.array([level, tilt])[2 - scales.size :]
        return scales[:, None] * terms


def read_sweep(name: str, given: xr.Dataset, ring: RingResonator, noise: float | None = None) -> Sweep:
    """Check the Dataset of a sweep and convert it to a `Sweep`.

    noise: standard deviation of a sample in the unit of the Dataset; by default estimated.

    Raises InputError: no port or two, nothing swept, a unit that the numbers contradict.
    """
    ports = [port for port in ("drop", "through") if port in given]
    if len(ports) != 1 or given[ports[0]].ndim != 1:
        raise InputError(f"{name} needs one of the variables drop and through, over one dimension")
    port = ports[0]
    measured = checks.array(f"{name}.{port}", given[port].values)
    laser = in_si(name, given.drop_vars(port))
    power = _number(laser, "power")
    nu = _number(laser, "detuning")
    wavelength = _number(laser, "wavelength")
    if wavelength is not None:
        nu = c / wavelength - ring.frequency
    moves = [value is not None and bool(np.ptp(value) > 0) for value in (power, nu)]
    swept = power if moves[0] else nu
    if power is None or nu is None or swept is None or sum(moves) != 1 or swept.shape != measured.shape:
        raise InputError(
            f"{name} needs power (W) and wavelength (m) or detuning (Hz), variables or attributes; one of them is swept"
        )
    for value in np.atleast_1d(power):
        check_power(float(value), f"{name}.power")
    stated = given[port].attrs.get("units")
    unit, factor = _unit(f"{name}.{port}", stated, measured, float(np.max(power)))
    y = factor * measured
    x = np.log(power) if moves[0] else nu
    watts = None if moves[0] else float(np.mean(power))
    hertz = None if moves[1] else float(np.mean(nu))
    steps = np.abs(np.diff(x))
    half_step = float(np.median(steps[steps > 0])) / 2
    # a noise of 0.2 % of the range is assumed at least
    deviation = max(noise_of(y), 2e-3 * float(np.ptp(y))) if noise is None else factor * noise
    sweep = Sweep(x, y, port, unit, watts, hertz, half_step, deviation, 1.0)
    return _levelled(sweep) if sweep.free_level else sweep


def _levelled(sweep: Sweep) -> Sweep:
    """A sweep of a through port relative to its level off resonance: divided by it, or in decibels less it."""
    level = float(np.quantile(sweep.y, TOP))
    if sweep.decibels:
        return sweep._replace(y=sweep.y - level, level=level)
    return sweep._replace(y=sweep.y / level, noise=sweep.noise / level, level=level)


def _number(laser: xr.Dataset, key: str) -> Array | None:
    """A variable or attribute of a sweep as an array of floats, in SI; None where it has none of this name."""
    value = laser[key].values if key in laser.variables else laser.attrs.get(key)
    return None if value is None else np.asarray(value, dtype=float)


def _unit(name: str, stated: Any, y: Array, power: float) -> tuple[str, float]:
    """Unit in which samples are compared, and the factor to it: "W", "1", "dB", "dBm", or an arbitrary one as stated.

    Raises InputError: numbers that are no powers, in a unit that is not decibels.
    """
    unit = "W" if stated is None else str(stated).strip()
    if unit.casefold() in DECIBELS:
        return DECIBELS[unit.casefold()], 1.0
    hint = 'powers in decibels have the attribute units "dB" or "dBm"'
    if y.mean() <= 0:
        where = "states no unit and" if stated is None else f"is in {unit} and"
        raise InputError(f"{name} {where} is negative on average, {y.mean():.3g}: no power of light", hint)
    # a number without unit far above the bus power is no power in W
    if stated is None and y.max() > 1.5 * power:
        hint = 'give its attribute units: "1" for a fraction of the bus power, "V" for a signal'
        raise InputError(f"{name} states no unit, and {y.max():.3g} W is more than the {power:.3g} W in the bus", hint)
    if unit in ("", "1"):
        return "1", 1.0
    if unit == "%":
        return "1", 1e-2
    try:
        return "W", quantity.parse(f"1 {unit}", "W", name=name)
    except InputError:
        return unit, 1.0


def with_seen_resonance(ring: RingResonator, sweeps: Sequence[xr.Dataset]) -> RingResonator:
    """The ring with the resonance and the linewidth of the weakest sweep of the wavelength, as a start of a fit.

    The frequency is that of the highest drop or the deepest through power; all rates are scaled by one factor to the
    full width at half of that height, and those of a ring of another bus than two equal ones to the depth of a dip,

        b = w (1 - sqrt(T_min))/2,     the rate into the bus of an under-coupled ring of total rate w.

    Without a sweep of the wavelength the ring is unchanged.
    """
    read = [read_sweep(f"sweeps[{k}]", sweep, ring) for k, sweep in enumerate(sweeps)]
    of_wavelength = [sweep for sweep in read if sweep.power is not None]
    if not of_wavelength:
        return ring
    weakest = min(of_wavelength, key=lambda sweep: sweep.power or 0.0)
    order = np.argsort(weakest.x)
    x = weakest.x[order]
    y = weakest.y[order]
    y = 10 ** (y / 10) if weakest.decibels else y
    height = y - np.median(y) if weakest.port == "drop" else float(np.quantile(y, TOP)) - y
    top = int(np.argmax(height))
    low = height < height[top] / 2
    left = int(np.flatnonzero(low[:top])[-1]) if low[:top].any() else 0
    right = top + int(np.argmax(low[top:])) if low[top:].any() else x.size - 1
    width = max(float(x[right] - x[left]), 2 * weakest.step)
    total = pi * width
    bus = total * ring.bus_rate / ring.linear_rate
    if weakest.port == "through" and ring.drop_rate is not None:
        # no rate into the bus is read from a dip above 99 % of the power
        lowest = float(np.clip(y[top], 0, 0.99))
        bus = total * (1 - np.sqrt(lowest)) / 2
    factor = (total - bus) / (ring.linear_rate - ring.bus_rate)
    if ring.drop_rate is None:
        factor = total / ring.linear_rate
    return replace(
        ring, frequency=ring.frequency + float(x[top]), bus_rate=bus, loss_rate=factor * ring.loss_rate,
        scattering_rate=factor * ring.scattering_rate,
        drop_rate=None if ring.drop_rate is None else factor * ring.drop_rate,
    )  # fmt: skip
