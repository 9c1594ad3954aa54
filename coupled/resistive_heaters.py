"""Drives of heaters, in watts, volts or amperes; resistances that follow the temperature, and heaters at rest.

    R_h = R_0 (1 + alpha dT_h),    P_h = V^2/R_h or I^2 R_h,    dT_h = sum_g Z_hg P_g + sum_c Z_hc P_c + T_a

R_0 and alpha are those of the part in the geometry that the thermal model records. dT_h is an output of the model that
it needs where alpha is not 0. P_c is the light absorbed by ring c, T_a the temperature of the ambient.

Under constant drives the powers at rest in the dark are found by Newton's method. The light heats a heater by a few
kelvin at most, and its power changes by dP/dT of that: the thermal model with A + b_h (dP_h/dT) c_h is linear again and
holds that feedback in its steady states and eigenvalues. What is left out is of second order in alpha times that rise.
`heater_loop` has drives in time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.linalg import eig
from scipy.sparse import csc_matrix

from thermofem import CrossSection, StateSpace, checks
from thermofem.arrays import Array
from thermofem.geometry.resistor import Resistor
from thermofem.geometry.section_parts import AMBIENT
from thermofem.models.contract import bare

from .inputs import Pieces, bounds, pieces, power_in_time
from .thermal import MOST_POLES, check_order, geometry_of

LARGEST_POWER = 10.0  # W
RANGES = {"W": (0.0, LARGEST_POWER), "V": (-1e3, 1e3), "A": (-1e3, 1e3), "K": (-250.0, 250.0)}
MOST_ITERATIONS = 50  # of Newton's method
DIGITS = 1e-12  # of the rise, below which its last correction is
APART = 1e-5  # relative difference of equal rates, so that modes exist
READ_TOO = (
    "a model that reads the heater, too: heat.channels(('core', 'heater'), ('core', 'heater')), reduce --read, "
    "surrogate.reduce_layout for a circuit"
)


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
    """

    wave: Any
    unit: ClassVar[str] = "V"
    exponent: ClassVar[int] = -1  # of R in the power


@dataclass(frozen=True)
class Amperes:
    """A current through a heater, where `simulate` and others take its power: P = I^2 R; R as of `Volts`.

    Parameters
    ----------
    wave : float, Waveform, `coupled.Sweep`, or a list of them; A
    """

    wave: Any
    unit: ClassVar[str] = "A"
    exponent: ClassVar[int] = 1


@dataclass(frozen=True)
class ResistiveHeater:
    """A heater with its drive and its resistance."""

    name: str
    drive: Volts | Amperes
    resistor: Resistor

    def power(self, square: Any, rise: Any) -> Any:
        """Power in W for the square of the drive and the rise in K; InputError where R or the power is out of range."""
        power = square * self.resistor.at(rise, self.name) ** self.drive.exponent
        drive = f"by {np.sqrt(np.max(square)):g} {self.drive.unit} in {self.resistor.resistance:g} ohm"
        check_drive(f"power of {self.name!r} {drive}", float(np.max(power)), "W")
        return power

    def slope(self, power: float, rise: float) -> float:
        """dP/dT in W/K at a constant drive."""
        per_ohm = self.drive.exponent * power / self.resistor.at(rise, self.name)
        return per_ohm * self.resistor.resistance * self.resistor.tcr

    def terminals(self, power: Any, square: Any) -> tuple[Array, Array]:
        """Voltage (V) and current (A) at a power in W and the square of the drive; both are positive."""
        drive = np.sqrt(square)
        other = np.divide(power, drive, out=np.zeros_like(drive), where=drive > 0)
        return (drive, other) if self.drive.exponent < 0 else (other, drive)


def check_drive(name: str, value: Any, unit: str, hint: str = "") -> float:
    """A drive of a heater in W, V or A, or the ambient in K; InputError if it is no number or out of range."""
    if unit == "K":
        hint = "it is in kelvin above the ambient of the geometry"
    return checks.between(name, value, *RANGES[unit], unit=unit, hint=hint)


