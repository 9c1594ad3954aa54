"""Columns of tables: what the unit in a header measures, its scale in SI, and what a column is read as.

    value = offset + factor * number,        of decibels    value = reference * 10^(number/10)

so that "degC" gives K, "nm" gives m, "dBm" gives W and "dB" a ratio of powers.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

from .. import checks
from ..arrays import Array
from .quantity import LONGEST_UNIT, registry

TIME = "second"
TEMPERATURE = "kelvin"
LENGTH = "meter"
RATIO = "dimensionless"
VOLTAGE = "kilogram * meter ** 2 / ampere / second ** 3"
POWER = "kilogram * meter ** 2 / second ** 3"
IMPEDANCE = "kelvin * second ** 3 / kilogram / meter ** 2"  # thermal, K/W

DECIBELS = {"db": (RATIO, 1.0), "dbm": (POWER, 1e-3), "dbw": (POWER, 1.0)}  # what they measure, and 0 dB of it in SI
LIGHT = {POWER: "W", VOLTAGE: "V", RATIO: "fraction"}  # what detectors measure, in SI; any other unit is arbitrary
SPELLED = {"C": "degC", "S": "s", "C/W": "K/W", "degC/W": "K/W"}
_SIGNS = str.maketrans({"℃": "degC", "°": "deg", "µ": "u", "μ": "u", "Ω": "ohm", "\u2126": "ohm"})
_SYMBOL = r"(?:[A-Za-z]+|%)"
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_UNIT = re.compile(rf"({_NUMBER})?\s*({_SYMBOL}(?:\s*[*/]\s*{_SYMBOL}){{0,3}})", re.ASCII)
# a name without a factor ("10^3 T", "T x 1000": its scale is open), and a unit; COMSOL writes a remark after a comma
_HEADER = re.compile(r"(?!.*(?:\d\s*x\b|\bx\s*\d))([^()\[\]*^×·]*)[(\[]([^()\[\]]+)[)\]]\s*(?:,.*)?")
_DECIBELS = re.compile(r"(?<![a-z])db[mw]?(?![a-z])", re.IGNORECASE)

MOST = 1e30  # of a number as the file writes it: beyond is the code of an overload, and 1e30 dBm overflows in W


class Scale(NamedTuple):
    """What a unit measures, as pint writes the dimensions of its SI unit, and how its numbers become SI."""

    dimensions: str
    offset: float
    factor: float
    decibels: bool = False

    def in_si(self, numbers: Array) -> Array:
        """Numbers of this unit in SI, the same shape."""
        if self.decibels:
            return self.factor * 10 ** (numbers / 10)
        return self.offset + self.factor * numbers


@lru_cache(maxsize=256)
def scale_of(text: str) -> Scale | None:
    """Scale of a unit as headers write it, also with a factor ("0.12 K"); None where it is no unit.

    >>> scale_of("µs"), scale_of("°C").offset, scale_of("core")
    (Scale(dimensions='second', offset=0.0, factor=1e-06, decibels=False), 273.15, None)
    """
    unit = text.strip().translate(_SIGNS).replace("deg C", "degC")
    if unit.lower() in DECIBELS:  # instruments write "DBM", too; to pint "db" is a tenth of a barn
        dimensions, reference = DECIBELS[unit.lower()]
        return Scale(dimensions, 0.0, reference, decibels=True)
    match = _UNIT.fullmatch(unit)
    if match is None or len(unit) > LONGEST_UNIT:
        return None
    symbols = SPELLED.get(match[2], match[2])
    scale = _parsed(symbols)  # as it stands: "Msec" is a megasecond, no millisecond
    is_word = len(symbols) > 2 and symbols.isalpha() and symbols.istitle()  # "Volt"
    if scale is None and is_word:
        scale = _parsed(symbols.lower())
    if scale is None:
        return None
    size = float(match[1] or 1)
    factor = float(f"{size * scale.factor:.15g}")
    return scale._replace(factor=factor) if math.isfinite(factor) else None


def _parsed(symbols: str) -> Scale | None:
    """Scale of a product of symbols that pint knows; None where it knows them not."""
    try:
        units = registry().parse_units(symbols)
        zero = registry().Quantity(0.0, units).to_base_units()
        one = registry().Quantity(1.0, units).to_base_units()
    except Exception:  # pint has several for a text that is no unit
        return None
    offset = float(zero.magnitude)
    return Scale(str(zero.units), offset, float(one.magnitude) - offset)


def name_and_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header ``name (unit)`` or ``name [unit]``; any other is a name without a unit but decibels.

    >>> name_and_unit("TIME (us)"), name_and_unit("V(core)"), name_and_unit("drop_dBm")
    (('TIME', 'us'), ('V(core)', ''), ('drop_dBm', 'dBm'))
    """
    match = _HEADER.fullmatch(header)
    if match and scale_of(match[2]):
        return match[1].strip(), match[2].strip()
    decibels = _DECIBELS.search(header)  # such a name has no unit in brackets, and is no linear scale
    return header.strip(), decibels[0] if decibels else ""


