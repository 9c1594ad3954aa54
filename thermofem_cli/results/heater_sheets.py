"""The data sheet of heaters as commands print it: R, K/mW, pm/mW, and mW, V and mA for pi and for one period."""

import thermofem as th
from thermofem.data import quantity
from thermofem.geometry.resistor import known_resistor

from ..console import say

PHASES = {"pi": "pi", "fsr": "one free spectral range"}
Sheets = dict[str, dict[str, float]]


def say_sheets(heat: th.fem.HeatProblem) -> dict[str, Sheets]:
    """Print and return the numbers of every heater beside a guide; {} where light or heater are not known."""
    light = heat.light or heat.geometry.light
    core = getattr(light, "core", None) or getattr(light, "part", None)
    heaters = [name for name in heat.heated if name != core] if core else []
    sheets = {name: heat.heater_sheet(name) for name in heaters}
    return say_each(heat.geometry, sheets)


def say_each(geometry: th.CrossSection, sheets: Sheets) -> dict[str, Sheets]:
    """Print the sheets of heaters by name, and return them as a number of the command; {} where there are none."""
    for name, sheet in sheets.items():
        resistor = known_resistor(geometry, name)
        if resistor is not None:
            tcr = f", tcr {resistor.tcr:g} 1/K" if resistor.tcr else ""
            say(f"{name}: {quantity.rounded(resistor.resistance, 'ohm', 4)} ({resistor.origin}){tcr}")
        shift = f"{sheet['shift_per_watt'] * 1e9:.4g} pm/mW"
        say(f"{name}: {sheet['thermal_resistance'] / 1e3:.4g} K/mW in the light, {shift}")
        for phase, words in PHASES.items():
            drive = f"{sheet[f'{phase}_power'] * 1e3:.4g} mW"
            if phase == "fsr":
                drive += "/FSR"
            if resistor is not None:
                drive += f", {sheet[f'{phase}_voltage']:.4g} V, {sheet[f'{phase}_current'] * 1e3:.4g} mA"
            say(f"{name}, {words}: {drive}")
    return {"heaters": sheets} if sheets else {}