def _parts(name: str, drive: Any) -> tuple[str, str, Any]:
    """Name in messages, unit (W, V, A; K of the ambient) and values of an input of a thermal model."""
    if name == AMBIENT:
        return AMBIENT, "K", drive
    return f"heaters[{name!r}]", getattr(drive, "unit", "W"), getattr(drive, "wave", drive)


def constant_drive(name: str, drive: Any) -> float:
    """The value of a constant drive of the input ``name``; raises as `check_drive`."""
    label, unit, value = _parts(name, drive)
    hint = "a constant power in W, such as 5e-3, or coupled.Volts(1.2); coupled.simulate takes waveforms"
    return check_drive(label, value, unit, hint)


def drive_in_time(name: str, drive: Any, duration: float) -> Pieces:
    """A drive of the input ``name`` as piecewise cubics over [0, duration]; raises as `check_drive`."""
    label, unit, wave = _parts(name, drive)
    if unit == "W":
        hint = "powers are in W (did you mean 5e-3 for 5 mW?)"
        return pieces(label, power_in_time(wave, duration, label, LARGEST_POWER, hint), 0.0, duration)
    found = pieces(label, wave, 0.0, duration)
    for value in bounds(found):
        check_drive(label, value, unit)
    return found


def resistive_heaters(model: Any, heaters: Mapping[str, Any]) -> list[ResistiveHeater]:
    """Those heaters that a voltage or a current drives, with the resistances of their parts.

    A model of several rings or shapes records them by input, any other one by its geometry.
    Raises InputError: a model that records neither, a part that is not heated or has no resistance.
    """
    driven = {name: drive for name, drive in heaters.items() if isinstance(drive, Volts | Amperes)}
    if not driven:
        return []
    origin = getattr(bare(model), "origin", None) or {}
    known = checks.mapping("resistors of the model", origin.get("resistors"))
    return [ResistiveHeater(name, drive, _resistor(model, name, known.get(name))) for name, drive in driven.items()]


def _resistor(model: Any, name: str, values: Any) -> Resistor:
    """The resistor of an input: R_0 (ohm) and tcr (1/K) in ``values`` where they are recorded, or by the geometry."""
    if values is not None:
        label = f"resistor of {name!r} in the model"
        pair = checks.array(label, values)
        checks.shape(label, pair, (2,))
        resistance, tcr = pair.tolist()
        return Resistor(resistance, tcr, "recorded")
    text = geometry_of(model)
    if text:
        return CrossSection.from_toml_text(text).resistor(name)
    raise checks.InputError(
        f"the resistance of {name!r} is not known: the thermal model records no geometry",
        "give its power in W, or a model that was made from a geometry with resistances",
    )


class Rest(NamedTuple):
    """Heaters at rest in the dark: their powers (W), and the model with the feedback of the light around that state."""

    model: Any
    powers: dict[str, float]
    """Of the heaters in W; the ambient in K."""
    sources: dict[str, float]
    """Powers (W) that put ``model`` into that state: P_h - (dP_h/dT) dT_h."""
    attributes: dict[str, float]
    """Power (W) of every heater, voltage (V) and current (A) of those that one of them drives, ambient (K)."""

    @property
    def fed_back(self) -> bool:
        """Whether a resistance follows its temperature, so that the model holds that feedback, too."""
        return self.sources != self.powers


def at_rest(model: Any, heaters: Mapping[str, Any] | None) -> Rest:
    """Powers of heaters under constant drives; numbers among them are powers already, or the ambient in K.

    dT_h = sum_g R_hg P_g + T_a,    P_h = p_h(dT_h)

    Raises InputError: as `resistive_heaters`, and a drive that is no number or out of range.
    """
    heaters = checks.mapping("heaters", heaters)
    resistive = resistive_heaters(model, heaters)
    powers = {name: constant_drive(name, drive) for name, drive in heaters.items()}
    squares = {heater.name: powers[heater.name] ** 2 for heater in resistive}
    for heater in resistive:
        powers[heater.name] = float(heater.power(squares[heater.name], 0.0))
    fed_back = [heater for heater in resistive if heater.resistor.tcr]
    sources = powers
    if fed_back:
        model, sources = _balanced(model, fed_back, squares, powers)
    attributes = {AMBIENT if name == AMBIENT else f"power_in_{name}": value for name, value in powers.items()}
    for heater in resistive:
        volts, amperes = heater.terminals(powers[heater.name], np.asarray(squares[heater.name]))
        attributes |= {f"voltage_of_{heater.name}": float(volts), f"current_of_{heater.name}": float(amperes)}
    return Rest(model, powers, sources, attributes)


