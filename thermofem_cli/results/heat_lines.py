"""Heat as commands print and draw it: R_th, rise times, the error of the domain, and the data sheet of heaters."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import thermofem as th
from thermofem import InputError
from thermofem.arrays import Array, ArrayLike
from thermofem.data import quantity
from thermofem.geometry.resistor import known_resistor

from ..console import note, say, written

PHASES = {"pi": "pi", "fsr": "one free spectral range"}
Sheets = dict[str, dict[str, float]]


def steady_rises(heat: th.fem.HeatProblem, data: xr.Dataset, power: float | None) -> dict[str, float]:
    """Rise of every output in K that a step of ``power`` in W settles at, by k(T) at that power; nan where it fails."""
    rises: dict[str, float] = {}
    for name in data.attrs["read"].split(", ") if power else ():
        try:
            rises[name] = heat.steady_rise(power or 0.0, data.attrs["heated"], name)
        except InputError:
            rises[name] = float("nan")
    return rises


def say_heat(data: xr.Dataset, power: float | None, steady: dict[str, float] | None = None) -> dict[str, Any]:
    """Print and return R_th of every output and, for a step of ``power`` in W, its rise time from 10 to 90 %.

    steady: rise of every output at rest under the step, in K; default R_th times the power.
    """
    a = data.attrs
    times = data["time"].values
    source = a["heated"]
    names = a["read"].split(", ")
    resistances = dict(zip(names, np.atleast_1d(a.get("thermal_resistances", a["thermal_resistance"])), strict=True))
    rises = dict(zip(names, np.atleast_2d(data["delta_T"].transpose(..., "time")), strict=True))
    steady = steady or {name: R * (power or 0.0) for name, R in resistances.items()}
    rise_times: dict[str, float | None] = {}
    for name, R in resistances.items():
        of = name if name == source else f"{name} heated by {source}"
        line = f"R_th of {of} = {R / 1e3:.4g} K/mW"
        if power:
            share = rises[name] / steady[name]
            # 1e-3: relative difference from which R_th at a power is printed beside that at small power
            settles = abs(steady[name] / (R * power) - 1) < 1e-3
            line += "" if settles else f" at small power, {steady[name] / power / 1e3:.4g} K/mW at this one"
            rise_times[name] = _rise_time(times, share)
            line += _progress(share, rise_times[name])
        say(line)
    largest = float(data["delta_T"].max())
    imbalance = a.get("heat_imbalance")
    error = f"error below {a['error_bound']:.1e}" if imbalance is None else f"energy imbalance {imbalance:.0e}"
    say(f"largest rise {largest:.4g} K, {error}")
    return {
        "thermal_resistance": resistances[names[0]],
        "largest_rise": largest,
        "heat_imbalance": imbalance,
        "domain_error": a.get("domain_error"),
        "heated": source,
        **({"thermal_resistances": resistances} if len(names) > 1 else {}),
        **({"rise_time": rise_times, "steady_rise": steady} if power else {}),
    }


def _rise_time(times: Array, share: Array) -> float | None:
    """Time in s from 10 to 90 % of the steady rise; None where the run ends before."""
    if not share[-1] >= 0.9:
        return None
    low = float(np.interp(0.1, share, times))
    high = float(np.interp(0.9, share, times))
    return high - low


def _progress(share: Array, rise_time: float | None) -> str:
    """Words on the rise time, and on what is missing of the steady rise at the end of the run."""
    if np.isnan(share[-1]):
        return ", no steady state found at this power"
    words = "" if rise_time is None else f", rise 10-90 % in {written(rise_time, 's')}"
    return words + (f", {share[-1]:.0%} of the steady rise at the end of the run" if share[-1] < 0.99 else "")


def note_domain(errors: ArrayLike, accuracy: float, option: str = "accuracy") -> int:
    """Return of how many geometries the domain's finite size changes R_th by more than ``accuracy``, and print it.

    option: the name under which the command takes the accuracy.
    """
    errors = np.asarray(errors)
    cut = int((errors > accuracy).sum())
    if cut:
        which = f"{cut} of {errors.size} geometries have a " if errors.size > 1 else ""
        note(
            f"{which}domain_error of up to {np.nanmax(errors):.1e}, above {option} = {accuracy:g}: the bottom or outer "
            'side is too near: move it outwards, or make it "open" where the stack goes on'
        )
    return cut


def note_cut(domain_error: float, accuracy: float, option: str = "accuracy") -> None:
    """Print `note_domain` of one geometry, unless the log has warned of an error as large as this."""
    from thermofem.fem.domain_truncation import NOTABLE

    if domain_error <= NOTABLE:
        note_domain([domain_error], accuracy, option)


def draw_preview(section: th.CrossSection, mesh: th.mesh.Mesh, path: Path) -> None:
    """Draw cross-section and mesh."""
    from thermofem import plot

    plot.save_figure(plot.plot_preview(section, mesh), path)


def draw_response(data: xr.Dataset, path: Path) -> None:
    """Draw the response; its title says what was heated and read, by which drive, and from which start."""
    from thermofem import plot, waveforms

    a = data.attrs
    of = "" if "," in a["read"] or a["read"] == a["heated"] else f"{a['read']}, "
    part = a["heated"] if a["read"] == a["heated"] else f"{of}{a['heated']} heated"
    drive = waveforms.from_json(a["waveform"]).words.replace(" us", " µs")
    begun = ", one period of the periodic state" if a["kind"] == "periodic" else ", from rest"
    ax = plot.plot_response(data)
    ax.set_title(f"{part}: {drive}{begun}", fontsize="small", loc="left")
    plot.save_figure(ax, path)


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
