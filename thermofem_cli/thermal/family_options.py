"""Options on families: parameters of --fix, --spread, --optics; quantities of --period, --swing, --range, --map.

A quantity is a function of a thermal model and, where the optics depend on the geometry, of changes of optical numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

import coupled
import surrogate
from coupled import RingResonator
from coupled.ring_family import MovingRing, ring_at
from coupled.thermal import check_geometry
from coupled.unknowns import number_of, optical_names, varied
from surrogate import Optics
from surrogate.family import Family
from thermofem import checks
from thermofem.data import quantity
from thermofem.errors import InputError

from ..command_files import note_ring, ring_of
from ..console import note, written
from ..drive_texts import assigned
from ..options import REFERENCE_RING

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


def ring_for(family: Family, given: str) -> RingResonator:
    """The ring of --ring; without it that of the family's own geometry where this has [light] and [[bus]]."""
    own = family.optics
    if given == REFERENCE_RING and own is not None and {"loss", "kappa 0"} <= {*own.names}:
        found = ring_at(family, family.box.nominal)
        note(f"the ring is computed from the geometry: {found.name}; carriers of {given}")
        return found
    found = ring_of(given)
    note_ring(found, given)
    check_geometry(found, family)
    return found


def optics_of(family: Family, given: Sequence[str] | None, ring: RingResonator) -> Optics | MovingRing | None:
    """How the ring follows the geometry: --optics 'bus_rate/width=-1e17', or what the family knows of its light.

    Slopes are d(optical number)/d(parameter) in SI; 'detuning' is a number, too.
    """
    if not given and family.optics is not None:
        moving = MovingRing(family, ring)
        at = ", ".join(f"{name} = {written(value, units_of(family)[name])}" for name, value in moving.at.items())
        buses = "" if "kappa 0" in family.optics.names else "; no [[bus]]: kappa^2 stands still"
        note(f"the optics move with the geometry, from the ring as it is at {at}{buses}")
        return moving
    if not given:
        note(
            "the optics stand still, this is the thermal part alone; [light] and [[bus]] in the geometry of the "
            "family, or --optics, move them"
        )
        return None
    slopes: dict[str, dict[str, float]] = {}
    known = {*optical_names(ring), "detuning"}
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


@dataclass(frozen=True)
class Settled:
    """Period (s) or swing (K) of the settled cycle of a ring at one power (W) and detuning (Hz)."""

    name: str
    ring: RingResonator
    power: float
    detuning: float

    @property
    def __name__(self) -> str:
        """Name of the quantity."""
        return f"settled_{self.name}"

    def __call__(self, model: Any, changes: Change | None = None) -> float:
        """That of one member."""
        moved, shift = _changed(self.ring, changes)
        found = coupled.limit_cycle(moved, model, power=self.power, detuning=self.detuning + shift)
        return float(found.attrs[self.name])


@dataclass(frozen=True)
class PulsingRange:
    """Range of detunings in Hz over which no state is stable, at one power (W)."""

    ring: RingResonator
    power: float
    __name__ = "range_of_pulsing"

    def __call__(self, model: Any, changes: Change | None = None) -> float:
        """That of one member."""
        moved, _ = _changed(self.ring, changes)
        detunings = np.linspace(*DETUNINGS)
        found = coupled.stability_map(moved, model, [self.power, 1.001 * self.power], detunings)
        growth = found.growth_rate.values[0]
        low, high = growth[:-1], growth[1:]
        share = np.clip(np.maximum(low, high) / np.maximum(np.abs(high - low), 1e-300), 0.0, 1.0)
        return float(share.sum() * np.diff(detunings)[0])


@dataclass(frozen=True, eq=False)
class Pulsing:
    """Where no state is stable, Boolean over power (W) and detuning (Hz)."""

    ring: RingResonator
    powers: Any
    detunings: Any
    __name__ = "pulses"

    def __call__(self, model: Any, changes: Change | None = None) -> Any:
        """The map of one member."""
        moved, shift = _changed(self.ring, changes)
        found = coupled.stability_map(moved, model, self.powers, self.detunings + shift).regime == "self-pulsing"
        return found.assign_coords(detuning=self.detunings)


def _changed(ring: RingResonator, changes: Change | None) -> tuple[RingResonator, float]:
    """The ring with changed numbers, and the change of the detuning in Hz."""
    if not changes:
        return ring, 0.0
    rest = {name: change for name, change in changes.items() if name != "detuning"}
    moved = varied(ring, {name: number_of(ring, name) + change for name, change in rest.items()})
    return moved, changes.get("detuning", 0.0)
