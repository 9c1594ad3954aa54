"""Electrical resistance of a heated part, given or from its material: V^2/R or I^2 R is the power that it takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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


def resistor_of(geometry: CrossSection, name: str) -> Resistor:
    """The resistance of a part, its own or R = rho L/(w h) along the ring or guide.

    L is the mean circumference of a ring, all of it, or the length of a straight section; w is the width at half
    height. Contacts and a gap in the ring are not part of it.
    Raises InputError: a part that is not heated, or one without resistance whose material has no resistivity.
    """
    checks.choice("heater", name, geometry.heated)
    part = next(part for part in geometry.parts if part.name == name)
    if part.resistance is not None:
        return Resistor(part.resistance, part.tcr, "given")
    resistivity = geometry.material_of(name).resistivity
    if resistivity is None:
        raise checks.InputError(
            f"part {name!r} has no resistance, and {part.material} no resistivity",
            f'give resistance = "120 ohm" to the part, or resistivity = "4.3e-7 ohm*m" in [material.{part.material}]',
        )
    width = part.outer_radius - part.inner_radius
    length = geometry.length
    if length is None:
        length = geometry.path_length((part.inner_radius + part.outer_radius) / 2)
    origin = f"rho L/(w h) of {part.material}, L = {quantity.rounded(length, 'm', 6)}"
    return Resistor(resistivity * length / (width * part.height), part.tcr, origin)


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