class Role(NamedTuple):
    """What a column is read as.

    name: "time", "temperature", ...
    dimensions: that its unit may have.
    hint: how to state another unit.
    unit, names, longest: headers that may stand without a unit, which is then this one; the values of such a column
        span no more than ``longest``.
    """

    name: str
    dimensions: tuple[str, ...]
    hint: str
    unit: str = ""
    names: tuple[str, ...] = ()
    longest: float = math.inf


ASK_UNITS = 'give the units of both columns, such as --units "us,mV", or other --columns'
TIMES = Role("time", (TIME,), ASK_UNITS, "s", ("t", "time", "Time", "TIME", "Zeit"), 1.0)  # longer may be no seconds
READINGS = (TEMPERATURE, IMPEDANCE, VOLTAGE)
ASK_SENSITIVITY = f'{ASK_UNITS}, or --sensitivity, such as "75 pm/K"'
RISES = Role(
    "temperature", READINGS, ASK_SENSITIVITY, "K", ("T", "dT", "delta_T", "temperature", "Temperature", "rise")
)
POWERS = Role("power", (POWER,), ASK_UNITS)
WAVELENGTHS = Role("wavelength", (LENGTH,), 'give --units "nm,dBm"')


@dataclass(frozen=True, eq=False)
class Column:
    """One column of numbers.

    number: in the file, from 1.
    header: the cell above it, "" where there is none.
    unit: that of the header or, instead, of the user; "" where neither states one.
    values [shape (rows,)]: as the file has them.
    """

    number: int
    header: str
    unit: str
    values: Array

    @property
    def name(self) -> str:
        """The header without its unit."""
        return name_and_unit(self.header)[0]

    @property
    def label(self) -> str:
        """The column as messages name it."""
        return f"column {self.header!r}" if self.header else f"column {self.number}"

    @property
    def scale(self) -> Scale | None:
        """What the column measures; None where it states no unit."""
        return scale_of(self.unit)

    def measures(self, role: Role) -> bool:
        """Whether its unit, or without one its header, says the role; volts may be anything."""
        if self.scale is None:
            return self.header in role.names
        return self.scale.dimensions in role.dimensions and self.scale.dimensions != VOLTAGE

    def in_si(self, role: Role) -> Array:
        """Values in SI.

        Raises InputError: no unit, or one that does not fit the role; numbers that are not finite.
        """
        scale = self.scale
        if scale is None or scale.dimensions not in role.dimensions:
            fault = f"is in {checks.shown(self.unit)}, no unit of its {role.name}" if self.unit else "states no unit"
            raise checks.InputError(f"{self.label} {fault}", role.hint)
        return scale.in_si(checks.numbers(self.label, self.values, most=MOST, hint="take such rows out"))

    def light_in_si(self) -> tuple[Array, str]:
        """Light in W, V or a fraction, and that unit; in another unit as the file has it.

        Raises InputError: a unit of time or temperature; numbers that are not finite.
        """
        scale = self.scale
        if scale and scale.dimensions in (TIME, TEMPERATURE, IMPEDANCE):
            raise checks.InputError(f"{self.label} is in {checks.shown(self.unit)}, no unit of light", ASK_UNITS)
        light = checks.numbers(self.label, self.values, most=MOST, hint="take such rows out")
        if scale is None or scale.dimensions not in LIGHT:
            return light, self.unit or "arbitrary"
        return scale.in_si(light), LIGHT[scale.dimensions]


def with_stated_units(columns: Mapping[str, Column], units: str | Mapping[str, str] | None) -> dict[str, Column]:
    """Columns by role in the units that the user states: "us,mV" in their order, or {"time": "us"}.

    Raises InputError: units of other columns.
    """
    stated = units or {}
    if isinstance(stated, str):
        texts = [text.strip() for text in stated.split(",")]
        if not 2 <= len(texts) <= len(columns):
            raise checks.InputError(f"--units = {checks.shown(units)} must be two units", 'such as "us,mV"')
        stated = dict(zip(columns, texts, strict=False))
    for role in stated:
        checks.choice("units", role, columns)
    return {role: replace(column, unit=stated.get(role) or column.unit) for role, column in columns.items()}
