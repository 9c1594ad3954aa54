"""What the data sheet of a thermal phase shifter says, from its cross-section.

    shift_per_watt = lambda alpha R(heater -> light),     FSR = c/(n_g L)
    P(2 pi) = FSR/(f alpha R(heater -> light)),           P(pi) = P(2 pi)/2
    V = sqrt(P R_e),  I = sqrt(P/R_e),                    R_e = R_0 (1 + tcr R(heater -> heater) P)

alpha = -d ln(omega)/dT is the mode's `thermo_optic`. L is the round trip of a ring or the length of a straight guide: a
shift by one free spectral range, or a phase of 2 pi at constant frequency, which takes the same power.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from scipy.constants import c

from .. import checks
from ..geometry.resistor import known_resistor

if TYPE_CHECKING:
    from .heat_problem import HeatProblem


def heater_sheet(heat: HeatProblem, heater: str | None = None) -> dict[str, float]:
    """Numbers of a heater by name, in SI; arguments, names and errors as of `HeatProblem.heater_sheet`."""
    light = heat.lit.light
    if light is None:
        hint = "give the geometry a [light] table with its wavelength, or take heat.with_light(mode)"
        raise checks.InputError(f"{heat.geometry.name!r} has no light, whose phase a heater moves", hint)
    heaters = [name for name in heat.heated if name != light.core]
    heater = checks.choice("heater", heater, heaters, default=next(iter(heaters), None))
    length = heat.geometry.length or heat.geometry.path_length(light.radius)
    to_light = heat.lit.thermal_resistance(heater, "light")
    shift_per_kelvin = light.wavelength * light.thermo_optic
    free_spectral_range = c / (light.n_g * length)
    shift = c / light.wavelength * light.thermo_optic * to_light  # Hz/W
    sheet = {
        "thermal_resistance": to_light,
        "shift_per_kelvin": shift_per_kelvin,
        "shift_per_watt": shift_per_kelvin * to_light,
        "free_spectral_range": free_spectral_range,
        "pi_power": free_spectral_range / shift / 2,
        "fsr_power": free_spectral_range / shift,
    }
    resistor = known_resistor(heat.geometry, heater)
    if resistor is None:
        return sheet
    self_heating = heat.thermal_resistance(heater)
    sheet["resistance"] = resistor.resistance
    for phase in ("pi", "fsr"):
        power = sheet[f"{phase}_power"]
        hot = resistor.resistance * (1 + resistor.tcr * self_heating * power)
        checks.positive(f"resistance of {heater!r} at the power of {phase}", hot, unit="ohm")
        sheet[f"{phase}_voltage"] = math.sqrt(power * hot)
        sheet[f"{phase}_current"] = math.sqrt(power / hot)
    return sheet
