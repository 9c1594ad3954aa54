"""The varied quantities of a campaign and its drives."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .. import checks, waveforms
from ..arrays import Array
from ..data import quantity
from ..errors import InputError

# names of variables and dimensions of one result; each drive is a group beside them
RESULT = ("time", "power", "delta_T", "probe", "field", "field_time", "vertex", "triangle", "triangles", "corner", "r")

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
        checks.check_name("vary:", self.name)
        checks.choice(f"vary {self.name!r}: unit", self.unit, quantity.SI, hint="it is in SI")
        if not self.paths:
            raise InputError(f"vary {self.name!r} needs at least one path", "e.g. 'part.core.width'")
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
    wave: waveforms.Waveform
    times: tuple[float, ...] = ()
    samples: int = 301

    def __post_init__(self) -> None:
        if not checks.check_name("drive", self.name).isidentifier() or self.name in RESULT:
            raise InputError(
                f"drive name = {self.name!r} is not usable", f"take letters, digits and _, not {RESULT[0]}"
            )
        self.kept  # noqa: B018  an impossible sampling raises here, not in a thousand workers

    @property
    def kept(self) -> Array:
        """The times in the result, s."""
        if self.times:
            return checks.array(f"drive {self.name!r}: times", self.times, increasing=True)
        return waveforms.period_times(self.wave, self.samples)
