"""Heaters driven by a voltage or a current, whose resistance follows their temperature, and their state at rest.

    R_h = R_0 (1 + alpha dT_h),    P_h = V^2/R_h or I^2 R_h,    dT_h = sum_g Z_hg P_g + Z_hc P_abs + T_a

R_0 and alpha are those of the part in the geometry that the thermal model records. dT_h is an output of the model that
it needs where alpha is not 0.

Under constant drives the powers at rest in the dark are found by Newton's method. The light heats a heater by a few
kelvin at most, and its power changes by dP/dT of that: the thermal model with A + b_h (dP_h/dT) c_h is linear again and
holds that feedback in its steady states and eigenvalues. What is left out is of second order in alpha times that rise.
`heater_loop` has drives in time.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.sparse import issparse

from thermofem import CrossSection, StateSpace, checks
from thermofem.arrays import Array
from thermofem.geometry.resistor import Resistor
from thermofem.models.contract import bare

from .thermal import LARGEST, check_order, geometry_of

LARGEST_DRIVE = 1e3  # V or A
MOST_ITERATIONS = 50  # of Newton's method
DIGITS = 1e-12  # of the rise, below which its last correction is
READ_TOO = "a model that reads the heater, too (heat.channels(('core', 'heater'), ('core', 'heater')), reduce --read)"


@dataclass(frozen=True)
class Volts:
    """A voltage across a heater, where `simulate` and others take its power.

        P = V^2/R,    R = R_0 (1 + tcr dT)

    R_0 and tcr are those of the heater in the geometry that the thermal model records (``resistance`` or the
    ``resistivity`` of its material, and ``tcr``); dT is the rise of the heater. With a tcr the model has to read the
    heater: ``heat.channels(("core", "heater"), ("core", "heater"))``.

    Parameters
    ----------
    wave : float, Waveform, `coupled.Sweep`, or a list of them; V
        in `simulate` and `cosimulate`; elsewhere a number.

    >>> Volts(1.2).power(1.2**2, 120.0)
    0.012
    """

    wave: Any
    unit: ClassVar[str] = "V"
    exponent: ClassVar[int] = -1

    def power(self, square: Any, resistance: Any) -> Any:
        """V^2/R in W, from V^2 and R."""
        return square / resistance


@dataclass(frozen=True)
class Amperes:
    """A current through a heater, where `simulate` and others take its power: P = I^2 R; R as of `Volts`.

    Parameters
    ----------
    wave : float, Waveform, `coupled.Sweep`, or a list of them; A

    >>> Amperes(10e-3).power(10e-3**2, 120.0)
    0.012
    """

    wave: Any
    unit: ClassVar[str] = "A"
    exponent: ClassVar[int] = 1

    def power(self, square: Any, resistance: Any) -> Any:
        """I^2 R in W, from I^2 and R."""
        return square * resistance


@dataclass(frozen=True)
class ResistiveHeater:
    """A heater with its drive and its resistance."""

    name: str
    drive: Volts | Amperes
    resistor: Resistor

    def power(self, square: Any, rise: Any) -> Any:
        """Power in W for the square of the drive and the rise in K; InputError where R is not positive."""
        resistance = self.resistor.resistance * (1 + self.resistor.tcr * rise)
        hint = f"at a rise of {np.max(np.abs(rise)):.4g} K; tcr = {self.resistor.tcr:g} 1/K does not reach that far"
        checks.positive(f"resistance of {self.name!r}", float(np.min(resistance)), unit="ohm", hint=hint)
        return self.drive.power(square, resistance)

    def slope(self, power: float, rise: float) -> float:
        """dP/dT in W/K at a constant drive."""
        return self.drive.exponent * self.resistor.tcr * power / (1 + self.resistor.tcr * rise)

    @property
    def square(self) -> float:
        """The square of the drive, which must be a number."""
        hint = "a constant, such as coupled.Volts(1.2); coupled.simulate takes waveforms"
        name = f"heaters[{self.name!r}]"
        drive = checks.between(name, self.drive.wave, -LARGEST_DRIVE, LARGEST_DRIVE, unit=self.drive.unit, hint=hint)
        return drive**2

    def terminals(self, power: Any, square: Any) -> tuple[Array, Array]:
        """Voltage (V) and current (A) at a power in W and the square of the drive; both are positive."""
        drive = np.sqrt(square)
        other = np.divide(power, drive, out=np.zeros_like(drive), where=drive > 0)
        return (drive, other) if self.drive.exponent < 0 else (other, drive)


def resistive_heaters(model: Any, heaters: Mapping[str, Any]) -> list[ResistiveHeater]:
    """Those heaters that a voltage or a current drives, with the resistances of their parts.

    A heater of an array, such as "heater 2", has the resistance of its part "heater".
    Raises InputError: a model that records no geometry, a part that is not heated or has no resistance.
    """
    driven = {name: drive for name, drive in heaters.items() if isinstance(drive, Volts | Amperes)}
    if not driven:
        return []
    text = geometry_of(model)
    if not text:
        raise checks.InputError(
            f"heaters[{next(iter(driven))!r}]: the thermal model records no geometry, so no resistance is known",
            "give its power in W, or a model that was made from a geometry with resistances",
        )
    section = CrossSection.from_toml_text(text)
    found = []
    for name, drive in driven.items():
        part = name if name in section.heated else re.sub(r" \d+$", "", name)
        found.append(ResistiveHeater(name, drive, section.resistor(part)))
    return found


class Rest(NamedTuple):
    """Heaters at rest in the dark: their powers (W), and the model with the feedback of the light around that state."""

    model: Any
    powers: dict[str, float]
    sources: dict[str, float]
    """Powers (W) that put ``model`` into that state: P_h - (dP_h/dT) dT_h."""
    attributes: dict[str, float]
    """Voltage (V) and current (A) of those that one of them drives."""


def at_rest(model: Any, heaters: Mapping[str, Any]) -> Rest:
    """Powers of heaters under constant drives; numbers among them are powers already.

    dT_h = sum_g R_hg P_g,    P_h = p_h(dT_h)
    """
    found = resistive_heaters(model, heaters)
    powers = {**heaters, **{one.name: float(one.power(one.square, 0.0)) for one in found}}
    fed_back = [one for one in found if one.resistor.tcr]
    sources = powers
    if fed_back:
        model, sources = _balanced(model, fed_back, powers)
    attributes: dict[str, float] = {}
    for one in found:
        volts, amperes = one.terminals(powers[one.name], np.asarray(one.square))
        attributes |= {f"voltage_of_{one.name}": float(volts), f"current_of_{one.name}": float(amperes)}
    return Rest(model, powers, sources, attributes)


def _balanced(
    model: Any, heaters: list[ResistiveHeater], powers: dict[str, float]
) -> tuple[StateSpace, dict[str, float]]:
    """Set the powers (W) of heaters with a tcr to those at rest; returns the model around it and its sources."""
    system = read_heaters(model, heaters)
    names = [heater.name for heater in heaters]
    rows = [system.outputs.index(name) for name in names]
    gain = system.gain[np.ix_(rows, [system.inputs.index(name) for name in powers])]
    across = gain[:, [list(powers).index(name) for name in names]]
    rise = np.zeros(len(heaters))
    slope = np.zeros(len(heaters))
    for _ in range(MOST_ITERATIONS):
        for k, heater in enumerate(heaters):
            powers[heater.name] = float(heater.power(heater.square, rise[k]))
            slope[k] = heater.slope(powers[heater.name], rise[k])
        residual = gain @ [*powers.values()] - rise
        step = np.linalg.solve(np.eye(rise.size) - across * slope, residual)
        rise = rise + step
        if np.abs(step).max() <= DIGITS * max(1.0, np.abs(rise).max()):
            B = system.B[:, [system.inputs.index(name) for name in names]]
            sources = {name: powers[name] - a * dT for name, a, dT in zip(names, slope, rise, strict=True)}
            return replace(system, A=system.A + (B * slope) @ system.C[rows]), {**powers, **sources}
    raise checks.InputError(f"heaters {', '.join(names)}: no steady temperature is found", "give a smaller drive")


def read_heaters(model: Any, heaters: list[ResistiveHeater]) -> StateSpace:
    """The matrices of a model, dense; InputError unless it is small, linear and reads the given heaters."""
    system = bare(model)
    checks.instance("model", system, StateSpace, hint=f"a heater with a tcr needs {READ_TOO}")
    for one in heaters:
        hint = f"its temperature changes its resistance; give {READ_TOO}, or tcr = 0"
        checks.choice(f"output of the model for heater {one.name!r}", one.name, system.outputs, hint=hint)
    check_order(system.order, LARGEST)
    return replace(system, A=system.A.toarray()) if issparse(system.A) else system


def check_constant(heaters: list[ResistiveHeater], what: str) -> None:
    """Raise InputError for a heater whose resistance follows its temperature, which ``what`` cannot do."""
    for one in heaters:
        hint = f"{what} takes a constant resistance"
        checks.between(f"tcr of {one.name!r}", one.resistor.tcr, 0, 0, unit="1/K", hint=hint)
