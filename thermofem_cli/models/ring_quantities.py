"""Quantities of self-pulsing that --period, --swing, --range and --map ask of the members of a family.

Each is a function of a thermal model and, where the optics depend on the geometry, of changes of optical numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from thermofem.data import quantity

from ..command_files import note_ring, ring_of
from ..drive_texts import detuning_of

if TYPE_CHECKING:
    from coupled import RingResonator

Change = Mapping[str, float]

DETUNINGS = -60e9, 100e9, 161  # first and last in Hz, and number, over which the range of self-pulsing is looked for


def cycle_property(name: str, family: Any, ring: str, power: str, detuning: str) -> Callable[..., float]:
    """Period (s) or swing (K) of the settled cycle."""
    import coupled

    resonator, watts, hertz = _drive(family, ring, power, detuning)

    def of_cycle(model: Any, changes: Change | None = None) -> float:
        moved, shift = _changed(resonator, changes)
        return float(coupled.limit_cycle(moved, model, power=watts, detuning=hertz + shift).attrs[name])

    of_cycle.__name__ = f"settled_{name}"
    return of_cycle


def pulsing_range(family: Any, ring: str, power: str, detuning: str) -> Callable[..., float]:
    """Range of detunings in Hz over which no state is stable, at one power."""
    import numpy as np

    import coupled

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
    import coupled
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
