"""Units of columns: what the unit in a header measures, and its scale in SI.

    value = offset + factor * number,        of decibels    value = reference * 10^(number/10)

so that "degC" gives K, "nm" gives m, "dBm" gives W and "dB" a ratio of powers.
"""

import math
import re
from functools import lru_cache
from typing import NamedTuple

from ..arrays import Array
from .quantity import registry

TIME = "second"
TEMPERATURE = "kelvin"
LENGTH = "meter"
FREQUENCY = "1 / second"
RATIO = "dimensionless"
VOLTAGE = "kilogram * meter ** 2 / ampere / second ** 3"
POWER = "kilogram * meter ** 2 / second ** 3"
IMPEDANCE = "kelvin * second ** 3 / kilogram / meter ** 2"  # thermal, K/W

DECIBELS = {"db": (RATIO, 1.0), "dbm": (POWER, 1e-3), "dbw": (POWER, 1.0)}  # what they measure, and 0 dB of it in SI
SPELLED = {"C": "degC", "deg C": "degC", "S": "s", "C/W": "K/W", "degC/W": "K/W"}
_SIGNS = str.maketrans({"℃": "degC", "°": "deg", "µ": "u", "μ": "u", "Ω": "ohm", "\u2126": "ohm"})
_SYMBOL = r"(?:[A-Za-z]+|%)"
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_UNIT = re.compile(rf"({_NUMBER})?\s*({_SYMBOL}(?:\s*[*/]\s*{_SYMBOL}){{0,3}})", re.ASCII)
LONGEST_UNIT = 40  # characters


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
    unit = text.strip().translate(_SIGNS)
    if unit.lower() in DECIBELS:  # instruments write "DBM", too; to pint "db" is a tenth of a barn
        dimensions, reference = DECIBELS[unit.lower()]
        return Scale(dimensions, 0.0, reference, decibels=True)
    match = _UNIT.fullmatch(SPELLED.get(unit, unit)) if len(unit) <= LONGEST_UNIT else None
    if match is None:
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
