"""Options on families: parameters of --fix, --spread, --optics; quantities of --period, --swing, --range, --map.

A quantity is a function of a thermal model and, where the optics depend on the geometry, of changes of optical numbers.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

import coupled
import surrogate
from coupled import RingResonator
from surrogate import Optics
from surrogate.family import Family
from thermofem import checks
from thermofem.data import quantity
from thermofem.errors import InputError

from ..command_files import note_ring, ring_of
from ..drive_texts import assigned, detuning_of

Change = Mapping[str, float]

DETUNINGS = -60e9, 100e9, 161  # first and last in Hz, and number, over which the range of self-pulsing is looked for


def units_of(family: Family) -> dict[str, str]:
    """SI unit of every parameter."""
    return dict(zip(family.names, family.box.units, strict=True))


def fixed_of(family: Family, given: list[str] | None) -> dict[str, float]:
    """Parameters of --fix 'radius=7 um', in SI."""
    texts = _of_parameters(family, "--fix", given, "radius=7 um")
    return {name: quantity.parse(text, unit, name=f"--fix {name}") for name, (unit, text) in texts.items()}


def spreads_of(family: Family, given: list[str]) -> dict[str, Any]:
    """Normal distributions of --spread 'width=450 nm,5 nm'."""
    spreads = {}
    for name, (unit, text) in _of_parameters(family, "--spread", given, "width=450 nm,5 nm").items():
        mean, _, width = (part.strip() for part in text.partition(","))
        if not width:
            raise InputError(f"--spread '{name}={text}' needs a mean and a standard deviation: 'width=450 nm,5 nm'")
        centre = quantity.parse(mean, unit, name=f"--spread {name}")
        spreads[name] = stats.norm(centre, quantity.positive(width, unit, name=f"--spread {name}"))
    return spreads


def optics_of(family: Family, given: Sequence[str] | None, ring: str) -> Optics | None:
    """Slopes d(optical number)/d(parameter) in SI of --optics 'bus_rate/width=-1e17'; 'detuning' is a number, too."""
    from coupled.unknowns import optical_names

    if not given:
        return None
    slopes: dict[str, dict[str, float]] = {}
    known = {*optical_names(ring_of(ring)), "detuning"}
    for left, value in assigned("--optics", given, "bus_rate/width=-1e17").items():
        number, stroke, parameter = left.partition("/")
        if not stroke:
            raise InputError(f"--optics '{left}={value}' is not of the form NUMBER/PARAMETER=SLOPE")
        slope = quantity.parse(value, "", name=f"--optics {left}")
        slopes.setdefault(checks.choice("--optics: number", number, known), {})[parameter] = slope
    found = surrogate.Optics(slopes)
    found.check(family)
    return found


def _of_parameters(family: Family, option: str, given: list[str] | None, example: str) -> dict[str, tuple[str, str]]:
    """Unit and text of every parameter of a repeatable option 'PARAMETER=VALUE'."""
    units = units_of(family)
    texts = assigned(option, given or [], example)
    return {checks.choice(f"{option}: parameter", name, units): (units[name], text) for name, text in texts.items()}


def cycle_property(name: str, family: Any, ring: str, power: str, detuning: str) -> Callable[..., float]:
    """Period (s) or swing (K) of the settled cycle."""
    resonator, watts, hertz = _drive(family, ring, power, detuning)

    def of_cycle(model: Any, changes: Change | None = None) -> float:
        moved, shift = _changed(resonator, changes)
        return float(coupled.limit_cycle(moved, model, power=watts, detuning=hertz + shift).attrs[name])

    of_cycle.__name__ = f"settled_{name}"
    return of_cycle


def pulsing_range(family: Any, ring: str, power: str, detuning: str) -> Callable[..., float]:
    """Range of detunings in Hz over which no state is stable, at one power."""
    resonator, watts, _ = _drive(family, ring, power, detuning)
    detunings = np.linspace(*DETUNINGS)

    def range_of_pulsing(model: Any, changes: Change | None = None) -> float:
        moved, _ = _changed(resonator, changes)
        growth = coupled.stability_map(moved, model, [watts, 1.001 * watts], detunings).growth_rate.values[0]
        low, high = growth[:-1], growth[1:]
        share = np.clip(np.maximum(low, high) / np.maximum(np.abs(high - low), 1e-300), 0.0, 1.0)
        return float(share.sum() * np.diff(detunings)[0])

    return range_of_pulsing


def pulsing_points(family: Any, ring: str, powers: Any, detunings: Any) -> Callable[..., Any]:
    """Where no state is stable, Boolean over power and detuning."""
    from coupled.contradictions import check_geometry

    resonator = ring_of(ring)
    note_ring(resonator, ring)
    check_geometry(resonator, family)

    def pulses(model: Any, changes: Change | None = None) -> Any:
        moved, shift = _changed(resonator, changes)
        found = coupled.stability_map(moved, model, powers, detunings + shift).regime == "self-pulsing"
        return found.assign_coords(detuning=detunings)

    return pulses


def _drive(family: Any, ring: str, power: str, detuning: str) -> tuple[RingResonator, float, float]:
    from coupled.contradictions import check_geometry

    resonator = ring_of(ring)
    note_ring(resonator, ring)
    check_geometry(resonator, family)
    watts = quantity.parse(power, "W", name="--power")
    return resonator, watts, detuning_of(detuning, resonator)


def _changed(ring: RingResonator, changes: Change | None) -> tuple[RingResonator, float]:
    """The ring with changed numbers, and the change of the detuning in Hz."""
    from coupled.unknowns import number_of, varied

    if not changes:
        return ring, 0.0
    rest = {name: change for name, change in changes.items() if name != "detuning"}
    moved = varied(ring, {name: number_of(ring, name) + change for name, change in rest.items()})
    return moved, changes.get("detuning", 0.0)
