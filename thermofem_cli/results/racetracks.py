"""Racetracks, rings with [plan] straight: their reductions, transients and data sheets, as commands print them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import surrogate
import thermofem as th
from surrogate.reduction.racetrack_reduction import reduce_racetrack
from surrogate.studies.inverse_search import channel_steps
from thermofem import InputError, checks, waveforms
from thermofem.arrays import Array
from thermofem.data import dataset, quantity
from thermofem.geometry.resistor import heater_sheet
from thermofem.geometry.section_parts import LIGHT, Guide
from thermofem.optics.mode import Mode

from ..console import note, say, working, written
from .heater_sheets import say_each
from .reductions import LEAST_TOLERANCE, over_channels


def racetrack_model(
    section: th.CrossSection, tolerance: float, inputs: list[str], outputs: list[str]
) -> tuple[th.StateSpace, float]:
    """The model of a racetrack with these inputs and outputs, and the bound of its error.

    inputs, outputs: default the first heated part, and the light where the file has [light].
    """
    with working("solving the section and the path of the racetrack"):
        layout = reduce_racetrack(section, tolerance)
    whole = layout.model
    heated = inputs or [whole.inputs[0]]
    for name in heated:
        checks.choice("--heated", name, whole.inputs)
    light = [LIGHT] if LIGHT in whole.outputs else []
    read = outputs or [*heated[:1], *light]
    for name in read:
        checks.choice("--read", name, whole.outputs, hint="a racetrack has its heated parts, and light")
    rows = [whole.outputs.index(name) for name in read]
    columns = [whole.inputs.index(name) for name in heated]
    model = replace(whole, B=whole.B[:, columns], C=whole.C[rows], inputs=tuple(heated), outputs=tuple(read))
    return model, float(layout.channel_bounds[np.ix_(rows, columns)].max())


def reduced_racetrack(
    section: th.CrossSection,
    tolerance: float,
    heated: list[str],
    read: list[str],
    positions: Path | None,
    output: Path,
) -> dict[str, Any]:
    """Reduce a ring with [plan] straight: inputs its heated parts, outputs the same and the light."""
    if positions is not None:
        raise InputError(
            f"--positions: {section.name!r} is a racetrack",
            "an array of racetracks is a layout, with a table [[shape]] for each",
        )
    tolerance = max(tolerance, LEAST_TOLERANCE)
    model, bound = racetrack_model(section, tolerance, heated, read)
    names = list(model.inputs)
    outputs = list(model.outputs)
    provenance = {
        "method": "racetrack reduction",
        "tolerance": tolerance,
        "error_bound": bound,
        "geometry": section.to_toml(),
        "ports": names,
    }
    surrogate.save_model(model, output, provenance=provenance)
    length = quantity.rounded(section.path_length(_radius(section, section.heated[0])), "m", 5)
    say(f"racetrack of {length}: {model.order} states, error of Z(f) below {bound:.1e} of R_th")
    steps = channel_steps(model) or []
    for row in steps:
        channel = f" from {row['heated']} to {row['read']}"
        rise = written(row["rise_time"], "s")
        say(f"R_th = {row['thermal_resistance'] / 1e3:.4g} K/mW{channel}, rise 10-90 % in {rise}")
    return {
        "poles": model.order,
        "error_bound": bound,
        "heated": names,
        "read": outputs,
        "thermal_resistance": over_channels(steps, names, outputs, "thermal_resistance"),
        "rise_time": over_channels(steps, names, outputs, "rise_time"),
        "model": output,
    }


def _radius(section: th.CrossSection, name: str) -> float:
    part = section.part(name)
    return (part.inner_radius + part.outer_radius) / 2


def solved_racetrack(
    section: th.CrossSection, wave: waveforms.Waveform, times: Array | int, heated: list[str], read: list[str]
) -> tuple[xr.Dataset, dict[str, float]]:
    """Rise under a wave at ``times`` in s, or one period of the periodic state at so many samples, as of `th.solve`.

    Returns the data, and R_th in K/W by output.
    """
    if len(heated) > 1:
        raise InputError(f"--heated {', '.join(heated)}: one part of a racetrack carries the power", "give one")
    model, bound = racetrack_model(section, LEAST_TOLERANCE, heated, read or heated or [section.heated[0]])
    channels = [model.channel(read=name).dynamics for name in model.outputs]
    if isinstance(times, int):
        rises = np.array([channel.periodic_response(wave, times) for channel in channels]).T
        sampled = waveforms.period_times(wave, times)
    else:
        rises = np.array([channel.response(wave, times) for channel in channels]).T
        sampled = times
    resistances = [channel.thermal_resistance for channel in channels]
    attributes: dict[str, Any] = {
        "method": "racetrack reduction",
        "error_bound": bound,
        "heated": model.inputs[0],
        "thermal_resistance": resistances[0],
        "geometry": section.to_toml(),
    }
    if len(channels) == 1:
        rises = rises[:, 0]
    else:
        attributes["thermal_resistances"] = resistances
    periodic = isinstance(times, int)
    data = dataset.build(sampled, rises, wave, periodic=periodic, read=model.outputs, attributes=attributes)
    return data, dict(zip(model.outputs, resistances, strict=True))


def say_racetrack_sheets(section: th.CrossSection, mode: Mode | None = None) -> dict[str, Any]:
    """Print and return the data sheets of the heaters along a racetrack; {} where light or heater are not known.

    mode: the light, by default that of [light].
    """
    if mode is None and section.light is None:
        return {}
    core = mode.core if mode else section.light.part  # type: ignore[union-attr]  # one of both is there
    heaters = [name for name in section.heated if name != core]
    if not heaters:
        return {}
    if core not in section.heated:
        note(f"no data sheet of heaters: the light is read beside the heat of {core!r}; give that part heated = true")
        return {}
    if mode is None:
        with working("solving the light"):
            mode = th.light(section).mode()
    lit = replace(section, light=Guide(mode.wavelength, core, polarisation=mode.name[:2]))
    model, _ = racetrack_model(lit, LEAST_TOLERANCE, heaters, [*heaters, LIGHT])
    sheets = {}
    for column, name in enumerate(heaters):
        to_light = float(model.gain[-1, column])
        self_heating = float(model.gain[column, column])
        sheets[name] = heater_sheet(section, mode, name, to_light, self_heating)
    return say_each(section, sheets)
