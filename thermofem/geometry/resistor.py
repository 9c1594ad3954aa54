"""Electrical resistance of a heated part, given or from its material, and the data sheet of a heater."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.constants import c

from .. import checks
from ..data import quantity

if TYPE_CHECKING:
    from .cross_section import CrossSection


@dataclass(frozen=True)
class Resistor:
    """A heater as its contacts see it.

        R(dT) = resistance (1 + tcr dT)

    resistance [ohm]: at the ambient temperature of the geometry.
    tcr [1/K]: temperature coefficient.
    origin: where the resistance comes from, in words.
    """

    resistance: float
    tcr: float
    origin: str

    def at(self, rise: Any, name: str) -> Any:
        """R in ohm at a rise in K; InputError, with the ``name`` of the heater, where it is not positive."""
        resistance = self.resistance * (1 + self.tcr * rise)
        hint = f"at a rise of {np.max(np.abs(rise)):.4g} K; tcr = {self.tcr:g} 1/K does not reach that far"
        checks.positive(f"resistance of {name!r}", float(np.min(resistance)), unit="ohm", hint=hint)
        return resistance


def known_resistor(
    geometry: CrossSection, name: str, length: float | None = None, width: float | None = None
) -> Resistor | None:
    """The resistance of a heated part, its own or R = rho L/(w h) along it; None where neither it nor rho is given.

    L is the line at the part's own mean radius, with the straights of a racetrack, or the length of a straight section;
    w is the width at half height. Contacts and a gap in the ring are not part of it.

    length, width [m]: L and w of a shape that is drawn in the plane of a chip.
    Raises InputError: a part that is not heated.
    """
    checks.choice("heater", name, geometry.heated)
    part = geometry.part(name)
    if part.resistance is not None:
        return Resistor(part.resistance, part.tcr, "given")
    resistivity = geometry.material_of(name).resistivity
    if resistivity is None:
        return None
    along = "of the guide" if length is None else "of the shape"
    length = length or geometry.length
    if length is None:
        length = geometry.path_length(part.centre)
        straights = f" + 2 x {quantity.rounded(geometry.straight, 'm', 6)}" if geometry.straight else ""
        along = f"= 2 pi x {quantity.rounded(part.centre, 'm', 6)}{straights}, at its own mean radius"
    width = width or part.breadth
    resistance = resistivity * length / (width * part.height)
    origin = f"rho L/(w h) of {part.material}, L = {quantity.rounded(length, 'm', 6)} {along}"
    return Resistor(resistance, part.tcr, origin)


def recorded(resistors: Mapping[str, Resistor | None]) -> dict[str, list[float]]:
    """R_0 in ohm and tcr in 1/K of the inputs of a model of several rings or shapes, as its ``origin`` keeps them."""
    return {name: [r.resistance, r.tcr] for name, r in resistors.items() if r is not None}


def check_resistors(geometry: CrossSection) -> None:
    """Raise InputError where resistance and resistivity are both given, or a coefficient of no resistance."""
    for part in geometry.parts:
        resistivity = geometry.material_of(part.name).resistivity
        if part.resistance is not None and resistivity is not None:
            raise checks.InputError(
                f"part {part.name!r} has a resistance and {part.material} a resistivity", "give one of the two"
            )
        if part.tcr and part.resistance is None and resistivity is None:
            raise checks.InputError(f"part {part.name!r} has a tcr, but no resistance", 'e.g. resistance = "120 ohm"')


def fsr_power(wavelength: float, n_g: float, length: float, shift_per_watt: float) -> float:
    """Power (W) that shifts a resonance by one free spectral range lambda^2/(n_g L), or a phase by 2 pi."""
    return wavelength**2 / (n_g * length * shift_per_watt)


def heater_sheet(
    geometry: CrossSection, mode: Any, heater: str, to_light: float, self_heating: float
) -> dict[str, float]:
    """Numbers of a heater's data sheet by name, in SI, as of `HeatProblem.heater_sheet`, which has the formulas.

    mode [thermofem.optics.Mode]: the light.
    to_light, self_heating [K/W]: R(heater -> light) and R(heater -> heater).
    Raises InputError: a tcr that makes the resistance negative.
    """
    length = geometry.length or geometry.path_length(mode.radius)
    shift_per_kelvin = mode.wavelength * mode.thermo_optic
    shift_per_watt = shift_per_kelvin * to_light
    power = fsr_power(mode.wavelength, mode.n_g, length, shift_per_watt)
    sheet = {
        "thermal_resistance": to_light,
        "shift_per_kelvin": shift_per_kelvin,
        "shift_per_watt": shift_per_watt,
        "free_spectral_range": c / (mode.n_g * length),
        "pi_power": power / 2,
        "fsr_power": power,
    }
    resistor = known_resistor(geometry, heater)
    if resistor is None:
        return sheet
    sheet["resistance"] = resistor.resistance
    for phase in ("pi", "fsr"):
        power = sheet[f"{phase}_power"]
        hot = resistor.at(self_heating * power, heater)
        sheet[f"{phase}_voltage"] = sqrt(power * hot)
        sheet[f"{phase}_current"] = sqrt(power / hot)
    return sheet
