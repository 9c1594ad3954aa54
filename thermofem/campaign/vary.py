"""The varied quantities of a campaign and its drives: `Variation` and `Drive`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..checks import InputError, check_name
from ..data import quantity
from ..data.variables import known

LARGEST = 1_000_000  # geometries of one campaign
MOST = 300  # drives, and varied quantities: each drive takes some 20 ms and a group in the file of every geometry
# variables and dimensions of the index and the training collection, beside those of the drives
_INDEX = """case key status reason probe thermal_resistance unknowns discretization_error domain_error feature features
feature_unit"""
# variables and dimensions of one result; a drive is a group beside them
_RESULT = ("time", "power", "delta_T", "probe", "field", "field_time", "vertex", "triangle", "triangles", "corner", "r")

Value = float | str


@dataclass(frozen=True)
class Variation:
    """One varied quantity: listed values, or a range from which a Latin hypercube draws.

    Parameters
    ----------
    name : str
        its name in the index.
    paths : tuple of str
        where the geometry takes it: "part.core.width", "layer.box.thickness", "material.SiO2.conductivity",
        "interface.core.resistance", "boundary.top.convection", "outer_radius"; several take the same value.
    unit : str
        SI unit of the values.
    values : tuple
        numbers in SI, or words (a material); crossed with the values of every other listed variation.
    low, high : float
        ends of the range to draw from, where there are no values.
    logarithmic : bool
        draw evenly in the logarithm.
    """

    name: str
    paths: tuple[str, ...]
    unit: str = ""
    values: tuple[Value, ...] = ()
    low: float = math.nan
    high: float = math.nan
    logarithmic: bool = False

    def __post_init__(self) -> None:
        checks.plain(self)
        check_name("vary:", self.name)
        for field, kinds in (("paths", (str,)), ("values", (str, int, float))):
            given = checks.instances(f"vary {self.name!r}: {field}", getattr(self, field), *kinds)
            object.__setattr__(self, field, given)
        checks.choice(f"vary {self.name!r}: unit", self.unit, quantity.SI, hint="it is in SI")
        if not self.paths:
            raise InputError(f"vary {self.name!r} needs at least one path, e.g. 'part.core.width'")
        if self.values:
            return
        low, high = checks.finite(f"{self.name}: from", self.low), checks.finite(f"{self.name}: to", self.high)
        if not low < high:
            raise InputError(f"{self.name}: from = {low:g} must be below to = {high:g}")
        if self.logarithmic and low <= 0:
            raise InputError(f"{self.name}: from = {low:g} must be positive where the spacing is logarithmic")

    def at(self, share: float) -> float:
        """The value at ``share`` (0 to 1) of the range."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))

    def text(self, value: Value) -> str:
        """A value as the geometry file writes it."""
        return value if isinstance(value, str) else quantity.write(value, self.unit)


def check_number(what: str, count: int) -> None:
    """InputError where there are more drives or varied quantities than `MOST`."""
    if count > MOST:
        raise InputError(f"[[{what}]]: {count} tables are more than {MOST}; share them out between several campaigns")


def check_taken(variations: tuple[Variation, ...], drives: tuple[Drive, ...]) -> None:
    """InputError where a varied quantity has the name of something else in the index, before anything is computed."""
    taken = {f"{kind}_{d.name}": d.name for d in drives for kind in ("time", "power", "delta_T")}
    for variation in variations:
        if variation.name in _INDEX.split():
            raise InputError(f"vary: name = {variation.name!r} is taken by the index; choose another one")
        if variation.name in taken:
            of = taken[variation.name]
            raise InputError(f"vary: name = {variation.name!r} is taken by the drive {of!r}; choose another one")
        if (own := known(variation.name)) and variation.unit != own.unit:
            raise InputError(
                f"vary: name = {variation.name!r} is that of the {own.long_name} ({own.unit}) in files; choose another"
            )


@dataclass(frozen=True)
class Drive:
    """One drive of every geometry: a waveform with the times to keep, or one period of its periodic state.

    Parameters
    ----------
    name : str
    wave : Waveform
    times : tuple of float, s
        empty for the periodic state.
    samples : int
        of the periodic state.
    """

    name: str
    wave: Any
    times: tuple[float, ...] = ()
    samples: int = 301

    def __post_init__(self) -> None:
        checks.plain(self)
        if not check_name("drive", self.name).isidentifier():
            raise InputError(f"drive name = {self.name!r} is not usable; take letters, digits and _")
        if self.name in _RESULT:
            raise InputError(f"drive name = {self.name!r} is taken by the results; choose another one")
        self.kept  # noqa: B018  an impossible sampling raises here, not in a thousand workers

    @property
    def kept(self) -> np.ndarray:
        """The times in the result, s."""
        if self.times:
            return checks.array(f"drive {self.name!r}: times", self.times, increasing=True)
        return waveforms.period_times(self.wave, self.samples)
