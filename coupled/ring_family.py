"""Rings for the members of a geometry family: optical parameters from polynomials, heat from the member's model.

    ring of a member = `ring_from` of its geometry, within `family.optics.error`

A given ring is scaled with the geometry: parameter(p) = parameter(p_0) computed(p)/computed(p_0). Quantities of
`surrogate.uncertainty` and `surrogate.design`: `SettledPeriod` and `PulsingMap`, of a thermal model and the changes of
optical numbers that `MovingRing` gives.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import xarray as xr

from thermofem import InputError, checks
from thermofem.arrays import Array
from thermofem.geometry.section_parts import LIGHT
from thermofem.optics.coupler import MOST_COUPLING
from thermofem.ring_temperature import GuidedMode

from .cycles.limit_cycle import limit_cycle
from .maps.stability_map import stability_map
from .resonator import RingResonator
from .ring_from import base_of, fields_of
from .unknowns import number_of, varied

STILL = {"loss": 1.0, "kappa 0": 1e-2}  # loss and kappa^2 where the geometry does not give them: they are constant


def ring_at(
    family: Any,
    values: Mapping[str, float],
    base: RingResonator | None = None,
    *,
    loss: float | None = None,
    coupling: float | None = None,
    order: int | None = None,
) -> RingResonator:
    """Return the ring of one member of a family that was trained on a geometry with [light].

    Parameters
    ----------
    family : surrogate.family.Family
    values : dict from parameter to float, SI
    base : RingResonator
        parameters that do not follow from the geometry; default as in `ring_from`.
    loss, coupling : float, 1/m and 1
        power loss of the guide, and kappa^2 of two buses; default those of [light] and of the [[bus]] tables.
    order : int
        of the resonance; default that next to the wavelength.

    Raises
    ------
    InputError
        a family without [light], a value outside its box, no loss or no bus.
    """
    n = _numbers(family, values)
    n |= {} if loss is None else {"loss": checks.between("loss", loss, 0, 1e6, unit="1/m")}
    if coupling is not None:
        n |= dict.fromkeys(("kappa 0", "kappa 1"), checks.between("coupling", coupling, 1e-9, MOST_COUPLING))
    for name, key in (("loss", "loss"), ("coupling", "kappa 0")):
        if key not in n:
            raise InputError(f"{name} is missing; give it, or [light] with loss and [[bus]] in the geometry")
    material = family.box.base.material_of(family.box.base.light.part)
    fields: dict[str, Any] = fields_of(n, _order(n) if order is None else order)
    name = f"{family.box.campaign.name} at {family.box.words(family.box.row(values))}"
    made = replace(base_of(base, material, n["wavelength"]), name=name, rates=(), **fields)
    mode = GuidedMode(family.box.base.light.mode, n["wavelength"])
    return replace(made, scattering_rate=n["radiated"], read=LIGHT, mode=mode)


@dataclass(frozen=True, eq=False)
class MovingRing:
    """A ring that depends on the geometry of a family: ``optics`` of `surrogate.uncertainty` and `surrogate.design`.

    ring: at the values in the family's own geometry file, or in the middle of the box if one of them is outside.
    """

    family: Any
    ring: RingResonator

    def __post_init__(self) -> None:
        if self.ring.rates:
            rates = ", ".join(name for name, _ in self.ring.rates)
            raise InputError(
                f"ring {self.ring.name!r} follows {rates}, which no geometry moves", "replace(ring, rates=())"
            )
        self._start  # noqa: B018 - a family without optics raises here

    @cached_property
    def at(self) -> dict[str, float]:
        """Family parameters (SI, by name) at which the ring is the given one."""
        found: dict[str, float] = self.family.box.nominal
        return found

    @cached_property
    def _start(self) -> dict[str, float]:
        return self._numbers(self.at)

    def _numbers(self, values: Mapping[str, float]) -> dict[str, float]:
        return STILL | _numbers(self.family, values)

    def check(self, family: Any) -> None:
        """Raise InputError if ``family`` is not the family of this ring."""
        if family is not self.family:
            raise InputError("optics: they are those of another family")

    def changes(self, family: Any, values: Mapping[str, float]) -> dict[str, float]:
        """Difference of each ring parameter (SI, by name) at a member from the given ring; same resonance order."""
        order = _order(self._start)
        n = self._numbers(values)
        begin = fields_of(self._start, order)
        end = fields_of(n, order)
        ratios = {name: end[name] / value for name, value in begin.items() if value}
        ratios.setdefault("drop_rate", ratios["bus_rate"])
        if self.ring.index_confinement is None:  # the printed rules: the shift is in proportion to thermo_optic
            ratios["thermo_optic"] = n["thermo_optic"] / self._start["thermo_optic"]
        own = {name: getattr(self.ring, name) for name in ratios}
        found = {name: value * (ratios[name] - 1) for name, value in own.items() if value is not None}
        return found | {"scattering_rate": n["radiated"] - self._start["radiated"]}


@dataclass(frozen=True)
class SettledPeriod:
    """Settled period (s) of a ring at one power (W) and detuning (Hz), as a function of its thermal model."""

    ring: RingResonator
    power: float
    detuning: float = 0.0
    __name__ = "settled_period"

    def __call__(self, model: Any, changes: Mapping[str, float] | None = None) -> float:
        """The period in s for a thermal model and changes of optical numbers (SI, by name)."""
        ring, shift = _changed(self.ring, changes)
        cycle = limit_cycle(ring, model, power=self.power, detuning=self.detuning + shift)
        return float(cycle.attrs["period"])


@dataclass(frozen=True, eq=False)
class PulsingMap:
    """Map over power (W) and detuning (Hz), True where no fixed point is stable, as a function of the thermal model."""

    ring: RingResonator
    powers: Array
    detunings: Array
    __name__ = "pulses"

    def __call__(self, model: Any, changes: Mapping[str, float] | None = None) -> xr.DataArray:
        """The Boolean map for a thermal model and changes of optical numbers (SI, by name)."""
        ring, shift = _changed(self.ring, changes)
        regimes = stability_map(ring, model, self.powers, self.detunings + shift).regime
        return (regimes == "self-pulsing").assign_coords(detuning=self.detunings)


def _changed(ring: RingResonator, changes: Mapping[str, float] | None) -> tuple[RingResonator, float]:
    """The ring with changed optical numbers, and the change of the detuning in Hz."""
    shifts = dict(changes or {})
    detuning = shifts.pop("detuning", 0.0)
    if not shifts:
        return ring, detuning
    values = {name: number_of(ring, name) + shift for name, shift in shifts.items()}
    return varied(ring, values), detuning


def _order(n: Mapping[str, float]) -> int:
    return round(n["n_eff"] * 2 * math.pi * n["radius"] / n["wavelength"])


def _numbers(family: Any, values: Mapping[str, float]) -> dict[str, float]:
    """Optical parameters of a member of a family by name, from the polynomials of ``family.optics``."""
    if family.optics is None:
        raise InputError("the family has no optics", "train it on a geometry with [light], and [[bus]] tables")
    found: dict[str, float] = family.optics.at(family.box.share(family.box.row(values)))
    return found