def _balanced(
    model: Any, heaters: list[ResistiveHeater], squares: Mapping[str, float], powers: dict[str, float]
) -> tuple[StateSpace, dict[str, float]]:
    """Set the powers (W) of heaters with a tcr to those at rest; returns the model around it and its sources."""
    system = read_heaters(model, heaters)
    names = [heater.name for heater in heaters]
    columns = [system.inputs.index(name) for name in names]
    rows = [system.outputs.index(name) for name in names]
    gain = system.gain[rows]
    at_once = 0.0 if AMBIENT in system.inputs else powers.get(AMBIENT, 0.0)
    rise = np.zeros(len(heaters))
    slope = np.zeros(len(heaters))
    for _ in range(MOST_ITERATIONS):
        for k, heater in enumerate(heaters):
            hot = rise[k] + at_once
            powers[heater.name] = float(heater.power(squares[heater.name], hot))
            slope[k] = heater.slope(powers[heater.name], hot)
        watts = np.array([powers.get(name, 0.0) for name in system.inputs])
        step = np.linalg.solve(np.eye(rise.size) - gain[:, columns] * slope, gain @ watts - rise)
        rise = rise + step
        if np.abs(step).max() <= DIGITS * max(1.0, np.abs(rise).max()):
            sources = dict(zip(names, watts[columns] - slope * rise, strict=True))
            return _fed_back(system, system.B[:, columns] * slope, system.C[rows]), {**powers, **sources}
    raise checks.InputError(f"heaters {', '.join(names)}: no steady temperature is found", "give a smaller drive")


def _fed_back(system: StateSpace, B: Array, C: Array) -> StateSpace:
    """The system with A + B C, by its modes where that is not symmetric, as of models of several rings.

    Their rings and heaters may have equal rates. The states that heater m drives then run faster by m `APART`, which
    keeps every static gain, so that the rates differ.
    """
    A = system.A + B @ C
    if np.allclose(A, A.T, rtol=1e-9, atol=1e-12 * np.abs(A).max()):
        return replace(system, A=A)
    numbers = np.arange(1, len(C) + 1)
    pace = 1 + APART * ((B != 0) @ numbers)[:, None]
    E = system.E / pace
    rates, modes = eig(A, E)
    turning = np.abs(rates.imag / rates).max()
    hint = "drive all heaters alike, by voltages or by currents"
    checks.between("frequency of a thermal mode with heaters", turning, 0, DIGITS, hint=hint)
    modes = modes.real
    inputs = np.linalg.solve(E @ modes, system.B)
    return replace(system, E=np.eye(rates.size), A=np.diag(rates.real), B=inputs, C=system.C @ modes)


def read_heaters(model: Any, heaters: list[ResistiveHeater]) -> StateSpace:
    """The matrices of a model, dense; InputError unless it is small, linear and reads the given heaters."""
    system = bare(model)
    checks.instance("model", system, StateSpace, hint=f"a heater with a tcr needs {READ_TOO}")
    for heater in heaters:
        if heater.name not in system.outputs:
            rule = f"the thermal model does not read {heater.name!r}, whose temperature changes its resistance"
            raise checks.InputError(rule, f"give {READ_TOO}, or tcr = 0")
    check_order(system.order, MOST_POLES)
    return replace(system, E=csc_matrix(system.E).toarray(), A=csc_matrix(system.A).toarray())
